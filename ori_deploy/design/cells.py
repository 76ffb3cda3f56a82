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


def build_cells(e: Embedding, corner: Corners, opening: OpeningCreases, wall_m: float) -> Cells:
    """Inner faces, offsets by (3) and closing creases of every cell.

    (3) is linear in the two offsets once the faces' directions are known: raising `t_c` by δ
    changes the difference of the unfolded lengths by δ (tan(α/2) + tan(β/2)), α and β the inner angles
    at v1 and v3, and raising `t_d` by the opposite. So the smallest pair follows in closed form.

    Raises
    ------
    CellError
        Inner faces that do not meet, a void that is not a convex quadrilateral, wall too thick, a
        cell at or beyond its dead centre.
    """
    names = e.layout.cell_ids
    c = opening.z.reshape(-1, 2)
    u = _face_directions(e, corner, opening)
    turn = np.angle(np.roll(u, -1, axis=1) * np.conj(u))  # at c, b, d, a
    angle = np.pi - turn[:, [0, 2, 3, 1]]
    _refuse_angles(names, angle)
    cross = np.sin(turn[:, [3, 1]])  # at a, b
    reach = np.conj(u) * c[:, [0, 0, 1, 1]]
    at_rest = reach.imag  # distance of each face's line from the origin at offset 0
    least = wall_m + opening.dip.reshape(-1, 2)

    def close(offset: Reals) -> tuple[Points, Reals]:
        height = at_rest + offset[:, [0, 0, 1, 1]]
        a = (height[:, 3] * u[:, 0] - height[:, 0] * u[:, 3]) / cross[:, 0]
        b = (height[:, 1] * u[:, 2] - height[:, 2] * u[:, 1]) / cross[:, 1]
        corners = np.stack([a, b, b, a], axis=1)
        run = reach.real - (np.conj(u) * corners).real
        return np.stack([a, b], axis=1), run * np.array([1.0, -1.0, 1.0, -1.0])

    def difference(run: Reals) -> Reals:
        return run[:, 0] + run[:, 1] - run[:, 2] - run[:, 3]

    gain = np.tan(0.5 * angle[:, 2]) + np.tan(0.5 * angle[:, 3])
    _, run = close(least)
    excess = -difference(run) / gain
    small = TOLERANCE.root * e.profile.size
    excess[np.abs(excess) <= small] = 0.0
    offset = least + np.stack([np.maximum(excess, 0.0), np.maximum(-excess, 0.0)], axis=1)
    closing, run = close(offset)
    _refuse_length(names, difference(run), e.profile.size)
    elbow = c + 1j * offset * (u[:, [0, 2]] + u[:, [1, 3]]) / (1.0 + np.cos(turn[:, [0, 2]]))
    cells = Cells(
        direction=u,
        crease=np.concatenate([c, closing], axis=1),
        elbow=elbow,
        rim=opening.rim.reshape(-1, 2),
        offset=offset,
        run=run,
        angle=angle,
    )
    _refuse_void(names, cells, turn, wall_m)
    _refuse_dead_centre(names, cells)
    return cells


def _face_directions(e: Embedding, corner: Corners, opening: OpeningCreases) -> Points:
    """(n_cells, 4) unit directions of the inner faces, counter-clockwise."""
    before = np.where(corner.curved_before, opening.z, corner.w) - corner.q_before
    after = corner.q_after - np.where(corner.curved_after, opening.z, corner.w)
    faces = np.stack([before, after], axis=1).reshape(-1, 4)
    length = np.abs(faces)
    short = np.argwhere(length <= TOLERANCE.vertex_gap * e.profile.size)
    if len(short):
        cell, k = short[0]
        raise CellError(
            f"cell {e.layout.cell_ids[cell]}: panel {e.layout.panel_ids[4 * cell + k]} has no length",
            value=f"{float(length[cell, k]):.3g} m",
            limit="a positive length",
            remedy="move its vertices apart",
        )
    return faces / length


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


def _refuse_void(names: tuple[str, ...], cells: Cells, turn: Reals, wall_m: float) -> None:
    # Along each face the elbow stands t tan(turn / 2) short of the crease's foot.
    short = cells.offset * np.tan(0.5 * turn[:, [0, 2]])
    face = cells.run - short[:, [0, 0, 1, 1]]
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
