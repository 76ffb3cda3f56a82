"""A structure as a tree of panels, its loops cut: what simulators of rigid bodies want.

Every cell is a closed loop of four panels. It is cut at one of the two creases that its entry panel, the one it hangs
on, does not touch; at which of them is chosen so that no driven crease is cut. Bonded panels are fixed to each other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ori_deploy.layout import Layout
from ori_deploy.motion import NEXT_CREASE


@dataclass(frozen=True)
class Hang:
    """A panel on the one above it.

    Attributes
    ----------
    above, panel
        Panel numbers.
    cell, crease
        The crease it turns about, in the order of `CREASES`; -1 both where the two are bonded.
    sense
        -1 where the panel turns clockwise about the crease's direction while the inner angle grows, else 1.
    """

    above: int
    panel: int
    cell: int = -1
    crease: int = -1
    sense: int = 1

    @property
    def bonded(self) -> bool:
        """Whether it does not turn."""
        return self.crease < 0


@dataclass(frozen=True)
class Loop:
    """A crease that is cut, and the two panels that have to keep meeting there."""

    cell: int
    crease: int
    panels: tuple[int, int]


@dataclass(frozen=True)
class Tree:
    """All panels but the first, each after the one it hangs on, and one cut per cell."""

    hangs: tuple[Hang, ...]
    loops: tuple[Loop, ...]

    def below(self, panel: int) -> tuple[Hang, ...]:
        """What hangs on a panel."""
        return tuple(hang for hang in self.hangs if hang.above == panel)

    @property
    def joints(self) -> tuple[Hang, ...]:
        """What turns."""
        return tuple(hang for hang in self.hangs if not hang.bonded)


def tree_of(layout: Layout, driven: Sequence[int] | None = None) -> Tree:
    """The tree from panel 0 outwards, and its cuts.

    Parameters
    ----------
    driven
        (n_cells,) crease of each cell that is not to be cut, in the order of `CREASES`.
    """
    hangs: list[Hang] = []
    loops: list[Loop] = []
    waiting, placed = deque([0]), {0}
    while waiting:
        entry = waiting.popleft()
        cell, k = divmod(entry, 4)
        ring = [4 * cell + (k + i) % 4 for i in range(4)]
        crease = [NEXT_CREASE[(k + i) % 4] for i in range(4)]  # between ring[i] and ring[i + 1]
        hangs += [Hang(ring[0], ring[1], cell, crease[0], -1), Hang(ring[0], ring[3], cell, crease[3])]
        if driven is not None and driven[cell] == crease[2]:
            hangs.append(Hang(ring[3], ring[2], cell, crease[2]))
            loops.append(Loop(cell, crease[1], (ring[1], ring[2])))
        else:
            hangs.append(Hang(ring[1], ring[2], cell, crease[1], -1))
            loops.append(Loop(cell, crease[2], (ring[2], ring[3])))
        for panel in ring:
            other = int(layout.bonded_to[panel])
            if other >= 0 and other // 4 not in placed:
                placed.add(other // 4)
                hangs.append(Hang(panel, other))
                waiting.append(other)
    return Tree(tuple(hangs), tuple(loops))
