"""The short form of the campaign: all of it on the mock, a sample on the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ori_deploy.clock import VirtualClock
from tests.campaign.faults import CAUSES, SEATS, STAGES, Cause
from tests.campaign.grounds import available
from tests.campaign.outcome import Trial
from tests.campaign.soak import soak
from tests.campaign.times import ENOUGH, Judge, worst
from tests.campaign.trial import run_fairly, run_trial
from tests.campaign.watch import LOOK_S, Look, Watch

SEED = 20261126
FAST = ("open", "close")
"""Stages that are tried in the fast suite with every fault; the rest comes with the slow tests."""

FAST_IN_RECOVERY = ("silence", "emergency stop")
"""Faults that are tried in the fast suite on the way back into step."""

ON_MOCK = [cause for cause in CAUSES if "board" not in cause.name]


def _is_fast(cause: Cause, stage: str) -> bool:
    return stage in FAST or stage in cause.stages or (stage == "recover" and cause.name in FAST_IN_RECOVERY)


TRIALS = [
    pytest.param(cause, stage, marks=[pytest.mark.slow] * (not _is_fast(cause, stage)), id=f"{cause.name}-{stage}")
    for cause in ON_MOCK
    for stage in STAGES
    if not cause.stages or stage in cause.stages
]
SAMPLE = (
    ("silence", "open"),
    ("unplugged", "open"),
    ("hardware error", "close"),
    ("low supply", "open"),
    ("silence", "recover"),
    ("slit does not close", "seat"),
    ("board's emergency stop", "close"),
    ("emergency stop", "open"),
)


@pytest.mark.parametrize(("cause", "stage"), TRIALS)
def test_every_fault_in_every_stage_on_the_mock(cause: Cause, stage: str, tmp_path: Path) -> None:
    seed = int(np.random.default_rng([SEED, CAUSES.index(cause), STAGES.index(stage)]).integers(2**31))
    trial = run_trial("mock", cause, stage, seed, tmp_path)
    assert trial is not None
    assert not trial.violations, trial


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "stage"), SAMPLE)
@pytest.mark.parametrize("backend", ["dynamixel", "board"])
def test_some_faults_on_the_others(backend: str, fault: str, stage: str, tmp_path: Path) -> None:
    why = available()[backend]
    if why:
        pytest.skip(f"{backend}: {why}")
    cause = next(cause for cause in CAUSES if cause.name == fault)
    trial = run_fairly(backend, cause, stage, SEED, tmp_path)
    if trial is None:
        pytest.skip(f"{backend} knows no {fault!r}")
    assert not trial.violations, trial


@pytest.mark.slow
def test_minutes_of_deploying_and_stowing_with_faults_leak_nothing() -> None:
    told = soak(300.0, SEED)
    assert not told.violations, told
    assert told.succeeded > 20
    assert len(told.faults) >= 4


def test_a_quantile_is_called_one_only_of_enough_trials() -> None:
    times = [0.001 * k for k in range(1, ENOUGH + 1)]
    assert worst([None, 0.02, 0.04]) == ("0.040", "worst of 2")
    assert worst(times[:-1]) == ("0.999", f"worst of {ENOUGH - 1}")
    assert worst(times) == ("1.000", f"p99.9 of {ENOUGH}")
    assert worst([None]) == ("-", "-")


def test_every_kind_of_seating_fault_is_reached() -> None:
    assert {kind for cause in CAUSES if cause.stages for kind in cause.kinds} == SEATS


@pytest.mark.parametrize(("late_s", "broken", "unjudged"), [(0.0, 1, 0), (0.01, 1, 0), (0.06, 0, 1)])
def test_what_the_machine_may_have_delayed_is_said_and_not_judged(late_s: float, broken: int, unjudged: int) -> None:
    shafts = np.zeros(1)
    watch = Watch(VirtualClock(), lambda: shafts, looks=[Look(0.0, shafts, 0.0), Look(0.2, shafts, late_s)])
    trial = Trial("dynamixel", "silence", "open", 1)
    Judge(trial, watch)("goals at rest", 0.1, 0.05, 0.0)
    assert (len(trial.violations), len(trial.not_judged)) == (broken, unjudged)
    Judge(trial, watch)("goals at rest", 0.04, 0.05, 0.0)
    assert (len(trial.violations), len(trial.not_judged)) == (broken, unjudged)


def test_a_machine_is_late_within_a_while_and_not_in_all() -> None:
    looks = [Look(0.1 * k, None, late_s) for k, late_s in enumerate((0.0, 0.01, 0.02, 0.07, 0.08, 0.09))]
    watch = Watch(VirtualClock(), lambda: np.zeros(1), looks=looks)
    assert watch.held_up_s(0.05) == pytest.approx(0.05)
    assert watch.held_up_s(0.15) == pytest.approx(0.06)


def test_shafts_are_judged_by_where_they_are_and_not_by_what_was_commanded() -> None:
    """On a clock that looks while it sleeps, a shaft is followed until it stays where it is."""
    clock = VirtualClock()
    watch = Watch(clock, lambda: np.array([min(clock.now(), 0.1), 0.0]))
    watch.seeing = True
    watch.begin()
    for _ in range(10):
        watch.sleep_until(clock.now() + 0.04)
    watch.look()
    still, unseen = watch.still_from(np.array([1e-3, 1e-3]))
    assert 0.099 <= still <= 0.1 + LOOK_S
    assert 0.0 < unseen <= LOOK_S + 1e-9
