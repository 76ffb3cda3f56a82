"""Frames that say anything: nothing escapes, and nothing moves."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

import numpy as np
import pytest

from ori_deploy.deploy.states import State
from ori_deploy.mav.commands import ALIAS, COMMANDS
from ori_deploy.wire.vehicle import Message, Reader, Writer, dialect
from ori_deploy.wire.vehicle import Party as Sender
from tests.mav.world import US, World, command, world

KINDS = sorted(dialect.mavlink_map)
SPECIAL = (0.0, 1.0, 2.0, 3.0, 4.0, 21196.0, -1.0, math.nan, math.inf, -math.inf, 1e30)
STATIONS = (255, 7, 1)


def frames(count: int, seed: int) -> Iterator[tuple[bytes, Message]]:
    """Good frames of any message with any values, most of them addressed to the structure; none that is an order."""
    dice = random.Random(seed)
    writers = [Writer(Sender(system, part)) for system in STATIONS for part in (1, 190)]
    wanted = [
        dialect.MAVLINK_MSG_ID_COMMAND_LONG,
        dialect.MAVLINK_MSG_ID_COMMAND_INT,
        dialect.MAVLINK_MSG_ID_COMMAND_CANCEL,
        dialect.MAVLINK_MSG_ID_PARAM_SET,
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    ]
    for _ in range(count):
        number = dice.choice(wanted) if dice.random() < 0.6 else dice.choice(KINDS)
        message = scrambled(number, dice)
        yield dice.choice(writers).pack(message), message


def scrambled(number: int, dice: random.Random) -> Message:
    """A message whose fields say anything that fits into them."""
    kind = dialect.mavlink_map[number]
    raw = kind.unpacker.unpack(bytes(dice.getrandbits(8) for _ in range(kind.unpacker.size)))
    payload = bytearray(kind.unpacker.pack(*raw))
    message = dialect.MAVLink(None).decode(bytearray(Writer(Sender(9, 9)).pack(_of(kind, payload))))
    if dice.random() < 0.9 and hasattr(message, "target_system"):
        message.target_system, message.target_component = dice.choice((US, (US[0], 0)))
    if number in (dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT):
        message.command = dice.choice((*COMMANDS, ALIAS, 512, 3001, 400, message.command))
        message.param1, message.param2 = dice.choice(SPECIAL), dice.choice(SPECIAL)
        if message.command in (*COMMANDS, ALIAS):
            message.param1 = dice.choice((5.5, -2.0, math.inf, 9.0))  # else it is an order, and may be obeyed
    if number == dialect.MAVLINK_MSG_ID_PARAM_SET and dice.random() < 0.7:
        names = (b"ORI_SPEED", b"ORI_DEPLOY_WHEN", b"ORI_TLM_HZ", b"ORI_NAMED_VAL")
        message.param_id, message.param_value = dice.choice(names), dice.choice(SPECIAL)
    return message


def _of(kind: type[Message], payload: bytearray) -> Message:
    """A message of a kind from its bytes on the wire."""
    values = kind.unpacker.unpack(payload)
    fields, at = [], 0
    for length in kind.lengths:
        is_text = isinstance(values[at], bytes)
        fields.append(values[at] if length == 1 or is_text else list(values[at : at + length]))
        at += 1 if is_text else length
    ordered = [fields[kind.orders[i]] for i in range(len(kind.fieldnames))]
    return kind(*ordered)


def drive(w: World, count: int, seed: int) -> Reader:
    """Frames through a reader into the component, with the loop going on."""
    reader = Reader()
    for index, (frame, _) in enumerate(frames(count, seed)):
        for message in reader.feed(frame):
            w.hear(message, (message.get_srcSystem(), message.get_srcComponent()), "somebody")
        if index % 100 == 0:
            w.cycle()
            w.sent.clear()
    w.run(0.3)
    return reader


@pytest.mark.parametrize(("count", "seed"), [(3_000, 1), pytest.param(100_000, 2, marks=pytest.mark.slow)])
def test_frames_that_are_no_order_move_nothing_and_raise_nothing(count: int, seed: int) -> None:
    w = world(force_allowed=True, deploy_when="always")
    w.run(0.1)
    w.hear(command(dialect.ORI_CMD_DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)
    goal = w.record.commanded_rad.copy()
    begun = len(w.bench.records)
    reader = drive(w, count, seed)
    assert reader.counts.frames == count
    assert w.state is State.DEPLOYED
    assert all(np.array_equal(record.commanded_rad, goal) for record in w.bench.records[begun:])
