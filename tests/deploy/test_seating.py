"""Seating: slits close under a limited effort, and who touches too early, too late or alone is named."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ori_deploy.deploy.result import FaultKind, Outcome
from ori_deploy.deploy.seating import FreeLag
from ori_deploy.deploy.states import State
from ori_deploy.motion.plan import Plan
from sim_backends.mock import MockBus
from tests.deploy.synthetic import NARROWING, RIG, Bench, bench, synthetic_plan
from tests.deploy.test_controller import largest_step, peak_crease_rate
from tests.deploy.test_faults import ends_in_fault

BEGINS = NARROWING.seating_fold
N = 4
STRENGTH_NM = 2.0
SEATING_KINDS = {FaultKind.SEATING_EARLY, FaultKind.SEATING_LATE, FaultKind.SEATING_UNEVEN}
DRIVES = [("close_a", -1), ("close_a", 1), ("open_c", -1), ("open_c", 1)]
few = settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])


def seating_plan() -> Plan:
    return synthetic_plan(N, duration_s=6.0, tolerance=NARROWING)


def seating_bench(
    stops: dict[int, float] | None = None, drive: tuple[str, int] = DRIVES[0], plan: Plan | None = None, **tables: Any
) -> Bench:
    """A bench with an end stop for some cells, each at a fold."""
    each_cell = {**RIG["each_cell"], "crease": drive[0], "direction": drive[1]}
    b = bench(plan or seating_plan(), each_cell=each_cell, **tables)
    shafts = b.rig.to_actuator(b.plan.crease_angles_rad)
    for cell, fold in (stops or {}).items():
        b.bus.end_stop(b.rig.hinge_ids[cell], float(np.interp(fold, b.plan.fold, shafts[:, cell])))
    return b


def torques(b: Bench, monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Fold that is commanded, and the largest torque, of every step of the simulation from now on."""
    servos = b.bus._servos
    electrics, found = servos._electrics, []

    def noted(torque_nm: np.ndarray) -> None:
        electrics(torque_nm)
        found.append((b.controller._motion.fold, float(servos.torque_nm.max())))

    monkeypatch.setattr(servos, "_electrics", noted)
    return found


# -- effort --------------------------------------------------------------------------------------------


def test_hinges_never_push_harder_than_they_may_while_slits_close(monkeypatch: pytest.MonkeyPatch) -> None:
    part, hold = 0.25, 0.2
    everyone = dict.fromkeys(range(N), 0.994)
    b = seating_bench(everyone, controller={"seating_effort": part, "holding_effort": hold})
    found = torques(b, monkeypatch)
    b.controller.deploy()
    assert b.controller.run().succeeded
    # The limit is sent in the cycle that commands the first fold of the seating.
    pushing = [torque for fold, torque in found if fold >= BEGINS + 0.005]
    assert max(pushing) == pytest.approx(part * STRENGTH_NM)  # as hard as it may, and no harder
    del found[:]
    b.steps(100)
    assert max(torque for _, torque in found) == pytest.approx(hold * STRENGTH_NM)


def test_without_a_limit_the_same_slits_are_pressed_harder(monkeypatch: pytest.MonkeyPatch) -> None:
    b = seating_bench(dict.fromkeys(range(N), 0.994), controller={"seating_effort": 1.0, "holding_effort": 1.0})
    found = torques(b, monkeypatch)
    b.controller.deploy()
    assert b.controller.run().succeeded
    assert max(torque for fold, torque in found if fold >= BEGINS) > 0.25 * STRENGTH_NM
    assert (b.bus.true_effort == 1.0).all()


def test_effort_follows_what_is_done_and_is_full_before_anything_else_moves() -> None:
    b = seating_bench(controller={"seating_effort": 0.6, "holding_effort": 0.4})
    efforts: list[tuple[str, float, float]] = []
    b.controller.add_observer(
        lambda record: efforts.append(
            (str(record.stage or record.state), record.commanded_fold, b.bus.true_effort[0])
        )
    )
    b.controller.deploy()
    assert b.controller.run().succeeded
    for stage, fold, effort in efforts:
        assert effort == {"unlock": 1.0, "latch": 0.6, "deployed": 0.4}.get(stage, 0.6 if fold >= BEGINS else 1.0)
    assert efforts[-1][0] == "deployed"  # relaxed without another cycle
    del efforts[:]
    b.controller.stow()
    assert b.controller.run().succeeded
    assert {effort for _, _, effort in efforts} == {1.0}


