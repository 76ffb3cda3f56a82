"""Writing a flight log: MCAP, JSON messages, compressed in chunks."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.writer import CompressionType, Writer

from ori_deploy.actuators.bus import HealthReadings, LatchReading
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, Fault, MotionResult
from ori_deploy.deploy.states import Transition
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.schema import CHANNELS, SCHEMA, json_schema

CHUNK_BYTES = 32 * 1024  # bounds the work of the cycle that finishes a chunk
FLUSH_EVERY_S = 0.5
"""Of record time: what a crash may cost, at any rate."""

_NON_FINITE = re.compile(r"(?<=[:,\[])-?(?:nan|inf)(?=[,\]}])")
"""Numbers in a cycle's text that JSON has no word for; names are quoted, and never match."""


class LogWriter:
    """A flight log; give it to the controller as an observer.

    It writes to a name of its own beside `path` and renames at `close`, so that `path` never holds half a
    log. After a crash the file under that other name can be read up to about the last second. After a
    failed write nothing more is written, since it would not line up, and `close` says where the rest is.

    Parameters
    ----------
    path
        Where the log will be.
    plan, rig
        What is carried out, on what.
    plan_sha256
        Digest of the plan file.

    Raises
    ------
    OSError
        From here and from every write: the disk is full, say.
    """

    def __init__(self, path: str | Path, plan: Plan, rig: ResolvedRig, *, plan_sha256: str = "") -> None:
        self.path = Path(path)
        self.partial_path = self.path.with_name(f"{self.path.name}.{os.getpid()}.partial")
        self._stream = self.partial_path.open("wb")
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="ori-deploy")
        self._channels = {channel: self._register(channel) for channel in CHANNELS}
        self._format = _cycle_format(len(rig.hinges))
        self._all_valid = _booleans(np.ones(len(rig.hinges), dtype=np.bool_))
        self._flush_due = -math.inf
        self._failure: OSError | None = None
        self._fault: Fault | None = None
        self._closed = False
        self._time_s = 0.0
        self._info = _plan_info(plan, rig, plan_sha256)
        self._info_written = False

    def __call__(self, record: CycleRecord) -> None:
        """Write one cycle and all that happened in it."""
        if math.isfinite(record.time_s):
            self._time_s = record.time_s
        with self._writing():
            self._write_cycle(record)
            if self._time_s >= self._flush_due:
                self._flush_due = self._time_s + FLUSH_EVERY_S
                self._flush()

    def write_result(self, result: MotionResult) -> None:
        """Write how a command ended."""
        with self._writing():
            self._write("/result", asdict(result))
            self._flush()

    def close(self) -> None:
        """Finish the file and give it its name. Safe to call twice.

        Raises
        ------
        OSError
            The log is not whole. The message names the file that holds what was written.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._finish()
            self.partial_path.replace(self.path)
        except OSError as error:
            reason = f"{error.strerror or error}; what was written is in {self.partial_path}"
            raise OSError(error.errno, reason, str(self.path)) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except OSError as failure:
            if error is None:
                raise
            error.add_note(str(failure))  # what ended the run matters more, and this is not to be lost

    def _flush(self) -> None:
        """Finish the chunk and hand it to the operating system: it outlives this process."""
        self._writer.flush()  # type: ignore[no-untyped-call]  # mcap is typed in part

    def _finish(self) -> None:
        """Complete and close the stream. Raises the first failure of all writes."""
        with self._stream:
            if self._failure is not None:
                raise self._failure
            self._writer.finish()  # type: ignore[no-untyped-call]  # mcap is typed in part

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Remember the first failure, and refuse to write after it."""
        if self._failure is not None:
            raise OSError(self._failure.errno, f"the log failed before: {self._failure.strerror}", str(self.path))
        try:
            yield
        except OSError as error:
            self._failure = error
            raise

    def _write_cycle(self, record: CycleRecord) -> None:
        if not self._info_written:
            self._write("/plan_info", self._info)
            self._info_written = True
        for transition in record.transitions:
            self._write_transition(transition)
        if record.fault is not self._fault:
            self._fault = record.fault
            if record.fault is not None:
                self._write("/fault", asdict(record.fault))
        self._emit("/cycle", self._cycle(record))
        if record.health is not None:
            self._write_health(record.health)
        for reading in record.latches or ():
            self._write_latch(reading)

    def _cycle(self, record: CycleRecord) -> bytes:
        readings = record.readings
        numbers = np.concatenate(
            (
                record.folds,
                record.commanded_rad,
                readings.position_rad,
                readings.velocity_rad_s,
                readings.current_a,
                record.time_s - readings.time_s,
            )
        ).tolist()
        text = self._format % (
            record.index,
            record.time_s,
            record.time_s - record.deadline_s,
            record.state,
            record.stage or "",
            record.path_time_s,
            record.rate,
            record.rate_limit,
            record.commanded_fold,
            record.lost_replies,
            record.overruns,
            self._all_valid if readings.valid.all() else _booleans(readings.valid),
            *numbers,
        )
        if "nan" in text or "inf" in text:
            text = _NON_FINITE.sub("null", text)
        return text.encode()

    def _write_transition(self, transition: Transition) -> None:
        self._write("/state", asdict(transition))

    def _write_health(self, health: HealthReadings) -> None:
        message = {
            "time_s": self._time_s,
            "valid": health.valid.tolist(),
            "temperature_c": health.temperature_c.tolist(),
            "voltage_v": health.voltage_v.tolist(),
            "hardware_error": health.hardware_error.tolist(),
            "torque_on": health.torque_on.tolist(),
        }
        self._write("/health", message)

    def _write_latch(self, reading: LatchReading) -> None:
        message = {
            "time_s": self._time_s,
            "id": reading.id,
            "engaged": reading.engaged,
            "confirmed": reading.confirmed,
            "valid": reading.valid,
            "fault": reading.fault,
        }
        self._write("/latch", message)

    def _write(self, channel: str, message: dict[str, Any]) -> None:
        self._emit(channel, json.dumps(_without_non_finite(message), allow_nan=False).encode())

    def _emit(self, channel: str, data: bytes) -> None:
        time_ns = int(self._time_s * 1e9)
        self._writer.add_message(self._channels[channel], log_time=time_ns, data=data, publish_time=time_ns)

    def _register(self, channel: str) -> int:
        schema = self._writer.register_schema(
            name=f"ori_deploy{channel.replace('/', '.')}",
            encoding="jsonschema",
            data=json.dumps(json_schema(channel)).encode(),
        )
        number: int = self._writer.register_channel(topic=channel, message_encoding="json", schema_id=schema)
        return number


