"""What a cone's structure measures, with exact derivatives: the plane's `measures`, seen from the apex.

Vertices vary in the base's plane; all that is measured is arcs and solid angles. Where the plane's (3)
gives the second offset of a cell in closed form, (6) is solved for it here, and its derivatives follow
from the implicit function theorem.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np

from ori_deploy.design.cone.cells import ConeFaces, faces_of, gains, unfolded_difference
from ori_deploy.design.cone.creases import ConeCorners, crease_roots, negligible, rim_thicknesses
from ori_deploy.design.cone.structure import AXIS, areas_of_panels
from ori_deploy.design.jet import Jet, select, stacked
from ori_deploy.profiles import Cone
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.sphere import Vectors, arc, cross, dot, unit
from ori_deploy.search.measures import SLOTS, Indices, Measurer, Measures, Unknowns

_BALANCED = 1e-15
_BALANCE_STEPS = 60


class ConeMeasurer(Measurer):
    """Measures cells of one layout on one cone.

    Parameters
    ----------
    unknowns
        What varies: vertices on the cone's base and in its plane, raises and the wall over the cone's size.
    cone
        The cone.
    """

    def __init__(self, unknowns: Unknowns, cone: Cone) -> None:
        super().__init__(unknowns)
        self.cone = cone

    def __call__(self, own: Reals, cell: Indices, guess: Reals | None = None) -> Measures | None:
        cone = self.cone
        s, z, dz = self._places(own, cell)
        vertex: Any = unit(cone.lift(cast(Points, self._vertex_jets(z, dz, cell))))
        corner = self._cone_corners(s, vertex.value, cell)
        root, before, after = crease_roots(cone, corner, None if guess is None else corner.s_w + guess.ravel())
        good = 1e3 * negligible(cone)
        if guess is not None and not (np.abs(before - after) <= good).all():
            root, before, after = crease_roots(cone, corner)
        if not (np.abs(before - after) <= good).all():
            return None
        w, q_before, q_after = (vertex[:, k].reshape(-1, 3) for k in ([1, 3], [0, 2], [2, 0]))
        jets = replace(corner, w=w, q_before=q_before, q_after=q_after)
        g, dg = cone.evaluate(root, 1)
        crease = Jet(g, dg[:, :, None] * self._slopes(corner, jets, root)[:, None, :])
        return self._measured(corner, jets, root, crease, own[:, 6:])

    def _cone_corners(self, s: Reals, u: Vectors, cell: Indices) -> ConeCorners:
        w, before, after = [1, 3], [0, 2], [2, 0]
        period, s_w, curved = self.cone.period, s[:, w].ravel(), self._curved[cell]
        return ConeCorners(
            s_w, u[:, w].reshape(-1, 3), u[:, before].reshape(-1, 3), u[:, after].reshape(-1, 3),
            s_w - (s_w - s[:, before].ravel()) % period, s_w + (s[:, after].ravel() - s_w) % period,
            curved[:, [0, 2]].ravel(), curved[:, [1, 3]].ravel(),
        )  # fmt: skip

    def _slopes(self, corner: ConeCorners, jets: ConeCorners, root: Reals) -> Reals:
        """(2 n_cells, slots) derivatives of the creases' parameters, by the implicit function theorem."""
        g = self.cone.point(root)
        _, _, d_before, d_after = rim_thicknesses(self.cone, corner, root)
        steep = d_before - d_after
        slope = np.zeros((len(root), SLOTS))
        for sign, curved, ends in (
            (1.0, corner.curved_before, (jets.q_before, jets.w)),
            (-1.0, corner.curved_after, (jets.w, jets.q_after)),
        ):
            straight = _straight_rim(ends[0], ends[1], g)
            slope += sign * np.where(curved[:, None], 0.0, straight.slope)
            k = np.flatnonzero(curved)
            if len(k):
                slope[k] += sign * self._rise(corner, jets, k, -sign, g[k], root).slope
        return np.asarray(-slope / np.where(steep == 0.0, np.inf, steep)[:, None])

    def _rise(
        self,
        corner: ConeCorners,
        jets: ConeCorners,
        k: Indices,
        sign: float,
        c: Any,
        root: Reals,
        hollow: bool = False,
    ) -> Jet:
        """Largest angle, seen from the crease c, of the outline over (or, hollow, under) the chord, for corners k."""
        q = cast(Any, jets.q_after if sign > 0.0 else jets.q_before)[k]
        out = unit(cross(c, q) * (sign if hollow else -sign))
        start, stop = (root[k], corner.s_after[k]) if sign > 0.0 else (corner.s_before[k], root[k])
        at = c.value if isinstance(c, Jet) else c
        angle, where = self.cone.steepest(start, stop, at, cast(Any, out).value)
        rise = cast(Jet, np.arctan2(dot(out, where), dot(c, where)))
        flat = angle <= negligible(self.cone)
        return Jet(np.where(flat, 0.0, angle), np.where(flat[:, None], 0.0, rise.slope))

    def _measured(self, corner: ConeCorners, jets: ConeCorners, root: Reals, crease: Jet, thick: Reals) -> Measures:
        """`thick`: (n, 2) the raise at c and the wall, over the size."""
        cone, n = self.cone, len(thick)
        faces = faces_of(jets, cast(Vectors, crease))
        above_c, wall = (Jet(thick[:, k] * cone.size, np.zeros((n, SLOTS))) for k in (0, 1))
        above_c.slope[:, 6] = wall.slope[:, 7] = cone.size
        least: Any = stacked([wall, wall], axis=1) + self._hollows(corner, jets, crease, root).reshape(n, 2)
        offset_c = least[:, 0] + above_c
        offset_d = _balancing(faces, offset_c, least[:, 1].value)
        offset = stacked([offset_c, offset_d], axis=1)
        rim = self._thickness(corner, jets, crease, root)
        cells = faces.cells(cast(Reals, rim), cast(Reals, offset))
        return Measures(
            material=self._solid_angles(corner, jets, crease, root, cells),
            cells=cells,
            raised=stacked([above_c, offset_d - least[:, 1]], axis=1),
            length=_arcs(jets, crease, corner),
            thickness=rim + offset,
            crease_at=(root - corner.s_w).reshape(n, 2),
        )

    def _thickness(self, corner: ConeCorners, jets: ConeCorners, crease: Jet, root: Reals) -> Jet:
        """(n_cells, 2) rim thicknesses, from the straight panel where there is one."""
        before = _straight_rim(cast(Any, jets.q_before), cast(Any, jets.w), crease)
        after = _straight_rim(cast(Any, jets.w), cast(Any, jets.q_after), crease)
        rim = select(corner.curved_before, after, before)
        both = np.flatnonzero(corner.curved_before & corner.curved_after)
        if len(both):
            rise = self._rise(corner, jets, both, 1.0, crease[both], root)
            rim.value[both], rim.slope[both] = rise.value, rise.slope
        return rim.reshape(-1, 2)

    def _hollows(self, corner: ConeCorners, jets: ConeCorners, crease: Jet, root: Reals) -> Jet:
        """(2 n_cells,) angle to which hollow outlines sink below the chords of curved panels."""
        dip = Jet(np.zeros(len(root)), np.zeros((len(root), SLOTS)))
        if self.cone.is_convex:
            return dip
        for sign, flags in ((-1.0, corner.curved_before), (1.0, corner.curved_after)):
            k = np.flatnonzero(flags)
            if len(k):
                depth = self._rise(corner, jets, k, sign, crease[k], root, hollow=True)
                deeper = depth.value > dip.value[k]
                dip.value[k] = np.where(deeper, depth.value, dip.value[k])
                dip.slope[k] = np.where(deeper[:, None], depth.slope, dip.slope[k])
        return dip

    def _solid_angles(self, corner: ConeCorners, jets: ConeCorners, crease: Jet, root: Reals, cells: Any) -> Jet:
        two = np.repeat(np.arange(len(root)), 2)
        even = np.arange(2 * len(root)) % 2 == 0
        curved = np.where(even, corner.curved_before[two], corner.curved_after[two])
        s_q = np.where(even, corner.s_before[two], corner.s_after[two])
        s_c, s_w = root[two], corner.s_w[two]
        over = np.where(even, s_w < s_c, s_w > s_c)
        s_far = np.where(curved, s_q, np.where(over, s_w, s_c))
        q = select(even[:, None], cast(Any, jets.q_before)[two], cast(Any, jets.q_after)[two])
        c = crease[two]
        far = select(curved[:, None], q, select(over[:, None], cast(Any, jets.w)[two], c))
        swept_far, swept_c = self.cone.swept(np.stack([s_far, s_c]))
        swept = Jet(swept_c - swept_far, _sweeping(c) - _sweeping(far))
        m = cells.elbow.reshape(-1, 3)[two]
        v = cells.crease[:, [2, 3, 3, 2]].reshape(-1, 3)
        return cast(Jet, areas_of_panels(*cast(Any, (c, m, v, q, far, swept))))


