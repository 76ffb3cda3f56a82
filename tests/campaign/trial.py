"""One injected fault: bring the structure to a stage, spoil something, and see that every promise is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ori_deploy.actuators.bus import BusError
from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import CycleRecord, StartRefused
from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.errors import OriDeployError
from ori_deploy.motion.recovery import Recovery
from tests.campaign.faults import MOVING, RECOVERY, SEATING, Cause
from tests.campaign.grounds import DEPLOYED, GROUNDS, STOWED, Ground, Start
from tests.campaign.judging import (
    NOT_BEGUN,
    judge_ending,
    judge_goals,
    judge_machine,
    judge_recovery,
    judge_rest,
    judge_uninvited,
)
from tests.campaign.outcome import Trial
from tests.campaign.times import judge_times

PATIENCE_S = 15.0
WATCHED_S, SHORTLY_S = 0.6, 0.2
"""How long what rests is looked at, and where only times matter."""

RAISED = "raised"
"""How a trial ends that nobody could carry out."""

ATTEMPTS = 3
"""At a trial that the machine does not let anybody judge."""

BEFORE_SLITS, AMONG_SLITS = 0.85, (0.905, 0.95)
"""Fold where a motion into the seating begins, and those between which something is spoilt."""

HALF_WAY = 0.35
"""Where a motion begins that is then stopped and pushed out of step."""

PUSH = (0.15, 0.35)
"""Fold by which a cell is pushed away."""

OWN = ("failing observer", "emergency stop")
"""Faults that no ground has to know."""


def run_trial(
    backend: str, cause: Cause, stage: str, seed: int, folder: Path, *, only_times: bool = False
) -> Trial | None:
    """One trial; None where the backend knows no such fault, or it cannot be injected in this stage.

    With `only_times` it begins near where something is spoilt, and ends once it rests.
    """
    if cause.stages and stage not in cause.stages:
        return None
    trial = Trial(backend, cause.name, stage, seed)
    generator = np.random.default_rng(seed)
    with GROUNDS[backend](folder, _start(stage, generator, only_times), seed) as ground:
        if cause.name not in ground.faults and cause.name not in OWN:
            return None
        hinge = int(generator.integers(ground.n))
        if ground.real_time:
            ground.watch.begin()
        try:
            reached = _reach(ground, stage, hinge, generator)
        except (BusError, IllegalCommand, StartRefused) as refused:
            return judge_uninvited(trial, ground, repr(refused))
        if ground.controller.fault is not None:
            return judge_uninvited(trial, ground, str(ground.controller.fault))
        if not reached and stage in MOVING | {"recover"}:
            return judge_uninvited(trial, ground, "it never got there")
        if not reached:
            return None  # a stage that this backend passes at once
        if not ground.real_time:  # there, any moment between two cycles is as likely as any other by itself
            ground.watch.sleep_until(ground.watch.now() + generator.uniform(0.0, ground.period_s))
        before = len(ground.records)
        ground.watch.seeing = True
        if ground.real_time:
            ground.watch.look()
        else:
            ground.watch.begin()
        injected_s = ground.watch.now()
        _inject(ground, cause.name, hinge)
        _let_it_end(ground, SHORTLY_S if only_times else WATCHED_S)
        ground.watch.look()
        ground.watch.seeing = False
        judge_times(trial, cause, ground, ground.records[before:], injected_s)
        judge_ending(trial, cause, ground)
        if not only_times:
            judge_rest(trial, ground)
            _go_on(trial, ground)
        judge_goals(trial, ground)
        judge_recovery(trial, ground)
        judge_machine(trial, ground)
    return trial


def run_fairly(backend: str, cause: Cause, stage: str, seed: int, folder: Path) -> Trial | None:
    """The trial; again, some times, where nobody can tell a broken promise from a machine that was late itself."""
    before: list[str] = []
    for attempt in range(ATTEMPTS):
        again = folder / str(attempt)
        again.mkdir()
        trial: Trial | None
        try:
            trial = run_trial(backend, cause, stage, seed, again)
        except OriDeployError as raised:
            trial = Trial(backend, cause.name, stage, seed, ended=RAISED, violations=[f"raised {raised!r}"])
        if trial is None:
            return None
        trial.attempts_before = list(before)
        if not trial.not_judged and trial.ended not in (RAISED, NOT_BEGUN):
            break
        before += trial.not_judged + trial.violations
    return trial


# -- doing it


def _start(stage: str, generator: np.random.Generator, near: bool) -> Start:
    if stage == SEATING:
        return Start(BEFORE_SLITS, slits=True)
    if stage in RECOVERY:
        return Start(HALF_WAY)
    if near and stage in MOVING:
        return Start(float(generator.uniform(0.1, 0.6) if stage == "open" else generator.uniform(0.4, 0.9)))
    return DEPLOYED if stage in ("unlatch", "close", "lock") else STOWED


def _reach(ground: Ground, stage: str, hinge: int, generator: np.random.Generator) -> bool:
    controller = ground.controller
    _steps(ground, 5)
    if stage == "armed":
        return True
    if stage in RECOVERY:
        return _reach_recovery(ground, stage, hinge, generator)
    if stage in ("unlatch", "close", "lock"):
        controller.stow()
    else:
        controller.deploy()
    if stage == "deployed":
        return controller.run().succeeded
    return _reach_stage(ground, stage, generator)


def _reach_stage(ground: Ground, stage: str, generator: np.random.Generator) -> bool:
    wanted = "open" if stage == SEATING else stage
    fold = _fold_within(stage, float(ground.records[-1].folds.mean()), generator)
    while ground.controller.under_way:
        record = ground.controller.step()
        there = record.stage == wanted
        if stage in MOVING:
            at = record.folds.min() if stage == SEATING else record.commanded_fold  # a board's goals are far ahead
            there = there and (at >= fold if wanted == "open" else at <= fold) and record.rate != 0.0
        if there:
            return True
    return False


def _fold_within(stage: str, begun: float, generator: np.random.Generator) -> float:
    """Where something is spoilt, farther on than the motion begins; of no matter in stages that rest."""
    if stage == "close":
        return float(generator.uniform(0.1, min(0.9, begun - 0.05)))
    low, high = AMONG_SLITS if stage == SEATING else (max(0.1, begun + 0.05), 0.9)
    return float(generator.uniform(low, max(low, high)))


def _reach_recovery(ground: Ground, stage: str, hinge: int, generator: np.random.Generator) -> bool:
    """Stopped on its way, a cell pushed out of step by hand, a pin driven in where it does not belong.

    Mostly it is the hinge of the fault that is pushed: the others have no way to go.
    """
    controller = ground.controller
    controller.deploy()
    while controller.under_way and not (controller.step().commanded_fold > HALF_WAY + 0.05):
        pass
    if controller.fault is not None:
        return False
    controller.stop()
    if controller.run().fault is not None:
        return False
    controller.disarm()
    _steps(ground, 5)  # a board goes on with pulses for some frames
    cell = hinge if generator.random() < 0.75 else int(generator.integers(ground.n))
    _push(ground, cell, float(generator.choice([-1.0, 1.0]) * generator.uniform(*PUSH)))
    if "pin" in ground.bus.latch_ids:
        ground.bus.engage("pin")
    _steps(ground, 10)  # feedback follows the hand
    controller.arm()
    _steps(ground, 5)
    target, begun = recover(ground), ground.records[-1].folds[cell]
    if stage == "free":
        return controller.state is State.LATCHING
    part = float(generator.uniform(0.2, 0.8))
    while controller.under_way:
        record = controller.step()
        if record.stage == stage and abs(record.folds[cell] - target) < part * abs(begun - target):
            return True
    return False


def _push(ground: Ground, cell: int, by_fold: float) -> None:
    """Turn a limp hinge by as much as its cell needs to be farther open by a fold."""
    here = ground.shafts()
    table = PathTable.build(ground.plan, ground.rig)
    fold = float(Localiser(table).folds(here)[cell])
    there = np.interp(fold + by_fold, table.fold, table.shaft_rad[:, cell])
    ground.push(cell, float(there - here[cell]))


def recover(ground: Ground) -> float:
    """Command a way back into step, straight to the middle of where cells stand; nothing is in it here."""
    folds = np.clip(ground.controller.step().folds, 0.0, 1.0)
    target = float(np.median(folds))
    ground.controller.recover(Recovery(np.stack([folds, np.full_like(folds, target)]), 2))
    return target


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
    """So many cycles, as long as there is a link."""
    for _ in range(count):
        if ground.controller.state is not State.DISCONNECTED:
            ground.controller.step()


def _let_it_end(ground: Ground, watched_s: float) -> None:
    """Until nothing is under way, and a while longer: what rests may still be told of a fault."""
    end = ground.watch.now() + PATIENCE_S
    until = ground.watch.now() + watched_s
    while ground.watch.now() < end and (ground.controller.under_way or ground.watch.now() < until):
        ground.controller.step()


def _go_on(trial: Trial, ground: Ground) -> None:
    """With the cause gone, the fault cleared and cells brought into step it goes on."""
    controller = ground.controller
    ground.heal()
    last = "nothing was tried"
    for _ in range(6):
        try:
            _bring_to_work(ground)
            try:
                _begin(ground)
            except StartRefused as refused:
                if "ori-deploy recover" not in str(refused):
                    raise
                last = f"{refused}"
                recover(ground)
        except StartRefused as refused:
            last = str(refused)
            ground.watch.sleep_until(ground.watch.now() + 0.5)
            continue
        except (BusError, IllegalCommand) as refused:
            last = f"{type(refused).__name__}: {refused}"
            ground.watch.sleep_until(ground.watch.now() + 0.5)
            continue
        result = controller.run()
        if result.succeeded and controller.state in (State.DEPLOYED, State.STOWED):
            return
        last = str(result.fault) if result.fault is not None else last
    trial.violations.append(f"does not go on after healing and clearing: {last}")


def _bring_to_work(ground: Ground) -> None:
    controller = ground.controller
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


def _begin(ground: Ground) -> None:
    controller = ground.controller
    if controller.state in (State.ARMED, State.STOWED):
        controller.deploy()
    elif controller.state is State.DEPLOYED:
        controller.stow()
    else:
        raise IllegalCommand(controller.state, "going on")
