"""The controller on the firmware: pulses against the plan, latches in order, faults, clearing them, going on."""

from __future__ import annotations

import time
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from ori_deploy.actuators.bus import BusError, CommandRefused
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import FaultKind, Outcome, StartRefused
from ori_deploy.deploy.states import State
from tests.deploy.on_board import N, Setup, frames, on_board, pulse_ns, spline

TICK_NS = 500.0
ONE_COUNT_RAD = 0.0075
"""Resolution of the feedback: so far from the path a motion may begin."""

pytestmark = pytest.mark.slow


def test_pulses_are_the_planned_angles_at_every_frame(tmp_path: Path) -> None:
    """Within half a tick of rounding, and what rounding knots and fixed point add: 0.5 us in all."""
    with on_board(tmp_path, port="atmega2560") as setup:
        setup.controller.connect()
        setup.controller.arm()
        setup.board.forget_pulses()
        setup.controller.deploy()
        result = setup.controller.run()
        assert result.outcome is Outcome.SUCCEEDED, result
        pulses = setup.board.pulses()
        knots = [knot for _, knot in setup.sent]
        for hinge in range(N):
            assert setup.rig.mcu is not None
            time_s, width_ns = frames(setup, pulses, setup.rig.mcu.hinges[hinge].output)
            assert len(time_s) > 150
            inside = (time_s >= knots[0].time_s) & (time_s <= knots[-1].time_s)
            wanted = pulse_ns(setup, hinge, spline(knots, time_s[inside])[:, hinge])
            assert np.abs(width_ns[inside] - wanted).max() <= TICK_NS
            along = pulse_ns(setup, hinge, planned(setup, time_s[inside])[:, hinge])
            known = np.isfinite(along)
            assert known.sum() > 120
            assert np.abs(width_ns[inside] - along)[known].max() <= TICK_NS


def planned(setup: Setup, time_s: np.ndarray) -> np.ndarray:
    """(n, n_hinges) the plan's own shaft positions at device times; NaN where the motion is not on the path.

    Between two commands path time is a cubic, exactly so where the jerk of its rate is the same all the way.
    """
    table, period_s = PathTable.build(setup.plan, setup.rig), 1.0 / setup.rig.rate_hz
    places = [(knot.time_s, setup.records[min(k, len(setup.records) - 1)]) for k, knot in setup.sent]
    times = np.array([at for at, _ in places])
    where = np.array([record.path_time_s for _, record in places])
    rate = np.array([record.rate for _, record in places])
    found = np.full((len(time_s), N), np.nan)
    for row, at in enumerate(time_s):
        i = int(np.searchsorted(times, at, side="right")) - 1
        if not 0 <= i < len(times) - 1 or places[i][1].state is not State.MOVING or rate[i] * rate[i + 1] == 0.0:
            continue
        span = times[i + 1] - times[i]
        if abs(where[i + 1] - where[i] - 0.5 * (rate[i] + rate[i + 1]) * period_s) > 1e-3:
            continue  # on the way to the path
        u = (at - times[i]) / span
        along = CubicHermiteSpline([0.0, 1.0], where[i : i + 2], period_s * rate[i : i + 2])
        found[row] = table.shaft_at(float(along(u)))
    return found


@pytest.mark.parametrize("port", ["host", "atmega2560"])
def test_latches_fire_in_order_and_confirmation_gates_deployed(tmp_path: Path, port: str) -> None:
    with on_board(tmp_path, port=port) as setup:  # type: ignore[arg-type]
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        result = setup.controller.run()
        assert result.outcome is Outcome.SUCCEEDED, result
        truth = setup.board.truth()
        assert [latch.closed for latch in truth.latches] == [True, True, False]
        told = [event.text.split(": ")[1] for event in setup.bus.events if ": latch" in event.text]
        released = ["latch, index 2, value 0", "latch, index 0, value 0", "latch, index 1, value 0"]
        assert told == [*released, "latch, index 0, value 1", "latch, index 1, value 1"]
        setup.controller.stow()
        assert setup.controller.run().succeeded
        assert [latch.closed for latch in setup.board.truth().latches] == [False, False, True]


def test_a_sensor_that_never_sees_its_latch_closed_is_no_deployment(tmp_path: Path) -> None:
    with on_board(tmp_path) as setup:
        setup.board.sensor(0, "high")
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        result = setup.controller.run()
        assert result.fault is not None
        assert result.fault is not None
        assert result.fault.thing == "coil"


def stands_still(setup: Setup, seconds: float = 0.3) -> None:
    time.sleep(0.3)  # a servo is a little behind its pulses
    before = setup.shafts()
    time.sleep(seconds)
    np.testing.assert_allclose(setup.shafts(), before, atol=2e-3)


@pytest.mark.parametrize("port", ["host", "atmega2560"])
def test_a_watchdog_reset_in_motion_leaves_a_latched_fault_and_wants_a_clear(tmp_path: Path, port: str) -> None:
    with on_board(tmp_path, port=port) as setup:  # type: ignore[arg-type]
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        setup.go_on(1.5)
        setup.board.hang()
        result = setup.controller.run()
        assert result.fault is not None
        assert result.fault is not None
        assert result.fault.kind in {
            FaultKind.LOST_REPLIES,
            FaultKind.RESTARTED,
            FaultKind.BUS_ERROR,
            FaultKind.COMMAND_REFUSED,
            FaultKind.PATH_TOLERANCE,  # what hangs stands still, and may be asked before it has been silent for long
        }, result.fault
        setup.board.wait_ready()
        setup.board.forget_pulses()
        stands_still(setup)
        assert not len(setup.board.pulses().output)  # limp, and never told to move
        with pytest.raises(CommandRefused):
            setup.bus.enable_torque()
        setup.controller.clear_fault()
        assert setup.controller.state is State.READY
        stands_still(setup)
        setup.controller.arm()
        setup.controller.deploy()
        assert setup.controller.run().succeeded


