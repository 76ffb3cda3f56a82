"""Whatever breaks, the structure stops along the path, says why, and stays stopped until told otherwise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ori_deploy.actuators.bus import BusClosed, CommandRefused
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.result import FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.motion.step_tolerance import StepTolerance
from tests.deploy.synthetic import NARROWING, Bench, bench, synthetic_plan
from tests.deploy.test_controller import PIN, STOW_LOCK, largest_step, peak_crease_rate

ELECTROMAGNET = {
    "id": "coil",
    "secures": "slit:P-T2",
    "kind": "electromagnet",
    "max_on_s": 1.0,
    "duty_cycle": 0.5,
    "timeout_s": 2.0,
}


def under_way(fold: float = 0.4, **tables: object) -> Bench:
    """A bench in the middle of opening."""
    b = bench(**tables)  # type: ignore[arg-type]
    b.controller.deploy()
    b.step_until_fold(fold)
    return b


def ends_in_fault(b: Bench, kind: FaultKind, thing: str) -> MotionResult:
    """Run to the end, which is a latched fault at rest, reached in step and without a jump."""
    result = b.controller.run()
    assert result.fault is not None
    assert result.state is State.FAULT
    assert result.fault is not None
    assert (result.fault.kind, result.fault.thing) == (kind, thing)
    assert not result.succeeded
    assert b.records[-1].rate == 0.0
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    goal = b.steps(5).commanded_rad
    np.testing.assert_array_equal(b.steps(50).commanded_rad, goal)
    for command in ("arm", "deploy", "stow", "resume", "hold", "stop", "connect"):
        with pytest.raises(IllegalCommand):
            getattr(b.controller, command)()
    assert b.controller.fault == result.fault
    return result


def cycles_from(b: Bench, start: int, condition: Callable[[object], bool]) -> int:
    return next(i for i, record in enumerate(b.records[start:]) if condition(record))


MOTION_FAULTS: dict[str, tuple[Callable[[Bench], object], FaultKind, str, float]] = {
    "mute": (lambda b: b.bus.mute("servo_c2"), FaultKind.LOST_REPLIES, "servo_c2", 0.05),
    "corrupt": (lambda b: b.bus.corrupt_replies("servo_c3", 3), FaultKind.LOST_REPLIES, "servo_c3", 0.05),
    "reboot": (lambda b: b.bus.reboot("servo_c1"), FaultKind.TORQUE_LOST, "servo_c1", 0.1),
    "overload": (lambda b: b.bus.overload("servo_c2"), FaultKind.HARDWARE_ERROR, "servo_c2", 0.02),
}


@pytest.mark.parametrize("name", MOTION_FAULTS)
@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_a_fault_stops_the_motion_along_the_path_in_time_and_is_named(name: str, command: str) -> None:
    inject, kind, thing, within_s = MOTION_FAULTS[name]
    b = bench(start="deployed" if command == "stow" else "stowed")
    getattr(b.controller, command)()
    b.step_until_fold(0.5)
    start = len(b.records)
    inject(b)
    ends_in_fault(b, kind, thing)
    noticed = next(i for i, r in enumerate(b.records[start:]) if r.state is State.FAULT)
    assert noticed <= round(within_s * b.rig.rate_hz)
    at_rest = next(i for i, r in enumerate(b.records[start + noticed :]) if r.rate == 0.0)
    assert at_rest <= 2


@pytest.mark.parametrize("spoil", ["mute", "corrupt"])
@pytest.mark.parametrize("fold", [0.2, 0.5, 0.8])
def test_silence_is_at_rest_within_50_ms(spoil: str, fold: float) -> None:
    """From the moment of the first reply that is missing to the cycle whose goals rest."""
    b = under_way(fold)
    begin = b.clock.now()
    MOTION_FAULTS[spoil][0](b)
    b.controller.run()
    resting = next(record for record in b.records if record.time_s >= begin and record.rate == 0.0)
    assert resting.time_s - begin <= 0.05 + 1e-9


@pytest.mark.parametrize("fold", [0.2, 0.5, 0.8])
def test_a_stall_is_at_rest_within_100_ms(fold: float) -> None:
    b = under_way(fold, controller={"path_tolerance_rad": 0.05})
    b.bus.jam("servo_c2")
    result = b.controller.run()
    assert result.outcome is Outcome.PATH_TOLERANCE
    assert result.fault is not None
    resting = next(r for r in b.records if r.time_s >= result.fault.time_s and r.rate == 0.0)
    assert resting.time_s - result.fault.time_s <= 0.1 + 1e-9


PAUSES: dict[str, tuple[Callable[[Bench], object], Callable[[Bench], object], FaultKind, str]] = {
    "overheat": (
        lambda b: b.bus.overheat("servo_c4", 75.0),
        lambda b: b.bus.overheat("servo_c4", 30.0),
        FaultKind.OVER_TEMPERATURE,
        "servo_c4",
    ),
    "sag": (lambda b: b.bus.sag(3.0), lambda b: b.bus.sag(0.0), FaultKind.LOW_VOLTAGE, "servo_c1"),
}


@pytest.mark.parametrize("name", PAUSES)
@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_heat_and_a_low_supply_pause_and_then_abort(name: str, command: str) -> None:
    inject, _, kind, thing = PAUSES[name]
    b = bench(start="deployed" if command == "stow" else "stowed", controller={"pause_patience_s": 1.0})
    getattr(b.controller, command)()
    b.step_until_fold(0.5)
    start = len(b.records)
    inject(b)
    b.steps(11)
    assert b.controller.state is State.HOLD
    assert b.controller.concern is not None
    with pytest.raises(IllegalCommand, match=thing):
        b.controller.resume()
    ends_in_fault(b, kind, thing)
    first = next(i for i, r in enumerate(b.records[start:]) if r.state is State.FAULT)
    assert 100 <= first <= 112  # pause_patience_s, and when health is looked at
    paused = [record.rate for record in b.records[start + 11 : start + first]]
    assert paused[-1] == 0.0


@pytest.mark.parametrize("name", PAUSES)
def test_what_passes_in_time_was_only_a_pause(name: str) -> None:
    inject, heal, _, _ = PAUSES[name]
    b = under_way()
    inject(b)
    b.steps(60)
    assert b.controller.under_way
    heal(b)
    result = b.controller.run()
    assert result.outcome is Outcome.HELD
    b.controller.resume()
    assert b.controller.run().succeeded


@pytest.mark.parametrize("duration_s", [1.5, 2.0, 3.0, 4.5])
@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_a_sound_structure_is_only_slowed_where_the_tolerance_narrows(duration_s: float, command: str) -> None:
    plan = synthetic_plan(4, duration_s=duration_s, tolerance=NARROWING)
    b = bench(plan, start="stowed" if command == "deploy" else "deployed")
    getattr(b.controller, command)()
    result = b.controller.run()
    assert result.succeeded, result.fault


def test_who_does_not_answer_has_not_cooled() -> None:
    b = under_way(controller={"pause_patience_s": 2.0, "health_period_s": 0.05})
    b.bus.overheat("servo_c4", 75.0)
    b.steps(12)
    assert b.controller.state is State.HOLD
    for _ in range(4):
        b.bus.silence_health(1)
        b.steps(10)
        assert b.controller.concern is not None
        with pytest.raises(IllegalCommand, match="servo_c4"):
            b.controller.resume()
    ends_in_fault(b, FaultKind.OVER_TEMPERATURE, "servo_c4")


def test_heat_from_before_the_motion_pauses_it_as_well() -> None:
    b = bench(controller={"pause_patience_s": 1.0})
    b.bus.overheat("servo_c4", 75.0)
    b.steps(10)
    assert b.controller.concern is not None
    b.bus.overheat("servo_c4", 30.0)
    b.controller.deploy()
    b.bus.overheat("servo_c4", 75.0)
    b.steps(12)
    assert b.controller.state is State.HOLD
    ends_in_fault(b, FaultKind.OVER_TEMPERATURE, "servo_c4")


def test_an_alert_is_looked_into_at_once_and_not_when_health_is_due() -> None:
    b = under_way(controller={"health_period_s": 10.0})
    b.bus.overload("servo_c2")
    assert b.steps(2).state is State.FAULT
    ends_in_fault(b, FaultKind.HARDWARE_ERROR, "servo_c2")


@pytest.mark.parametrize("name", MOTION_FAULTS)
@pytest.mark.parametrize("stage", ["unlock", "latch"])
def test_a_fault_while_latching_is_a_fault_as_well(name: str, stage: str) -> None:
    inject, kind, thing, _ = MOTION_FAULTS[name]
    b = bench(latch=[{**PIN, "travel_s": 0.8}, {**STOW_LOCK, "kind": "lock_pin", "travel_s": 0.8,
                                               "max_on_s": None, "duty_cycle": None}])  # fmt: skip
    b.controller.deploy()
    while b.controller.step().stage != stage:
        pass
    b.steps(5)
    inject(b)
    ends_in_fault(b, kind, thing)


@pytest.mark.parametrize("spoil", ["drop_replies", "corrupt_replies"])
@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_lost_replies_are_counted_and_have_no_effect(spoil: str, count: int) -> None:
    quiet, b = bench(), bench()
    for each in (quiet, b):
        each.controller.deploy()
        each.steps(100)
    getattr(b.bus, spoil)("servo_c2", count)
    result, undisturbed = b.controller.run(), quiet.controller.run()
    assert result.succeeded
    assert result.lost_replies == count
    assert undisturbed.lost_replies == 0
    np.testing.assert_array_equal([r.commanded_rad for r in b.records], [r.commanded_rad for r in quiet.records])


def test_lost_replies_of_all_hinges_at_once_count_for_each() -> None:
    b = under_way()
    for hinge in b.rig.hinge_ids:
        b.bus.drop_replies(hinge, 2)
    result = b.controller.run()
    assert result.succeeded
    assert result.lost_replies == 8


def test_lost_replies_that_are_not_in_a_row_never_add_up() -> None:
    b = under_way()
    for _ in range(10):
        b.bus.drop_replies("servo_c2", 2)
        b.steps(3)
    result = b.controller.run()
    assert result.succeeded
    assert result.lost_replies == 20


def test_readings_that_are_too_old_count_as_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    b = under_way()
    old = b.bus.read_hinges()
    b.steps(6)
    monkeypatch.setattr(b.bus, "_read_hinges", lambda: old)
    ends_in_fault(b, FaultKind.LOST_REPLIES, "servo_c1")


def test_a_jammed_cell_stops_all_before_the_step_tolerance_is_used_up() -> None:
    for tolerance in (0.05, 0.1, 0.2):
        b = bench(synthetic_plan(4, tolerance=tolerance), controller={"path_tolerance_rad": 1.0})
        b.controller.deploy()
        b.step_until_fold(0.5)
        b.bus.jam("servo_c3")
        ends_in_fault(b, FaultKind.OUT_OF_STEP, "c3")
        folds = (0.5 - b.bus.true_shaft_rad) / 4.0 / b.plan.crease_angles_rad[-1, :, 2]
        assert np.ptp(folds) < tolerance


def test_the_step_tolerance_is_kept_where_it_narrows_ahead() -> None:
    tolerance = StepTolerance(np.array([0.6, 1.0]), np.array([0.3, 0.04]), 1.0, 0.0)
    b = bench(synthetic_plan(4, tolerance=tolerance), controller={"path_tolerance_rad": 1.0})
    b.controller.deploy()
    b.step_until_fold(0.45)
    b.bus.jam("servo_c2")
    ends_in_fault(b, FaultKind.OUT_OF_STEP, "c2")
    folds = (0.5 - b.bus.true_shaft_rad) / 4.0 / b.plan.crease_angles_rad[-1, :, 2]
    assert np.ptp(folds) > 0.04  # it was stuck that far behind
    assert folds.max() < 0.6  # and the others waited where that is harmless


@pytest.mark.parametrize(
    ("folds", "thing", "says"),
    [
        (
            [0.3] * 4,
            "all cells",
            "at least 0.2000 of fold from the command, 0.5000; that leaves no room to stop within",
        ),
        ([0.5, 0.5, 0.4, 0.5], "c3", "spread of all cells 0.1000; that leaves no room to stop within"),
        ([0.5, 0.5, 0.3, 0.5], "c3", "spread of all cells 0.2000; limit: the plan's step tolerance, here 0.1800"),
    ],
)
def test_no_value_within_its_limit_is_told_as_a_fault(folds: list[float], thing: str, says: str) -> None:
    b = bench(synthetic_plan(4))
    monitor = Monitor(b.plan, b.rig)
    monitor.seed(np.array(folds))
    assert monitor.judge_step(0.5, 0.9, 0.18, 0.0, rate=0.8) is None or np.ptp(folds) >= 0.18
    fault = monitor.judge_step(0.5, 0.7, 0.18, 0.0, rate=0.8)
    assert fault is not None
    assert (fault.kind, fault.thing) == (FaultKind.OUT_OF_STEP, thing)
    assert says in fault.detail


def test_cells_that_fall_out_of_step_while_held_are_a_fault() -> None:
    b = under_way(controller={"path_tolerance_rad": 1.0})
    b.controller.hold()
    b.step_to_rest()
    b.bus.jam("servo_c2")
    b.bus.push("servo_c2", 0.9)  # 0.22 rad at the crease, a fifth of its way
    b.steps(2)
    ends_in_fault(b, FaultKind.OUT_OF_STEP, "c2")


def test_a_stall_is_found_by_the_path_tolerance() -> None:
    b = under_way()
    b.bus.jam("servo_c2")
    result = ends_in_fault(b, FaultKind.PATH_TOLERANCE, "servo_c2")
    assert "path_tolerance_rad" in str(result.fault)
    assert "c2" in str(result.fault)


def test_being_pushed_away_at_rest_is_a_fault_too() -> None:
    b = bench()
    b.steps(5)
    b.bus.jam("servo_c1")
    b.bus.push("servo_c1", -0.6)
    b.steps(2)
    assert b.controller.state is State.FAULT
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.PATH_TOLERANCE


def test_a_hinge_that_does_not_reach_the_end_keeps_the_latches_open() -> None:
    b = bench(latch=[PIN], controller={"goal_tolerance_rad": 0.005, "settle_timeout_s": 0.5})
    b.controller.deploy()
    b.step_until_fold(0.985)
    b.bus.jam("servo_c4")
    result = ends_in_fault(b, FaultKind.GOAL_TOLERANCE, "servo_c4")
    assert "goal_tolerance_rad" in str(result.fault)
    assert not any(reading.engaged for reading in b.bus.read_latches())


def test_unplugging_is_a_fault_in_a_cycle_and_reconnecting_moves_nothing() -> None:
    b = under_way()
    b.bus.unplug()
    record = b.controller.step()
    assert record.state is State.FAULT
    assert record.rate == 0.0
    assert record.fault is not None
    assert record.fault.kind is FaultKind.BUS_CLOSED
    b.bus.replug()
    b.steps(30)
    assert not b.bus.connected
    b.controller.clear_fault()
    assert b.controller.state is State.DISCONNECTED
    before = b.bus.true_shaft_rad
    b.controller.connect()
    b.steps(30)
    np.testing.assert_allclose(b.bus.true_shaft_rad, before, atol=1e-3)
    b.controller.arm()
    b.steps(30)
    np.testing.assert_allclose(b.bus.true_shaft_rad, before, atol=0.01)
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_a_fault_outlives_the_connection() -> None:
    b = under_way()
    b.bus.overload("servo_c2")
    b.controller.run()
    b.controller.disconnect()
    b.controller.connect()
    assert b.controller.state is State.FAULT
    b.steps(10)
    b.controller.clear_fault()
    assert b.controller.state is State.READY


def test_goals_from_before_a_disconnection_are_never_sent_again() -> None:
    b = bench(controller={"at_close": "relax"})
    b.controller.disconnect()
    b.bus.push("servo_c2", -0.3)
    b.controller.connect()
    before = b.bus._servos.goal_rad
    assert np.isnan(b.steps(20).commanded_rad).all()
    assert b.bus._servos.goal_rad is before
    assert b.controller.state is State.READY


def test_a_fault_is_not_cleared_while_slowing_down() -> None:
    b = under_way()
    b.bus.jam("servo_c2")
    while b.controller.state is not State.FAULT:
        b.steps(1)
    for command in ("clear_fault", "disarm", "disconnect"):
        with pytest.raises(IllegalCommand, match="still slowing down"):
            getattr(b.controller, command)()
    b.controller.run()
    b.controller.clear_fault()


@pytest.mark.parametrize("inject", ["overload", "reboot"])
def test_torque_that_was_lost_comes_back_by_arming_only(inject: str) -> None:
    b = under_way()
    getattr(b.bus, inject)("servo_c2")
    b.controller.run()
    b.steps(20)
    assert not b.bus.true_torque_on[1]
    b.controller.clear_fault()
    assert b.controller.state is State.READY
    b.steps(20)
    assert not b.bus.true_torque_on[1]
    before = b.bus.true_shaft_rad
    b.controller.arm()
    b.steps(20)
    assert b.bus.true_torque_on.all()
    np.testing.assert_allclose(b.bus.true_shaft_rad, before, atol=0.01)


def test_clearing_a_fault_moves_nothing() -> None:
    b = under_way()
    b.bus.jam("servo_c2")
    b.controller.run()
    before = b.bus.true_shaft_rad
    b.controller.clear_fault()
    assert b.controller.state is State.ARMED
    b.bus.free("servo_c2")
    b.steps(50)
    np.testing.assert_allclose(b.bus.true_shaft_rad, before, atol=0.01)


def test_a_cause_that_persists_is_found_again() -> None:
    b = under_way(controller={"pause_patience_s": 0.0})
    b.bus.sag(4.0)
    b.controller.run()
    b.controller.clear_fault()
    b.steps(12)
    assert b.controller.state is State.FAULT
    b.bus.sag(0.0)
    b.controller.clear_fault()
    b.steps(10)
    assert b.controller.state is State.ARMED


def test_an_error_that_cannot_be_reset_stays() -> None:
    b = under_way()
    b.bus.overheat("servo_c2", 95.0)
    b.controller.run()
    with pytest.raises(CommandRefused, match="servo_c2"):
        b.controller.clear_fault()
    assert b.controller.state is State.FAULT
    assert b.controller.fault is not None


# -- latches


@pytest.mark.parametrize("table", [PIN, ELECTROMAGNET], ids=["lock_pin", "electromagnet"])
def test_never_deployed_while_a_latch_is_stuck_open(table: dict[str, object]) -> None:
    b = bench(latch=[table])
    b.bus.latch_stuck(str(table["id"]))
    b.controller.deploy()
    result = b.controller.run()
    assert result.fault is not None
    assert result.fault is not None
    assert result.fault.thing == table["id"]
    assert result.fault.kind in (FaultKind.LATCH_TIMEOUT, FaultKind.LATCH_TRIPPED)
    assert "slit:P-T2" in str(result.fault) or "on for more" in str(result.fault)
    assert State.DEPLOYED not in {record.state for record in b.records}


def test_never_deployed_while_a_sensor_is_blind() -> None:
    b = bench()
    b.bus.latch_blind("latch_cell:c1")
    b.controller.deploy()
    result = ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "latch_cell:c1")
    assert "its sensor cannot tell" in str(result.fault)
    np.testing.assert_allclose(b.records[-1].folds, 1.0, atol=0.01)


def test_lost_latch_replies_delay_the_confirmation_only() -> None:
    b = bench()
    b.controller.deploy()
    while b.controller.step().stage != "latch":
        pass
    b.bus.drop_latch_replies(20)
    assert b.controller.run().succeeded


def test_a_silent_latch_is_a_timeout() -> None:
    b = bench()
    b.controller.deploy()
    while b.controller.step().stage != "latch":
        pass
    b.bus.drop_latch_replies(10**6)
    result = ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "latch_slit:P-T2")
    assert "silent" in str(result.fault)


def test_a_latch_that_trips_is_named() -> None:
    b = bench(latch=[{**ELECTROMAGNET, "max_on_s": 0.5}, {**PIN, "secures": "cell:c1", "timeout_s": 5.0}])
    b.bus.latch_stuck("pin")
    b.controller.deploy()
    ends_in_fault(b, FaultKind.LATCH_TRIPPED, "coil")


def test_a_deployed_structure_that_loses_a_latch_says_so() -> None:
    b = bench(latch=[ELECTROMAGNET])
    b.controller.deploy()
    assert b.controller.run().succeeded
    b.steps(150)  # on for longer than the coil bears
    assert b.controller.state is State.FAULT
    assert b.controller.fault is not None
    assert (b.controller.fault.kind, b.controller.fault.thing) == (FaultKind.LATCH_LOST, "coil")
    assert b.controller.result().fault is not None


def test_a_deployed_structure_stays_deployed_through_lost_latch_replies() -> None:
    b = bench()
    b.controller.deploy()
    b.controller.run()
    b.bus.drop_latch_replies(2)
    b.steps(50)
    assert b.controller.state is State.DEPLOYED


def test_a_sensor_that_says_closed_where_nothing_can_be_is_not_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    b = bench()
    monkeypatch.setattr(b.bus._latches[0], "closed", lambda _: True)
    b.controller.deploy()
    ends_in_fault(b, FaultKind.LATCH_SENSOR, b.rig.latch_ids[0])
    assert b.records[-1].commanded_fold < 0.5


def test_a_latch_that_does_not_open_keeps_the_structure_where_it_is() -> None:
    b = bench(start="deployed", latch=[PIN])
    b.bus.latch_stuck("pin")
    before = b.bus.true_output_rad
    b.controller.stow()
    result = ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "pin")
    assert "not open" in str(result.fault)
    np.testing.assert_allclose(b.bus.true_output_rad, before, atol=0.01)


def test_a_latch_that_cannot_say_that_it_is_open_keeps_the_structure_where_it_is() -> None:
    b = bench(start="deployed", latch=[PIN])
    b.bus.latch_blind("pin")
    b.controller.stow()
    result = ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "pin")
    assert "its sensor cannot tell" in str(result.fault)
    np.testing.assert_allclose(b.records[-1].folds, 1.0, atol=0.01)


def test_a_magnet_that_does_not_let_go_stops_the_motion() -> None:
    b = bench(start="deployed")
    b.bus.latch_stuck("latch_slit:P-T2")
    b.controller.stow()
    result = b.controller.run()
    assert result.fault is not None
    assert result.fault is not None
    assert result.fault.kind in (FaultKind.PATH_TOLERANCE, FaultKind.OUT_OF_STEP)


def test_a_stow_lock_that_does_not_open_keeps_the_structure_stowed() -> None:
    b = bench(latch=[STOW_LOCK])
    b.bus.latch_stuck("lock")
    b.controller.deploy()
    ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "lock")
    np.testing.assert_allclose(b.records[-1].folds, 0.0, atol=0.01)


def test_never_stowed_while_the_stow_lock_is_not_confirmed() -> None:
    b = bench(start="deployed", latch=[STOW_LOCK])
    b.bus.latch_blind("lock")
    b.controller.stow()
    ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "lock")
    assert State.STOWED not in {record.state for record in b.records}


def test_never_stowed_while_a_hinge_is_not_measured_closed() -> None:
    b = bench(start="deployed", controller={"goal_tolerance_rad": 0.005})
    b.controller.stow()
    b.step_until_fold(0.015)
    b.bus.jam("servo_c1")
    ends_in_fault(b, FaultKind.GOAL_TOLERANCE, "servo_c1")
    assert State.STOWED not in {record.state for record in b.records}


def test_unplugging_between_commands_shows_at_the_next_one() -> None:
    b = bench()
    b.bus.unplug()
    with pytest.raises(BusClosed):
        b.controller.deploy()
    b.steps(1)
    assert b.controller.state is State.FAULT
