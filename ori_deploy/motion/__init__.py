"""Motion: kinematics, poses, interference, step tolerance, timing, plans."""

from __future__ import annotations

from ori_deploy.motion.fourbar import FourBars
from ori_deploy.motion.interference import Collision, Interference
from ori_deploy.motion.plan import CREASES, MotionCheck, Plan
from ori_deploy.motion.planner import plan_motion
from ori_deploy.motion.poses import Mechanism, Poses
from ori_deploy.motion.step_tolerance import StepTolerance, step_tolerance

__all__ = [
    "CREASES",
    "Collision",
    "FourBars",
    "Interference",
    "Mechanism",
    "MotionCheck",
    "Plan",
    "Poses",
    "StepTolerance",
    "plan_motion",
    "step_tolerance",
]
