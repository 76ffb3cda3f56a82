"""How far the panels under a strip separate while a structure folds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.design.cone import ConeStructure
from ori_deploy.design.strip import Joint
from ori_deploy.design.structure import Structure
from ori_deploy.motion.cone_mechanism import ConeMechanism
from ori_deploy.motion.mechanism import Mechanism
from ori_deploy.profiles.profile import Reals


def strip_gaps(structure: Structure | ConeStructure, joints: Sequence[Joint], fold: ArrayLike) -> Reals:
    """Distance between the two places into which a joint's place on the outer surface separates.

    Parameters
    ----------
    structure
        What folds.
    joints
        Of its outer surface (`design.strip.joints_of`).
    fold
        (n_poses,) in step, or (n_poses, n_cells).

    Returns
    -------
    (n_joints, n_poses): metres; on a cone the straight distance per metre from the apex.
    """
    s = np.array([joint.s for joint in joints])
    before, after = np.array([joint.before for joint in joints]), np.array([joint.after for joint in joints])
    if isinstance(structure, ConeStructure):
        turn = ConeMechanism(structure).poses(fold).rotation
        apart = (turn[after] - turn[before]) @ structure.profile.point(s)[:, None, :, None]
        return np.asarray(np.linalg.norm(apart[..., 0], axis=-1))
    poses, place = Mechanism(structure).poses(fold), structure.profile.point(s)[:, None]
    apart_m = (poses.turn[after] - poses.turn[before]) * place + poses.shift[after] - poses.shift[before]
    return np.asarray(np.abs(apart_m))