def _sweeping(g: Jet) -> Reals:
    """How fast the solid angle swept from the axis grows as a point of the curve moves."""
    u, du = g.value, np.moveaxis(g.slope, -1, 0)
    turned = dot(np.cross(AXIS, u)[None], du)
    return np.asarray((turned / (1.0 + u @ AXIS)[None]).T)


def _straight_rim(q: Any, w: Any, g: Any) -> Jet:
    """Arc from `g` to the bond plane, which runs from `q` to `w` with the cell on its left."""
    sine = dot(unit(cross(q, w)), g)
    return cast(Jet, np.arctan2(cast(Any, sine), np.sqrt(1.0 - sine * sine)))


def _balancing(faces: ConeFaces, offset_c: Jet, least_d: Reals) -> Jet:
    """The offset at d with which both sides of every cell unfold to the same length, (6).

    The difference falls with it (`gains`): Newton's method from the least offset.
    """
    plain = ConeFaces(cast(Any, faces.opening).value, cast(Any, faces.pole).value)
    t = least_d.copy()
    for _ in range(_BALANCE_STEPS):
        _, run, angle = plain.close(np.stack([offset_c.value, t], axis=1))
        step = unfolded_difference(run) / gains(run, angle)[:, 1]
        t = t + np.clip(step, -0.1, 0.1)
        if not np.isfinite(t).all() or np.abs(step).max() <= _BALANCED:
            break
    held = Jet(t, np.zeros_like(offset_c.slope))
    moved = faces.close(cast(Reals, stacked([offset_c, held], axis=1)))[1]
    _, run, angle = plain.close(np.stack([offset_c.value, t], axis=1))
    slope = cast(Any, unfolded_difference(moved)).slope / gains(run, angle)[:, 1:]
    return Jet(t, slope)


def _arcs(jets: ConeCorners, crease: Jet, corner: ConeCorners) -> Jet:
    before = arc(cast(Any, jets.q_before), cast(Any, select(corner.curved_before[:, None], crease, jets.w)))
    after = arc(cast(Any, jets.q_after), cast(Any, select(corner.curved_after[:, None], crease, jets.w)))
    return stacked([before, after], axis=1).reshape(-1, 4)
