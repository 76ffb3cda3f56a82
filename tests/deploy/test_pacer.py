"""When cycles run, and how late one is said to have been."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.pacer import Pacer

PERIOD_S = 0.01


@given(st.floats(0.001, 2.0))
def test_a_cycle_is_as_late_as_it_is_after_the_deadline_that_it_missed(stall_s: float) -> None:
    """Reproduced: cycles 210 ms apart at 100 Hz, and a worst lateness of 20 ms told."""
    clock = VirtualClock(5.0)
    pacer = Pacer(clock, 1.0 / PERIOD_S)
    pacer.wait(under_way=False)
    due = 5.0 + PERIOD_S
    clock.sleep_until(due + stall_s)
    assert pacer.wait(under_way=True) == pytest.approx(due)
    assert clock.now() - due >= stall_s - 1e-9
    assert pacer.overruns == pytest.approx(stall_s / PERIOD_S, abs=1.01)
    assert pacer.late_in_a_row == 1


def test_nobody_waits_for_a_cycle_while_nothing_is_under_way() -> None:
    clock = VirtualClock(5.0)
    pacer = Pacer(clock, 1.0 / PERIOD_S)
    pacer.wait(under_way=False)
    clock.sleep_until(9.0)
    assert pacer.wait(under_way=False) == 9.0
    assert pacer.overruns == pacer.late_in_a_row == 0
