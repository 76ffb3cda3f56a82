"""Wire times against a second account of the bytes, and what is refused because of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.dynamixel.settings import DynamixelSettings
from ori_deploy.actuators.dynamixel.throughput import WireTimes, check_rate, cycle_time, planned_times
from ori_deploy.actuators.dynamixel.wiring import HingeServo, Wiring
from ori_deploy.errors import RigError
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from tests.actuators.dynamixel.scripted import ScriptedPort, status
from tests.actuators.dynamixel.test_line import fast_reply
from tests.actuators.dynamixel.test_wiring import wiring

FAST = WireTimes(4_000_000, 50e-6, 0.0, 1e-3)


@pytest.mark.parametrize(
    ("baud", "sync_hz", "fast_hz"), [(1_000_000, 194, 262), (3_000_000, 357, 507), (4_000_000, 399, 574)]
)
def test_twelve_servos_reach_what_was_computed_by_hand(baud: int, sync_hz: float, fast_hz: float) -> None:
    times = WireTimes(baud, 50e-6, 0.0, 1e-3)
    write = times.sync_write_s(12, 4)
    assert 1.0 / (write + times.sync_read_s(12, 10, fast=False)) == pytest.approx(sync_hz, rel=0.02)
    assert 1.0 / (write + times.sync_read_s(12, 10, fast=True)) == pytest.approx(fast_hz, rel=0.02)


@given(n=st.integers(1, 30), size=st.integers(1, 20))
def test_bytes_are_those_of_real_packets(n: int, size: int) -> None:
    times = WireTimes(10, 0.0, 0.0, 0.0)  # one byte a second
    ids = list(range(1, n + 1))
    with ScriptedPort(lambda _: b"", slack_s=0.0005) as scripted:
        scripted.line.sync_write(116, size, {i: bytes(size) for i in ids})
        scripted.port.slack_s = 0.0
        scripted.line.sync_read(126, size, ids)
    write, ask = (len(packet) for packet in scripted.sent)
    assert times.sync_write_s(n, size) == write
    assert times.sync_read_s(n, size, fast=False) == ask + n * len(status(1, bytes(size)))
    assert times.sync_read_s(n, size, fast=True) == ask + len(fast_reply({i: bytes(size) for i in ids}, size))


def test_return_delay_and_latency_count_for_every_answer() -> None:
    slow = WireTimes(4_000_000, 50e-6, 500e-6, 16e-3)
    more = slow.sync_read_s(12, 10, fast=False) - FAST.sync_read_s(12, 10, fast=False)
    assert more == pytest.approx(12 * 500e-6 + 15e-3)
    assert slow.sync_read_s(0, 10, fast=False) == 0.0


def test_the_longest_cycle_holds_everything_that_is_asked_for() -> None:
    found = wiring()  # three hinges, one pin
    cycle = cycle_time(found, FAST, fast=False)
    assert cycle.longest_s == pytest.approx(
        FAST.sync_write_s(3, 4) + FAST.sync_read_s(3, 14, fast=False)
        + FAST.sync_read_s(3, 9, fast=False) + FAST.sync_read_s(1, 10, fast=False)
    )  # fmt: skip
    assert cycle.usual_s < cycle.longest_s


def test_a_rate_is_refused_exactly_when_its_cycle_does_not_fit() -> None:
    found = wiring()
    rate = cycle_time(found, FAST, fast=False).rate_hz
    check_rate(found, FAST, 0.999 * rate, fast=False, source=None)
    with pytest.raises(RigError, match="the longest cycle takes"):
        check_rate(found, FAST, 1.001 * rate, fast=False, source=None)


@pytest.mark.parametrize(
    ("times", "fast", "rate_hz", "remedy"),
    [
        (WireTimes(1_000_000, 50e-6, 0.0, 16e-3), False, 100.0, "latency timer"),
        (WireTimes(1_000_000, 50e-6, 0.0, 1e-3), False, 190.0, "fast_sync_read"),
        (WireTimes(57_600, 50e-6, 0.0, 1e-3), False, 100.0, "baud"),
        (WireTimes(4_000_000, 50e-6, 0.0, 1e-3), True, 1000.0, "fewer servos"),
    ],
)
def test_the_remedy_is_one_that_helps(times: WireTimes, fast: bool, rate_hz: float, remedy: str) -> None:
    with pytest.raises(RigError) as caught:
        check_rate(wiring(), times, rate_hz, fast=fast, source=None)
    assert remedy in str(caught.value).split("remedy:")[1]


def test_the_hardware_page_has_the_rates_that_are_computed() -> None:
    """Section 7: rounded down, plain / fast."""
    page = (Path(__file__).parents[3] / "docs" / "hardware-dynamixel.md").read_text()
    head, *rows = re.findall(r"^\| (servos|\d+) \| (.+) \|$", page.split("## 7.")[1].split("## 8.")[0], re.MULTILINE)
    assert head == ("servos", "57600 | 1 M | 3 M | 4 M")
    assert len(rows) == 4
    model = model_named("XM430-W350")
    for count, cells in rows:
        hinges = tuple(
            HingeServo(f"s{i}", i, model, OperatingMode.POSITION, 0, 4095) for i in range(1, int(count) + 1)
        )
        for baud, cell in zip((57_600, 1_000_000, 3_000_000, 4_000_000), cells.split(" | "), strict=True):
            rig = Wiring(DynamixelSettings(port="none", baud=baud), hinges, ())
            for fast, text in zip((False, True), cell.split(" / "), strict=True):
                rate = cycle_time(rig, planned_times(rig), fast=fast).rate_hz
                assert 0.0 <= rate - float(text) < (0.1 if "." in text else 1.0), (count, baud, fast)
