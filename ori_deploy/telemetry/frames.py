"""What the loop hands to the recorder: plain values, quickly made, with no class of ours in them.

The loop packs; another process formats, compresses and writes. A frame is a list of items in the order of the
log; an item is a tuple whose first entry names its kind:

- ("message", channel, time_s, text): a message, as the JSON that goes into the log.
- ("cycle", ...): a cycle, its arrays as bytes; see `cycle_item`.
- ("health", time_s, temperatures and voltages, valid, errors, torque): arrays as bytes.
- ("latches", time_s, readings): one message per latch.
- ("timing", time_s, ...): the numbers of `/timing`, in order.
- ("tape", time_s, data): a piece of the tape.
- ("dropped", count): so many frames before this one did not get through.
- ("end",): the log is whole.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from ori_deploy.actuators.bus import HealthReadings, LatchReading
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, Fault, MotionResult
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.channel import Frame, Item
from ori_deploy.telemetry.schema import SCHEMA


def message(channel: str, time_s: float, content: dict[str, Any]) -> Item:
    """Something rare, as JSON; null for what is no number."""
    return "message", channel, float(time_s), json.dumps(without_non_finite(content), allow_nan=False)


def without_non_finite(value: Any) -> Any:
    """The same message with null for every number that JSON cannot hold."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: without_non_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_non_finite(item) for item in value]
    return value


class CycleFrames:
    """Turns records into frames; remembers which fault it has told."""

    def __init__(self) -> None:
        self._fault: Fault | None = None
        self.time_s = 0.0

    def frame(self, record: CycleRecord) -> Frame:
        """One cycle and all that happened in it."""
        if math.isfinite(record.time_s):
            self.time_s = float(record.time_s)
        time_s = self.time_s
        items: Frame = [message("/state", time_s, asdict(change)) for change in record.transitions]
        if record.fault is not self._fault:
            self._fault = record.fault
            if record.fault is not None:
                items.append(message("/fault", time_s, asdict(record.fault)))
        items.append(cycle_item(record, time_s))
        if record.health is not None:
            items.append(_health(record.health, time_s))
        if record.latches:
            items.append(("latches", time_s, tuple(_latch(reading) for reading in record.latches)))
        return items


def cycle_item(record: CycleRecord, log_time_s: float) -> Item:
    """A cycle: log time, the scalars of `/cycle`, valid as bytes, and six arrays of n_hinges as float64."""
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
    )
    return (
        "cycle",
        log_time_s,
        int(record.index),
        float(record.time_s),
        float(record.time_s - record.deadline_s),
        str(record.state),
        str(record.stage or ""),
        float(record.path_time_s),
        float(record.rate),
        float(record.rate_limit),
        float(record.commanded_fold),
        int(record.lost_replies),
        int(record.overruns),
        readings.valid.tobytes(),
        numbers.tobytes(),
    )


def _health(health: HealthReadings, time_s: float) -> Item:
    numbers = np.concatenate((health.temperature_c, health.voltage_v)).tobytes()
    return (
        "health",
        time_s,
        numbers,
        health.valid.tobytes(),
        health.hardware_error.tobytes(),
        health.torque_on.tobytes(),
    )


def _latch(reading: LatchReading) -> tuple[str, bool, bool | None, bool, str | None]:
    confirmed = None if reading.confirmed is None else bool(reading.confirmed)
    return reading.id, bool(reading.engaged), confirmed, bool(reading.valid), reading.fault


def result_item(result: MotionResult, time_s: float) -> Item:
    """How a command ended."""
    return message("/result", time_s, asdict(result))


def plan_info(plan: Plan, rig: ResolvedRig, *, plan_sha256: str = "") -> dict[str, Any]:
    """The message of `/plan_info`: what is carried out, on what."""
    return {
        "schema": SCHEMA,
        "version": version("ori-deploy"),
        "design_name": plan.design_name,
        "design_sha256": plan.design_sha256,
        "plan_sha256": plan_sha256,
        "rig_sha256": rig.sha256,
        "rig_file": rig.source or "",
        "seed": rig.mock.seed if rig.backend == "mock" else None,
        "rate_hz": rig.rate_hz,
        "delay_s": rig.delay_s,
        "cell_ids": list(rig.cell_ids),
        "hinge_ids": list(rig.hinge_ids),
        "latch_ids": list(rig.latch_ids),
        "driven_creases": [hinge.crease for hinge in rig.hinges],
        "shaft_per_crease": rig.shaft_per_crease.tolist(),
        "zero_rad": rig.zero_rad.tolist(),
    }
