"""What the controller promises when nothing breaks, and what operators may do to it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from ori_deploy.actuators.bus import BusClosed, CommandRefused
from ori_deploy.deploy.result import CycleRecord, FaultKind, Outcome, StartRefused
from ori_deploy.deploy.states import IllegalCommand, State
from tests.deploy.synthetic import Bench, bench, synthetic_plan

PIN = {"id": "pin", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.3, "timeout_s": 1.0}
STOW_LOCK = {
    "id": "lock",
    "secures": "stow",
    "kind": "electromagnet",
    "max_on_s": 5.0,
    "duty_cycle": 1.0,
    "timeout_s": 1.0,
}


def states(b: Bench) -> list[str]:
    return [str(t.target) for record in b.records for t in record.transitions]


def largest_step(b: Bench) -> float:
    """Largest change of a command from one cycle to the next, at the crease, as a rate."""
    goals = np.array([record.commanded_rad for record in b.records]) / 4.0
    return float(np.abs(np.diff(goals, axis=0)).max()) * b.rig.rate_hz


def peak_crease_rate(b: Bench) -> float:
    return float(np.abs(b.rig.driven(b.plan.crease_rates_rad_s)).max())


@pytest.mark.parametrize("n_cells", [1, 4, 12])
@pytest.mark.parametrize("curvature", [0.0, 0.3])
def test_deploys_and_stows(n_cells: int, curvature: float) -> None:
    b = bench(synthetic_plan(n_cells, curvature=curvature), latch=[PIN, STOW_LOCK])
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert result.state is State.DEPLOYED
    assert all(b.bus.truly_closed(latch.id) for latch in b.rig.latches)
    assert not b.bus.truly_closed("lock")
    np.testing.assert_allclose(b.records[-1].folds, 1.0, atol=0.01)
    b.controller.stow()
    result = b.controller.run()
    assert result.succeeded
    assert result.state is State.STOWED
    assert b.bus.truly_closed("lock")
    assert not any(b.bus.truly_closed(latch.id) for latch in b.rig.latches)
    np.testing.assert_allclose(b.records[-1].folds, 0.0, atol=0.01)
    assert states(b) == [
        "ready", "armed", "latching", "moving", "latching", "deployed", "latching", "moving", "latching", "stowed",
    ]  # fmt: skip


def test_a_run_can_be_repeated_exactly() -> None:
    runs = []
    for _ in range(2):
        b = bench()
        b.controller.deploy()
        result = b.controller.run()
        runs.append((result, np.array([record.readings.position_rad for record in b.records])))
    assert runs[0][0] == runs[1][0]
    np.testing.assert_array_equal(runs[0][1], runs[1][1])


def test_motion_follows_the_plan_in_time_and_speed() -> None:
    b = bench()
    b.controller.deploy()
    result = b.controller.run()
    # The plan's two seconds, the alignment, the ramp to full rate, and the latches.
    assert 2.0 < result.duration_s < 3.0
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    assert result.worst_tracking_rad < b.rig.controller.path_tolerance_rad / 2.0
    assert max(np.ptp(record.folds) for record in b.records) < 0.02


def test_arming_moves_nothing() -> None:
    b = bench(start_fold=0.4, armed=False)
    before = b.bus.true_shaft_rad
    b.controller.connect()
    b.steps(20)
    assert not b.bus.true_torque_on.any()
    b.controller.arm()
    b.steps(50)
    assert b.bus.true_torque_on.all()
    np.testing.assert_allclose(b.bus.true_shaft_rad, before, atol=0.01)


@pytest.mark.parametrize("fold", [0.0, 0.03, 0.5, 0.97, 1.0])
@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_starts_wherever_on_the_path_it_stands_without_a_jump(fold: float, command: str) -> None:
    b = bench(start_fold=fold)
    getattr(b.controller, command)()
    assert b.controller.run().succeeded
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    for before, record in pairwise(b.records):  # the rate changes gently, but may end where the plan rests
        assert record.rate == 0.0 or abs(record.rate - before.rate) <= 0.0534


def test_small_misalignment_of_cells_is_taken_out_slowly_before_the_motion() -> None:
    b = bench(start_fold=0.5, armed=False)
    for hinge, push in (("servo_c1", 0.08), ("servo_c3", -0.1)):
        b.bus.push(hinge, push)  # 0.02 and 0.025 rad at the crease
    b.controller.connect()
    b.controller.arm()
    seeded = b.bus._servos.goal_rad.copy()
    b.controller.deploy()
    record = b.controller.step()
    np.testing.assert_allclose(record.commanded_rad, seeded, rtol=0, atol=1e-6)
    while np.isclose(record.commanded_fold, b.records[0].commanded_fold) or record.state is State.LATCHING:
        record = b.controller.step()
    aligning = np.array([r.commanded_rad for r in b.records[:-1]]) / 4.0
    assert np.abs(np.diff(aligning, axis=0)).max() * 100.0 <= b.rig.controller.align_velocity_rad_s * 1.001
    assert b.controller.run().succeeded


def test_start_is_refused_when_a_hinge_is_silent_and_nothing_moves() -> None:
    b = bench()
    b.bus.mute("servo_c2")
    with pytest.raises(StartRefused, match="no valid position from servo_c2"):
        b.controller.deploy()
    assert b.controller.state is State.ARMED
    b.bus.unmute("servo_c2")
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_start_survives_as_many_lost_replies_as_the_motion() -> None:
    b = bench()
    b.bus.drop_replies("servo_c2", 2)
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_start_is_refused_when_a_cell_was_moved_off_the_path() -> None:
    b = bench(start_fold=0.5, armed=False)
    b.bus.push("servo_c4", -0.5)
    b.controller.connect()
    b.controller.arm()
    with pytest.raises(StartRefused, match="cell c4 is off the path"):
        b.controller.deploy()
    assert b.controller.state is State.ARMED


def test_start_is_refused_when_an_actuator_is_hot() -> None:
    b = bench()
    b.bus.overheat("servo_c3", 75.0)
    with pytest.raises(StartRefused, match=r"servo_c3.*75.0 °C.*limit: 70"):
        b.controller.deploy()


def test_arming_is_refused_when_a_hinge_does_not_say_where_it_is() -> None:
    b = bench(armed=False)
    b.controller.connect()
    b.bus.mute("servo_c1")
    with pytest.raises(CommandRefused, match="servo_c1"):
        b.controller.arm()
    assert b.controller.state is State.READY
    assert not b.bus.true_torque_on.any()


COMMANDS: dict[str, Callable[[Bench], object]] = {
    name: (lambda b, name=name: getattr(b.controller, name)())
    for name in ("connect", "arm", "disarm", "deploy", "stow", "hold", "resume", "stop", "clear_fault")
}


@pytest.mark.parametrize("command", ["connect", "arm", "disarm", "deploy", "resume", "clear_fault"])
def test_a_command_that_does_not_belong_into_a_motion_changes_nothing(command: str) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.3)
    with pytest.raises(IllegalCommand, match=rf"{command}.*moving.*hold, stop"):
        COMMANDS[command](b)
    assert b.controller.run().succeeded


def test_being_late_is_forgotten_at_rest() -> None:
    b = bench(controller={"overruns_allowed": 3})
    b.controller.deploy()
    b.step_until_fold(0.3)
    for _ in range(6):
        b.clock.sleep_until(b.clock.now() + 0.011)
        b.steps(1)
    b.controller.run()
    b.clock.sleep_until(b.clock.now() + 10.0)
    b.controller.clear_fault()
    b.steps(5)
    assert b.controller.fault is None


def test_what_an_observer_cannot_tell_is_no_end_of_the_result() -> None:
    class Broken:
        def __call__(self, record: CycleRecord) -> None:
            del record

        @property
        def problems(self) -> list[str]:
            raise OSError(5, "broken")

    b = bench()
    b.controller.add_observer(Broken())
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert any("broken" in error for error in result.observer_errors)


def test_step_needs_a_connection_and_result_a_command() -> None:
    b = bench(armed=False)
    with pytest.raises(IllegalCommand, match="step"):
        b.controller.step()
    b.controller.connect()
    with pytest.raises(IllegalCommand, match="result"):
        b.controller.run()


def test_connecting_to_nothing_says_so() -> None:
    b = bench(armed=False)
    b.bus.unplug()
    with pytest.raises(BusClosed):
        b.controller.connect()
    assert b.controller.state is State.DISCONNECTED


def test_disarm_lets_go() -> None:
    b = bench()
    b.controller.deploy()
    b.controller.run()
    b.controller.disarm()
    assert b.controller.state is State.READY
    assert not b.bus.true_torque_on.any()
    b.steps(10)
    with pytest.raises(IllegalCommand, match="result"):
        b.controller.result()


@pytest.mark.parametrize(("at_close", "holds"), [("hold", True), ("relax", False)])
def test_closing_in_mid_motion_first_comes_to_rest_along_the_path(at_close: str, holds: bool) -> None:
    b = bench(controller={"at_close": at_close})
    with b.controller:
        b.controller.deploy()
        b.step_until_fold(0.5)
        count = len(b.records)
    assert b.controller.state is State.DISCONNECTED
    assert not b.bus.connected
    assert b.records[-1].rate == 0.0
    assert 5 <= len(b.records) - count <= 9  # a fault's ramp
    assert b.bus.true_torque_on.all() == holds
    b.controller.close()  # again: nothing happens
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.INTERRUPTED


class Boom(Exception):
    pass


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_whatever_interrupts_a_run_the_structure_comes_to_rest_and_the_error_goes_on(
    error: type[BaseException],
) -> None:
    b = bench()

    def interrupt(record: CycleRecord) -> None:
        if record.state is State.MOVING and record.stage == "open" and record.commanded_fold > 0.4:
            raise error

    b.controller.add_observer(interrupt)
    b.controller.deploy()
    with pytest.raises(error):
        b.controller.run()
    assert b.records[-1].rate == 0.0
    assert b.controller.state is State.FAULT
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.INTERRUPTED
    assert error.__name__ in b.controller.fault.detail
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    b.controller.clear_fault()
    b.controller.stow()
    assert b.controller.run().succeeded


def test_a_bus_that_raises_something_unheard_of_ends_in_rest_and_the_error_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    sound = b.bus._read_hinges

    def broken() -> object:
        monkeypatch.setattr(b.bus, "_read_hinges", sound)
        raise Boom

    monkeypatch.setattr(b.bus, "_read_hinges", broken)
    with pytest.raises(Boom):
        b.controller.run()
    assert b.records[-1].rate == 0.0
    assert b.controller.state is State.FAULT


def test_a_bus_that_keeps_raising_leaves_the_last_goals_and_the_first_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    monkeypatch.setattr(b.bus, "_read_hinges", lambda: (_ for _ in ()).throw(Boom("first")))
    with pytest.raises(Boom, match="first"):
        b.controller.run()
    assert b.controller.state is State.FAULT
    assert not b.controller.under_way


def test_an_observer_that_fails_is_reported_and_the_motion_finishes() -> None:
    b = bench()
    calls = 0

    def full_disk(_: CycleRecord) -> None:
        nonlocal calls
        calls += 1
        if calls == 50:
            raise OSError("No space left on device")

    b.controller.add_observer(full_disk)
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert result.observer_errors == ("OSError: No space left on device",)
    assert calls == 50
    assert len(b.records) > 200


def test_late_cycles_are_counted_and_never_made_up_for_by_a_jump() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    b.bus.delay_reads(1, 0.034)  # three deadlines pass
    b.steps(10)
    b.bus.delay_reads(1, 0.0101)
    result = b.controller.run()
    assert result.succeeded
    assert result.overruns == 4
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    times = np.array([record.time_s for record in b.records])
    assert np.diff(times).min() > 0.0099


def test_after_a_gap_the_motion_starts_again_from_rest() -> None:
    b = bench()
    b.controller.deploy()
    before = b.step_until_fold(0.4)
    b.clock.sleep_until(b.clock.now() + 2.0)
    record = b.controller.step()
    assert record.rate == 0.0
    assert record.overruns >= 199
    np.testing.assert_array_equal(record.commanded_rad, before.commanded_rad)
    assert 0.0 < b.controller.step().rate <= 0.0401
    assert b.controller.run().succeeded


def test_arrays_that_observers_get_cannot_be_written_to() -> None:
    record = bench().steps(1)
    b = bench()
    b.steps(1)
    for array in (b.records[0].commanded_rad, b.records[0].folds, b.records[0].readings.position_rad):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert record.commanded_rad is not None


def test_interrupted_at_rest_the_observers_still_see_the_fault() -> None:
    b = bench(latch=[PIN])
    b.controller.deploy()
    b.steps(2)
    b.controller.close()
    assert b.records[-1].state is State.FAULT


def test_stopping_while_latching_takes_the_current_off_the_magnets() -> None:
    coil = {**STOW_LOCK, "id": "coil", "secures": "slit:P-T2"}
    b = bench(latch=[coil, {**PIN, "secures": "cell:c1", "travel_s": 0.8}])
    b.controller.deploy()
    while b.controller.step().stage != "latch":
        pass
    while not b.bus.read_latches()[0].engaged:
        b.controller.step()
    b.controller.stop()
    assert not b.bus.read_latches()[0].engaged
    assert b.controller.run().outcome is Outcome.STOPPED


def test_opening_begins_with_every_latch_open() -> None:
    b = bench(start="deployed", latch=[PIN])
    b.bus.latch_stuck("pin")
    b.controller.deploy()
    result = b.controller.run()
    assert result.fault is not None
    assert (result.fault.kind, result.fault.thing) == (FaultKind.LATCH_TIMEOUT, "pin")
    assert "not open" in result.fault.detail


def test_a_loop_that_is_always_late_is_a_fault_and_one_that_sometimes_is_goes_on() -> None:
    for allowed, faults in ((5, True), (40, False)):
        b = bench(controller={"overruns_allowed": allowed})
        b.controller.deploy()
        b.step_until_fold(0.3)
        for _ in range(20):
            b.clock.sleep_until(b.clock.now() + 0.011)
            b.steps(1)
        result = b.controller.run()
        assert (result.fault is not None) == faults
        assert result.overruns >= 6
        if result.fault is not None:
            assert result.fault.kind is FaultKind.OVERRUN
            assert "overruns_allowed" in result.fault.detail


def test_time_between_commands_is_no_overrun() -> None:
    b = bench()
    b.steps(3)
    b.clock.sleep_until(b.clock.now() + 60.0)
    b.controller.deploy()
    assert b.controller.run().overruns == 0


def test_deploy_needs_another_word_once_deployed() -> None:
    b = bench(start="deployed")
    b.controller.deploy()  # armed somewhere: deploying confirms what is already so
    assert b.controller.run().succeeded
    with pytest.raises(IllegalCommand, match=r"deploy.*stow"):
        b.controller.deploy()


def test_records_carry_what_was_read_and_when() -> None:
    b = bench()
    b.controller.deploy()
    b.controller.run()
    times = np.array([record.time_s for record in b.records])
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)
    assert [record.index for record in b.records] == list(range(len(b.records)))
    health = [record.time_s for record in b.records if record.health is not None]
    np.testing.assert_allclose(np.diff(health), b.rig.controller.health_period_s, atol=1e-9)
    latching = [r for r in b.records if r.state is State.LATCHING and not r.transitions]
    assert latching
    assert all(record.latches is not None for record in latching)


@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_where_a_command_ends_it_is_done_already_and_looking_changes_nothing(command: str) -> None:
    b = bench(start="deployed" if command == "deploy" else "stowed", armed=False)
    b.controller.connect()
    assert b.controller.already(command)
    assert not b.controller.already("stow" if command == "deploy" else "deploy")
    assert b.controller.state is State.READY
    assert not b.bus.read_health().torque_on.any()


def test_not_deployed_already_while_that_is_not_known() -> None:
    """Half-way, a latch that cannot tell, a hinge that is silent: the command itself says what is wrong."""
    spoils: tuple[Callable[[Bench], None], ...] = (
        lambda b: b.bus.latch_blind(b.bus.latch_ids[0]),
        lambda b: b.bus.silence_latches(10),
        lambda b: b.bus.mute(b.bus.hinge_ids[0]),
        lambda b: b.bus.push(b.bus.hinge_ids[0], 0.5),
        lambda b: b.bus.overload(b.bus.hinge_ids[0]),
        lambda b: b.bus.unplug(),
    )
    for spoil in spoils:
        b = bench(start="deployed", armed=False)
        b.controller.connect()
        assert b.controller.already("deploy")
        spoil(b)
        assert not b.controller.already("deploy")
