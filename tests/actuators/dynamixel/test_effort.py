"""Effort on virtual servos: which register limits it, in which units, and what that does to the motor."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.dynamixel.bus import REARM_EVERY
from ori_deploy.wire.dynamixel import model_named
from tests.actuators.dynamixel.virtual import N, Setup, servos

HINGES = range(1, N + 1)
PIN = 20
FULL_PWM = 885


def registers(setup: Setup, name: str) -> list[int]:
    if setup.bus.connected:
        setup.bus.read_hinges()  # nobody answers a sync write: behind this answer it has been heard
    return [setup.virtual.register(i, name) for i in HINGES]


@pytest.mark.parametrize("turns", [False, True], ids=["position", "extended position"])
def test_in_position_modes_goal_pwm_limits_it(tmp_path: Path, turns: bool) -> None:
    with servos(tmp_path, turns=turns) as setup:
        setup.bus.connect()
        if turns:
            setup.bus.vouch(setup.bus.read_hinges().position_rad, np.full(N, 0.1))
        setup.bus.enable_torque()
        assert registers(setup, "operating_mode") == [4 if turns else 3] * N
        pin = setup.virtual.register(PIN, "goal_pwm")
        for part in (0.6, 0.25, 1e-6, 1.0):
            setup.bus.limit_effort(part)
            assert registers(setup, "goal_pwm") == [max(1, round(part * FULL_PWM))] * N
        assert setup.virtual.register(PIN, "goal_pwm") == pin


def test_in_current_based_position_mode_goal_current_limits_it(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"operating_mode": "current_based_position", "current_limit_a": 0.8}
    unit = model_named("XM430-W350").current_unit_a
    assert unit is not None
    with servos(tmp_path, **settings) as setup:
        setup.bus.connect()
        setup.bus.enable_torque()
        full = round(0.8 / unit)
        assert registers(setup, "goal_current") == [full] * N
        setup.bus.limit_effort(0.5)
        assert registers(setup, "goal_current") == [round(0.5 * full)] * N
        assert registers(setup, "current_limit") == [full] * N
        assert registers(setup, "goal_pwm") == [FULL_PWM] * N
        setup.bus.limit_effort(1.0)
        assert registers(setup, "goal_current") == [full] * N


def test_it_is_a_part_of_what_the_servo_itself_allows(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.virtual.set_register(2, "pwm_limit", 500)
        setup.bus.connect()
        setup.bus.enable_torque()
        setup.bus.limit_effort(0.5)
        assert registers(setup, "goal_pwm") == [round(0.5 * FULL_PWM), 250, round(0.5 * FULL_PWM)]


def test_a_servo_without_a_current_sensor_is_limited_too(tmp_path: Path) -> None:
    with servos(tmp_path, model="XL430-W250") as setup:
        setup.bus.connect()
        setup.bus.enable_torque()
        setup.bus.limit_effort(0.4)
        assert registers(setup, "goal_pwm") == [round(0.4 * FULL_PWM)] * N


def test_a_servo_that_missed_it_is_told_again(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        goal = setup.bus.enable_torque()
        setup.bus.limit_effort(0.5)
        setup.virtual.set_register(3, "goal_pwm", FULL_PWM)
        for _ in range(REARM_EVERY):
            setup.bus.command_hinges(goal)
        assert registers(setup, "goal_pwm") == [round(0.5 * FULL_PWM)] * N


def test_connecting_changes_nothing_and_torque_on_takes_the_limit_off(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        setup.bus.enable_torque()
        setup.bus.limit_effort(0.5)
        setup.bus.close()
        other = setup.again()
        other.connect()
        assert registers(setup, "goal_pwm") == [round(0.5 * FULL_PWM)] * N
        other.enable_torque()  # asks every servo, behind the limit
        assert registers(setup, "goal_pwm") == [FULL_PWM] * N
        other.close()


def test_a_blocked_servo_pushes_no_harder_than_its_part(tmp_path: Path) -> None:
    model = model_named("XM430-W350")
    idle, stall, part = 0.05, model.stall_current_a, 0.3
    with servos(tmp_path) as setup:
        setup.bus.connect()
        goal = setup.bus.enable_torque()
        setup.virtual.jam(2)
        for limit in (1.0, part):
            setup.bus.limit_effort(limit)
            end = time.monotonic() + 0.3
            while time.monotonic() < end:
                setup.bus.command_hinges(goal + np.array([0.0, 0.4, 0.0]))
                time.sleep(0.01)
            current = setup.virtual.truth()[2].current_a
            assert current == pytest.approx(idle + (stall - idle) * limit, rel=0.02)


def test_a_servo_whose_pwm_is_limited_turns_slower_in_proportion(tmp_path: Path) -> None:
    fastest = []
    for part in (1.0, 0.3):
        with servos(tmp_path, turns=True, servo={"load_nm": 0.0}) as setup:
            setup.bus.connect()
            setup.bus.vouch(setup.bus.read_hinges().position_rad, np.full(N, 0.1))
            goal = setup.bus.enable_torque()
            setup.bus.limit_effort(part)
            setup.bus.command_hinges(goal + 3.0)
            time.sleep(0.25)
            fastest.append(setup.virtual.truth()[1].velocity_rad_s)
    assert fastest[1] == pytest.approx(0.3 * fastest[0], rel=0.02)
