"""Two clients that others wrote, on the pty: rustypot, and the SDK itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from math import pi
from pathlib import Path
from typing import Any

import pytest
import rustypot
from dynamixel_sdk import (
    COMM_RX_CORRUPT,
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    GroupBulkRead,
    GroupBulkWrite,
    GroupSyncRead,
    GroupSyncWrite,
    PortHandler,
    Protocol2PacketHandler,
)

from sim_backends.dynamixel.launcher import VirtualBusError
from sim_backends.dynamixel_bus import BusSpec, ServoSpec, VirtualBus

BAUD = 1_000_000
PATIENCE_S = 10.0
LED, GOAL_VELOCITY, GOAL, POSITION, TORQUE, MODE = 65, 104, 116, 132, 64, 11
MODELS = {"XL330-M077": (1, 2, 3), "XL430-W250": (11, 12, 13), "XM430-W350": (21, 22)}
SPEC = BusSpec(
    servos=tuple(
        ServoSpec(id=i, model=model, start_rad=0.01 * i, load_nm=0.0) for model, ids in MODELS.items() for i in ids
    ),
    wire_timing=False,
)


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualBus]:
    with VirtualBus(SPEC, link=tmp_path_factory.mktemp("clients") / "tty") as bus:
        yield bus


def until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def count(rad: float) -> int:
    return round(2048 + rad * 4096 / (2 * pi))


# -- rustypot ----------------------------------------------------------------------------------------


@pytest.fixture(params=["XL330-M077", "XL430-W250"])
def rusty(request: pytest.FixtureRequest, bus: VirtualBus) -> Iterator[tuple[Any, list[int], int]]:
    """A controller of its own for each family, the ids that it drives, and their model number."""
    make = {"XL330-M077": rustypot.Xl330PyController, "XL430-W250": rustypot.Xl430PyController}[request.param]
    controller = make(str(bus.link), BAUD, 1.0)
    yield controller, list(MODELS[request.param]), {"XL330-M077": 1190, "XL430-W250": 1060}[request.param]
    controller.close()


def test_rustypot_finds_who_is_there(rusty: tuple[Any, list[int], int]) -> None:
    controller, ids, number = rusty
    assert all(controller.ping(i) for i in ids)
    controller.set_timeout(0.05)
    assert not controller.ping(99)
    controller.set_timeout(1.0)
    assert controller.scan(ids) == dict.fromkeys(ids, number)


def test_rustypot_reads_what_is_the_case(rusty: tuple[Any, list[int], int], bus: VirtualBus) -> None:
    controller, ids, _ = rusty
    expected = [count(bus.truth()[i].shaft_rad) for i in ids]
    assert [controller.read_register(i, "present_position") for i in ids] == expected
    assert controller.sync_read_register(ids, "present_position") == expected
    assert controller.sync_read_register_with_error(ids, "present_position") == [(one, 0) for one in expected]
    pairs = controller.sync_read_raw_data(ids, POSITION, 4)
    assert [int.from_bytes(bytes(one), "little", signed=True) for one in pairs] == expected


def test_rustypot_writes_and_is_refused(rusty: tuple[Any, list[int], int], bus: VirtualBus) -> None:
    controller, ids, _ = rusty
    for i in ids:
        controller.write_register(i, "led", 1)
        assert bus.register(i, "led") == 1
    controller.sync_write_register(ids, "led", [0, 1, 0])
    until(lambda: [bus.register(i, "led") for i in ids] == [0, 1, 0])
    assert controller.write_register_with_error(ids[0], "led", 2) == 4
    assert controller.write_raw_data_with_error(ids[0], POSITION, [0, 0, 0, 0]) == 7


def test_rustypot_moves_servos(rusty: tuple[Any, list[int], int], bus: VirtualBus) -> None:
    controller, ids, _ = rusty
    controller.sync_write_register(ids, "torque_enable", [1] * len(ids))
    goals = [1500 + 10 * i for i in ids]
    controller.sync_write_register(ids, "goal_position", goals)
    until(lambda: all(abs(a - b) <= 1 for a, b in zip(_positions(controller, ids), goals, strict=True)))
    controller.write_register(ids[0], "goal_position", 2100)
    until(lambda: abs(controller.read_register(ids[0], "present_position") - 2100) <= 1)
    assert bus.truth()[ids[0]].shaft_rad == pytest.approx(52 * 2 * pi / 4096, abs=4e-3)
    controller.sync_write_register(ids, "torque_enable", [0] * len(ids))
    until(lambda: not any(bus.truth()[i].torque_on for i in ids))


def _positions(controller: Any, ids: list[int]) -> list[int]:
    found: list[int] = controller.sync_read_register(ids, "present_position")
    return found


def test_rustypots_own_table_agrees_with_the_servos(rusty: tuple[Any, list[int], int], bus: VirtualBus) -> None:
    controller, ids, number = rusty
    assert controller.read_register(ids[0], "model_number") == number
    compared = 0
    for info in controller.registers():
        if info.name == "realtime_tick":
            continue  # it goes on between the two looks
        try:
            truth = bus.register(ids[0], info.name)
        except VirtualBusError:  # it has names of its own for some
            continue
        assert controller.read_register(ids[0], info.name) == truth, info.name
        compared += 1
    assert compared > 20


def test_rustypot_in_radians(bus: VirtualBus) -> None:
    controller = rustypot.Xl330PyController(str(bus.link), BAUD, 1.0)
    try:
        truth = bus.truth()
        assert controller.sync_read_present_position([1, 2]) == pytest.approx(
            [truth[i].shaft_rad for i in (1, 2)], abs=2e-3
        )
        controller.sync_write_goal_position([1, 2], [0.25, -0.25])
        assert controller.sync_read_goal_position([1, 2]) == pytest.approx([0.25, -0.25], abs=2e-3)
    finally:
        controller.close()


def test_rustypot_restarts_a_servo(rusty: tuple[Any, list[int], int], bus: VirtualBus) -> None:
    controller, ids, _ = rusty
    controller.write_register(ids[2], "led", 1)
    assert controller.reboot(ids[2])
    controller.set_timeout(0.05)
    until(lambda: bool(controller.ping(ids[2])))
    assert bus.register(ids[2], "led") == 0


# -- the SDK -----------------------------------------------------------------------------------------


class PatientPort(PortHandler):  # type: ignore[misc]
    """The SDK's port, which waits 34 ms and the time on the wire for an answer; a busy machine takes longer."""

    def setPacketTimeout(self, packet_length: int) -> None:
        super().setPacketTimeout(packet_length)
        self.packet_timeout += 1000.0