def test_a_hinge_that_is_held_is_a_fault_and_the_others_brake_along_the_path(tmp_path: Path) -> None:
    with on_board(tmp_path, controller={"path_tolerance_rad": 0.06, "start_tolerance_rad": 0.2}) as setup:
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        setup.go_on(1.2)
        setup.board.jam(1)
        result = setup.controller.run()
        assert result.fault is not None
        assert result.fault.kind in {FaultKind.PATH_TOLERANCE, FaultKind.OUT_OF_STEP}, result.fault
        stands_still(setup)
        folds = setup.records[-1].folds
        assert np.ptp(folds) < 0.2  # the plan's step tolerance
        setup.board.jam(1, False)
        time.sleep(0.3)
        setup.controller.clear_fault()
        if setup.controller.state is State.READY:
            setup.controller.arm()
        setup.controller.deploy()
        assert setup.controller.run().succeeded


def test_the_emergency_stop_stops_along_the_path_and_has_to_be_released(tmp_path: Path) -> None:
    with on_board(tmp_path) as setup:
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        setup.go_on(1.2)
        setup.board.estop()
        result = setup.controller.run()
        assert result.fault is not None
        assert "stop" in str(result.fault)
        stands_still(setup)
        with pytest.raises(CommandRefused):
            setup.controller.clear_fault()
        setup.board.estop(False)
        time.sleep(0.1)
        setup.controller.clear_fault()
        setup.controller.deploy()
        assert setup.controller.run().succeeded


def test_a_host_that_hangs_finds_its_hinges_at_rest_and_says_so(tmp_path: Path) -> None:
    with on_board(tmp_path) as setup:
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        setup.go_on(1.2)
        time.sleep(0.6)
        stands_still(setup, 0.1)
        result = setup.controller.run()
        assert result.fault is not None
        assert result.fault.kind is FaultKind.WATCHDOG
        setup.controller.clear_fault()
        assert setup.controller.state is State.ARMED
        setup.controller.deploy()
        assert setup.controller.run().succeeded


@pytest.mark.parametrize(("rate", "seed"), [(0.0002, 1), (0.0002, 2), (0.002, 3), (0.02, 4), (0.02, 5)])
def test_a_lossy_link_deploys_on_the_plan_or_ends_in_a_typed_fault(tmp_path: Path, rate: float, seed: int) -> None:
    """Half of the spoilt bytes are dropped, half flipped, both ways; no pulse ever leaves the path."""
    with on_board(tmp_path, seed=seed) as setup:
        setup.controller.connect()
        setup.controller.arm()
        setup.board.forget_pulses()
        for direction in ("to_device", "from_device"):
            setup.board.drop(direction, rate / 2)  # type: ignore[arg-type]
            setup.board.flip(direction, rate / 2)  # type: ignore[arg-type]
        try:
            setup.controller.deploy()
        except (StartRefused, BusError):
            outcome = None  # not even a start, and nothing moved
        else:
            outcome = setup.controller.run()
        for direction in ("to_device", "from_device"):
            setup.board.drop(direction, 0.0)  # type: ignore[arg-type]
            setup.board.flip(direction, 0.0)  # type: ignore[arg-type]
        if outcome is not None and outcome.outcome is not Outcome.SUCCEEDED:
            assert outcome.fault is not None
        if rate < 0.001:
            assert outcome is not None
            assert outcome.succeeded, outcome
        assert farthest_from_the_path(setup) < ONE_COUNT_RAD


def farthest_from_the_path(setup: Setup) -> float:
    """Largest distance of what the servos were told from the nearest place on the path, rad at the shaft."""
    assert setup.rig.mcu is not None
    hinges = setup.rig.mcu.hinges
    pulses = setup.board.pulses()
    mine = [pulses.of(hinge.output) for hinge in hinges]
    # All pulses of a frame rise together. One is on record as soon as it has ended, the longer ones a little later.
    frames = reduce(np.intersect1d, [one.rise for one in mine])
    assert len(frames) >= max(len(one.rise) for one in mine) - 2  # the first and the last may be in part
    told = []
    for hinge, one in zip(hinges, mine, strict=True):
        width_s = one.width_s[np.isin(one.rise, frames)]
        told.append((1e6 * width_s - hinge.servo.pulse_zero_us) / hinge.servo.pulse_us_per_rad)
    n = len(frames)
    shaft = np.stack(told, axis=1)
    table = PathTable.build(setup.plan, setup.rig)
    path = np.array([table.shaft_at(t) for t in np.linspace(0.0, table.duration_s, 6001)])
    away = (
        np.abs(shaft[:, None, :] - path[None, :, :]).max(axis=2).min(axis=1)
        if n < 400
        else np.array([np.abs(row - path).max(axis=1).min() for row in shaft])
    )
    return float(away.max())
