"""What a structure measures, and how every measure changes with the vertices: exact derivatives.

The unknowns are the parameters of outline vertices, the places of inner ones, one number per cell,
the raise of its wall offset at crease c, and the wall. The construction of `design` runs on jets; only the
opening creases, found by a root search, get their derivatives from the implicit function theorem,
and the bulge of a curved panel from the envelope theorem: its place may be held fixed.

The rule of the construction (raise the offset of one side only, as (3) asks) has a kink where
neither side needs a raise, and the best structures sit just there. Here the raise is an unknown
with two bounds instead: not negative at c, nor at d. What is left is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import Cells, ConeCells
from ori_deploy.design.cells import faces_of
from ori_deploy.design.creases import Corners, crease_roots, rim_thicknesses
from ori_deploy.design.jet import Jet, select, stacked
from ori_deploy.design.structure import areas_of_panels
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE

Indices = NDArray[np.intp]

SLOTS = 8
"""A cell's own unknowns: two for a, one for c, two for b, one for d, the raise, and the wall all cells share."""


@dataclass(frozen=True)
class Unknowns:
    """Where a layout's unknowns stand in one vector: all of them lengths over the profile's size.

    Attributes
    ----------
    profile, layout
        What is laid out on what.
    """

    profile: Profile
    layout: Layout

    @cached_property
    def inner(self) -> NDArray[np.bool_]:
        return np.array([v.inner for v in self.layout.vertices])

    @cached_property
    def column(self) -> Indices:
        """(n_vertices, 2) columns of each vertex: (s, -1) on the outline, (x, y) inside."""
        first = np.cumsum(1 + self.inner) - (1 + self.inner)
        return np.stack([first, np.where(self.inner, first + 1, -1)], axis=1)

    @property
    def n_places(self) -> int:
        """Unknowns that place vertices; the cells' raises follow, then the wall."""
        return len(self.inner) + int(self.inner.sum())

    @property
    def count(self) -> int:
        return self.n_places + self.layout.n_cells + 1

    @property
    def wall(self) -> int:
        """Column of the wall."""
        return self.count - 1

    @cached_property
    def stride(self) -> float:
        """Parameter per unknown: an outline vertex then moves about as far as its unknown says."""
        return self.profile.period * self.profile.size / self.profile.perimeter

    @cached_property
    def local(self) -> Indices:
        """(n_cells, 8) column of each of a cell's own unknowns; `count` where it has none."""
        a, c, b, d = self.layout.corners.T
        raise_ = self.n_places + np.arange(self.layout.n_cells)
        col = self.column
        wall = np.full(self.layout.n_cells, self.wall)
        slots = np.stack([col[a, 0], col[a, 1], col[c, 0], col[b, 0], col[b, 1], col[d, 0], raise_, wall], axis=1)
        return np.where(slots < 0, self.count, slots)

    def of_cells(self, x: Reals) -> Reals:
        """(n_cells, 8) every cell's own unknowns; 0 where it has none."""
        return np.append(x[: self.count], 0.0)[self.local]

    def pack(self, s: Reals, z: Points, wall: float) -> Reals:
        """The vector of vertex places and the wall over the size; raises 0."""
        x = np.zeros(self.count)
        x[self.wall] = wall
        x[self.column[~self.inner, 0]] = s[~self.inner] / self.stride
        x[self.column[self.inner, 0]] = z[self.inner].real / self.profile.size
        x[self.column[self.inner, 1]] = z[self.inner].imag / self.profile.size
        return x

    def places(self, x: Reals) -> tuple[Reals, Points, Points]:
        """s (NaN inside), z and df/dx of every vertex (one on the outline, none inside: 1)."""
        s = np.full(len(self.inner), np.nan)
        z = np.empty(len(self.inner), dtype=complex)
        dz = np.full(len(self.inner), self.profile.size, dtype=complex)
        out, inn = ~self.inner, self.inner
        s[out] = x[self.column[out, 0]] * self.stride
        f, df = self.profile.evaluate(s[out], 1)
        z[out], dz[out] = f, df * self.stride
        z[inn] = (x[self.column[inn, 0]] + 1j * x[self.column[inn, 1]]) * self.profile.size
        return s, z, dz