class Sdk:
    """The SDK's own handlers, as its examples use them."""

    def __init__(self, link: Path) -> None:
        self.port = PatientPort(str(link))
        assert self.port.openPort()
        assert self.port.setBaudRate(BAUD)
        self.handler = Protocol2PacketHandler()

    def close(self) -> None:
        self.port.closePort()

    def read4(self, servo_id: int, address: int) -> int:
        value, result, error = self.handler.read4ByteTxRx(self.port, servo_id, address)
        assert (result, error) == (COMM_SUCCESS, 0)
        return int(value)

    def write1(self, servo_id: int, address: int, value: int) -> int:
        result, error = self.handler.write1ByteTxRx(self.port, servo_id, address, value)
        assert result == COMM_SUCCESS
        return int(error)

    def write4(self, servo_id: int, address: int, value: int) -> int:
        result, error = self.handler.write4ByteTxRx(self.port, servo_id, address, value)
        assert result == COMM_SUCCESS
        return int(error)

    def there(self, servo_id: int) -> bool:
        return bool(self.handler.ping(self.port, servo_id)[1] == COMM_SUCCESS)


@pytest.fixture
def sdk(bus: VirtualBus) -> Iterator[Sdk]:
    sdk = Sdk(bus.link)
    yield sdk
    sdk.close()


def test_the_sdk_pings_one_and_all(sdk: Sdk) -> None:
    assert sdk.handler.ping(sdk.port, 1) == (1190, COMM_SUCCESS, 0)
    everyone, result = sdk.handler.broadcastPing(sdk.port)
    assert result == COMM_SUCCESS
    numbers = {"XL330-M077": 1190, "XL430-W250": 1060, "XM430-W350": 1020}
    assert everyone == {i: [numbers[model], 48] for model, ids in MODELS.items() for i in ids}


def test_the_sdk_writes_reads_and_hears_of_refusals(sdk: Sdk) -> None:
    assert sdk.write4(1, GOAL, 0x00FDFF & 0xFFF) == 0
    assert sdk.read4(1, GOAL) == 0x00FDFF & 0xFFF
    assert sdk.write4(1, GOAL, 5000) == 6
    assert sdk.write4(1, POSITION, 0) == 7
    assert sdk.write1(1, TORQUE, 1) == 0
    assert sdk.write1(1, MODE, 4) == 7
    assert sdk.write1(1, TORQUE, 0) == 0