def test_effort_is_set_once_and_not_in_every_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    b = seating_bench()
    told: list[float] = []
    monkeypatch.setattr(b.bus, "_limit_effort", told.append)
    b.controller.deploy()
    b.controller.run()
    b.steps(20)
    assert told == [0.6, 0.5]


@pytest.mark.parametrize("command", ["stow", "hold", "stop"])
def test_turning_round_takes_the_limit_off_and_resting_leaves_it(command: str) -> None:
    b = seating_bench()
    b.controller.deploy()
    b.step_until_fold(0.95)
    getattr(b.controller, command)()
    b.step_to_rest()
    assert (b.bus.true_effort == (1.0 if command == "stow" else 0.6)).all()
    if command == "hold":
        b.controller.resume()
        assert b.controller.run().succeeded
    elif command == "stop":
        b.controller.run()
        b.controller.stow()
        assert b.controller.run().state is State.STOWED
        assert (b.bus.true_effort == 1.0).all()


def test_a_fault_leaves_the_effort_and_clearing_it_takes_the_limit_off() -> None:
    b = seating_bench({1: 0.95})
    b.controller.deploy()
    ends_in_fault(b, FaultKind.SEATING_EARLY, "c2")
    assert (b.bus.true_effort == 0.6).all()
    b.bus.clear_stops()
    b.controller.clear_fault()
    assert (b.bus.true_effort == 1.0).all()
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_a_plan_in_which_no_slit_closes_seats_nothing() -> None:
    b = bench(synthetic_plan(N))
    b.controller.deploy()
    b.step_until_fold(0.99)
    while b.controller.step().stage != "latch":
        pass
    assert (b.bus.true_effort == 1.0).all()
    assert b.controller.run().succeeded


def test_hinges_that_cannot_be_told_are_judged_all_the_same_and_that_is_told_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(MockBus, "limits_effort", False)
    b = seating_bench({2: 0.95})
    b.controller.deploy()
    with caplog.at_level(logging.WARNING, logger="ori_deploy.deploy.seating"):
        ends_in_fault(b, FaultKind.SEATING_EARLY, "c3")
    assert len([record for record in caplog.records if record.name == "ori_deploy.deploy.seating"]) == 1
    assert (b.bus.true_effort == 1.0).all()


# -- early, late, uneven -------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", range(N))
@pytest.mark.parametrize("fold", [0.92, 0.97])
def test_a_cell_that_touches_too_early_is_named(cell: int, fold: float) -> None:
    b = seating_bench({cell: fold})
    b.controller.deploy()
    result = ends_in_fault(b, FaultKind.SEATING_EARLY, f"c{cell + 1}")
    assert result.outcome is Outcome.SEATING
    assert result.fault is not None
    for told in (f"c{cell + 1} at fold {fold:.2f}", "seating_tolerance", "out_of_step"):
        assert told in result.fault.detail
    folds = (b.bus.true_output_rad - b.rig.to_actuator(b.plan.crease_angles_rad[0])) / np.ptp(
        b.rig.to_actuator(b.plan.crease_angles_rad), axis=0
    )
    assert np.ptp(np.abs(folds)) < 0.02  # what a controller may let happen in the seating


def test_all_cells_that_touch_too_early_alike_are_early_and_not_uneven() -> None:
    b = seating_bench(dict.fromkeys(range(N), 0.95))
    b.controller.deploy()
    result = b.controller.run()
    assert result.fault is not None
    assert result.fault.kind is FaultKind.SEATING_EARLY
    assert all(f"c{k + 1} at fold 0.95" in result.fault.detail for k in range(N))


@pytest.mark.parametrize("cell", range(N))
def test_a_cell_that_keeps_its_crease_short_of_the_end_is_early_by_the_goal_tolerance(cell: int) -> None:
    b = seating_bench({cell: 0.988}, controller={"goal_tolerance_rad": 0.008, "settle_timeout_s": 0.5})
    b.controller.deploy()
    result = ends_in_fault(b, FaultKind.SEATING_EARLY, f"c{cell + 1}")
    assert result.fault is not None
    assert "goal_tolerance_rad" in result.fault.detail


@pytest.mark.parametrize("cell", range(N))
def test_cells_that_touch_one_after_the_other_are_uneven_and_the_first_is_named(cell: int) -> None:
    b = seating_bench({cell: 0.966, (cell + 1) % N: 0.974}, controller={"seating_tolerance": 0.005})
    b.controller.deploy()
    result = ends_in_fault(b, FaultKind.SEATING_UNEVEN, f"c{cell + 1}")
    assert result.outcome is Outcome.SEATING


