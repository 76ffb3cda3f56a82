"""A cone's fold as seen from its apex: what the frames of a strip show, in degrees of arc."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import ConeStructure
from ori_deploy.motion import ConeMechanism
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.sphere import Vectors, cross, unit
from ori_deploy.view.globe import Globe, strokes

_STEPS_BETWEEN = 8


def cone_views(
    structure: ConeStructure, mechanism: ConeMechanism, folds: Sequence[float], faced: NDArray[np.intp]
) -> list[tuple[list[Points], list[Points]]]:
    """Panel polygons, and the faces of the panels `faced`, on paper at each fold.

    Every pose is turned to match the next one up as closely as a rotation can, beginning at the deployed one, and
    is looked at along its middle; what is then missing for the flat stack to lie level is turned in evenly.
    """
    rotations, middles = _matched(structure, mechanism, np.asarray(folds))
    panels = [strokes(outline, closed=True) for outline in structure.panel_outlines()]
    layout = structure.layout
    edges = np.stack([layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()], axis=1)
    faces = [strokes(structure.embedding.u[edges[p]], closed=False) for p in faced]
    east = np.array([1.0, 0.0, 0.0])
    views = []
    for turn, middle in zip(rotations, middles, strict=True):
        globe = Globe.looking_along(middle, east)
        views.append(
            (
                [globe.flat(panel @ turn[p].T) for p, panel in enumerate(panels)],
                [globe.flat(face @ turn[p].T) for p, face in zip(faced, faces, strict=True)],
            )
        )
    # The stack's direction is that of its first panel's inner face.
    first = Globe.looking_along(middles[0], east)
    crease, pole = structure.cells.crease[0, 0], structure.cells.pole[0, 0]
    along = rotations[0][0] @ unit(cross(pole, crease))
    here = rotations[0][0] @ crease
    way = complex(first.flat(unit(here + 1e-4 * along))) - complex(first.flat(here))
    missing = 0.5 * float(np.angle((way / abs(way)) ** 2))
    levelled = []
    for fold, (shown, slits) in zip(folds, views, strict=True):
        roll = np.exp(-1j * missing * (1.0 - fold))
        levelled.append(([roll * z for z in shown], [roll * z for z in slits]))
    return levelled


def _matched(structure: ConeStructure, mechanism: ConeMechanism, folds: Reals) -> tuple[Reals, Vectors]:
    """(n, n_panels, 3, 3) rotations of the panels at `folds`, and (n, 3) the middle of each pose."""
    pieces = [np.linspace(a, b, _STEPS_BETWEEN, endpoint=False) for a, b in pairwise(folds)]
    fine = np.append(np.concatenate(pieces), folds[-1])
    rotation = mechanism.poses(fine).rotation.swapaxes(0, 1)  # (n, n_panels, 3, 3)
    weight = structure.panel_areas / structure.panel_areas.sum()
    middle = unit(np.array([outline.mean(axis=0) for outline in structure.panel_outlines()]))
    matched = rotation.copy()
    for k in range(len(fine) - 2, -1, -1):
        # Best rotation onto the pose after: of the panels' places, and of the panels themselves.
        after, here = matched[k + 1] @ middle[..., None], rotation[k] @ middle[..., None]
        match = (weight[:, None, None] * (after @ here.swapaxes(1, 2))).sum(axis=0)
        match = match + 0.02 * (weight[:, None, None] * (matched[k + 1] @ rotation[k].swapaxes(1, 2))).sum(axis=0)
        u, _, v = np.linalg.svd(match)
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
        matched[k] = turn @ rotation[k]
    some = matched[::_STEPS_BETWEEN]
    middles = unit((weight[:, None] * (some @ middle[..., None])[..., 0]).sum(axis=1))
    return some, middles
