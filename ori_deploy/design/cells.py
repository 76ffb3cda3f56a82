"""Cells: inner faces, wall offsets, closing creases and the dead centre (the paper's equation (3)).

Every cell has four inner faces, one per panel, in the panels' order a-c, c-b, b-d, d-a. Each lies on
a directed line: the straight panel's through the crease parallel to its inner edge, the curved
panel's along the chord between its closing vertex and the crease, both moved inwards by the wall
offset of their opening crease.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ori_deploy.design.creases import Corners, OpeningCreases
from ori_deploy.design.embedding import Embedding
from ori_deploy.errors import CellError
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE


@dataclass(frozen=True)
class Cells:
    """All cells of a structure; the leading axis is the cell. Lengths in metres, angles in radians.

    Attributes
    ----------
    direction
        (n, 4) unit directions of the inner faces, counter-clockwise round the void.
    crease
        (n, 4) places of the creases in the order open_c, open_d, close_a, close_b.
    elbow
        (n, 2) where the two inner faces of each opening crease meet (m_c, m_d).
    rim, offset
        (n, 2) rim thickness h and wall offset t at the opening creases c, d.
    run
        (n, 4) distance along each inner face between its closing crease and the foot of its opening crease.
    angle
        (n, 4) deployed inner angles at the creases: of the void's corners; they add up to 2 pi.
    """

    direction: Points
    crease: Points
    elbow: Points
    rim: Reals
    offset: Reals
    run: Reals
    angle: Reals

    @property
    def close_a(self) -> Points:
        return self.crease[:, 2]

    @property
    def close_b(self) -> Points:
        return self.crease[:, 3]

    @cached_property
    def void(self) -> Points:
        """(n, 4) corners of the void: v1, m_c, v3, m_d, counter-clockwise."""
        return np.stack([self.crease[:, 2], self.elbow[:, 0], self.crease[:, 3], self.elbow[:, 1]], axis=1)

    @cached_property
    def face(self) -> Reals:
        """(n, 4) length of each inner face, from closing crease to elbow; the void crosses itself where negative."""
        # The elbow stands t tan(turn / 2) short of the crease's foot, and the turn there is pi less the angle.
        short = self.offset / np.tan(0.5 * self.angle[:, [0, 1]])
        return self.run - short[:, [0, 0, 1, 1]]

    @cached_property
    def lean(self) -> Reals:
        """(n, 4) angle at each face's closing crease between the face and the link to the opening crease."""
        return np.arctan2(self.offset[:, [0, 0, 1, 1]], self.run)

    @cached_property
    def link(self) -> Reals:
        """(n, 4) link lengths of the four-bar v1 - c' - v3 - d': v1c', c'v3, v3d', d'v1."""
        return np.hypot(self.run, self.offset[:, [0, 0, 1, 1]])

    @cached_property
    def dead_centre_margin(self) -> Reals:
        """(n, 2) `pi -` link angle at v1 and v3; must be positive for the cell to be able to close."""
        lean = self.lean
        link_a = self.angle[:, 2] + lean[:, 0] + lean[:, 3]
        link_b = self.angle[:, 3] + lean[:, 1] + lean[:, 2]
        return np.pi - np.stack([link_a, link_b], axis=1)


@dataclass(frozen=True)
class Faces:
    """Inner faces of all cells before any wall offset: directions and where they lie.

    Attributes
    ----------
    direction
        (n, 4) unit directions, counter-clockwise round the void.
    turn
        (n, 4) angles by which the direction turns at c, b, d, a.
    opening
        (n, 2) opening creases c, d.
    """

    direction: Points
    turn: Reals
    opening: Points

    @cached_property
    def angle(self) -> Reals:
        """(n, 4) inner angles at the creases, in their order."""
        angle: Reals = np.pi - self.turn[:, [0, 2, 3, 1]]
        return angle

    @cached_property
    def _reach(self) -> Points:
        """(n, 4) opening crease of each face in the face's own frame: along it, and off it."""
        return np.conj(self.direction) * self.opening[:, [0, 0, 1, 1]]

    def close(self, offset: Reals) -> tuple[Points, Reals]:
        """(n, 2) closing creases and (n, 4) runs for wall offsets (n, 2)."""
        u = self.direction
        height = self._reach.imag + offset[:, [0, 0, 1, 1]]
        cross = np.sin(self.turn[:, [3, 1]])
        a = (height[:, 3] * u[:, 0] - height[:, 0] * u[:, 3]) / cross[:, 0]
        b = (height[:, 1] * u[:, 2] - height[:, 2] * u[:, 1]) / cross[:, 1]
        run = self._reach.real - (np.conj(u) * np.stack([a, b, b, a], axis=1)).real
        return np.stack([a, b], axis=1), run * np.array([1.0, -1.0, 1.0, -1.0])

    def excess(self, offset: Reals) -> Reals:
        """(n,) by how much (3) wants the offset at c raised; at d where negative.

        (3) is linear in the two offsets: raising `t_c` by δ changes the difference of the unfolded
        lengths by δ (tan(α/2) + tan(β/2)), α and β the inner angles at v1 and v3, and raising `t_d`
        by the opposite.
        """
        gain: Reals = np.tan(0.5 * self.angle[:, 2]) + np.tan(0.5 * self.angle[:, 3])
        return -unfolded_difference(self.close(offset)[1]) / gain

    def cells(self, rim: Reals, offset: Reals) -> Cells:
        """The cells with these rim thicknesses and wall offsets, (n, 2) each."""
        u, turn = self.direction, self.turn[:, [0, 2]]
        closing, run = self.close(offset)
        elbow = self.opening + 1j * offset * (u[:, [0, 2]] + u[:, [1, 3]]) / (1.0 + np.cos(turn))
        crease = np.concatenate([self.opening, closing], axis=1)
        return Cells(u, crease, elbow, rim, offset, run, self.angle)


