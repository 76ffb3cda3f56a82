"""Cells of a cone: inner faces, wall offsets, closing creases, the dead centre (the paper's equation (6)).

An inner face is a great circle. Moved inwards by a wall offset t it still crosses, 90 degrees from its
opening crease c, the points it crossed before: with `M` its pole at offset 0, at right angles to c, the
pole at offset t is `M cos t - c sin t` and the foot of c on it `c cos t + M sin t`. Faces, runs and
angles are told in the order of the plane's `Cells`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ori_deploy.design.cone.creases import ConeCorners, ConeCreases, face_poles, negligible
from ori_deploy.design.cone.embedding import ConeEmbedding
from ori_deploy.errors import CellError
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors, arc, cross, dot, length, unit
from ori_deploy.tolerance import TOLERANCE

_OF_FACE = [0, 0, 1, 1]
"""Opening crease (c, d) of each face a-c, c-b, b-d, d-a."""
_AHEAD = np.array([-1.0, 1.0, -1.0, 1.0])
"""Way along each face, counter-clockwise, from its opening crease to its closing one."""


@dataclass(frozen=True)
class ConeCells:
    """All cells of a cone's structure; the leading axis is the cell. Lengths are arcs; everything in radians.

    Attributes
    ----------
    pole
        (n, 4, 3) poles of the inner faces a-c, c-b, b-d, d-a: unit normals, pointing into the void.
    crease
        (n, 4, 3) unit vectors of the creases in the order open_c, open_d, close_a, close_b.
    elbow
        (n, 2, 3) where the two inner faces of each opening crease meet (m_c, m_d).
    rim, offset
        (n, 2) rim thickness h and wall offset t at the opening creases c, d.
    run
        (n, 4) arc along each inner face between its closing crease and the foot of its opening crease.
    angle
        (n, 4) deployed inner angles about the creases: between the inner faces of each; pi is open flat, 0
        closed. They add up to more than 2 pi.
    """

    pole: Vectors
    crease: Vectors
    elbow: Vectors
    rim: Reals
    offset: Reals
    run: Reals
    angle: Reals

    @property
    def close_a(self) -> Vectors:
        return self.crease[:, 2]

    @property
    def close_b(self) -> Vectors:
        return self.crease[:, 3]

    @cached_property
    def void(self) -> Vectors:
        """(n, 4, 3) corners of the void: v1, m_c, v3, m_d, counter-clockwise."""
        return np.stack([self.crease[:, 2], self.elbow[:, 0], self.crease[:, 3], self.elbow[:, 1]], axis=1)

    @cached_property
    def face(self) -> Reals:
        """(n, 4) arc of each inner face, from closing crease to elbow; the void crosses itself where negative."""
        half_turn = 0.5 * (np.pi - self.angle[:, [0, 1]])
        short: Reals = np.arctan2(np.sin(self.offset) * np.sin(half_turn), np.cos(half_turn))
        return self.run - short[:, _OF_FACE]

    @cached_property
    def lean(self) -> Reals:
        """(n, 4) angle at each face's closing crease between the face and the link to the opening crease."""
        t = self.offset[:, _OF_FACE]
        lean: Reals = np.arctan2(np.sin(t), np.cos(t) * np.sin(self.run))
        return lean

    @cached_property
    def link(self) -> Reals:
        """(n, 4) link arcs of the spherical four-bar v1 - c' - v3 - d': v1c', c'v3, v3d', d'v1."""
        t = self.offset[:, _OF_FACE]
        sine = np.hypot(np.sin(t), np.cos(t) * np.sin(self.run))
        link: Reals = np.arctan2(sine, np.cos(t) * np.cos(self.run))
        return link

    @cached_property
    def dead_centre_margin(self) -> Reals:
        """(n, 2) `pi -` link angle at v1 and v3; must be positive for the cell to be able to close."""
        lean = self.lean
        link_a = self.angle[:, 2] + lean[:, 0] + lean[:, 3]
        link_b = self.angle[:, 3] + lean[:, 1] + lean[:, 2]
        return np.pi - np.stack([link_a, link_b], axis=1)


