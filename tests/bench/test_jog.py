"""A way that was told is the way that is gone, or none."""

from __future__ import annotations

from pathlib import Path

import pytest

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.bench.jog import carry_out, plan_move
from ori_deploy.clock import MonotonicClock
from sim_backends.dynamixel_bus import BusSpec, ServoSpec, VirtualBus


def test_a_shaft_that_was_turned_since_its_way_was_told_does_not_go(tmp_path: Path) -> None:
    spec = BusSpec(servos=(ServoSpec(id=1),), wire_timing=False)
    with VirtualBus(spec, tmp_path / "tty") as virtual:
        port = BlockingPort(str(virtual.link), spec.baud, slack_s=0.05)
        port.open()
        try:
            line = ServoLine(port)
            move = plan_move(line, line.ping(1), 1.0, by_rad=0.1)
            virtual.push(1, 1.0)
            with pytest.raises(CommandRefused, match=r"was turned by 65[12] counts"):
                carry_out(line, move, MonotonicClock(), lambda: False)
        finally:
            port.close()
        truth = virtual.truth()[1]
        assert truth.shaft_rad == pytest.approx(1.0, abs=0.01)
        assert not truth.torque_on