@pytest.mark.parametrize("cell", range(N))
def test_a_cell_out_of_step_in_the_seating_is_uneven(cell: int) -> None:
    b = seating_bench({cell: 0.967}, controller={"seating_tolerance": 0.04})
    b.controller.deploy()
    ends_in_fault(b, FaultKind.SEATING_UNEVEN, f"c{cell + 1}")


def test_cells_that_are_all_late_alike_in_the_seating_are_not_uneven() -> None:
    b = seating_bench()
    b.controller.deploy()
    b.step_until_fold(BEGINS + 0.3 * (1.0 - BEGINS))
    monitor, seating = b.controller._monitor, b.controller._seating
    folds = np.full(N, BEGINS + 1e-4)
    monitor.seed(folds)
    late = monitor.judge_step(float(folds[0]) + 0.01, 0.1, 0.02, 0.0, rate=0.5)
    assert late is not None
    assert seating._active
    assert seating.named(late) == late


def per_cell_latches() -> Plan:
    return replace(seating_plan(), latch_points=tuple(f"cell:c{k + 1}" for k in range(N)))


@pytest.mark.parametrize("cell", range(N))
def test_a_latch_that_does_not_confirm_beside_a_cell_that_never_touched_is_late(cell: int) -> None:
    b = seating_bench({(cell + 1) % N: 0.994}, plan=per_cell_latches())
    b.bus.latch_stuck(f"latch_cell:c{cell + 1}")
    b.controller.deploy()
    result = ends_in_fault(b, FaultKind.SEATING_LATE, f"c{cell + 1}")
    assert result.outcome is Outcome.SEATING
    assert result.fault is not None
    assert f"latch_cell:c{cell + 1}" in result.fault.detail


def test_a_slit_that_does_not_confirm_though_cells_touched_is_the_latch_s_affair() -> None:
    b = seating_bench({2: 0.994}, plan=per_cell_latches())
    b.bus.latch_stuck("latch_cell:c3")
    b.controller.deploy()
    ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "latch_cell:c3")


def test_a_slit_is_late_when_none_of_the_cells_touched() -> None:
    b = seating_bench()
    b.bus.latch_stuck("latch_slit:P-T2")
    b.controller.deploy()
    result = b.controller.run()
    assert result.fault is not None
    assert result.fault.kind is FaultKind.SEATING_LATE
    assert result.fault.thing in b.rig.cell_ids


def test_a_sensor_that_cannot_tell_says_nothing_of_the_slit() -> None:
    b = seating_bench(plan=per_cell_latches())
    b.bus.latch_blind("latch_cell:c2")
    b.controller.deploy()
    ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "latch_cell:c2")


def test_a_latch_that_fails_because_its_cell_stopped_short_is_early() -> None:
    plan = per_cell_latches()
    b = seating_bench({1: 0.986}, plan=plan, each_latch_point={"capture_range_rad": 0.005})
    b.controller.deploy()
    ends_in_fault(b, FaultKind.SEATING_EARLY, "c2")


@pytest.mark.parametrize("cell", range(N))
@pytest.mark.parametrize("fold", [0.6, 0.8, 0.89, 0.898])
def test_what_blocks_a_cell_before_slits_close_is_what_it_was(cell: int, fold: float) -> None:
    b = seating_bench({cell: fold})
    b.controller.deploy()
    result = b.controller.run()
    assert result.fault is not None
    assert result.fault.kind in (FaultKind.OUT_OF_STEP, FaultKind.PATH_TOLERANCE)
    assert result.fault.thing in (f"c{cell + 1}", f"servo_c{cell + 1}")
    assert result.outcome is Outcome.PATH_TOLERANCE
    assert np.isnan(b.controller._seating.contact_fold).all()


@pytest.mark.parametrize(
    "stops", [{}, {0: 0.994}, {0: 0.993, 1: 0.998}, dict.fromkeys(range(N), 0.995)], ids=["none", "one", "two", "all"]
)
def test_latches_that_confirm_make_a_good_deployment_whatever_touched(stops: dict[int, float]) -> None:
    b = seating_bench(stops, controller={"seating_tolerance": 0.001})
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded, result
    assert result.state is State.DEPLOYED