@dataclass(frozen=True)
class ConeFaces:
    """Inner faces of all cells before any wall offset.

    Attributes
    ----------
    opening
        (n, 2, 3) opening creases c, d.
    pole
        (n, 4, 3) poles of the faces, at right angles to their opening creases.
    """

    opening: Vectors
    pole: Vectors

    @cached_property
    def opening_turn(self) -> Reals:
        """(n, 2) angle about each opening crease by which its second face turns from its first."""
        first, second = self.pole[:, [0, 2]], self.pole[:, [1, 3]]
        turn: Reals = np.arctan2(dot(self.opening, cross(first, second)), dot(first, second))
        return turn

    def moved(self, offset: Reals) -> tuple[Vectors, Vectors]:
        """(n, 4, 3) poles of the faces moved inwards by offsets (n, 2), and the feet of their opening creases."""
        t, c = offset[:, _OF_FACE, None], self.opening[:, _OF_FACE]
        return self.pole * np.cos(t) - c * np.sin(t), c * np.cos(t) + self.pole * np.sin(t)

    def close(self, offset: Reals) -> tuple[Vectors, Reals, Reals]:
        """(n, 2, 3) closing creases, (n, 4) runs and (n, 2) inner angles at a, b for wall offsets (n, 2)."""
        pole, foot = self.moved(offset)
        meet = cross(pole[:, [3, 1]], pole[:, [0, 2]])
        size = length(meet)
        angle = np.pi - np.arctan2(size, dot(pole[:, [3, 1]], pole[:, [0, 2]]))
        with np.errstate(invalid="ignore"):  # faces that lie on each other meet nowhere; such cells are refused
            v = meet / size[..., None]
        at = v[:, [0, 1, 1, 0]]
        # The face's direction at its foot does not change with the offset.
        along = cross(self.pole, self.opening[:, _OF_FACE])
        return v, np.arctan2(dot(at, along) * _AHEAD, dot(at, foot)), angle

    def cells(self, rim: Reals, offset: Reals) -> ConeCells:
        """The cells with these rim thicknesses and wall offsets, (n, 2) each."""
        closing, run, closing_angle = self.close(offset)
        turn, t = self.opening_turn, offset[..., None]
        bend = self.pole[:, [0, 2]] + self.pole[:, [1, 3]]
        elbow = unit(self.opening * ((1.0 + np.cos(turn))[..., None] * np.cos(t)) + bend * np.sin(t))
        crease = np.concatenate([self.opening, closing], axis=1)
        angle = np.concatenate([np.pi - turn, closing_angle], axis=1)
        return ConeCells(self.moved(offset)[0], crease, elbow, rim, offset, run, angle)


def faces_of(corner: ConeCorners, opening: Vectors) -> ConeFaces:
    """Inner faces from the opening corners and their creases, (2 n, 3)."""
    before, after = face_poles(corner, opening)
    return ConeFaces(opening.reshape(-1, 2, 3), np.stack([before, after], axis=1).reshape(-1, 4, 3))


def unfolded_difference(run: Reals) -> Reals:
    """(n,) unfolded arc over c less that over d: zero by (6)."""
    return run[:, 0] + run[:, 1] - run[:, 2] - run[:, 3]


def gains(run: Reals, closing_angle: Reals) -> Reals:
    """(n, 2) how fast the unfolded difference grows with the offset at c, and falls with that at d.

    Moving a face by dt moves its crossing with the other face of a closing crease, at a run r, by
    cos(r) dt across itself: its own run loses cos(r) cot(angle) dt and the other's gains cos(r) dt / sin(angle).
    """
    half = np.tan(0.5 * closing_angle)
    reach = np.cos(run) * half[:, [0, 1, 1, 0]]
    return np.stack([reach[:, 0] + reach[:, 1], reach[:, 2] + reach[:, 3]], axis=1)


