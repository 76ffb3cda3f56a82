"""The servos that a rig file describes, with the structure between them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import STOW_POINT, Latch, Rig, load_rig
from ori_deploy.errors import InputError
from sim_backends.dynamixel.spec import BusSpec, PinSpec, ServoSpec
from sim_backends.plant_spec import PlantSpec

Start = Literal["stowed", "deployed"]
FloatArray = NDArray[np.float64]


def spec_from_rig(
    rig: ResolvedRig,
    stowed_rad: ArrayLike,
    deployed_rad: ArrayLike,
    *,
    start: Start = "stowed",
    start_rad: ArrayLike | None = None,
    plant: Path | None = None,
    loads: Path | None = None,
) -> BusSpec:
    """A bus as a rig describes it.

    Parameters
    ----------
    rig
        Fitted to the design, with backend "dynamixel".
    stowed_rad, deployed_rad
        (n_cells, 4) crease angles at the two ends of the motion.
    start
        At which end the structure is found, its lock pins driven home there.
    start_rad
        (n_cells, 4) crease angles to start from instead, no pin driven home.
    plant, loads
        Design file that the servos drive, and loads file of it.
    """
    if rig.wiring is None:
        raise InputError("the rig has no Dynamixel servos", remedy='use one with backend = "dynamixel"')
    ends = {"stowed": rig.to_actuator(stowed_rad), "deployed": rig.to_actuator(deployed_rad)}
    shaft = ends[start] if start_rad is None else rig.to_actuator(start_rad)
    hinges = rig.wiring.hinges
    servos = [
        ServoSpec(
            id=servo.id, model=servo.model.name, start_rad=float(angle), load_nm=0.05 * servo.model.stall_torque_nm
        )
        for servo, angle in zip(hinges, shaft, strict=True)
    ]
    pins = []
    by_id = {latch.id: latch for latch in rig.latches + rig.stow_locks}
    for pin in rig.wiring.pins:
        latch = by_id[pin.latch]
        end: Start = "stowed" if latch.secures == STOW_POINT else "deployed"
        engaged, released = pin.angles_rad
        home = start_rad is None and end == start
        servos.append(
            ServoSpec(
                id=pin.id,
                model=pin.model.name,
                start_rad=engaged if home else released,
                load_nm=0.02 * pin.model.stall_torque_nm,
            )
        )
        pins.append(_pin(pin.id, (engaged, released), latch, rig, ends[end]))
    driven = None
    if plant is not None:
        angles = start_rad if start_rad is not None else stowed_rad if start == "stowed" else deployed_rad
        stall = [servo.model.stall_torque_nm for servo in hinges]
        driven = PlantSpec.of_rig(rig, plant.resolve(), None if loads is None else loads.resolve(), angles, stall)
    return BusSpec(servos=tuple(servos), baud=rig.wiring.settings.baud, pins=tuple(pins), plant=driven)


def _pin(servo_id: int, ends: tuple[float, float], latch: Latch, rig: ResolvedRig, closed: FloatArray) -> PinSpec:
    assert rig.wiring is not None
    reach = rig.latch_reach(latch)
    matters = np.flatnonzero(np.isfinite(reach))
    return PinSpec(
        servo_id=servo_id,
        engaged_rad=ends[0],
        released_rad=ends[1],
        hinge_ids=tuple(rig.wiring.hinges[k].id for k in matters),
        closed_rad=tuple(float(angle) for angle in closed[matters]),
        range_rad=tuple(float(angle) for angle in reach[matters]),
        secures=latch.secures,
    )


def spec_for_files(
    rig_file: Path, plan_file: Path | None, start: Start, plant: Path | None = None, loads: Path | None = None
) -> BusSpec:
    """The bus of a rig file; with a plan its structure stands at one end of the motion, with a plant it pulls back.

    Raises
    ------
    InputError
        A file cannot be used; the rig has another backend; it has templates, and no plan says for what.
    """
    rig = load_rig(rig_file)
    if plan_file is None:
        if plant is not None:
            raise InputError("--plant: where the structure stands", limit="a plan", remedy="add --plan PLAN")
        return _spec_of_rig_alone(rig, rig_file)
    from ori_deploy.files import load_plan  # slow to import, and wanted for this alone

    plan = load_plan(plan_file)
    resolved = resolve_rig(rig, plan.cell_ids, plan.latch_points)
    ends = plan.crease_angles_rad[0], plan.crease_angles_rad[-1]
    return spec_from_rig(resolved, *ends, start=start, plant=plant, loads=loads)


def _spec_of_rig_alone(rig: Rig, source: Path) -> BusSpec:
    """Named servos only, every driven crease folded to 0, no structure between them."""
    if rig.each_cell is not None or not rig.hinge:
        raise InputError(
            "which cells the rig drives", value="only a template, [each_cell]", limit="a plan, or named hinges",
            remedy="add --plan PLAN", source=str(source),
        )  # fmt: skip
    cells = [hinge.cell for hinge in rig.hinge]
    points = sorted({latch.secures for latch in rig.latch if latch.secures != STOW_POINT})
    resolved = resolve_rig(rig, cells, points)
    shut = np.zeros((len(cells), 4))
    spec = spec_from_rig(resolved, shut, shut)
    return replace(spec, pins=())
