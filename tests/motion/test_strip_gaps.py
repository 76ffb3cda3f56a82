"""Gaps under a strip: nothing where panels are one or hinged, closed form at closing vertices, wide at slits."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design.strip import joints_of
from ori_deploy.motion import mechanism_of
from ori_deploy.motion.strip_gaps import strip_gaps
from tests import cones
from tests.shapes import CATALOGUE, structure

FOLDS = np.linspace(0.0, 1.0, 21)


@pytest.mark.parametrize("name", CATALOGUE)
def test_joints_of_a_cylinder_stay_closed_or_part_as_their_kind_says(name: str) -> None:
    s = structure(name)
    joints = joints_of(s)
    gaps = strip_gaps(s, joints, FOLDS)
    assert gaps.shape == (len(joints), len(FOLDS))
    tiny = 1e-5 * s.profile.size
    assert gaps[:, -1] == pytest.approx(0.0, abs=tiny)  # deployed
    for joint, gap in zip(joints, gaps, strict=True):
        assert (gap.max() > tiny) == (joint.kind == "part"), joint.at


@pytest.mark.parametrize("name", ["wing", "ellipse 4", "one cell", "two inner vertices", "peanut 8"])
def test_a_closing_vertex_parts_by_the_chord_about_its_hinge(name: str) -> None:
    s = structure(name)
    joints = [j for j in joints_of(s) if j.kind == "part" and j.before // 4 == j.after // 4]
    assert joints
    angles = mechanism_of(s).four_bars.angles(FOLDS)
    for joint, gap in zip(joints, strip_gaps(s, joints, FOLDS), strict=True):
        cell, k = divmod(joint.before, 4)
        which = 3 if k == 1 else 2
        reach = abs(s.profile.point(joint.s) - s.cells.crease[cell, which])
        turned = s.cells.angle[cell, which] - angles[:, cell, which]
        assert gap == pytest.approx(2.0 * reach * np.sin(0.5 * turned), abs=1e-9 * s.profile.size)


@pytest.mark.parametrize(
    "name", ["circular 6", "circular 6 without wall", "elliptic 6", "wing, apex above", "one cell"]
)
def test_joints_of_a_cone_stay_closed_or_part_as_their_kind_says(name: str) -> None:
    s = cones.cone(name)
    joints = joints_of(s)
    gaps = strip_gaps(s, joints, FOLDS)
    tiny = 1e-5 * s.profile.size
    assert gaps[:, -1] == pytest.approx(0.0, abs=tiny)
    for joint, gap in zip(joints, gaps, strict=True):
        assert (gap.max() > tiny) == (joint.kind == "part"), joint.at
        assert gap.max() <= 2.0  # a chord of the unit sphere


def test_a_narrow_cones_gaps_become_the_cylinders() -> None:
    flat = structure("wing thin")
    far = 400.0
    s = cones.coned("wing thin", (0.3, 0.0, -far), flat.wall_m / far)
    gaps = strip_gaps(flat, joints_of(flat), FOLDS), strip_gaps(s, joints_of(s), FOLDS) * far
    assert [j.at for j in joints_of(s)] == [j.at for j in joints_of(flat)]
    assert np.allclose(*gaps, atol=5e-3 * flat.profile.size)