def smallest_offsets(faces: ConeFaces, least: Reals, small: float) -> tuple[Reals, Reals]:
    """The smallest pair of wall offsets that satisfies (6), at least `least` (n, 2), and what is left of (6).

    At most one offset of a cell is raised. While runs are shorter than 90 degrees either way the unfolded
    difference is strictly monotone in both (`gains`): so the sign of what is missing says which to raise, and
    Newton's method, kept below the first offset that leaves those bounds, finds how far. Beyond lie poles, where
    two faces become parallel.

    Parameters
    ----------
    small
        Unfolded difference that counts as none, radians.

    Returns
    -------
    (n, 2) offsets, radians, and (n,) residuals of (6).
    """
    _, run, _ = faces.close(least)
    missing = -unfolded_difference(run)
    missing = np.where(np.abs(missing) <= small, 0.0, missing)
    which = np.stack([missing > 0.0, missing < 0.0], axis=1)
    sign = np.sign(missing)
    lo, hi = np.zeros(len(least)), np.full(len(least), 0.5 * np.pi)
    raised = np.zeros(len(least))
    best, left = raised, np.full(len(least), np.inf)
    for _ in range(80):
        _, run, angle = faces.close(least + which * raised[:, None])
        short = -sign * unfolded_difference(run)
        sound = (np.abs(run) < 0.5 * np.pi).all(axis=1)
        closer = sound & (np.abs(short) < left)
        best, left = np.where(closer, raised, best), np.where(closer, np.abs(short), left)
        low = sound & (short > 0.0)
        lo, hi = np.where(low, raised, lo), np.where(low, hi, raised)
        gain = (gains(run, angle) * which).sum(axis=1)
        step = raised + short / np.where(gain > 0.0, gain, np.inf)
        usable = sound & (step > lo) & (step < hi)
        new = np.where(usable, step, 0.5 * (lo + hi))
        new = np.where((left <= 1e-16) | (sign == 0.0), raised, new)
        if (np.abs(new - raised) <= 1e-16).all():
            break
        raised = new
    offset = least + which * best[:, None]
    return offset, unfolded_difference(faces.close(offset)[1])


def build_cells(e: ConeEmbedding, corner: ConeCorners, opening: ConeCreases, wall_rad: float) -> ConeCells:
    """Inner faces, offsets by (6) and closing creases of every cell.

    Raises
    ------
    CellError
        Inner faces that do not meet, a void that is not a convex quadrilateral, wall too thick, a
        cell at or beyond its dead centre.
    """
    names = e.layout.cell_ids
    _refuse_no_length(e, corner, opening.u)
    faces = faces_of(corner, opening.u)
    _refuse_turned(names, faces)
    least = wall_rad + opening.dip.reshape(-1, 2)
    _refuse_apart(names, faces, least)
    offset, residual = smallest_offsets(faces, least, negligible(e.profile))
    _refuse_length(names, residual, max(TOLERANCE.unfolded_length * e.profile.size, 100.0 * negligible(e.profile)))
    cells = faces.cells(opening.rim.reshape(-1, 2), offset)
    _refuse_void(names, cells, wall_rad)
    _refuse_dead_centre(names, cells)
    return cells


def _refuse_no_length(e: ConeEmbedding, corner: ConeCorners, crease: Vectors) -> None:
    before = arc(corner.q_before, np.where(corner.curved_before[:, None], crease, corner.w))
    after = arc(corner.q_after, np.where(corner.curved_after[:, None], crease, corner.w))
    panels = np.stack([before, after], axis=1).reshape(-1, 4)
    short = np.argwhere(panels <= TOLERANCE.vertex_gap * e.profile.size)
    if len(short):
        cell, k = short[0]
        raise CellError(
            f"cell {e.layout.cell_ids[cell]}: panel {e.layout.panel_ids[4 * cell + k]} has no length",
            value=f"{float(panels[cell, k]):.3g} rad",
            limit="a positive length",
            remedy="move its vertices apart",
        )