def test_both_clients_unstuff_what_is_stuffed(bus: VirtualBus) -> None:
    data = [0xFF, 0xFF, 0xFD, 0xFD, 0xFF, 0xFF, 0xFD, 0x00]
    rusty = rustypot.Xl430PyController(str(bus.link), BAUD, 1.0)
    rusty.write_raw_data(21, 224, data)  # the SDK's Python (4.1.0) forgets to stuff what it sends
    assert list(rusty.read_raw_data(21, 224, len(data))) == data
    rusty.close()
    sdk = Sdk(bus.link)
    assert sdk.handler.readTxRx(sdk.port, 21, 224, len(data)) == (data, COMM_SUCCESS, 0)
    for fast in (False, True):
        sync = GroupSyncRead(sdk.port, sdk.handler, 224, 4)
        sync.addParam(21)
        assert (sync.fastSyncRead() if fast else sync.txRxPacket()) == COMM_SUCCESS
        assert sync.getData(21, 224, 4) == int.from_bytes(bytes(data[:4]), "little")
    sdk.close()


@pytest.mark.parametrize("fast", [False, True])
def test_the_sdk_reads_many_at_once(fast: bool, sdk: Sdk, bus: VirtualBus) -> None:
    ids = [i for group in MODELS.values() for i in group]
    sync = GroupSyncRead(sdk.port, sdk.handler, POSITION, 4)
    for i in ids:
        assert sync.addParam(i)
    assert (sync.fastSyncRead() if fast else sync.txRxPacket()) == COMM_SUCCESS
    truth = bus.truth()
    for i in ids:
        assert sync.isAvailable(i, POSITION, 4)
        assert sync.getData(i, POSITION, 4) == count(truth[i].shaft_rad)


def test_the_sdk_notices_a_fault_in_a_group(sdk: Sdk, bus: VirtualBus) -> None:
    sync = GroupSyncRead(sdk.port, sdk.handler, POSITION, 4)
    for i in (1, 2, 3):
        sync.addParam(i)
    bus.drop(2)
    assert sync.txRxPacket() == COMM_RX_TIMEOUT
    bus.corrupt(2)
    assert sync.txRxPacket() in (COMM_RX_CORRUPT, COMM_RX_TIMEOUT)
    sdk.port.clearPort()
    assert sync.txRxPacket() == COMM_SUCCESS


def test_the_sdk_writes_many_at_once(sdk: Sdk) -> None:
    write = GroupSyncWrite(sdk.port, sdk.handler, GOAL, 4)
    for i in (1, 11, 21):
        write.addParam(i, list((1000 + i).to_bytes(4, "little")))
    assert write.txPacket() == COMM_SUCCESS
    assert [sdk.read4(i, GOAL) for i in (1, 11, 21)] == [1001, 1011, 1021]
    bulk = GroupBulkWrite(sdk.port, sdk.handler)
    bulk.addParam(1, LED, 1, [1])
    bulk.addParam(11, GOAL, 4, list((77).to_bytes(4, "little")))
    assert bulk.txPacket() == COMM_SUCCESS
    read = GroupBulkRead(sdk.port, sdk.handler)
    read.addParam(1, LED, 1)
    read.addParam(11, GOAL, 4)
    assert read.txRxPacket() == COMM_SUCCESS
    assert (read.getData(1, LED, 1), read.getData(11, GOAL, 4)) == (1, 77)
    sdk.write1(1, LED, 0)


def test_the_sdk_registers_and_acts(sdk: Sdk, bus: VirtualBus) -> None:
    for i in (21, 22):
        data = list((30 + i).to_bytes(4, "little"))
        assert sdk.handler.regWriteTxRx(sdk.port, i, GOAL_VELOCITY, 4, data) == (COMM_SUCCESS, 0)
    assert [bus.register(i, "goal_velocity") for i in (21, 22)] == [0, 0]
    assert sdk.handler.action(sdk.port, 0xFE) == COMM_SUCCESS
    until(lambda: [bus.register(i, "goal_velocity") for i in (21, 22)] == [51, 52])


def test_the_sdk_turns_a_servo_round_clears_restarts_and_resets_it(sdk: Sdk, bus: VirtualBus) -> None:
    assert sdk.write1(22, MODE, 4) == sdk.write1(22, TORQUE, 1) == 0
    assert sdk.write4(22, GOAL, 5000) == 0
    until(lambda: sdk.read4(22, POSITION) == 5000 and not bus.register(22, "moving"))
    assert sdk.handler.clearMultiTurn(sdk.port, 22) == (COMM_SUCCESS, 0)
    assert sdk.read4(22, POSITION) == 5000 - 4096
    assert sdk.handler.reboot(sdk.port, 22) == (COMM_SUCCESS, 0)
    until(lambda: sdk.there(22))
    assert bus.register(22, "torque_enable") == 0
    assert bus.register(22, "operating_mode") == 4
    assert sdk.handler.factoryReset(sdk.port, 22, 0x02) == (COMM_SUCCESS, 0)
    until(lambda: sdk.there(22))
    assert bus.register(22, "operating_mode") == 3
