"""Where panels are, over the whole fold, seen from the end of a crease: what a horn about it would meet.

A hub is round about its crease, so it is at rest in both panels there and in all that are bonded to them; every other
panel passes it, and is cut along its way. To measure distances, panels are cut by the plane of the hub's floor: on a
cylinder that is their cross-section, on a cone their rays are straight lines there, too. All cells fold in step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import Structure
from ori_deploy.export.kernel import Body, joined, swept, upright
from ori_deploy.export.rulings import PanelShape
from ori_deploy.files import Design
from ori_deploy.motion import mechanism_of
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

FOLDS = np.linspace(0.0, 1.0, 41)
"""From flat to deployed."""
_AHEAD = 1e-6
"""Least cosine between a ray and the crease: what points away is put very far off."""


@dataclass(frozen=True)
class Hub:
    """A horn's place, in the design's own frame.

    Attributes
    ----------
    panel
        The panel it is screwed to.
    base, along
        (3,) a point of the crease and its direction.
    s
        Where on the crease the hub's floor is.
    """

    panel: int
    base: Vectors
    along: Vectors
    s: float


@dataclass(frozen=True)
class Sweep:
    """All panels at `FOLDS`.

    Attributes
    ----------
    design, shapes
        What moves, and its panels' sections.
    """

    design: Design
    shapes: Mapping[int, PanelShape]

    @cached_property
    def _poses(self) -> Any:
        return mechanism_of(self.design.structure, self.design.unit_m).poses(FOLDS)

    def outline(self, panel: int, hub: Hub) -> Reals:
        """(n_folds, n, 2) a panel's section round a hub, metres: the hub's axis is the origin."""
        return self._flat(self.shapes[panel].points, panel, hub)

    def place(self, other: Hub, hub: Hub) -> Reals:
        """(n_folds, 2) where another hub is, seen from a hub."""
        on_plane = isinstance(self.design.structure, Structure)
        return self._flat(other.base[None, :2] if on_plane else other.along[None], other.panel, hub)[:, 0]

    def way(self, bar: Body, panel: int, hub: Hub, near: NDArray[np.bool_]) -> Body:
        """What a bar that turns with a hub's panel sweeps of another panel, round folds (n_folds,) that are near."""
        moved = [bar.transform(matrix[:3]) for matrix in self._seen_by(panel, hub.panel)]
        pairs = np.flatnonzero(near[:-1] | near[1:])
        return joined([swept(moved[k], moved[k + 1]) for k in pairs])

    def _seen_by(self, panel: int, other: int) -> Reals:
        """(n_folds, 4, 4) motions of another panel, seen by a panel that does not move."""
        poses = self._poses
        out = np.tile(np.eye(4), (len(FOLDS), 1, 1))
        if not isinstance(self.design.structure, Structure):
            out[:, :3, :3] = np.einsum("fji,fjk->fik", poses.rotation[panel], poses.rotation[other])
            return out
        turn = np.conj(poses.turn[panel]) * poses.turn[other]
        shift = np.conj(poses.turn[panel]) * (poses.shift[other] - poses.shift[panel])
        out[:, 0, 0], out[:, 1, 1], out[:, 1, 0], out[:, 0, 1] = turn.real, turn.real, turn.imag, -turn.imag
        out[:, 0, 3], out[:, 1, 3] = shift.real, shift.imag
        return out

    def _flat(self, points: Reals, panel: int, hub: Hub) -> Reals:
        poses = self._poses
        if isinstance(self.design.structure, Structure):
            z = points[:, 0] + 1j * points[:, 1]
            there = poses.turn[panel][:, None] * z + poses.shift[panel][:, None]
            seen = np.conj(poses.turn[hub.panel])[:, None] * (there - poses.shift[hub.panel][:, None])
            away = seen - complex(hub.base[0], hub.base[1])
            return np.stack([away.real, away.imag], axis=-1)
        there = np.einsum("fij,nj->fni", poses.rotation[panel], points)
        seen = np.einsum("fji,fnj->fni", poses.rotation[hub.panel], there)
        right, up = upright(hub.along)
        ahead = np.maximum(seen @ hub.along, _AHEAD)
        return np.asarray(hub.s * np.stack([seen @ right, seen @ up], axis=-1) / ahead[..., None])


def distances(outline: Reals) -> Reals:
    """(n_folds,) how far polygons (n_folds, n, 2) are from the origin; 0 where they hold it."""
    a, b = outline, np.roll(outline, -1, axis=1)
    side = b - a
    size = np.einsum("fni,fni->fn", side, side)
    share = -np.einsum("fni,fni->fn", a, side) / np.where(size > 0.0, size, 1.0)
    nearest = np.linalg.norm(a + np.clip(share, 0.0, 1.0)[..., None] * side, axis=-1).min(axis=1)
    # How often the outline crosses the half-line to the right of the origin.
    crosses = (a[..., 1] > 0.0) != (b[..., 1] > 0.0)
    rise = np.where(crosses, side[..., 1], 1.0)
    right = crosses & (a[..., 0] - a[..., 1] * side[..., 0] / rise > 0.0)
    return np.where(right.sum(axis=1) % 2 == 1, 0.0, nearest)
