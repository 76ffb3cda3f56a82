"""One injected fault: bring the structure to a stage, spoil something, and see that every promise is kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from ori_deploy.actuators.bus import BusError
from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import CycleRecord, StartRefused
from ori_deploy.deploy.states import Event, IllegalCommand, State
from tests.campaign.faults import AT_REST, MOVING, Cause
from tests.campaign.grounds import GROUNDS, Ground

ONE_DEGREE = float(np.deg2rad(1.0))
PATIENCE_S = 15.0
WATCHED_S = 0.6
"""How long what rests is looked at."""

SEATS = frozenset({Event.ARM, Event.CLEAR_FAULT})
"""What sets the goals to where the shafts are measured."""

ENDED = frozenset(State) - {State.MOVING, State.LATCHING, State.STOPPING}


@dataclass
class Trial:
    """What came of it.

    Attributes
    ----------
    noticed_s, rested_s
        From the injection to the first cycle that holds or stops, and from there to rest; None where nothing was.
    ended
        State and fault, in words.
    violations
        Broken promises, in words.
    """

    backend: str
    fault: str
    stage: str
    seed: int
    noticed_s: float | None = None
    rested_s: float | None = None
    ended: str = ""
    violations: list[str] = field(default_factory=list)


def run_trial(backend: str, cause: Cause, stage: str, seed: int, folder: Path) -> Trial | None:
    """One trial; None where the backend knows no such fault."""
    trial = Trial(backend, cause.name, stage, seed)
    generator = np.random.default_rng(seed)
    start = "deployed" if stage in ("unlatch", "close", "lock") else "stowed"
    with GROUNDS[backend](folder, start, seed) as ground:
        if cause.name not in ground.faults and cause.name not in ("failing observer", "emergency stop"):
            return None
        if not _reach(ground, stage, generator):
            return None  # a stage that this backend passes at once
        before, injected_s = len(ground.records), ground.clock.now()
        _inject(ground, cause.name, int(generator.integers(ground.n)))
        _let_it_end(ground)
        _judge_times(trial, cause, ground, ground.records[before:], injected_s, stage)
        _judge_ending(trial, cause, ground)
        _judge_rest(trial, ground)
        _go_on(trial, ground)
        _judge_goals(trial, ground)
    return trial


# -- doing it


def _reach(ground: Ground, stage: str, generator: np.random.Generator) -> bool:
    controller = ground.controller
    if stage == "armed":
        _steps(ground, 5)
        return True
    if stage in ("unlatch", "close", "lock"):
        controller.stow()
    else:
        controller.deploy()
    if stage == "deployed":
        return controller.run().succeeded
    fold = float(generator.uniform(0.1, 0.9))
    while controller.under_way:
        record = controller.step()
        there = record.stage == stage
        if stage in MOVING:
            passed = record.commanded_fold >= fold if stage == "open" else record.commanded_fold <= fold
            there = there and passed and record.rate != 0.0
        if there:
            return True
    return False


def _inject(ground: Ground, name: str, hinge: int) -> None:
    if name == "emergency stop":
        ground.controller.emergency_stop("the campaign")
    elif name == "failing observer":

        def full(_: CycleRecord) -> None:
            raise OSError(28, "No space left on device")

        ground.controller.add_observer(full)
    else:
        ground.faults[name](hinge)


def _steps(ground: Ground, count: int) -> None:
    for _ in range(count):
        if ground.controller.state is not State.DISCONNECTED:
            ground.controller.step()


def _let_it_end(ground: Ground) -> None:
    """Until nothing is under way, and a while longer: what rests may still be told of a fault."""
    end = ground.clock.now() + PATIENCE_S
    until = ground.clock.now() + WATCHED_S
    while ground.clock.now() < end and (ground.controller.under_way or ground.clock.now() < until):
        ground.controller.step()


def _go_on(trial: Trial, ground: Ground) -> None:
    """With the cause gone and the fault cleared it goes on, or says in a typed refusal why not."""
    controller = ground.controller
    ground.heal()
    last = "nothing was tried"
    for _ in range(6):
        try:
            for state, step in (
                (State.FAULT, controller.clear_fault),
                (State.DISCONNECTED, controller.connect),
                (State.FAULT, controller.clear_fault),
                (State.READY, controller.arm),
            ):
                if controller.state is state:
                    step()
                    _steps(ground, 3)  # what an actuator has latched itself shows by looking
            if controller.state is State.HOLD:
                controller.stop()
                controller.run()
            _steps(ground, 10)
            if controller.state in (State.ARMED, State.STOWED):
                controller.deploy()
            elif controller.state is State.DEPLOYED:
                controller.stow()
            else:
                raise IllegalCommand(controller.state, "going on")
        except StartRefused as refused:
            if "off the path" in str(refused) or "out of step" in str(refused):
                return  # as a jam leaves it: told, and nothing moved
            last = str(refused)
            ground.clock.sleep_until(ground.clock.now() + 0.5)
            continue
        except (BusError, IllegalCommand) as refused:
            last = f"{type(refused).__name__}: {refused}"
            ground.clock.sleep_until(ground.clock.now() + 0.5)
            continue
        result = controller.run()
        if result.succeeded:
            return
        last = str(result.fault)
    trial.violations.append(f"does not go on after healing and clearing: {last}")


# -- judging it


def _stops(record: CycleRecord) -> bool:
    return record.state in (State.FAULT, State.HOLD)


def _judge_times(
    trial: Trial, cause: Cause, ground: Ground, after: list[CycleRecord], injected_s: float, stage: str
) -> None:
    first = next((k for k, record in enumerate(after) if _stops(record)), None)
    if first is None:
        return
    trial.noticed_s = after[first].time_s - injected_s
    resting = next((record for record in after[first:] if record.rate == 0.0), None)
    if resting is None:
        trial.violations.append("never came to rest")
        return
    trial.rested_s = resting.time_s - after[first].time_s
    if ground.real_time:
        return  # what else the machine does is in these times: they are told, not judged
    period = 1.0 / ground.rig.rate_hz
    if cause.notice_s is not None and stage not in AT_REST and trial.noticed_s > cause.notice_s + period:
        trial.violations.append(f"noticed after {trial.noticed_s:.3f} s; limit: {cause.notice_s:g} s and a cycle")
    allowed = ground.rig.controller.hold_ramp_s * 1.3 if cause.pauses else 0.1
    if trial.rested_s > allowed + 1e-9:
        trial.violations.append(f"at rest {trial.rested_s:.3f} s after it was noticed; limit: {allowed:g} s")


def _judge_ending(trial: Trial, cause: Cause, ground: Ground) -> None:
    controller = ground.controller
    fault = controller.fault
    trial.ended = f"{controller.state}" + (f", {fault.kind} ({fault.thing})" if fault is not None else "")
    if controller.state not in ENDED or controller.under_way:
        trial.violations.append(f"does not end: {controller.state}")
    if fault is None and not cause.passes:
        trial.violations.append(f"no fault was told; {trial.ended}")
    if fault is not None and fault.kind not in cause.kinds:
        trial.violations.append(f"told as {fault}")
    if controller.state is State.DEPLOYED:
        for latch in ground.latches:
            if ground.closed(latch) is False:
                trial.violations.append(f"deployed, and {latch} is open")


def _judge_rest(trial: Trial, ground: Ground) -> None:
    """What rests goes on resting: goals do not change, and driven shafts stay."""
    if ground.controller.state is State.DISCONNECTED:
        return
    before, shafts = ground.records[-1].commanded_rad, ground.shafts()
    _steps(ground, 20)
    after = ground.records[-1].commanded_rad
    if not np.array_equal(before, after, equal_nan=True):
        trial.violations.append(f"goals change at rest, by {np.nanmax(np.abs(after - before)):.2g} rad")
    moved = np.abs(ground.shafts() - shafts) / np.abs(ground.rig.shaft_per_crease)
    if moved.max() > 2.0 * ONE_DEGREE:
        trial.violations.append(f"a crease moves at rest, by {np.rad2deg(moved.max()):.1f} deg")


def _angles(ground: Ground, goals: Iterable[np.ndarray]) -> np.ndarray:
    """(n, n_cells, 4) angles of all creases that goals mean."""
    localiser, plan = Localiser(PathTable.build(ground.plan, ground.rig)), ground.plan
    folds = np.array([localiser.folds(goal) for goal in goals])
    out = np.empty((*folds.shape, 4))
    for c in range(folds.shape[1]):
        for k in range(4):
            out[:, c, k] = np.interp(folds[:, c], plan.fold, plan.crease_angles_rad[:, c, k])
    return out


def _judge_goals(trial: Trial, ground: Ground) -> None:
    """No crease, driven or not, is told to jump: beyond its speed by a degree; and none moves unless armed."""
    known = [record for record in ground.records if np.isfinite(record.commanded_rad).all()]
    if len(known) < 2:
        return
    peak = np.abs(ground.plan.crease_rates_rad_s).max(axis=0) / ground.rig.rate_hz
    steps = np.abs(np.diff(_angles(ground, [record.commanded_rad for record in known]), axis=0)) - peak
    for step, record in zip(steps, known[1:], strict=True):
        seated = SEATS & {transition.event for transition in record.transitions}
        if seated and record.readings.valid.all():  # goals are where the shafts stand: nothing moves by it
            step = np.abs(record.commanded_rad - record.readings.position_rad) / np.abs(ground.rig.shaft_per_crease)
        if not seated and step.max() > ONE_DEGREE:
            trial.violations.append(f"a goal jumps by {np.rad2deg(step.max()):.2f} deg in cycle {record.index}")
        if seated and step.max() > ONE_DEGREE:
            trial.violations.append(f"torque goes on {np.rad2deg(step.max()):.2f} deg off in cycle {record.index}")
    for before, record in pairwise(ground.records):
        unarmed = record.state in (State.READY, State.DISCONNECTED)
        if unarmed and np.isfinite(record.commanded_rad).all() and record.rate != 0.0:
            trial.violations.append(f"a rate of {record.rate:g} in state {record.state}")
        if record.state is State.DEPLOYED and before.state is not State.DEPLOYED and record.latches is None:
            trial.violations.append("deployed without a look at the latches")
