"""How fast a motion is stopped, by what stops it. Always along the path, all cells in step."""

from __future__ import annotations

from ori_deploy.deploy.path_variable import Ramp
from ori_deploy.deploy.result import FaultKind

ABORT_S = 0.07
"""From full rate to rest when something is wrong but every cell is still driven and seen."""

ABORT = Ramp.lasting(ABORT_S)

EMERGENCY_CYCLES = 2
"""Cycles from full rate to rest when a cell is not driven, not seen, or somebody pressed the button."""

EMERGENCIES = frozenset(
    {
        FaultKind.EMERGENCY_STOP,
        FaultKind.HARDWARE_ERROR,
        FaultKind.TORQUE_LOST,
        FaultKind.RESTARTED,
        FaultKind.LOST_REPLIES,
        FaultKind.WATCHDOG,
        FaultKind.COMMAND_REFUSED,
        FaultKind.BUS_CLOSED,
        FaultKind.BUS_ERROR,
    }
)
"""Faults after which every further cycle takes the structure farther from where it is known to be."""

PAUSING = frozenset({FaultKind.OVER_TEMPERATURE, FaultKind.LOW_VOLTAGE})
"""What pauses a motion, and only stops it for good when it lasts."""


def stop_ramp(kind: FaultKind, period_s: float) -> Ramp:
    """How the path rate is brought to zero after a fault.

    An emergency's ramp keeps no acceleration limit: a cell that stands still while others go on is worse.
    """
    if kind in EMERGENCIES:
        return Ramp.within_cycles(EMERGENCY_CYCLES, period_s)
    return ABORT
