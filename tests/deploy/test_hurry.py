"""While a silent hinge is found out, nothing else is asked that would have to wait for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ori_deploy.deploy.result import FaultKind
from ori_deploy.deploy.states import State
from tests.deploy.synthetic import Bench, bench

WAIT_S = 0.009
"""What a servo that does not answer costs with `reply_slack_s` and `usb_latency_s` as they are by default."""


def waits_for_silence(b: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every question to a silent servo takes its time, as on a real bus."""

    def slowly(method: Callable[[], object]) -> Callable[[], object]:
        def asked() -> object:
            if b.bus._mute.any():
                b.clock.sleep_until(b.clock.now() + WAIT_S)
            return method()

        return asked

    for name in ("_read_hinges", "_read_health", "_read_latches"):
        monkeypatch.setattr(b.bus, name, slowly(getattr(b.bus, name)))


@pytest.mark.parametrize("extra_cycles", range(1, 11))
def test_a_silent_servo_is_at_rest_in_time_though_its_health_is_due(
    extra_cycles: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    b.steps(extra_cycles)  # health is read every tenth
    waits_for_silence(b, monkeypatch)
    silent_s = b.clock.now()
    b.bus.mute("servo_c2")
    b.controller.run()
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.LOST_REPLIES
    last = max(k for k, record in enumerate(b.records) if record.rate != 0.0)
    assert b.records[last + 1].time_s - silent_s <= 0.05 + 1e-9


def test_replies_that_get_lost_again_and_again_put_health_off_by_a_little_only() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.2)
    looks = []
    for k in range(100):
        b.bus.drop_replies(f"servo_c{k % 4 + 1}", 1)
        record = b.controller.step()
        assert record.state is State.MOVING
        looks += [record.time_s] if record.health is not None else []
    assert np.diff(looks).max() < b.rig.controller.health_period_s + 0.06


def test_a_hinge_that_reports_an_error_is_looked_at_whoever_else_is_silent() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    b.bus.mute("servo_c1")
    b.bus.overload("servo_c2")
    b.controller.step()
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.HARDWARE_ERROR