@dataclass(frozen=True)
class Measures:
    """Measures of all cells, with their derivatives by the cells' own unknowns.

    Attributes
    ----------
    material
        (n_panels,) panel areas.
    cells
        The cells; its arrays are jets too.
    raised
        (n_cells, 2) by how much each offset is raised above the least.
    length
        (n_cells, 4) length of every panel, from closing vertex to opening vertex or crease.
    thickness
        (n_cells, 2) rim thickness and offset together: of both panels at c and at d.
    crease_at
        (n_cells, 2) parameters of the opening creases less those of their vertices.
    """

    material: Jet
    cells: Cells | ConeCells
    raised: Jet
    length: Jet
    thickness: Jet
    crease_at: Reals


class Measurer:
    """Measures cells of one layout on one profile, one by one: any cell, any places of its own vertices.

    Parameters
    ----------
    unknowns
        What varies.
    """

    def __init__(self, unknowns: Unknowns) -> None:
        self.unknowns = unknowns
        self._curved = (unknowns.layout.neighbour < 0).reshape(-1, 4)
        self._inner = unknowns.inner[unknowns.layout.corners]

    def __call__(self, own: Reals, cell: Indices, guess: Reals | None = None) -> Measures | None:
        """The measures of cells.

        Parameters
        ----------
        own
            (n, 8) their own unknowns.
        cell
            (n,) which cells they are.
        guess
            (n, 2) parameters of opening creases less those of their vertices, where they are known roughly.

        Returns
        -------
        None where an opening crease has no place on the outline.
        """
        profile = self.unknowns.profile
        s, z, dz = self._places(own, cell)
        corner = self._corners(s, z, cell)
        root, before, after = crease_roots(profile, corner, None if guess is None else corner.s_w + guess.ravel())
        good = 1e3 * TOLERANCE.root * profile.size
        if guess is not None and not (np.abs(before - after) <= good).all():
            root, before, after = crease_roots(profile, corner)
        if not (np.abs(before - after) <= good).all():
            return None
        jets = _corner_jets(corner, self._vertex_jets(z, dz, cell))
        return self._measure(corner, jets, root, self._crease_slopes(corner, jets, root), own[:, 6:])

    def vertices(self, own: Reals, cell: Indices) -> Jet:
        """(n, 4) places of the corners a, c, b, d of cells; arguments as when measuring."""
        _, z, dz = self._places(own, cell)
        return self._vertex_jets(z, dz, cell)

    def _places(self, own: Reals, cell: Indices) -> tuple[Reals, Points, Points]:
        """s (NaN inside), z and dz/dx of the corners a, c, b, d, (n, 4) each."""
        first, second = own[:, [0, 2, 3, 5]], own[:, [1, 2, 4, 5]]
        inner, size = self._inner[cell], self.unknowns.profile.size
        s = np.where(inner, np.nan, first * self.unknowns.stride)
        z: Points = np.asarray((first + 1j * second) * size, dtype=np.complex128)
        dz: Points = np.full(z.shape, size, dtype=np.complex128)
        f, df = self.unknowns.profile.evaluate(s[~inner], 1)
        z[~inner], dz[~inner] = f, df * self.unknowns.stride
        return np.asarray(s), z, dz

    def _corners(self, s: Reals, z: Points, cell: Indices) -> Corners:
        w, before, after = [1, 3], [0, 2], [2, 0]
        period, s_w, curved = self.unknowns.profile.period, s[:, w].ravel(), self._curved[cell]
        return Corners(
            s_w, z[:, w].ravel(), z[:, before].ravel(), z[:, after].ravel(),
            s_w - (s_w - s[:, before].ravel()) % period, s_w + (s[:, after].ravel() - s_w) % period,
            curved[:, [0, 2]].ravel(), curved[:, [1, 3]].ravel(),
        )  # fmt: skip

    def _vertex_jets(self, z: Points, dz: Points, cell: Indices) -> Jet:
        """(n, 4) corners a, c, b, d of every cell."""
        slope = np.zeros((*z.shape, SLOTS), dtype=complex)
        for k, slot in enumerate((0, 2, 3, 5)):
            slope[:, k, slot] = dz[:, k]
        for k, slot in ((0, 1), (2, 4)):
            slope[:, k, slot] = np.where(self._inner[cell, k], 1j * dz[:, k], 0.0)
        return Jet(z, slope)

    def _crease_slopes(self, corner: Corners, jets: Corners, root: Reals) -> Reals:
        """(2 n_cells, slots) derivatives of the creases' parameters, by the implicit function theorem."""
        profile = self.unknowns.profile
        f = profile.point(root)
        _, _, d_before, d_after = rim_thicknesses(profile, corner, root)
        steep = d_before - d_after
        w, before, after = cast(Jet, jets.w), cast(Jet, jets.q_before), cast(Jet, jets.q_after)
        slope = _straight_rim(w - before, w, f).slope - _straight_rim(after - w, w, f).slope
        for sign, flags, q in ((-1.0, corner.curved_before, before), (1.0, corner.curved_after, after)):
            k = np.flatnonzero(flags)
            if not len(k):
                continue
            rim = _bulge(profile, corner, k, sign, q[k], f[k], root)
            straight = _straight_rim(*((w[k] - q[k], w[k]) if sign < 0.0 else (q[k] - w[k], w[k])), f[k])
            slope[k] += (straight.slope - rim.slope) * sign
        return np.asarray(-slope / np.where(steep == 0.0, np.inf, steep)[:, None])

    def _measure(self, corner: Corners, jets: Corners, root: Reals, d_root: Reals, thick: Reals) -> Measures:
        """`thick`: (n, 2) the raise at c and the wall, over the size."""
        profile, n = self.unknowns.profile, len(thick)
        f, df = profile.evaluate(root, 1)
        crease = Jet(f, df[:, None] * d_root)
        faces = faces_of(jets, cast(Points, crease))
        above_c, wall = (Jet(thick[:, k] * profile.size, np.zeros((n, SLOTS))) for k in (0, 1))
        above_c.slope[:, 6] = wall.slope[:, 7] = profile.size
        least: Any = stacked([wall, wall], axis=1) + self._dips(corner, jets, crease, root).reshape(n, 2)
        raised = stacked([above_c, above_c - faces.excess(least)], axis=1)
        rim = self._rims(corner, jets, crease, root)
        offset = least + raised
        cells = faces.cells(cast(Reals, rim), cast(Reals, offset))
        material = self._material(corner, jets, crease, root, cells)
        guess = (root - corner.s_w).reshape(n, 2)
        return Measures(material, cells, raised, _lengths(jets, crease, corner), rim + offset, guess)

    def _rims(self, corner: Corners, jets: Corners, crease: Jet, root: Reals) -> Jet:
        """(n_cells, 2) rim thicknesses, from the straight panel where there is one."""
        w, before, after = cast(Jet, jets.w), cast(Jet, jets.q_before), cast(Jet, jets.q_after)
        straight_before = _straight_rim(w - before, w, crease)
        straight_after = _straight_rim(after - w, w, crease)
        rim = select(corner.curved_before, straight_after, straight_before)
        both = np.flatnonzero(corner.curved_before & corner.curved_after)
        if len(both):
            bulge = _bulge(self.unknowns.profile, corner, both, 1.0, after[both], crease[both], root)
            rim.value[both], rim.slope[both] = bulge.value, bulge.slope
        return rim.reshape(-1, 2)

    def _dips(self, corner: Corners, jets: Corners, crease: Jet, root: Reals) -> Jet:
        """(2 n_cells,) depth of hollow outlines below the chords of curved panels."""
        profile = self.unknowns.profile
        dip = Jet(np.zeros(len(root)), np.zeros((len(root), SLOTS)))
        if profile.is_convex:
            return dip
        ends = ((-1.0, corner.curved_before, jets.q_before), (1.0, corner.curved_after, jets.q_after))
        for sign, flags, q in ends:
            k = np.flatnonzero(flags)
            if len(k):
                depth = _bulge(profile, corner, k, sign, cast(Jet, q)[k], crease[k], root, hollow=True)
                deeper = depth.value > dip.value[k]
                dip.value[k] = np.where(deeper, depth.value, dip.value[k])
                dip.slope[k] = np.where(deeper[:, None], depth.slope, dip.slope[k])
        return dip

    def _material(self, corner: Corners, jets: Corners, crease: Jet, root: Reals, cells: Cells) -> Jet:
        profile = self.unknowns.profile
        two = np.repeat(np.arange(len(root)), 2)
        even = np.arange(2 * len(root)) % 2 == 0
        curved = np.where(even, corner.curved_before[two], corner.curved_after[two])
        s_q = np.where(even, corner.s_before[two], corner.s_after[two])
        s_c, s_w = root[two], corner.s_w[two]
        over = np.where(even, s_w < s_c, s_w > s_c)
        s_far = np.where(curved, s_q, np.where(over, s_w, s_c))
        q = select(even, jets.q_before[two], jets.q_after[two])
        c = crease[two]
        far = select(curved, q, select(over, jets.w[two], c))
        swept_far, swept_c = profile.swept_area(np.stack([s_far, s_c]))
        # An area swept along the curve changes with its end by half the cross product of place and motion.
        swept = Jet(swept_c - swept_far, _sweeping(c) - _sweeping(far))
        m = cast(Jet, cells.elbow).reshape(-1)[two]
        v = cast(Jet, cells.crease)[:, [2, 3, 3, 2]].reshape(-1)
        return cast(Jet, areas_of_panels(*cast(Any, (c, m, v, q, far, swept))))


