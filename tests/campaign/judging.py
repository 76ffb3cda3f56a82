"""The promises that hold whatever was injected: how a trial may end, what rests, what goals may do."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.states import Event, State
from tests.campaign.faults import Cause
from tests.campaign.grounds import Ground
from tests.campaign.outcome import Trial

ONE_DEGREE = float(np.deg2rad(1.0))
ROUNDING = 1.05

SEATS = frozenset({Event.ARM, Event.CLEAR_FAULT})
"""What sets the goals to where the shafts are measured."""

NOT_BEGUN = "not begun"
"""How a trial ends in which nothing could be injected."""

ENDED = frozenset(State) - {State.MOVING, State.LATCHING, State.STOPPING}


def judge_ending(trial: Trial, cause: Cause, ground: Ground) -> None:
    controller = ground.controller
    fault = controller.fault
    trial.ended = f"{controller.state}" + (f", {fault.kind} ({fault.thing})" if fault is not None else "")
    if controller.state not in ENDED or controller.under_way:
        trial.violations.append(f"does not end: {controller.state}")
    if fault is None and not cause.passes:
        trial.violations.append(f"no fault was told; {trial.ended}")
    if fault is not None and not cause.may_be(fault.kind, trial.stage):
        trial.violations.append(f"told as {fault}")
    if controller.state is State.DEPLOYED:
        for latch in ground.latches:
            if ground.closed(latch) is False:
                trial.violations.append(f"deployed, and {latch} is open")


def judge_rest(trial: Trial, ground: Ground) -> None:
    """What rests goes on resting: goals do not change, and driven shafts stay."""
    if ground.controller.state is State.DISCONNECTED:
        return
    before, shafts = ground.records[-1].commanded_rad, ground.shafts()
    for _ in range(20):
        ground.controller.step()
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


def judge_goals(trial: Trial, ground: Ground) -> None:
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


def judge_recovery(trial: Trial, ground: Ground) -> None:
    """Cells are brought into step slowly."""
    limit = ground.rig.controller.align_velocity_rad_s * ROUNDING
    fastest = 0.0
    for before, record in pairwise(ground.records):
        if before.stage == record.stage == "recover" and not record.transitions:
            step = np.abs(record.commanded_rad - before.commanded_rad) / np.abs(ground.rig.shaft_per_crease)
            fastest = max(fastest, float(step.max()) / ground.period_s)
    if fastest > limit:
        trial.violations.append(f"cells are brought into step with {fastest:.3f} rad/s; limit: {limit:.3f}")


def judge_uninvited(trial: Trial, ground: Ground, what: str) -> Trial:
    """A fault or a refusal before anything was injected."""
    trial.ended = NOT_BEGUN
    trial.violations.append(f"before anything was injected: {what}")
    judge_machine(trial, ground)
    return trial


def judge_machine(trial: Trial, ground: Ground) -> None:
    """Take broken promises for not judged where the machine alone may have broken them.

    That is where it kept the loop or the simulation waiting for as long as the controller may lose replies.
    """
    if not ground.real_time or not trial.violations:
        return
    ground.watch.look()
    bearable_s = (ground.rig.controller.lost_replies_allowed + 1) * ground.period_s
    late_s = ground.watch.held_up_s(2.0 * bearable_s)
    if late_s > bearable_s:
        trial.not_judged += [f"{told}; the machine was late by {late_s:.3f} s" for told in trial.violations]
        trial.violations.clear()