def _plan_info(plan: Plan, rig: ResolvedRig, plan_sha256: str) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "version": version("ori-deploy"),
        "design_name": plan.design_name,
        "design_sha256": plan.design_sha256,
        "plan_sha256": plan_sha256,
        "rig_sha256": rig.sha256,
        "rig_file": rig.source or "",
        "seed": rig.mock.seed,
        "rate_hz": rig.rate_hz,
        "cell_ids": list(rig.cell_ids),
        "hinge_ids": list(rig.hinge_ids),
        "latch_ids": list(rig.latch_ids),
        "driven_creases": [hinge.crease for hinge in rig.hinges],
        "shaft_per_crease": rig.shaft_per_crease.tolist(),
        "zero_rad": rig.zero_rad.tolist(),
    }


def _cycle_format(n_hinges: int) -> str:
    """One template for a whole message: a tenth of the time that a general JSON encoder takes."""
    numbers = "[" + ",".join(["%.7g"] * n_hinges) + "]"
    fields = {
        "index": "%d",
        "time_s": "%.6f",
        "lateness_s": "%.6f",
        "state": '"%s"',
        "stage": '"%s"',
        "path_time_s": "%.6f",
        "rate": "%.6g",
        "rate_limit": "%.6g",
        "commanded_fold": "%.8g",
        "lost_replies": "%d",
        "overruns": "%d",
        "valid": "[%s]",
    }
    arrays = ("fold", "commanded_rad", "position_rad", "velocity_rad_s", "current_a", "age_s")
    fields.update(dict.fromkeys(arrays, numbers))
    return "{" + ",".join(f'"{name}":{form}' for name, form in fields.items()) + "}"


def _booleans(values: np.ndarray[Any, np.dtype[np.bool_]]) -> str:
    return ",".join("true" if value else "false" for value in values.tolist())


def _without_non_finite(value: Any) -> Any:
    """The same message with null for every number that JSON cannot hold."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _without_non_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_non_finite(item) for item in value]
    return value
