"""The table of faults: what each is to end in, and how soon."""

from __future__ import annotations

from dataclasses import dataclass

from ori_deploy.deploy.result import FaultKind as K


@dataclass(frozen=True, slots=True)
class Cause:
    """One kind of fault.

    Attributes
    ----------
    name
        As in the grounds' tables.
    kinds
        Faults it may be told as.
    passes
        Whether a command may succeed all the same.
    notice_s
        From the injection to the first cycle that holds or stops; None where the cause shows later than it is
        injected, as a jam does.
    pauses
        Whether the motion is held first.
    """

    name: str
    kinds: frozenset[K]
    passes: bool = False
    notice_s: float | None = None
    pauses: bool = False


def _cause(name: str, *kinds: K, passes: bool = False, notice_s: float | None = None, pauses: bool = False) -> Cause:
    return Cause(name, frozenset(kinds), passes, notice_s, pauses)


_LATE = (K.WATCHDOG, K.OVERRUN, K.LOST_REPLIES, K.HARDWARE_ERROR, K.PATH_TOLERANCE, K.BUS_ERROR, K.COMMAND_REFUSED)
_OFF_PATH = (K.PATH_TOLERANCE, K.OUT_OF_STEP, K.GOAL_TOLERANCE, K.HARDWARE_ERROR)

CAUSES: tuple[Cause, ...] = (
    _cause("one lost reply", passes=True),
    _cause("one corrupt reply", passes=True),
    _cause("failing observer", passes=True),
    _cause("silence", K.LOST_REPLIES, K.HARDWARE_ERROR, notice_s=0.05),
    _cause("garbage", K.LOST_REPLIES, K.HARDWARE_ERROR, notice_s=0.05),
    _cause("unplugged", K.BUS_CLOSED, notice_s=0.1),
    _cause("hardware error", K.HARDWARE_ERROR, notice_s=0.02),
    _cause("jam", *_OFF_PATH, passes=True),
    _cause("reboot", K.RESTARTED, K.TORQUE_LOST, K.LOST_REPLIES, K.BUS_ERROR, notice_s=0.1),
    _cause("heat", K.OVER_TEMPERATURE, notice_s=0.1, pauses=True),
    _cause("low supply", K.LOW_VOLTAGE, K.HARDWARE_ERROR, notice_s=0.1, pauses=True),
    _cause("stuck latch", K.LATCH_TIMEOUT, K.LATCH_SENSOR, K.LATCH_LOST, *_OFF_PATH, passes=True),
    _cause("blind latch", K.LATCH_TIMEOUT, K.LATCH_SENSOR, K.LATCH_LOST, passes=True),
    _cause("late loop", *_LATE, passes=True),
    _cause("board's emergency stop", K.HARDWARE_ERROR, notice_s=0.1),
    _cause("board hangs", K.PATH_TOLERANCE, K.RESTARTED, K.LOST_REPLIES, K.WATCHDOG, K.BUS_ERROR, K.HARDWARE_ERROR),
    _cause("emergency stop", K.EMERGENCY_STOP, notice_s=0.02),
)

STAGES = ("armed", "unlock", "open", "latch", "deployed", "unlatch", "close", "lock")
"""Where a fault is injected."""

MOVING = frozenset({"open", "close"})
AT_REST = frozenset({"armed", "deployed"})