def unfolded_difference(run: Reals) -> Reals:
    """(n,) unfolded length over c less that over d: zero by (3)."""
    difference: Reals = run[:, 0] + run[:, 1] - run[:, 2] - run[:, 3]
    return difference


def faces_of(corner: Corners, crease: Points) -> Faces:
    """Inner faces from the opening corners and their creases, (2 n,)."""
    before = np.where(corner.curved_before, crease, corner.w) - corner.q_before
    after = corner.q_after - np.where(corner.curved_after, crease, corner.w)
    side = np.stack([before, after], axis=1).reshape(-1, 4)
    u = side / np.abs(side)
    turn = np.angle(np.roll(u, -1, axis=1) * np.conj(u))
    return Faces(u, turn, crease.reshape(-1, 2))


def build_cells(e: Embedding, corner: Corners, opening: OpeningCreases, wall_m: float) -> Cells:
    """Inner faces, offsets by (3) and closing creases of every cell.

    The smallest pair of offsets that satisfies (3) is taken: at most one of the two is raised.

    Raises
    ------
    CellError
        Inner faces that do not meet, a void that is not a convex quadrilateral, wall too thick, a
        cell at or beyond its dead centre.
    """
    names = e.layout.cell_ids
    _refuse_no_length(e, corner, opening.z)
    faces = faces_of(corner, opening.z)
    _refuse_angles(names, faces.angle)
    least = wall_m + opening.dip.reshape(-1, 2)
    excess = faces.excess(least)
    excess[np.abs(excess) <= TOLERANCE.root * e.profile.size] = 0.0
    offset = least + np.stack([np.maximum(excess, 0.0), np.maximum(-excess, 0.0)], axis=1)
    cells = faces.cells(opening.rim.reshape(-1, 2), offset)
    _refuse_length(names, unfolded_difference(cells.run), e.profile.size)
    _refuse_void(names, cells, wall_m)
    _refuse_dead_centre(names, cells)
    return cells


def _refuse_no_length(e: Embedding, corner: Corners, crease: Points) -> None:
    before = np.where(corner.curved_before, crease, corner.w) - corner.q_before
    after = corner.q_after - np.where(corner.curved_after, crease, corner.w)
    length = np.abs(np.stack([before, after], axis=1)).reshape(-1, 4)
    short = np.argwhere(length <= TOLERANCE.vertex_gap * e.profile.size)
    if len(short):
        cell, k = short[0]
        raise CellError(
            f"cell {e.layout.cell_ids[cell]}: panel {e.layout.panel_ids[4 * cell + k]} has no length",
            value=f"{float(length[cell, k]):.3g} m",
            limit="a positive length",
            remedy="move its vertices apart",
        )


def _refuse_angles(names: tuple[str, ...], angle: Reals) -> None:
    bad = np.argwhere(~((angle > 1e-9) & (angle < np.pi - 1e-9)))
    if len(bad):
        cell, k = bad[0]
        what = ("opening crease c", "opening crease d", "closing crease a", "closing crease b")[k]
        raise CellError(
            f"cell {names[cell]}: inner faces do not form a convex void at {what}",
            value=f"{np.degrees(angle[cell, k]):.4g} deg",
            limit="0 deg < inner angle < 180 deg",
            remedy="move the cell's vertices so that each corner is convex, or add cells; lengths are in metres",
        )


def _refuse_length(names: tuple[str, ...], difference: Reals, size: float) -> None:
    bad = np.flatnonzero(~(np.abs(difference) <= TOLERANCE.unfolded_length * size))
    if len(bad):
        raise CellError(
            f"cell {names[bad[0]]}: unfolded lengths differ, equation (3)",
            value=f"{difference[bad[0]]:.3g} m",
            limit=f"{TOLERANCE.unfolded_length * size:.3g} m",
            remedy="two inner faces are nearly parallel: move the cell's vertices",
        )


def _refuse_void(names: tuple[str, ...], cells: Cells, wall_m: float) -> None:
    face = cells.face
    bad = np.argwhere(~(face > 0.0))
    if len(bad):
        cell, k = bad[0]
        edge = ("a-c", "c-b", "b-d", "d-a")[k]
        raised = float(cells.offset[cell].max())
        raise CellError(
            f"cell {names[cell]}: the wall leaves no inner face on panel {edge}: the void crosses itself",
            value=f"inner face {face[cell, k]:.4g} m long with offsets up to {raised:.4g} m (wall {wall_m:.4g} m)",
            limit="a positive length",
            remedy=("make wall_m smaller, the cell larger, or" if wall_m > 0.0 else "make the cell larger, or")
            + " its two sides more alike: unequal sides raise one offset, equation (3)",
        )


def _refuse_dead_centre(names: tuple[str, ...], cells: Cells) -> None:
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
            f"{where} off the flat piece of outline, widen the cell, or make wall_m smaller",
        )
