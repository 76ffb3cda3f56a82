"""The world at a microcontroller's pins that a rig file describes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.mcu.records import ADC_COUNTS
from ori_deploy.actuators.mcu.wiring import Hinge, Latch
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import STOW_POINT, load_rig
from ori_deploy.actuators.rig import Latch as RigLatch
from ori_deploy.errors import InputError
from sim_backends.microcontroller.spec import NOBODY, HingeSpec, LatchKind, LatchSpec, WorldSpec
from sim_backends.plant_spec import PlantSpec

Start = Literal["stowed", "deployed"]
FloatArray = NDArray[np.float64]

SPARE_SPEED = 1.5
"""A servo's own speed, in parts of what the rig lets it do."""

SPARE_SUPPLY = 1.2
NOISE_COUNTS = 0.3


def world_from_rig(
    rig: ResolvedRig,
    stowed_rad: ArrayLike,
    deployed_rad: ArrayLike,
    *,
    start: Start = "stowed",
    start_rad: ArrayLike | None = None,
    seed: int = 1,
    turned: bool = False,
    plant: Path | None = None,
    loads: Path | None = None,
) -> WorldSpec:
    """A world as a rig describes it.

    Parameters
    ----------
    rig
        Fitted to the design, with a microcontroller.
    stowed_rad, deployed_rad
        (n_cells, 4) crease angles at the two ends of the motion: where stow locks and latches close.
    start
        At which end the structure is found, its lock pins driven home there.
    start_rad
        (n_cells, 4) crease angles to start from instead, no pin driven home.
    seed
        Of noise and faults.
    turned
        Whether hinges that are not wired to the microcontroller are in its world all the same, and turned by
        somebody else: latches then close where these stand. Without it, latches are closed wherever they may be.
    plant, loads
        Design file that the servos drive, and loads file of it.
    """
    if rig.mcu is None:
        raise InputError("the rig has no microcontroller", remedy="use one with a table [mcu]", source=rig.source)
    settings = rig.mcu.settings
    ends = {"stowed": rig.to_actuator(stowed_rad), "deployed": rig.to_actuator(deployed_rad)}
    shaft = ends[start] if start_rad is None else rig.to_actuator(start_rad)
    hinges = tuple(_hinge(hinge, float(angle)) for hinge, angle in zip(rig.mcu.hinges, shaft, strict=False))
    if turned and not hinges:
        hinges = tuple(HingeSpec(NOBODY, start_rad=float(angle)) for angle in shaft)
    latches = []
    for latch in rig.mcu.latches:
        end: Start = "stowed" if _of_rig(rig, latch.name).secures == STOW_POINT else "deployed"
        home = start_rad is None and end == start
        latches.append(_latch(latch, rig, ends[end], len(hinges), home=home))
    driven = None
    if plant is not None:
        angles = start_rad if start_rad is not None else stowed_rad if start == "stowed" else deployed_rad
        torque = [actuator.max_torque_nm for actuator in rig.actuators]
        driven = PlantSpec.of_rig(rig, plant.resolve(), None if loads is None else loads.resolve(), angles, torque)
    return WorldSpec(
        plant=driven,
        hinges=hinges,
        latches=tuple(latches),
        supply_v=max(6.0, SPARE_SUPPLY * max(settings.min_supply_v, rig.controller.min_voltage_v)),
        supply_uv_per_count=1e6 * settings.supply_divider * settings.adc_reference_v / ADC_COUNTS,
        seed=seed,
    )


def _hinge(hinge: Hinge, angle_rad: float) -> HingeSpec:
    servo = hinge.servo
    wired = {} if hinge.feedback is None else {
        "feedback_zero_urad": round(1e6 * (servo.feedback_zero_rad or 0.0)),
        "feedback_slope_nrad": round(1e9 * (servo.feedback_rad_per_count or 0.0)),
    }  # fmt: skip
    return HingeSpec(
        output=hinge.output,
        adc=NOBODY if hinge.feedback is None else hinge.feedback,
        start_rad=angle_rad,
        pulse_zero_ns=round(1e3 * servo.pulse_zero_us),
        pulse_slope_ns=round(1e3 * servo.pulse_us_per_rad),
        noise_counts=NOISE_COUNTS,
        max_velocity_rad_s=SPARE_SPEED * hinge.max_velocity_rad_s,
        **wired,
    )


def _latch(latch: Latch, rig: ResolvedRig, closed: FloatArray, n_hinges: int, *, home: bool) -> LatchSpec:
    reach = rig.latch_reach(_of_rig(rig, latch.name))
    matters = [int(k) for k in np.flatnonzero(np.isfinite(reach)) if k < n_hinges]
    pin = (
        {
            "engaged_us": round(latch.drive.engaged_us or 0.0),
            "released_us": round(latch.drive.released_us or 0.0),
            "travel_s": latch.travel_s,
            "start_closed": home,
        }
        if latch.kind == "lock_pin"
        else {}
    )
    return LatchSpec(
        secures=_of_rig(rig, latch.name).secures,
        kind=cast(LatchKind, latch.kind),
        output=NOBODY if latch.output is None else latch.output,
        sensor=NOBODY if latch.sensor is None else latch.sensor,
        sensor_high=latch.drive.sensor_high,
        hinges=tuple(matters),
        closed_rad=tuple(float(closed[k]) for k in matters),
        range_rad=tuple(float(reach[k]) for k in matters),
        **pin,  # type: ignore[arg-type]
    )


def _of_rig(rig: ResolvedRig, name: str) -> RigLatch:
    return next(latch for latch in rig.latches + rig.stow_locks if latch.id == name)


def servo_ids(rig: ResolvedRig) -> tuple[int, ...]:
    """Servos on another bus that turn the hinges, in the order of the hinges; none where the board drives them."""
    return () if rig.wiring is None else tuple(servo.id for servo in rig.wiring.hinges)


def world_for_files(
    rig_file: Path, plan_file: Path, start: Start, plant: Path | None = None, loads: Path | None = None
) -> WorldSpec:
    """The world of a rig file and a plan, the structure at one end of the motion; with a plant it pulls back.

    Raises as `linked_world_for_files`.
    """
    return _for_files(rig_file, plan_file, start, turned=False, plant=plant, loads=loads)[0]


def linked_world_for_files(rig_file: Path, plan_file: Path, start: Start) -> tuple[WorldSpec, tuple[int, ...]]:
    """The same with the hinges that servos on another bus turn, and `servo_ids`.

    Raises
    ------
    InputError
        A file cannot be used, or the rig has no microcontroller.
    """
    world, ids = _for_files(rig_file, plan_file, start, turned=True)
    if not ids:
        raise InputError(
            "--servos: no hinge of the rig is on another bus", remedy="leave it out", source=str(rig_file)
        )
    return world, ids


def _for_files(
    rig_file: Path,
    plan_file: Path,
    start: Start,
    *,
    turned: bool,
    plant: Path | None = None,
    loads: Path | None = None,
) -> tuple[WorldSpec, tuple[int, ...]]:
    from ori_deploy.files import load_plan  # slow to import, and wanted for this alone

    plan = load_plan(plan_file)
    rig = resolve_rig(load_rig(rig_file), plan.cell_ids, plan.latch_points)
    ends = plan.crease_angles_rad[[0, -1]]
    world = world_from_rig(rig, ends[0], ends[1], start=start, turned=turned, plant=plant, loads=loads)
    return world, servo_ids(rig)
