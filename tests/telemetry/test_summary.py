"""What a log amounts to where it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.telemetry.read import Run, read_run
from ori_deploy.telemetry.summary import summarise
from tests.telemetry.inline import logged


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = tmp_path_factory.mktemp("summary") / "run.mcap"
    logged(path)
    return read_run(path)


def silent(run: Run, *hinges: int, value: float = np.nan) -> Run:
    """The run, had hinges never answered with more than a value."""
    position_rad = run.position_rad.copy()
    position_rad[:, hinges] = value
    return replace(run, position_rad=position_rad)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_hinge_that_was_never_measured_has_no_tracking_error(run: Run, value: float) -> None:
    whole = summarise(run).tracking
    worst = max(range(4), key=lambda i: whole[i].error_rad)
    found = summarise(silent(run, worst, value=value))
    assert np.isnan([found.tracking[worst].error_rad, found.tracking[worst].time_s]).all()
    others = [i for i in range(4) if i != worst]
    assert [found.tracking[i] for i in others] == [whole[i] for i in others]
    assert found.worst_tracking == max((whole[i] for i in others), key=lambda one: one.error_rad)
    assert [one.hinge_id for one in found.tracking] == [one.hinge_id for one in whole]


def test_where_no_hinge_was_ever_measured_there_is_no_worst_tracking(run: Run) -> None:
    assert summarise(silent(run, 0, 1, 2, 3)).worst_tracking is None


def test_the_worst_lateness_is_of_the_cycles_that_tell_theirs(run: Run) -> None:
    lateness_s = np.linspace(0.0, 1e-3, len(run.time_s))
    lateness_s[-1] = np.nan
    assert summarise(replace(run, lateness_s=lateness_s)).worst_lateness_s == lateness_s[-2]
    assert np.isnan(summarise(replace(run, lateness_s=np.full_like(lateness_s, np.nan))).worst_lateness_s)
