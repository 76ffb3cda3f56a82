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
        From the injection to the first cycle that holds or stops, at 100 Hz; at other rates it is so many cycles.
        None where the cause shows later than it is injected, as a jam does.
    pauses
        Whether the motion is held first.
    stages
        Where alone it can be injected; empty for everywhere.
    """

    name: str
    kinds: frozenset[K]
    passes: bool = False
    notice_s: float | None = None
    pauses: bool = False
    stages: frozenset[str] = frozenset()

    def may_be(self, kind: K, stage: str) -> bool:
        """Whether it may be told as this there: while slits close, what is off the path has names of its own."""
        return kind in self.kinds or (stage == SEATING and kind in SEATS and bool(self.kinds & _OFF_PATH))


def _cause(
    name: str,
    *kinds: K,
    passes: bool = False,
    notice_s: float | None = None,
    pauses: bool = False,
    stages: frozenset[str] = frozenset(),
) -> Cause:
    return Cause(name, frozenset(kinds), passes, notice_s, pauses, stages)


STAGES = (
    "armed", "unlock", "open", "seat", "latch", "deployed", "unlatch", "close", "lock", "free", "recover"
)  # fmt: skip
"""Where a fault is injected; "seat" is the end of "open", where slits close."""

SEATING = "seat"
MOVING = frozenset({"open", "close", "seat"})
RECOVERY = frozenset({"free", "recover"})
AT_REST = frozenset({"armed", "deployed"})

SEATS = frozenset({K.SEATING_EARLY, K.SEATING_LATE, K.SEATING_UNEVEN})

# A device that brakes because goals come late leaves all cells behind the command.
_LATE = (
    K.WATCHDOG, K.OVERRUN, K.LOST_REPLIES, K.HARDWARE_ERROR, K.PATH_TOLERANCE, K.OUT_OF_STEP, K.BUS_ERROR,
    K.COMMAND_REFUSED,
)  # fmt: skip
_OFF_PATH = frozenset({K.PATH_TOLERANCE, K.OUT_OF_STEP, K.GOAL_TOLERANCE, K.HARDWARE_ERROR})
_LATCH = (K.LATCH_TIMEOUT, K.LATCH_SENSOR, K.LATCH_LOST)
_SLITS = frozenset({SEATING})

CAUSES: tuple[Cause, ...] = (
    _cause("one lost reply", passes=True),
    _cause("one corrupt reply", passes=True),
    _cause("two lost in a row", passes=True),
    _cause("failing observer", passes=True),
    _cause("silence", K.LOST_REPLIES, K.HARDWARE_ERROR, notice_s=0.03),
    _cause("garbage", K.LOST_REPLIES, K.HARDWARE_ERROR, notice_s=0.03),
    _cause("unplugged", K.BUS_CLOSED, notice_s=0.01),
    _cause("hardware error", K.HARDWARE_ERROR, notice_s=0.01),
    _cause("jam", *_OFF_PATH, passes=True),
    _cause("reboot", K.RESTARTED, K.TORQUE_LOST, K.LOST_REPLIES, K.BUS_ERROR, notice_s=0.1),
    _cause("heat", K.OVER_TEMPERATURE, notice_s=0.1, pauses=True),
    _cause("low supply", K.LOW_VOLTAGE, K.HARDWARE_ERROR, K.COMMAND_REFUSED, notice_s=0.1, pauses=True),
    _cause("stuck latch", *_LATCH, *_OFF_PATH, passes=True),
    _cause("blind latch", *_LATCH, passes=True),
    _cause("late loop", *_LATE, passes=True),
    _cause("board's emergency stop", K.HARDWARE_ERROR, notice_s=0.1),
    _cause("board hangs", K.PATH_TOLERANCE, K.RESTARTED, K.LOST_REPLIES, K.WATCHDOG, K.BUS_ERROR, K.HARDWARE_ERROR),
    _cause("emergency stop", K.EMERGENCY_STOP, notice_s=0.01),
    _cause("slit touches early", K.SEATING_EARLY, stages=_SLITS),
    _cause("slits touch unevenly", K.SEATING_UNEVEN, stages=_SLITS),
    _cause("slit does not close", K.SEATING_LATE, stages=_SLITS),
)

TIMED = ("silence", "garbage", "hardware error", "jam", "emergency stop")
"""Those that have a limit from the fault to rest, tried often enough for a quantile."""
