"""How the structure is, as messages of the network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from ori_deploy.mav.words import Snapshot
from ori_deploy.wire.vehicle import dialect

CREASES_PER_MESSAGE = 16
LATCHES_PER_MESSAGE = 32
NO_PROGRESS = 255
UNKNOWN_MV = 65535
LOCKED_BIT = dialect.MAV_SYS_STATUS_PREARM_CHECK
"""The bit of the health flags that stations show as "not ready to arm"."""

SYSTEM_STATUS: Mapping[int, int] = MappingProxyType(
    {
        dialect.ORI_STRUCTURE_DISCONNECTED: dialect.MAV_STATE_CRITICAL,
        dialect.ORI_STRUCTURE_READY: dialect.MAV_STATE_STANDBY,
        dialect.ORI_STRUCTURE_ARMED: dialect.MAV_STATE_STANDBY,
        dialect.ORI_STRUCTURE_MOVING: dialect.MAV_STATE_ACTIVE,
        dialect.ORI_STRUCTURE_LATCHING: dialect.MAV_STATE_ACTIVE,
        dialect.ORI_STRUCTURE_DEPLOYED: dialect.MAV_STATE_STANDBY,
        dialect.ORI_STRUCTURE_STOWED: dialect.MAV_STATE_STANDBY,
        dialect.ORI_STRUCTURE_HOLD: dialect.MAV_STATE_ACTIVE,
        dialect.ORI_STRUCTURE_STOPPING: dialect.MAV_STATE_ACTIVE,
        dialect.ORI_STRUCTURE_FAULT: dialect.MAV_STATE_CRITICAL,
    }
)
"""HEARTBEAT.system_status of every state."""


def locked(snapshot: Snapshot) -> bool:
    """Whether the structure is deployed and every latch says so."""
    return snapshot.state == dialect.ORI_STRUCTURE_DEPLOYED


def heartbeat(snapshot: Snapshot) -> dialect.MAVLink_message:
    """That the component lives, and in which state."""
    return dialect.MAVLink_heartbeat_message(
        type=dialect.MAV_TYPE_SERVO,
        autopilot=dialect.MAV_AUTOPILOT_INVALID,
        base_mode=dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        custom_mode=snapshot.state,
        system_status=SYSTEM_STATUS[snapshot.state],
        mavlink_version=3,
    )


def health(snapshot: Snapshot) -> dialect.MAVLink_message:
    """Health flags: the vehicle is not to be armed unless the structure is deployed and locked."""
    return dialect.MAVLink_sys_status_message(
        onboard_control_sensors_present=LOCKED_BIT,
        onboard_control_sensors_enabled=LOCKED_BIT,
        onboard_control_sensors_health=LOCKED_BIT if locked(snapshot) else 0,
        load=0,
        voltage_battery=UNKNOWN_MV,
        current_battery=-1,
        battery_remaining=-1,
        drop_rate_comm=0,
        errors_comm=0,
        errors_count1=0,
        errors_count2=0,
        errors_count3=0,
        errors_count4=0,
    )


def structure(snapshot: Snapshot, boot_ms: int) -> dialect.MAVLink_message:
    """The structure in one message."""
    measured = [fold for fold in snapshot.folds if math.isfinite(fold)]
    flags = (
        (dialect.ORI_STRUCTURE_LOCKED, locked(snapshot)),
        (dialect.ORI_STRUCTURE_FAULTED, bool(snapshot.fault)),
        (dialect.ORI_STRUCTURE_AT_REST, snapshot.at_rest),
        (dialect.ORI_STRUCTURE_MAY_FOLD, snapshot.may_fold),
        (dialect.ORI_STRUCTURE_MAY_DEPLOY, snapshot.may_deploy),
        (dialect.ORI_STRUCTURE_FORCED, snapshot.forced),
    )
    return dialect.MAVLink_ori_structure_message(
        time_boot_ms=boot_ms,
        fold=snapshot.fold,
        fold_lowest=min(measured, default=math.nan),
        fold_highest=max(measured, default=math.nan),
        rate=snapshot.rate,
        remaining_s=snapshot.remaining_s,
        worst_tracking=snapshot.worst_tracking_rad,
        flags=sum(bit for bit, is_set in flags if is_set),
        creases=len(snapshot.creases_rad),
        latches=len(snapshot.confirmed),
        latches_confirmed=sum(snapshot.confirmed),
        state=snapshot.state,
        progress=int(snapshot.progress) if math.isfinite(snapshot.progress) else NO_PROGRESS,
        stage=snapshot.stage.encode()[:20],
        fault=snapshot.fault.encode()[:24],
    )


def creases(snapshot: Snapshot, boot_ms: int) -> Iterator[dialect.MAVLink_message]:
    """Angles of all driven creases, in as many messages as they need."""
    angles = snapshot.creases_rad
    for first in range(0, len(angles), CREASES_PER_MESSAGE):
        part = angles[first : first + CREASES_PER_MESSAGE]
        yield dialect.MAVLink_ori_creases_message(
            time_boot_ms=boot_ms,
            angle=[*part, *[math.nan] * (CREASES_PER_MESSAGE - len(part))],
            first=first,
            total=len(angles),
            count=len(part),
        )


def latches(snapshot: Snapshot, boot_ms: int) -> Iterator[dialect.MAVLink_message]:
    """All latches, in as many messages as they need."""
    total = len(snapshot.confirmed)
    for first in range(0, total, LATCHES_PER_MESSAGE):
        here = slice(first, first + LATCHES_PER_MESSAGE)
        yield dialect.MAVLink_ori_latches_message(
            time_boot_ms=boot_ms,
            commanded=_mask(snapshot.commanded[here]),
            confirmed=_mask(snapshot.confirmed[here]),
            sensed=_mask(snapshot.sensed[here]),
            first=first,
            total=total,
            count=len(snapshot.confirmed[here]),
        )


def named_values(snapshot: Snapshot, boot_ms: int) -> Iterator[dialect.MAVLink_message]:
    """What stock stations can plot."""
    values = {
        "ori_fold": snapshot.fold,
        "ori_prog": snapshot.progress,
        "ori_track": math.degrees(snapshot.worst_tracking_rad),
        "ori_latch": float(sum(snapshot.confirmed)),
        "ori_state": float(snapshot.state),
    }
    for name, value in values.items():
        if math.isfinite(value):
            yield dialect.MAVLink_named_value_float_message(
                time_boot_ms=boot_ms, name=name.encode(), value=float(value)
            )


def _mask(bits: Sequence[bool]) -> int:
    return sum(1 << index for index, bit in enumerate(bits) if bit)
