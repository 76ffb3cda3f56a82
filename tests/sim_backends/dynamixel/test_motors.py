"""What shafts do: profiles, limits, jams, free play, stops, lock pins, heat and supply."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, sqrt

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ori_deploy.wire.dynamixel import MODELS
from sim_backends.dynamixel.motors import STEP_S, Motors
from sim_backends.dynamixel.spec import BusSpec, PinSpec, ServoSpec
from sim_backends.mock_latches import GRIP_RAD
from tests.sim_backends.dynamixel.test_packets import few

NIMBLE = ServoSpec(id=1, model="XL330-M077", load_nm=0.0, time_constant_s=1e-6)
"""Follows its profile at once, as long as that is slower than 40 rad/s."""


class Bench:
    """Motors without registers, run step by step, with a record of the shafts."""

    def __init__(self, *servos: ServoSpec, **spec: object) -> None:
        self.motors = Motors(BusSpec(servos=servos, **spec))  # type: ignore[arg-type]
        self.motors.torque_on[:] = True
        self.steps = 0

    def run(self, duration_s: float) -> np.ndarray:
        """Shaft angles, (steps + 1, n)."""
        rows = [self.motors.shaft_rad.copy()]
        for _ in range(round(duration_s / STEP_S)):
            self.steps += 1
            self.motors.step(self.steps * STEP_S)
            rows.append(self.motors.shaft_rad.copy())
        return np.array(rows)


# -- profiles ----------------------------------------------------------------------------------------

VELOCITIES = st.floats(1.0, 20.0)
ACCELERATIONS = st.floats(1.0, 2000.0)
GOALS = st.floats(-2.0, 2.0)


def travel_s(distance: float, velocity: float, acceleration: float) -> float:
    """Of a trapezoid from rest to rest."""
    if distance < velocity**2 / acceleration:
        return 2.0 * sqrt(distance / acceleration)
    return distance / velocity + velocity / acceleration


@few
@given(
    st.lists(st.tuples(VELOCITIES, st.floats(2.0, 200.0), GOALS, GOALS), min_size=8, max_size=8), st.floats(0.0, 1.0)
)
def test_a_profile_keeps_velocity_and_acceleration_and_arrives(
    drawn: list[tuple[float, float, float, float]], change_s: float
) -> None:
    velocity, per_s, first, then = np.array(drawn).T
    acceleration = velocity * per_s
    bench = Bench(*(replace(NIMBLE, id=k) for k in range(len(drawn))), supply_ohm=0.0)
    bench.motors.profile_rad_s[:], bench.motors.profile_rad_s2[:] = velocity, acceleration
    bench.motors.goal_rad[:] = first
    way = bench.run(change_s)
    bench.motors.goal_rad[:] = then  # whatever they were doing
    back = np.abs(then - way[-1]) + velocity / per_s
    longest = max(travel_s(d, v, a) for d, v, a in zip(back, velocity, acceleration, strict=True))
    way = np.concatenate((way[:1], way, bench.run(1.0 / per_s.min() + longest + 20 * STEP_S)[1:]))
    rates = np.diff(way, axis=0) / STEP_S
    assert (np.abs(rates).max(axis=0) <= velocity * (1 + 1e-6)).all()
    # The last two steps share what whole steps of braking leave: at most an eighth of one more.
    assert (np.abs(np.diff(rates, axis=0)).max(axis=0) <= 1.125 * acceleration * STEP_S + 1e-6).all()
    np.testing.assert_allclose(way[-1], then, atol=1e-9)


@few
@given(VELOCITIES, ACCELERATIONS, st.floats(0.05, 3.0))
def test_a_profile_takes_the_time_of_its_trapezoid(velocity: float, acceleration: float, goal: float) -> None:
    bench = Bench(NIMBLE)
    bench.motors.profile_rad_s[:], bench.motors.profile_rad_s2[:] = velocity, acceleration
    bench.motors.goal_rad[:] = goal
    needed = travel_s(goal, velocity, acceleration)
    assume(needed < 4.0)
    way = bench.run(needed + 10 * STEP_S)[:, 0]
    arrived = int(np.argmax(way >= goal - 1e-6)) * STEP_S
    assert arrived == pytest.approx(needed, abs=4 * STEP_S)
    assert way.max() <= goal + 1e-9


@few
@given(VELOCITIES, GOALS)
def test_without_acceleration_a_profile_is_a_rectangle(velocity: float, goal: float) -> None:
    bench = Bench(NIMBLE)
    bench.motors.profile_rad_s[:] = velocity
    bench.motors.goal_rad[:] = goal
    assume(abs(goal) / velocity < 4.0)
    way = bench.run(abs(goal) / velocity + 3 * STEP_S)[:, 0]
    assert np.abs(np.diff(way)).max() <= velocity * STEP_S * (1 + 1e-6)
    assert way[-1] == pytest.approx(goal, abs=1e-9)


@pytest.mark.parametrize("model", [model.name for model in MODELS])
def test_without_a_profile_it_is_as_fast_as_voltage_and_load_let_it(model: str) -> None:
    servo = ServoSpec(id=1, model=model, load_nm=0.0)
    number = next(one for one in MODELS if one.name == model)
    free = Bench(servo, supply_ohm=0.0)
    loaded = Bench(replace(servo, load_nm=0.5 * number.stall_torque_nm), supply_ohm=0.0)
    slow = Bench(servo, supply_v=0.5 * number.nominal_v, supply_ohm=0.0)
    for bench, part in ((free, 1.0), (loaded, 0.5), (slow, 0.5)):
        bench.motors.goal_rad[:] = 1000.0
        way = bench.run(0.1)[:, 0]
        assert np.diff(way).max() == pytest.approx(part * number.no_load_rad_s * STEP_S, rel=1e-6)


@few
@given(st.floats(0.005, 0.3), st.floats(-0.05, 0.05))
def test_the_shaft_follows_with_its_time_constant(time_constant_s: float, goal: float) -> None:
    assume(abs(goal) < time_constant_s)  # slow enough for its speed limit of about 4.8 rad/s
    bench = Bench(ServoSpec(id=1, load_nm=0.0, time_constant_s=time_constant_s), supply_ohm=0.0)
    bench.motors.goal_rad[:] = goal
    way = bench.run(0.2)[:, 0]
    times = np.arange(len(way)) * STEP_S
    np.testing.assert_allclose(way, goal * (1.0 - np.exp(-times / time_constant_s)), atol=1e-9)


# -- hands, loads, obstacles -------------------------------------------------------------------------


def test_nothing_moves_without_torque() -> None:
    bench = Bench(ServoSpec(id=1), ServoSpec(id=2))
    bench.motors.torque_on[:] = False, True
    bench.motors.goal_rad[:] = 1.0
    way = bench.run(1.0)
    assert (way[:, 0] == 0.0).all()
    assert way[-1, 1] == pytest.approx(1.0, abs=1e-3)
    bench.motors.torque_on[:] = True  # and nothing is caught up with
    assert abs(np.diff(bench.run(STEP_S)[:, 0])[0]) <= 46 * pi / 30 * STEP_S


def test_a_frozen_servo_holds_where_it_is_whatever_its_goal() -> None:
    bench = Bench(NIMBLE)
    bench.motors.frozen[:] = True
    bench.motors.goal_rad[:] = 1.0
    assert np.ptp(bench.run(0.5)) == 0.0
    bench.motors.push(0, 0.2)
    assert np.ptp(bench.run(0.5)) == 0.0


def test_a_limp_shaft_stays_where_it_is_pushed_a_driven_one_comes_back() -> None:
    bench = Bench(ServoSpec(id=1), ServoSpec(id=2))
    bench.motors.torque_on[:] = False, True
    for k in (0, 1):
        bench.motors.push(k, 0.4)
    np.testing.assert_allclose(bench.motors.output_rad, [0.4, 0.4])
    way = bench.run(1.0)
    np.testing.assert_allclose(way[-1], [0.4, 0.0], atol=1e-4)


def test_a_jammed_shaft_pushes_without_moving_and_goes_on_when_freed() -> None:
    bench = Bench(ServoSpec(id=1))
    bench.motors.goal_rad[:] = 1.0
    bench.run(0.1)
    bench.motors.jammed[:] = True
    assert np.ptp(bench.run(0.5)) == 0.0
    assert bench.motors.torque_nm[0] == pytest.approx(bench.motors.stall_nm[0])
    assert bench.motors.current_a[0] == pytest.approx(2.3)
    bench.motors.jammed[:] = False
    assert bench.run(1.0)[-1, 0] == pytest.approx(1.0, abs=1e-3)
    assert bench.motors.torque_nm[0] == pytest.approx(0.1, abs=0.01)  # its load


@pytest.mark.parametrize("limit", [0.05, 0.1])
def test_a_limit_below_the_load_moves_nothing_and_pushes_no_harder(limit: float) -> None:
    bench = Bench(ServoSpec(id=1, load_nm=0.1))
    bench.motors.limit_nm[:] = limit
    bench.motors.goal_rad[:] = 1.0
    assert np.ptp(bench.run(0.5)) == 0.0
    assert bench.motors.torque_nm[0] == pytest.approx(limit)


@few
@given(st.floats(0.01, 0.5), st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=4))
def test_the_crease_is_within_the_free_play_and_dragged_by_its_ends(play: float, goals: list[float]) -> None:
    bench = Bench(replace(NIMBLE, backlash_rad=play))
    for goal in goals:
        before, start = float(bench.motors.output_rad[0]), float(bench.motors.shaft_rad[0])
        bench.motors.goal_rad[:] = goal
        way = bench.run(0.2)[:, 0]
        output, shaft = float(bench.motors.output_rad[0]), float(way[-1])
        assert abs(output - shaft) <= 0.5 * play + 1e-12
        if abs(output - before) > 1e-12:  # it moved: the shaft drags it from behind
            assert output - shaft == pytest.approx(-np.copysign(0.5 * play, shaft - start), abs=1e-9)


@few
@given(st.floats(0.05, 0.5), st.floats(0.05, 0.5), st.floats(0.0, 0.04), GOALS)
def test_end_stops_hold_the_crease(low: float, high: float, play: float, goal: float) -> None:
    bench = Bench(replace(NIMBLE, backlash_rad=play, lower_stop_rad=-low, upper_stop_rad=high))
    bench.motors.goal_rad[:] = goal
    bench.run(0.5)
    assert -low - 1e-9 <= float(bench.motors.output_rad[0]) <= high + 1e-9
    assert float(bench.motors.shaft_rad[0]) == pytest.approx(
        np.clip(goal, -low - play / 2, high + play / 2), abs=1e-6
    )


def test_a_crease_pushed_past_its_stop_comes_back_and_goes_no_farther() -> None:
    bench = Bench(replace(NIMBLE, upper_stop_rad=0.3))
    bench.motors.push(0, 0.5)
    bench.motors.goal_rad[:] = 1.0
    assert bench.run(0.3)[-1, 0] == pytest.approx(0.5)
    bench.motors.goal_rad[:] = 0.0
    assert bench.run(0.3)[-1, 0] == pytest.approx(0.0, abs=1e-6)
    bench.motors.goal_rad[:] = 1.0
    assert bench.run(0.3)[-1, 0] == pytest.approx(0.3)


# -- lock pins ---------------------------------------------------------------------------------------


def pinned(pin_at: float, hinge_at: float, engaged: float, play: float = 0.0) -> Bench:
    """A hinge that is closed at 0.2 rad to within 0.05, and its pin, driven from -engaged to engaged."""
    pin = PinSpec(2, engaged, -engaged, hinge_ids=(1,), closed_rad=(0.2,), range_rad=(0.05,))
    hinge = replace(NIMBLE, start_rad=hinge_at)
    driver = replace(NIMBLE, id=2, start_rad=pin_at, backlash_rad=play)
    return Bench(hinge, driver, pins=(pin,))


@pytest.mark.parametrize("engaged", [1.0, -0.7])
@pytest.mark.parametrize("play", [0.0, 0.1])
def test_a_pin_goes_home_only_through_its_hole(engaged: float, play: float) -> None:
    for hinge_at, inside in ((0.2, True), (0.24, True), (0.26, False), (-0.5, False)):
        bench = pinned(-engaged, hinge_at, engaged, play)
        bench.motors.goal_rad[1] = engaged
        for _ in range(3):  # however long it pushes
            bench.run(0.3)
            output = float(bench.motors.output_rad[1])
            assert output == pytest.approx((engaged - np.copysign(play / 2, engaged)) if inside else 0.0, abs=1e-6)
        bench.motors.goal_rad[:] = 1.0, -engaged
        bench.run(0.6)
        assert float(bench.motors.shaft_rad[1]) == pytest.approx(-engaged, abs=1e-6)  # back out it always comes


@pytest.mark.parametrize("engaged", [1.0, -0.7])
@pytest.mark.parametrize("goal", [-1.0, 1.0])
def test_a_pin_that_is_home_keeps_its_hinge_and_one_that_is_out_does_not(engaged: float, goal: float) -> None:
    bench = pinned(engaged, 0.2, engaged)
    bench.motors.goal_rad[0] = goal
    held = bench.run(0.5)[-1, 0]
    assert held == pytest.approx(0.2 + np.copysign(GRIP_RAD, goal - 0.2), abs=1e-9)
    bench.motors.goal_rad[1] = -engaged
    assert bench.run(0.8)[-1, 0] == pytest.approx(goal, abs=1e-6)


def test_a_pin_that_meets_no_hole_is_blocked_like_anything_else() -> None:
    bench = pinned(-1.0, 1.0, 1.0)
    bench.motors.goal_rad[1] = 1.0
    bench.run(1.5)
    assert bench.motors.torque_nm[1] == pytest.approx(bench.motors.stall_nm[1])
    assert bench.motors.strained_s[1] > 1.0


# -- heat and supply ---------------------------------------------------------------------------------


@pytest.mark.parametrize("torque", [0.0, 0.5, 2.0, 4.0])
def test_heat_rises_under_load_to_what_the_current_makes_and_falls_without(torque: float) -> None:
    bench = Bench(ServoSpec(id=1, load_nm=torque), ServoSpec(id=2, load_nm=0.5 * torque), ambient_c=20.0)
    bench.motors.torque_on[:] = torque > 0.0
    rows = []
    for _ in range(20):
        bench.run(0.1)
        rows.append(bench.motors.temperature_c.copy())
    assert (np.diff(rows, axis=0) > 0.0).all()  # the electronics alone warm it
    assert (rows[-1][0] > rows[-1][1]) == (torque > 0.0)
    bench.motors.torque_on[:] = False
    bench.motors.temperature_c[:] = 70.0, 50.0
    rows = [bench.motors.temperature_c.copy()]
    for _ in range(20):
        bench.run(0.1)
        rows.append(bench.motors.temperature_c.copy())
    assert (np.diff(rows, axis=0) < 0.0).all()
    assert (np.array(rows) > 20.0).all()


def test_the_supply_sags_by_the_current_of_all_and_by_what_it_is_told() -> None:
    bench = Bench(ServoSpec(id=1, load_nm=1.0), ServoSpec(id=2, load_nm=2.0), supply_v=12.0, supply_ohm=0.1)
    bench.run(0.01)
    total = float(bench.motors.current_a.sum())
    assert total > 1.0
    np.testing.assert_allclose(bench.motors.supply_v, 12.0 - 0.1 * total)
    bench.motors.sag_v = 3.0
    np.testing.assert_allclose(bench.motors.supply_v, 9.0 - 0.1 * total)
    bench.motors.sag_v = 100.0
    assert (bench.motors.supply_v == 0.0).all()


def test_only_servos_that_turn_have_moved() -> None:
    bench = Bench(NIMBLE, replace(NIMBLE, id=2))
    bench.motors.goal_rad[:] = 0.5, 0.0
    bench.run(0.2)
    assert bench.motors.moved_s[1] == -inf
    assert 0.0 < bench.motors.moved_s[0] < 0.2


@pytest.mark.parametrize("ahead", [1e-6, 0.001, 0.005, 0.02])
def test_a_goal_just_ahead_of_a_fast_shaft_is_overrun_not_stopped_at_dead(ahead: float) -> None:
    bench = Bench(NIMBLE)
    bench.motors.profile_rad_s[:], bench.motors.profile_rad_s2[:] = 5.0, 20.0
    bench.motors.goal_rad[:] = 50.0
    way = bench.run(0.5)[:, 0]
    goal = float(way[-1]) + ahead
    bench.motors.goal_rad[:] = goal
    way = np.concatenate((way, bench.run(2.0)[1:, 0]))
    assert np.abs(np.diff(way, 2)).max() <= 1.125 * 20.0 * STEP_S**2
    assert way.max() > goal + 0.5
    assert way[-1] == pytest.approx(goal, abs=1e-9)