@pytest.mark.slow
@few
@given(cell=st.integers(0, N - 1), depth=st.floats(0.0, 0.095), drive=st.sampled_from(DRIVES))
def test_a_stop_anywhere_in_the_seating_succeeds_or_is_named(cell: int, depth: float, drive: tuple[str, int]) -> None:
    b = seating_bench({cell: 1.0 - depth}, drive)
    b.controller.deploy()
    result = b.controller.run()
    assert b.records[-1].rate == 0.0
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    if depth < 0.012:  # goal_tolerance_rad of any of the creases is more
        assert result.succeeded, result
    elif result.fault is not None:
        assert result.fault.kind in SEATING_KINDS
        assert result.fault.thing == f"c{cell + 1}"
        assert result.outcome is Outcome.SEATING
    else:
        assert depth < 0.025
    if depth > 0.025:
        assert result.fault is not None
        assert result.fault.kind is FaultKind.SEATING_EARLY


# -- contact -------------------------------------------------------------------------------------------


def test_a_shove_that_passes_is_no_contact() -> None:
    b = seating_bench()
    b.controller.deploy()
    b.step_until_fold(0.95)
    b.bus.push("servo_c2", 0.025)  # towards closed
    seating, looked_like_it = b.controller._seating, False
    while b.controller.under_way:
        b.controller.step()
        looked_like_it |= bool(seating._streak[1] > 0)
        assert np.isnan(seating.contact_fold).all()
    assert looked_like_it
    assert b.controller.result().succeeded


def test_what_touched_in_an_earlier_deployment_is_forgotten() -> None:
    b = seating_bench({1: 0.994}, plan=per_cell_latches())
    b.controller.deploy()
    assert b.controller.run().succeeded
    b.controller.stow()
    assert b.controller.run().succeeded
    b.bus.clear_stops()
    b.bus.latch_stuck("latch_cell:c2")
    b.controller.deploy()
    ends_in_fault(b, FaultKind.SEATING_LATE, "c2")


def test_contact_is_noted_at_the_fold_where_the_cell_stands() -> None:
    folds = {0: 0.993, 2: 0.996}
    b = seating_bench(folds)
    b.controller.deploy()
    assert b.controller.run().succeeded
    noted = b.controller._seating.contact_fold
    for cell in range(N):
        if cell in folds:
            assert noted[cell] == pytest.approx(folds[cell], abs=0.001)
    assert np.isnan(noted[[1, 3]]).all()


@few
@given(tau=st.floats(0.005, 0.08), noise=st.floats(0.0, 0.0005), seed=st.integers(0, 2**32 - 1))
def test_free_motion_does_not_touch_at_any_speed_and_what_stops_does(tau: float, noise: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    free, speeds = FreeLag(1, 0.02), np.linspace(0.0, 0.6, 200)
    amps = np.array([0.24])
    for speed in speeds:
        free.learn(np.array([tau * speed + random.normal(0.0, noise)]), np.array([speed]), amps)
    for speed in speeds:
        lag = np.array([tau * speed + random.normal(0.0, noise)])
        assert not free.touching(lag, np.array([speed]), amps)[0]
        assert free.touching(lag + 0.008, np.array([speed]), amps)[0]


def test_with_the_current_of_a_push_half_the_lag_is_enough_and_without_a_sensor_lag_alone_counts() -> None:
    for amps, pushing, enough in ((0.24, 0.5, 0.002), (0.24, 0.24, 0.004), (np.nan, np.nan, 0.004)):
        free = FreeLag(1, 0.02)
        for speed in np.linspace(0.0, 0.6, 100):
            free.learn(np.array([0.03 * speed]), np.array([speed]), np.array([amps]))
        rest = np.array([0.0])
        assert free.touching(np.array([enough]), rest, np.array([pushing]))[0]
        assert not free.touching(np.array([0.5 * enough]), rest, np.array([pushing]))[0]


def test_a_hinge_whose_free_motion_was_not_seen_has_to_lag_by_all_that_it_may() -> None:
    free = FreeLag(2, 0.02)
    lag, rest, amps = np.array([0.015, 0.025]), np.zeros(2), np.full(2, 0.2)
    np.testing.assert_array_equal(free.touching(lag, rest, amps), [False, True])


def test_lost_replies_teach_nothing_and_touch_nothing() -> None:
    free = FreeLag(1, 0.02)
    nan = np.array([np.nan])
    for _ in range(100):
        free.learn(nan, np.array([0.1]), nan)
    assert not free.touching(nan, np.array([0.1]), nan)[0]
    assert not free.touching(np.array([0.019]), np.array([0.0]), nan)[0]
