"""Contact of panels in the plane of a generalized cylinder's cross-section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ori_deploy.design import Structure
from ori_deploy.motion.contact import Contact, Indices, Shapes, polygons
from ori_deploy.motion.poses import Poses
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import Tolerance


@dataclass(frozen=True)
class PlaneContact(Contact[Poses]):
    """Panels of a structure in the plane; all charts are the deployed cross-section itself.

    Attributes
    ----------
    structure
        Whose panels.
    tolerance
        `sagitta` counts here.
    """

    structure: Structure
    tolerance: Tolerance

    @cached_property
    def outlines(self) -> tuple[Points, ...]:
        """Panel polygons, deployed."""
        return self.structure.panel_outlines(self.tolerance.sagitta * self.structure.profile.size)

    @cached_property
    def shapes(self) -> Shapes:
        return polygons(self.outlines)

    @cached_property
    def _boxes(self) -> tuple[Points, Points, Reals]:
        """Per panel: unit axis along its inner face, centre and half extents of its box along it."""
        axis = self.structure.cells.direction.ravel()
        centre = np.empty(len(axis), dtype=complex)
        half = np.empty((len(axis), 2))
        for p, outline in enumerate(self.outlines):
            local = outline * np.conj(axis[p])
            lo = complex(local.real.min(), local.imag.min())
            hi = complex(local.real.max(), local.imag.max())
            centre[p] = 0.5 * (lo + hi) * axis[p]
            half[p] = 0.5 * (hi - lo).real, 0.5 * (hi - lo).imag
        return axis, centre, half

    @property
    def widest_m(self) -> Reals:
        return np.asarray(self._boxes[2].max(axis=1))

    def shrunk(self, depth_m: Reals, panels: Indices) -> Shapes:
        return np.asarray(shapely.buffer(self.shapes[panels], -depth_m))

    def moved(self, poses: Poses, pose: Indices, moving: Indices, fixed: Indices) -> Shapes:
        turn = np.conj(poses.turn[fixed, pose]) * poses.turn[moving, pose]
        shift = np.conj(poses.turn[fixed, pose]) * (poses.shift[moving, pose] - poses.shift[fixed, pose])
        count = np.array([len(o) for o in self.outlines])[moving]
        which = np.repeat(np.arange(len(moving)), count)
        points = np.concatenate([self.outlines[m] for m in moving]) if len(moving) else np.empty(0, complex)
        return np.asarray(
            shapely.polygons(shapely.linearrings(xy(turn[which] * points + shift[which]), indices=which))
        )

    def gaps(self, poses: Poses, pose: Indices, i: Indices, j: Indices) -> Reals:
        axis, centre, half = self._boxes
        ui, uj = poses.turn[i, pose] * axis[i], poses.turn[j, pose] * axis[j]
        between = poses.turn[j, pose] * centre[j] + poses.shift[j, pose]
        between -= poses.turn[i, pose] * centre[i] + poses.shift[i, pose]
        rel = np.conj(ui) * uj
        c, s = np.abs(rel.real), np.abs(rel.imag)
        hi, hj = half[i].T, half[j].T
        d = between * np.conj(ui)
        gap = np.maximum(
            np.abs(d.real) - (hi[0] + c * hj[0] + s * hj[1]), np.abs(d.imag) - (hi[1] + s * hj[0] + c * hj[1])
        )
        d = between * np.conj(uj)
        gap = np.maximum(gap, np.abs(d.real) - (hj[0] + c * hi[0] + s * hi[1]))
        return np.asarray(np.maximum(gap, np.abs(d.imag) - (hj[1] + s * hi[0] + c * hi[1])))

    def distances(self, poses: Poses, pose: Indices, i: Indices, j: Indices) -> Reals:
        return np.asarray(shapely.distance(self.shapes[j], self.moved(poses, pose, i, j)))

    def travel(self, a: Poses, b: Poses, pose: Indices, i: Indices, j: Indices) -> Reals:
        _, centre, half = self._boxes

        def seen(p: Poses) -> tuple[Points, Points]:
            turn = np.conj(p.turn[j, pose]) * p.turn[i, pose]
            return turn, turn * centre[i] + np.conj(p.turn[j, pose]) * (p.shift[i, pose] - p.shift[j, pose])

        turn_a, place_a = seen(a)
        turn_b, place_b = seen(b)
        radius = np.hypot(half[i, 0], half[i, 1])
        # The path between the poses is an arc; a tenth covers what it is longer than its chord.
        return np.asarray(1.1 * (np.abs(place_b - place_a) + np.abs(turn_b - turn_a) * radius))