def _sweeping(z: Jet) -> Reals:
    return np.asarray(0.5 * (np.conj(z.value)[..., None] * z.slope).imag)


def _corner_jets(corner: Corners, vertex: Jet) -> Corners:
    """The corners with jets for their vertices."""
    w, before, after = (vertex[:, k].reshape(-1) for k in ([1, 3], [0, 2], [2, 0]))
    return replace(corner, w=cast(Points, w), q_before=cast(Points, before), q_after=cast(Points, after))


def _straight_rim(edge: Jet, w: Jet, f: Any) -> Jet:
    """Distance of `f` from an inner edge's line, inwards positive."""
    return cast(Jet, (np.conj(edge) * (f - w)).imag / np.abs(edge))


def _bulge(
    profile: Profile, corner: Corners, k: Indices, sign: float, q: Jet, c: Any, root: Reals, *, hollow: bool = False
) -> Jet:
    """Largest outward (or, hollow, inward) distance of the outline from the chord between q and c, for corners k."""
    chord = sign * (q - c)
    u = chord / np.abs(chord)
    normal = (1j if hollow else -1j) * u
    start, stop = (root[k], corner.s_after[k]) if sign > 0.0 else (corner.s_before[k], root[k])
    height, where = profile.extreme(start, stop, q.value, normal.value)
    rim = (np.conj(normal) * (where - q)).real
    # The largest distance is at the chord's own ends where the outline keeps to its other side: always 0 there.
    flat = height <= TOLERANCE.root * profile.size
    return Jet(np.where(flat, 0.0, height), np.where(flat[:, None], 0.0, rim.slope))


def _lengths(jets: Corners, crease: Jet, corner: Corners) -> Jet:
    before = select(corner.curved_before, crease, jets.w) - jets.q_before
    after = jets.q_after - select(corner.curved_after, crease, jets.w)
    return cast(Jet, np.abs(cast(Any, stacked([before, after], axis=1)))).reshape(-1, 4)
