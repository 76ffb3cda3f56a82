"""Motion: kinematics, poses, interference, step tolerance, timing, plans."""

from __future__ import annotations

from ori_deploy.motion.cone_mechanism import ConeMechanism
from ori_deploy.motion.fourbar import FourBars
from ori_deploy.motion.interference import Collision, Interference
from ori_deploy.motion.mechanism import BEFORE_CREASE, NEXT_CREASE, Linkage, Mechanism
from ori_deploy.motion.mechanism_of import mechanism_of
from ori_deploy.motion.plan import CREASES, MotionCheck, Plan, SpanStage
from ori_deploy.motion.planner import plan_motion
from ori_deploy.motion.poses import ConePoses, Poses
from ori_deploy.motion.spanwise import SpanFolding
from ori_deploy.motion.spanwise_plan import plan_span, span_limits
from ori_deploy.motion.spherical_fourbar import SphericalFourBars
from ori_deploy.motion.step_tolerance import StepTolerance, step_tolerance

__all__ = [
    "BEFORE_CREASE",
    "CREASES",
    "NEXT_CREASE",
    "Collision",
    "ConeMechanism",
    "ConePoses",
    "FourBars",
    "Interference",
    "Linkage",
    "Mechanism",
    "MotionCheck",
    "Plan",
    "Poses",
    "SpanFolding",
    "SpanStage",
    "SphericalFourBars",
    "StepTolerance",
    "mechanism_of",
    "plan_motion",
    "plan_span",
    "span_limits",
    "step_tolerance",
]
