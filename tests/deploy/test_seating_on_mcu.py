"""Seating on hobby servos: nobody can tell them to push less, and who touches is told by how far a shaft lags."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.deploy.result import FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import State
from tests.deploy.on_board import N, Setup, on_board
from tests.deploy.synthetic import NARROWING, synthetic_plan

pytestmark = pytest.mark.slow

RATE_HZ, DURATION_S = 12.5, 6.0
PATIENT = {"silence_s": 0.7, "min_lead_s": 0.8, "lead_s": 0.9}
"""Long cycles carry goals far ahead: a machine that is busy with other tests does not run out of them."""


@contextmanager
def seating_board(folder: Path, stops: dict[int, float] | None = None, **tables: Any) -> Iterator[Setup]:
    """An armed board whose slits close from fold 0.9 on, with an end stop for some cells."""
    plan = synthetic_plan(N, duration_s=DURATION_S, rate_hz=RATE_HZ, tolerance=NARROWING)
    with on_board(folder, plan=plan, stops=stops, rate_hz=RATE_HZ, mcu=PATIENT, **tables) as setup:
        setup.controller.connect()
        setup.controller.arm()
        yield setup


def deployed(setup: Setup) -> MotionResult:
    setup.controller.deploy()
    return setup.controller.run()


def test_slits_are_seated_and_latches_confirm_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with (
        seating_board(tmp_path, {1: 0.994, 2: 0.997}) as setup,
        caplog.at_level(logging.WARNING, logger="ori_deploy.deploy.seating"),
    ):
        assert not setup.bus.limits_effort
        result = deployed(setup)
        assert result.outcome is Outcome.SUCCEEDED, result
        assert result.state is State.DEPLOYED
        assert [latch.closed for latch in setup.board.truth().latches] == [True, True, False]
        told = [record.message for record in caplog.records if record.name == "ori_deploy.deploy.seating"]
        assert len(told) == 1
        assert "cannot be told to push less" in told[0]
        # Nothing takes the push back: goals stay where the faces do not let the shafts go.
        goal = setup.rig.to_actuator(setup.plan.crease_angles_rad[-1])
        np.testing.assert_allclose(setup.sent[-1][1].position_rad, goal, atol=1e-6)


@pytest.mark.parametrize("cell", [0, 2])
def test_a_cell_that_touches_while_the_others_go_on_is_uneven_and_named(tmp_path: Path, cell: int) -> None:
    with seating_board(tmp_path, {cell: 0.966}, controller={"seating_tolerance": 0.04}) as setup:
        result = deployed(setup)
        assert result.fault is not None
        assert (result.fault.kind, result.fault.thing) == (FaultKind.SEATING_UNEVEN, f"c{cell + 1}")
        assert result.outcome is Outcome.SEATING
        assert np.ptp(setup.records[-1].folds) < 0.05
        assert not setup.board.truth().latches[0].closed  # the coil, on whose account nothing is deployed


def test_a_latch_that_sees_nothing_beside_a_cell_that_never_touched_is_late_and_named(tmp_path: Path) -> None:
    with seating_board(tmp_path) as setup:
        setup.board.sensor(1, "high")  # that of cell c1: its magnets are not there
        result = deployed(setup)
        assert result.fault is not None
        assert (result.fault.kind, result.fault.thing) == (FaultKind.SEATING_LATE, "c1")
        assert result.outcome is Outcome.SEATING
        assert "cell:c1" in result.fault.detail
