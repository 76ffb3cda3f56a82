"""Layouts with spars: which chains of inner edges can stand upright in a profile, and where to begin.

All vertices inside are closing and their neighbours opening, so an upright chain from skin to skin is
either one inner edge, between an opening and a closing vertex of the outline, or two, through an inner
vertex. A straight line through an inner vertex needs two cells on each side of it, or the cell that has
it all would be at its dead centre.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise, permutations

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout, PlaneTree, folds_flat_with_some_slits, layout_of, layouts
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.starts import with_inner_vertices
from ori_deploy.search.wish import Spar, neighbours_in_turn

Chain = tuple[int, ...]

_MOST_CELLS = 9
"""Cells up to which the smallest sufficient number is looked for when there are too few."""


@dataclass(frozen=True)
class Sparred:
    """A layout with the chains that are to be its spars.

    Attributes
    ----------
    layout
        With slits that fold flat.
    chains
        One per spar, front to rear: vertex indices from the upper skin to the lower.
    tail
        The closing vertex that goes to the start of the outline (an airfoil's trailing edge), behind the last spar.
    """

    layout: Layout
    chains: tuple[Chain, ...]
    tail: int

    @property
    def pins(self) -> tuple[Spar, ...]:
        ids = [v.id for v in self.layout.vertices]
        return tuple(Spar(tuple(ids[i] for i in chain)) for chain in self.chains)


def locked_by_slits(tree: PlaneTree) -> bool:
    """Whether every cell touches an inner vertex, so that securing the slits locks all of them."""
    return all(min(cell[0], cell[2]) < tree.n_inner for cell in tree.cells)


def chains_of(layout: Layout) -> list[Chain]:
    """All chains of inner edges from skin to skin that can be straight."""
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    edges = {frozenset((int(t), int(h))) for t, h, n in zip(tail, head, layout.neighbour, strict=True) if n >= 0}
    inner = [v.inner for v in layout.vertices]
    chains: list[Chain] = sorted((min(e), max(e)) for e in edges if not any(inner[i] for i in e))
    for p in np.flatnonzero(inner):
        turn = neighbours_in_turn(layout, int(p))
        for i, j in combinations(range(len(turn)), 2):
            if min(j - i, len(turn) - (j - i)) >= 2:
                chains.append((turn[i], int(p), turn[j]))
    return chains


def _between(loop: list[int], a: int, b: int) -> list[int]:
    """Outline vertices strictly between two, counter-clockwise."""
    i, n = loop.index(a), len(loop)
    return [loop[(i + t) % n] for t in range(1, (loop.index(b) - i) % n)]


def sparred(layout: Layout, n_spars: int) -> Iterator[Sparred]:
    """Every way in which a layout can carry so many spars, one behind the other."""
    loop = list(layout.outline)
    for chosen in permutations(chains_of(layout), n_spars):
        if len({v for chain in chosen for v in chain}) < sum(len(chain) for chain in chosen):
            continue
        upright = _upright(loop, chosen)
        if upright is None:
            continue
        rear = upright[-1]
        for tail in _between(loop, rear[-1], rear[0]):
            if layout.vertices[tail].role == "closing":
                yield Sparred(layout, upright, tail)


def _upright(loop: list[int], chosen: tuple[Chain, ...]) -> tuple[Chain, ...] | None:
    """The chains turned upper end first, if they stand one behind the other as listed, front to rear."""
    rear = chosen[-1]
    for last in (rear, rear[::-1]):
        ahead = _between(loop, last[0], last[-1])  # from the rear spar over the nose back to it
        turned = []
        for chain in reversed(chosen[:-1]):
            if chain[0] not in ahead or chain[-1] not in ahead:
                break
            upper_first = ahead.index(chain[0]) < ahead.index(chain[-1])
            turned.append(chain if upper_first else chain[::-1])
            ahead = _between(loop, turned[-1][0], turned[-1][-1])
        else:
            return (*reversed(turned), last)
    return None


def sparred_layouts(n_cells: int, n_spars: int, *, locked: bool = True) -> Iterator[Sparred]:
    """Every layout of so many cells, mirror images apart, with every way to carry so many spars.

    Parameters
    ----------
    n_cells, n_spars
        How many.
    locked
        Only layouts whose every cell is locked by a slit.
    """
    for tree in layouts(n_cells, mirror_apart=True, allowable=folds_flat_with_some_slits):
        if locked and not (tree.n_inner and locked_by_slits(tree)):
            continue
        yield from sparred(layout_of(tree), n_spars)


def refuse_too_few_cells(n_cells: int, n_spars: int, *, locked: bool = True) -> LayoutError:
    """The error for a number of cells that cannot carry so many spars; says which number can."""
    enough = next(
        (k for k in range(n_cells + 1, _MOST_CELLS + 1) if next(sparred_layouts(k, n_spars, locked=locked), None)),
        None,
    )
    return LayoutError(
        f"no layout of {n_cells} cells carries {n_spars} straight spars"
        + (" with every cell locked by a slit" if locked else ""),
        value=f"{n_cells} cells",
        limit=f"at least {enough} cells" if enough else f"none up to {_MOST_CELLS} cells",
        remedy=f"--cells {enough}" if enough else "fewer spars, or locked = false",
    )


def spar_start(profile: Profile, wanted: Sparred, start: int, seed: int = 0) -> Embedding:
    """Where a search for a sparred structure begins: spars evenly along x, or drawn; skins evenly between them."""
    layout, n = wanted.layout, len(wanted.chains)
    generator = np.random.default_rng((seed, start))
    even = (np.arange(n) + 1.0) / (n + 1.5)
    shares = even if start == 0 else np.sort(generator.uniform(0.1, 0.8, n))
    left, right = float(profile.table_f.real.min()), float(profile.table_f.real.max())
    s = np.full(len(layout.vertices), np.nan)
    s[wanted.tail] = 0.0
    for chain, share in zip(wanted.chains, shares, strict=True):
        s[chain[0]], s[chain[-1]] = _skins(profile, left + share * (right - left))
    loop = list(layout.outline)
    ends = [c[0] for c in reversed(wanted.chains)] + [c[-1] for c in wanted.chains]
    anchors = [wanted.tail, *ends, wanted.tail]
    stops = [0.0, *(float(s[i]) for i in ends), profile.period]
    for (a, b), (from_s, to_s) in zip(pairwise(anchors), pairwise(stops), strict=True):
        inside = _between(loop, a, b)
        lengths = np.interp(
            (np.arange(len(inside)) + 1.0) / (len(inside) + 1.0),
            [0.0, 1.0],
            profile.arc_length([from_s, to_s - 1e-12]),
        )
        s[inside] = [profile.at_arc(float(length / profile.perimeter) % 1.0) for length in lengths]
    laid = with_inner_vertices(profile, layout, s)
    z = laid.z.copy()
    for chain in wanted.chains:
        if len(chain) == 3:
            z[chain[1]] = complex(0.5 * (z[chain[0]] + z[chain[2]]).real, z[chain[1]].imag)
    return Embedding(profile, layout, laid.s, z)


def _skins(profile: Profile, x: float) -> tuple[float, float]:
    """Parameters where the outline crosses a vertical line: highest and lowest, to the table's step."""
    f: Reals = profile.table_f.real
    crossing = np.flatnonzero((f - x) * (np.roll(f, -1) - x) <= 0.0)
    heights = profile.table_f.imag[crossing]
    return float(profile.table_s[crossing[heights.argmax()]]), float(profile.table_s[crossing[heights.argmin()]])
