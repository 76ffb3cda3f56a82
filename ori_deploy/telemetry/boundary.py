"""A bus and a journal whose every public call goes through one method: to be taken down, or answered from a tape."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from ori_deploy.actuators.bus import ActuatorBus, FloatArray, HealthReadings, HingeReadings, LatchReading
from ori_deploy.deploy.journal import Entry

ASKS = frozenset(
    {
        *("now", "read_hinges", "read_health", "read_latches", "due_s", "delay_s", "brake_s", "connected"),
        *("limits_effort", "has_journal", "last", "settled", "failure"),
    }
)
"""What only asks; every other call, of bus, clock or journal, is a decision."""


class BoundaryJournal:
    """Hands every call of a journal to `call`."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self._call = call

    @property
    def last(self) -> Entry | None:
        found: Entry | None = self._call("last")
        return found

    @property
    def failure(self) -> str | None:
        found: str | None = self._call("failure")
        return found

    def post(self, entry: Entry) -> None:
        self._call("post", entry)

    def settled(self) -> bool:
        return bool(self._call("settled"))


class BoundaryBus(ActuatorBus):
    """Hands every call to `_call`, and keeps nothing of the base class's: what that promises is kept behind it."""

    def __init__(self, hinge_ids: tuple[str, ...], latch_ids: tuple[str, ...]) -> None:
        self.hinge_ids, self.latch_ids = hinge_ids, latch_ids

    @abstractmethod
    def _call(self, name: str, *arguments: Any) -> Any:
        """What a call of the bus, or a property of it, comes to."""

    @property
    def connected(self) -> bool:
        return bool(self._call("connected"))

    @property
    def delay_s(self) -> float:
        return float(self._call("delay_s"))

    @property
    def brake_s(self) -> float:
        return float(self._call("brake_s"))

    def connect(self) -> None:
        self._call("connect")

    def close(self) -> None:
        self._call("close")

    def enable_torque(self, readings: HingeReadings | None = None) -> FloatArray:
        goals: FloatArray = self._call("enable_torque", readings)
        return goals

    def disable_torque(self) -> None:
        self._call("disable_torque")

    @property
    def limits_effort(self) -> bool:
        return bool(self._call("limits_effort"))

    def limit_effort(self, part: float) -> None:
        self._call("limit_effort", part)

    def unvouched(self) -> tuple[str, ...]:
        return tuple(self._call("unvouched"))

    def vouch(self, shaft_rad: FloatArray, tolerance_rad: FloatArray) -> None:
        self._call("vouch", shaft_rad, tolerance_rad)

    def due_s(self, now: float) -> float:
        return float(self._call("due_s", now))

    def command_hinges(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None = None) -> None:
        self._call("command_hinges", position_rad, velocity_rad_s)

    def brake(self) -> float:
        return float(self._call("brake"))

    def read_hinges(self) -> HingeReadings:
        readings: HingeReadings = self._call("read_hinges")
        return readings

    def read_health(self) -> HealthReadings:
        health: HealthReadings = self._call("read_health")
        return health

    def reset_errors(self) -> None:
        self._call("reset_errors")

    def engage(self, latch_id: str) -> None:
        self._call("engage", latch_id)

    def release(self, latch_id: str) -> None:
        self._call("release", latch_id)

    def read_latches(self) -> tuple[LatchReading, ...]:
        return tuple(self._call("read_latches"))

    # -- nobody comes here: the calls above are the only way in ------------------------------------------

    def _open(self) -> None:
        raise NotImplementedError

    def _close(self) -> None:
        raise NotImplementedError

    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None) -> None:
        raise NotImplementedError

    def _set_torque(self, on: bool) -> None:
        raise NotImplementedError

    def _read_hinges(self) -> HingeReadings:
        raise NotImplementedError

    def _read_health(self) -> HealthReadings:
        raise NotImplementedError

    def _reset_errors(self) -> None:
        raise NotImplementedError

    def _set_latch(self, index: int, engaged: bool) -> None:
        raise NotImplementedError

    def _read_latches(self) -> tuple[LatchReading, ...]:
        raise NotImplementedError
