"""The reply to a fast sync read: one packet to which every servo adds its block.

Source: e-manual, Protocol 2.0, "Fast Sync Read". After the header, the broadcast id, a length and 0x55 come
blocks of error, id, data and CRC; each CRC is that of everything before it, so that it carries on from the
one before. A block is therefore checked as the step from one CRC to the next, and a spoilt block does not
spoil those after it. Nothing is stuffed: the first servo announces the length for all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

HEADER_BYTES = 8
BLOCK_OVERHEAD = 4

Crc = Callable[[int, Sequence[int], int], int]


def split_fast_reply(raw: bytes, size: int, ids: Sequence[int], crc: Crc) -> dict[int, tuple[int, bytes]]:
    """Error byte and data of every block that can be believed, by id.

    Parameters
    ----------
    raw
        From the header on; may end early, or hold bytes that were spoilt.
    size
        Data bytes of a block.
    ids
        Who was asked, in the order of their blocks.
    crc
        `crc(start, data, length)`: CRC-16 of data, carried on from `start`.
    """
    believed: dict[int, tuple[int, bytes]] = {}
    length = 1 + (size + BLOCK_OVERHEAD) * len(ids)
    # What the header has to be is known, so a spoilt one does no harm.
    header = bytes((0xFF, 0xFF, 0xFD, 0x00, 0xFE, length & 0xFF, length >> 8, 0x55))
    states = {crc(0, header, HEADER_BYTES)}
    for k, servo_id in enumerate(ids):
        at = HEADER_BYTES + k * (size + BLOCK_OVERHEAD)
        block = raw[at : at + size + BLOCK_OVERHEAD]
        if len(block) < size + BLOCK_OVERHEAD:
            break
        body, told = block[:-2], block[-2] | block[-1] << 8
        computed = {crc(state, body, len(body)) for state in states}
        if told in computed:
            if body[1] == servo_id:
                believed[servo_id] = (body[0], bytes(body[2:]))
            computed = {told}
        # After a spoilt block either its data or its CRC was hit: the next block has to follow from one. What
        # a servo sent as its CRC is what the next one counted on from, not what arrived.
        states = {crc(state, state.to_bytes(2, "little"), 2) for state in computed | {told}}
    return believed
