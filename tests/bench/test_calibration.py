"""Zeros from shafts, and when a hinge stands against its stop: arithmetic and recorded traces, no servos."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.dynamixel.wiring import HingeServo
from ori_deploy.bench.calibration import (
    LEAD_RAD,
    READINGS,
    SCATTER_RAD,
    STILL_S,
    HingeZero,
    NotCalibrated,
    StopDetector,
    as_switched_on,
    nearest_turn,
    steady,
    zero_rad,
)
from ori_deploy.wire.dynamixel import OperatingMode, model_named

CYCLE_S = 0.03
LIMIT_A = 0.3
ANGLES = st.floats(-10.0, 10.0)
GEARS = st.floats(0.1, 20.0).flatmap(lambda gear: st.sampled_from((gear, -gear)))


@given(ANGLES, GEARS, st.floats(0.0, math.pi))
def test_the_zero_makes_the_rigs_own_formula_true(zero: float, gear: float, crease: float) -> None:
    shaft = zero + gear * crease
    assert zero_rad(shaft, gear, crease) == pytest.approx(zero, abs=1e-9)


@given(st.integers(0, 4095), st.integers(-60, 60), st.integers(-1024, 1024))
def test_a_shaft_reads_the_same_after_a_restart_whatever_turns_were_counted(
    raw: int, turns: int, offset: int
) -> None:
    """Position mode shows the raw position in its turn plus the offset, modes of many turns show everything."""
    assert as_switched_on(raw + 4096 * turns + offset, offset) == raw + offset


@given(st.integers(0, 4095), st.integers(-60, 60), st.integers(1025, 100_000))
def test_position_mode_adds_no_offset_beyond_a_quarter_turn(raw: int, turns: int, offset: int) -> None:
    assert as_switched_on(raw + 4096 * turns + offset, offset) == raw


@given(ANGLES, ANGLES)
def test_the_nearest_turn_is_the_same_place_within_half_a_turn(zero: float, old: float) -> None:
    near = nearest_turn(zero, old)
    assert abs(near - old) <= math.pi + 1e-9
    assert math.remainder(near - zero, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.floats(-0.5 * SCATTER_RAD, 0.5 * SCATTER_RAD), min_size=READINGS, max_size=READINGS), ANGLES)
def test_the_median_of_steady_readings_lies_among_them(noise: list[float], where: float) -> None:
    readings = [where + 0.99 * value for value in noise]
    middle, spread = steady(readings, "servo_1")
    assert min(readings) <= middle <= max(readings)
    assert spread <= SCATTER_RAD


def test_one_reading_that_is_off_means_that_it_was_not_held_still() -> None:
    with pytest.raises(NotCalibrated, match=r"servo_1 was not held still.*limit: 0\.69 deg.*remedy"):
        steady([0.0] * (READINGS - 1) + [1.1 * SCATTER_RAD], "servo_1")


def at_stop_after(trace: list[tuple[float, float]]) -> int | None:
    """Index of the reading (position, current) at which a stop is seen."""
    detector = StopDetector(LIMIT_A)
    for k, (position, current) in enumerate(trace):
        if detector.at_stop(k * CYCLE_S, position, current):
            return k
    return None


def moving(n: int, speed: float = 0.26, current: float = 0.08) -> list[tuple[float, float]]:
    return [(speed * CYCLE_S * k, current) for k in range(n)]


def standing(n: int, position: float, current: float) -> list[tuple[float, float]]:
    """With the last digit of the encoder coming and going."""
    return [(position + 0.0015 * (k % 2), current) for k in range(n)]


def test_a_stop_is_seen_once_the_shaft_has_stood_still_pressing_for_long_enough() -> None:
    way = moving(60)
    seen = at_stop_after(way + standing(60, way[-1][0], LIMIT_A))
    assert seen is not None
    assert (seen - 59) * CYCLE_S >= STILL_S - 1e-9
    assert (seen - 59) * CYCLE_S <= STILL_S + 3 * CYCLE_S


@pytest.mark.parametrize(
    "trace",
    [
        moving(300, current=LIMIT_A),  # heavy, but on its way
        moving(300, speed=0.02, current=LIMIT_A),  # hardly on its way
        standing(300, 0.0, 0.5 * LIMIT_A),  # not pressing: it has not begun to move
        standing(12, 0.0, LIMIT_A) + moving(300),  # sticks at the start
        [(0.03 * math.sin(0.5 * k), LIMIT_A) for k in range(300)],  # swings
    ],
)
def test_what_is_no_stop_is_not_taken_for_one(trace: list[tuple[float, float]]) -> None:
    assert at_stop_after(trace) is None


def test_pushing_either_way_counts() -> None:
    assert at_stop_after(standing(60, 1.0, -LIMIT_A)) is not None


def test_a_single_reading_far_off_does_not_move_the_stop() -> None:
    detector = StopDetector(LIMIT_A)
    for k, (position, current) in enumerate(standing(60, 1.0, LIMIT_A)):
        detector.at_stop(k * CYCLE_S, position, current)
    assert detector.position_rad == pytest.approx(1.0, abs=2e-3)
    assert detector.scatter_rad <= 2e-3


@pytest.mark.parametrize(
    ("gear", "crease", "other", "towards"),
    [(2.0, 0.0, 3.0, -1), (-2.0, 0.0, 3.0, 1), (2.0, 3.0, 0.0, 1), (-4.0, 3.1, 2.0, -1)],
)
def test_a_hinge_walks_towards_the_end_where_it_is_measured(
    gear: float, crease: float, other: float, towards: int
) -> None:
    servo = HingeServo("servo_1", 1, model_named("xm430"), OperatingMode.POSITION, 0, 4095)
    hinge = HingeZero(servo, "c1", "close_a", gear, 0.0, crease, other)
    assert hinge.towards == towards
    assert hinge.way_rad == pytest.approx(abs(gear * (crease - other)))
    assert hinge.way_rad > LEAD_RAD
