"""What leads on after a fault, as a command: a fault that names none leaves its reader standing there."""

from __future__ import annotations

from dataclasses import replace

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import Fault, FaultKind

CLEAR_BOARD = "ori-deploy mcu clear-fault"
AGAIN = "give the command again"


def reset_command(rig: ResolvedRig, hinge: int) -> str | None:
    """The command that makes a hinge's actuator forget an error of its own; None where there is none to give."""
    rig_option = f" --rig {rig.source}" if rig.source else ""
    if rig.backend == "mcu":
        return CLEAR_BOARD + rig_option
    return None if rig.wiring is None else f"ori-deploy bus reset-error {rig.wiring.hinges[hinge].id}{rig_option}"


def with_next_step(fault: Fault, rig: ResolvedRig) -> Fault:
    """The same fault, its remedy ending with what leads on.

    A fault ends with the session that found it, and the next one looks for itself; but a board that was told to
    brake, or no longer heard anything, has latched that and keeps it.
    """
    steps = [fault.remedy]
    if rig.backend == "mcu" and CLEAR_BOARD not in fault.remedy:
        steps.append(str(reset_command(rig, 0)))
    if AGAIN not in fault.remedy:
        steps.append(AGAIN)
    remedy = ", then ".join(steps)
    if fault.kind is FaultKind.OUT_OF_STEP:
        remedy += "; cells that it finds out of step: ori-deploy recover"
    return replace(fault, remedy=remedy)
