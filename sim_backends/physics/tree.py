"""A structure cut into a tree of bodies: what hangs on what by which crease, from the clamp outwards.

Every cell is a closed loop. It is cut through the panel opposite to the one it hangs on: half of that panel
goes with either side, and the two halves are held together. So all four creases of a cell stay joints, each
with its own spring and friction.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from ori_deploy.layout import Layout
from ori_deploy.motion import NEXT_CREASE


@dataclass(frozen=True)
class Hang:
    """A body on its crease.

    Attributes
    ----------
    cell, crease
        The crease, in the order of `CREASES`.
    above, panel
        Panel that it hangs on, and panel that it carries.
    sense
        -1 where the panel turns clockwise about the crease's direction while the inner angle grows, else 1.
    half
        Whether it carries the second half of a cut panel.
    """

    cell: int
    crease: int
    above: int
    panel: int
    sense: int
    half: bool = False


def hangs_from(layout: Layout, clamp: int) -> tuple[Hang, ...]:
    """All creases, each after the one its upper panel hangs on.

    Parameters
    ----------
    clamp
        Number of the panel that is held; what is bonded to it is held, too.
    """
    hangs: list[Hang] = []
    waiting, placed = deque([clamp]), {clamp // 4}
    bonded = int(layout.bonded_to[clamp])
    if bonded >= 0:
        waiting.append(bonded)
        placed.add(bonded // 4)
    while waiting:
        entry = waiting.popleft()
        cell, k = divmod(entry, 4)
        ring = [4 * cell + (k + i) % 4 for i in range(4)]
        crease = [NEXT_CREASE[(k + i) % 4] for i in range(4)]  # between ring[i] and ring[i + 1]
        hangs += [
            Hang(cell, crease[0], ring[0], ring[1], -1),
            Hang(cell, crease[1], ring[1], ring[2], -1),
            Hang(cell, crease[3], ring[0], ring[3], 1),
            Hang(cell, crease[2], ring[3], ring[2], 1, half=True),
        ]
        for panel in ring:
            other = int(layout.bonded_to[panel])
            if other >= 0 and other // 4 not in placed:
                placed.add(other // 4)
                waiting.append(other)
    return tuple(hangs)
