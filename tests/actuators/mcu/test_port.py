"""The real port, on a pty, in real time: what depends on it, and no more."""

from __future__ import annotations

import os
import termios
import time

import numpy as np
import pytest

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.actuators.mcu.bus import McuBus
from ori_deploy.actuators.mcu.port import SerialPort
from ori_deploy.clock import MonotonicClock
from tests.actuators.mcu.scripted import Pty, ScriptedDevice
from tests.actuators.mcu.setups import config, wiring

SLOW: dict[str, float] = {"rate_hz": 10.0, "silence_s": 0.5, "min_lead_s": 0.6, "lead_s": 0.8, "reply_timeout_s": 0.5}
"""A device and a bus that do not mind a busy computer."""


def test_a_device_behind_a_pty() -> None:
    made = wiring(**SLOW)
    with Pty(ScriptedDevice(config(made))) as pty:
        bus = McuBus(made, MonotonicClock(), SLOW["rate_hz"], port=pty.path)
        bus.connect()
        goal = bus.enable_torque() + 0.1
        bus.command_hinges(goal)
        bus.close()
        np.testing.assert_allclose(pty.device.asked[:3], 1e6 * goal)
        bus.connect()
        pty.unplug()
        with pytest.raises(BusClosed, match="gone"):
            bus.read_hinges()
        assert not bus.connected
        with pytest.raises(BusClosed):
            bus.connect()


def test_a_missing_port_is_closed() -> None:
    with pytest.raises(BusClosed, match=r"ttyNONE.*remedy"):
        McuBus(wiring(), MonotonicClock(), 50.0, port="/dev/ttyNONE").connect()


def test_what_is_no_serial_port_is_closed(tmp_path: os.PathLike[str]) -> None:
    path = os.path.join(tmp_path, "file")  # noqa: PTH118
    with open(path, "w"):  # noqa: PTH123
        pass
    with pytest.raises(BusClosed, match="file"):
        SerialPort(path, 500_000).open()


def test_a_port_is_opened_once() -> None:
    with Pty(ScriptedDevice(config(wiring()))) as pty:
        first, second = SerialPort(pty.path, 500_000), SerialPort(pty.path, 500_000)
        first.open()
        with pytest.raises(BusClosed, match="this program has it already"):
            second.open()
        first.close()
        first.close()
        second.open()
        second.close()


def test_closing_does_not_restart_the_board() -> None:
    with Pty(ScriptedDevice(config(wiring()))) as pty:
        port = SerialPort(pty.path, 500_000)
        port.open()
        fd = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
        assert not termios.tcgetattr(fd)[2] & termios.HUPCL
        os.close(fd)
        port.close()


def test_reading_waits_for_the_first_byte_and_no_longer_than_told() -> None:
    master, slave = os.openpty()
    port = SerialPort(os.ttyname(slave), 500_000)
    port.open()
    begin = time.monotonic()
    assert port.read(0.05) == b""
    assert time.monotonic() - begin >= 0.05
    os.write(master, b"abc")
    assert port.read(5.0) == b"abc"
    assert port.read() == b""
    port.write(b"x" * 1000)
    assert os.read(master, 4096)
    os.close(master)
    os.close(slave)
    with pytest.raises(BusClosed):
        port.check()
    with pytest.raises(BusClosed):
        port.write(b"x")
    port.close()
    for call in (port.check, port.read, lambda: port.write(b"")):
        with pytest.raises(BusClosed, match="not open"):
            call()