def _refuse_turned(names: tuple[str, ...], faces: ConeFaces) -> None:
    angle = np.pi - faces.opening_turn
    bad = np.argwhere(~((angle > 1e-9) & (angle < np.pi - 1e-9)))
    if len(bad):
        cell, k = bad[0]
        raise _not_convex(names[cell], f"opening crease {'cd'[k]}", float(angle[cell, k]))


def _refuse_apart(names: tuple[str, ...], faces: ConeFaces, least: Reals) -> None:
    """Refuse faces that do not meet ahead of their opening creases at a closing one."""
    v, _, angle = faces.close(least)
    # Where the void is not convex the great circles meet on the far side of the sphere.
    ahead = (dot(v, faces.opening[:, [0, 0]]) > 0.0) & (dot(v, faces.opening[:, [1, 1]]) > 0.0)
    shown = np.where(ahead, angle, 2.0 * np.pi - angle)
    bad = np.argwhere(~((shown > 1e-9) & (shown < np.pi - 1e-9)))
    if len(bad):
        cell, k = bad[0]
        raise _not_convex(names[cell], f"closing crease {'ab'[k]}", float(shown[cell, k]))


def _not_convex(name: str, where: str, angle: float) -> CellError:
    return CellError(
        f"cell {name}: inner faces do not form a convex void at {where}",
        value=f"{np.degrees(angle):.4g} deg",
        limit="0 deg < inner angle < 180 deg",
        remedy="move the cell's vertices so that each corner is convex, or add cells, or make the wall smaller",
    )


def _refuse_length(names: tuple[str, ...], difference: Reals, limit: float) -> None:
    bad = np.flatnonzero(~(np.abs(difference) <= limit))
    if len(bad):
        raise CellError(
            f"cell {names[bad[0]]}: unfolded lengths differ, equation (6)",
            value=f"{difference[bad[0]]:.3g} rad",
            limit=f"{limit:.3g} rad",
            remedy="no wall offset makes its two sides equally long: make them more alike, or the wall smaller",
        )


def _refuse_void(names: tuple[str, ...], cells: ConeCells, wall_rad: float) -> None:
    sound = (cells.face > 0.0) & (cells.run < 0.5 * np.pi)
    bad = np.argwhere(~sound)
    if len(bad):
        cell, k = bad[0]
        edge = ("a-c", "c-b", "b-d", "d-a")[k]
        raised = float(cells.offset[cell].max())
        raise CellError(
            f"cell {names[cell]}: the wall leaves no inner face on panel {edge}: the void crosses itself",
            value=f"inner face {cells.face[cell, k]:.4g} rad long with offsets up to {raised:.4g} rad "
            f"(wall {wall_rad:.4g} rad)",
            limit="a positive length below 90 deg",
            remedy=("make the wall smaller, the cell larger, or" if wall_rad > 0.0 else "make the cell larger, or")
            + " its two sides more alike: unequal sides raise one offset, equation (6)",
        )


def _refuse_dead_centre(names: tuple[str, ...], cells: ConeCells) -> None:
    margin = cells.dead_centre_margin
    bad = np.argwhere(~(margin > TOLERANCE.dead_centre_rad))
    if len(bad):
        cell, k = bad[0]
        where = "ab"[k]
        raise CellError(
            f"cell {names[cell]}: beyond its dead centre at closing crease {where}: it cannot close",
            value=f"dead-centre margin {np.degrees(margin[cell, k]):.4g} deg",
            limit="more than 0 deg",
            remedy="longer or thinner panels there: move closing vertex "
            f"{where} off the flat piece of outline, widen the cell, or make the wall smaller",
        )
