"""The short form of the campaign: all of it on the mock, a sample on the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.campaign.faults import CAUSES, STAGES, Cause
from tests.campaign.grounds import available
from tests.campaign.soak import soak
from tests.campaign.trial import run_trial

SEED = 20261126
FAST = ("open", "close")
"""Stages that are tried in the fast suite; the rest comes with the slow tests."""

ON_MOCK = [cause for cause in CAUSES if "board" not in cause.name]
SAMPLE = (
    ("silence", "open"),
    ("unplugged", "open"),
    ("hardware error", "close"),
    ("low supply", "open"),
    ("board's emergency stop", "close"),
    ("emergency stop", "open"),
)


@pytest.mark.parametrize("stage", [pytest.param(s, marks=[pytest.mark.slow] * (s not in FAST)) for s in STAGES])
@pytest.mark.parametrize("cause", ON_MOCK, ids=lambda cause: cause.name)
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
    trial = run_trial(backend, cause, stage, SEED, tmp_path)
    if trial is None:
        pytest.skip(f"{backend} knows no {fault!r}")
    assert not trial.violations, trial


@pytest.mark.slow
def test_minutes_of_deploying_and_stowing_with_faults_leak_nothing() -> None:
    told = soak(300.0, SEED)
    assert not told.violations, told
    assert told.succeeded > 20
    assert len(told.faults) >= 4
