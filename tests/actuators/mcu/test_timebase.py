"""What is certain about a clock that runs at another rate, seen through messages that take their time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.mcu.timebase import MAX_ERROR_S, Timebase


# The clock of the device counts in steps of 4 us, as an Arduino's does.
def exchange(base: Timebase, at_s: float, drift: float, offset_s: float, there_s: float, back_s: float) -> None:
    base.add(at_s, at_s + there_s + back_s, 4e-6 * int(2.5e5 * (offset_s + (1.0 + drift) * (at_s + there_s))))


@settings(max_examples=60)
@given(
    drift=st.floats(-5e-3, 5e-3),
    offset_s=st.floats(0.0, 1e5),
    start_s=st.floats(0.0, 1e5),
    seed=st.integers(0, 2**32 - 1),
    jitter_s=st.floats(1e-4, 5e-3),
    count=st.integers(2, 200),
)
def test_the_error_is_never_larger_than_told(
    drift: float, offset_s: float, start_s: float, seed: int, jitter_s: float, count: int
) -> None:
    random = np.random.default_rng(seed)
    base = Timebase()
    at = start_s
    for i in range(count):
        there, back = 2e-4 + random.exponential(jitter_s, 2)
        exchange(base, at, drift, offset_s - start_s, there, back)
        at += float(there + back) + (0.01 if i < 20 else 0.2)
        for ahead in (0.0, 0.3, -0.05):
            t = at + ahead
            true = offset_s - start_s + (1.0 + drift) * t
            error = base.error_s(t)
            assert abs(base._middle_s + base.rate * (t - base._anchor_s) - true) <= error + 1e-6
            assert abs(base.rate - 1.0 - drift) <= base.rate_error + 1e-9
            if error <= MAX_ERROR_S:
                assert base.host_s(base.device_s(t) + 0.1, t) == pytest.approx(t + 0.1 / (1.0 + drift), abs=2e-3)


def test_it_gets_good() -> None:
    random = np.random.default_rng(0)
    base = Timebase()
    for i in range(120):
        there, back = 5e-4 + random.exponential(2e-4, 2)
        exchange(base, 0.2 * i, 4e-3, 10.0, there, back)
    assert base.error_s(24.0) < 7e-4
    assert base.rate_error < 2e-4


def test_it_refuses_while_it_knows_nothing() -> None:
    base = Timebase()
    with pytest.raises(CommandRefused, match="limit: 10 ms"):
        base.device_s(1.0)
    with pytest.raises(CommandRefused, match="limit: 10 ms"):
        base.host_s(1.0, 1.0)
    assert not base.good_at(1.0)
    exchange(base, 0.0, 0.0, 5.0, 0.001, 0.001)
    assert base.device_s(0.1) == pytest.approx(5.1, abs=2e-3)
    with pytest.raises(CommandRefused, match="known to"):  # one exchange tells nothing of the rate
        base.device_s(10.0)
    base.forget()
    assert not base.good_at(0.0)


def test_a_slow_exchange_alone_is_not_good_enough() -> None:
    base = Timebase()
    exchange(base, 0.0, 0.0, 5.0, 0.02, 0.02)
    assert not base.good_at(0.02)


def test_a_clock_that_started_anew_replaces_the_old_one() -> None:
    base = Timebase()
    for i in range(30):
        exchange(base, 0.1 * i, 1e-3, 100.0, 0.001, 0.001)
    exchange(base, 3.0, 1e-3, -2.5, 0.001, 0.001)
    assert base.device_s(3.0) == pytest.approx(0.503, abs=2e-3)


def test_a_rate_that_changes_is_followed() -> None:
    base = Timebase()
    device = 0.0
    for i in range(300):
        base.add(0.2 * i - 0.0005, 0.2 * i + 0.0005, device)
        device += 0.2 * (1.0 + (1e-3 if i < 150 else 3e-3))
    t = 0.2 * 299
    true = device - 0.2 * 1.003
    assert abs(base.device_s(t) - true) < 1e-3
    assert base.rate == pytest.approx(1.003, abs=3e-4)


def test_an_answer_before_its_question_is_a_slip() -> None:
    with pytest.raises(ValueError, match="answer"):
        Timebase().add(1.0, 0.5, 3.0)


def test_a_coarse_clock_is_not_taken_for_an_exact_one() -> None:
    base = Timebase()
    for i in range(40):  # exchanges that take no time: all that is left is the clock's own step
        exchange(base, 0.0100007 * i, 0.0, 1.0, 1e-7, 1e-7)
        t = 0.0100007 * i
        assert abs(base.device_s(t) - 1.0 - t) <= base.error_s(t)
        assert abs(base.rate - 1.0) <= base.rate_error
