"""A control cycle of 12 servos at 4 Mbit/s, ours beside the SDK's own: `python -m benchmarks.dynamixel`.

The servos are the virtual bus with wire timing on, in a process of its own. What the wire would allow is what
the bus itself counted: the simulated time of every byte, pause and adapter wait in the same run.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

from ori_deploy.actuators.dynamixel.bus import DynamixelBus
from ori_deploy.actuators.dynamixel.latches import Latches
from ori_deploy.actuators.dynamixel.settings import DynamixelSettings
from ori_deploy.actuators.dynamixel.wiring import HingeServo, Wiring
from ori_deploy.clock import MonotonicClock
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from sim_backends.dynamixel.spec import BusSpec, ServoSpec
from sim_backends.dynamixel_bus import VirtualBus

N_SERVOS = 12
BAUD = 4_000_000
CYCLES = 1500
WARM_UP = 100
CORRUPT_EVERY = 25
TARGET_SHARE = 0.8
TARGET_CPU = 0.5


@dataclass(frozen=True)
class Run:
    """What one loop took.

    Attributes
    ----------
    rate_hz, allowed_hz
        Cycles per second, and what the wire would allow.
    cpu_us
        Processor time of the host's process per cycle.
    bad
        Cycles without a good answer from everybody.
    """

    rate_hz: float
    allowed_hz: float
    cpu_us: float
    bad: int


def measure(virtual: VirtualBus, cycle: Callable[[int], bool], each: Callable[[int], None] | None = None) -> Run:
    """Run a loop as fast as it goes; `cycle` says whether everybody answered."""
    for k in range(WARM_UP):
        cycle(k)
    before = virtual.account()
    cpu, wall = time.process_time(), time.monotonic()
    bad = 0
    for k in range(CYCLES):
        if each is not None:
            each(k)
        bad += not cycle(k)
    cpu, wall = time.process_time() - cpu, time.monotonic() - wall
    wire_s = virtual.account().wire_s - before.wire_s
    return Run(CYCLES / wall, CYCLES / wire_s, 1e6 * cpu / CYCLES, bad)


def our_bus(port: str, *, fast: bool) -> DynamixelBus:
    """Twelve hinges and no latch."""
    model = model_named("xm430")
    hinges = tuple(
        HingeServo(f"servo_{i}", i, model, OperatingMode.POSITION, 0, 4095) for i in range(1, N_SERVOS + 1)
    )
    settings = DynamixelSettings(port=port, baud=BAUD, fast_sync_read=fast, watchdog_s=0.2)
    limits = np.tile([-3.1, 3.1], (N_SERVOS, 1))
    nothing = np.zeros((0, N_SERVOS))
    latches = Latches((), (), nothing, nothing, 0.0)
    return DynamixelBus(Wiring(settings, hinges, ()), latches, (), limits, MonotonicClock(), 100.0, {})


def goals(k: int) -> np.ndarray:
    return 0.3 * np.sin(0.01 * k + np.arange(N_SERVOS))


def ours(virtual: VirtualBus, *, fast: bool, corrupt: bool = False) -> Run:
    bus = our_bus(str(virtual.link), fast=fast)
    bus.connect()
    bus.enable_torque()

    def cycle(k: int) -> bool:
        bus.command_hinges(goals(k))
        return bool(bus.read_hinges().valid.sum() >= N_SERVOS - corrupt)

    def spoil(k: int) -> None:
        if k % CORRUPT_EVERY == 0:
            virtual.corrupt(1 + k // CORRUPT_EVERY % N_SERVOS)

    try:
        return measure(virtual, cycle, spoil if corrupt else None)
    finally:
        bus.disable_torque()
        bus.close()


def the_sdk(virtual: VirtualBus) -> Run:
    """The loop of the SDK's example `sync_read_write.py`, torque off."""
    port, packets = PortHandler(str(virtual.link)), PacketHandler(2.0)
    port.openPort()
    port.setBaudRate(BAUD)
    write, read = GroupSyncWrite(port, packets, 116, 4), GroupSyncRead(port, packets, 126, 10)
    for i in range(1, N_SERVOS + 1):
        read.addParam(i)

    def cycle(k: int) -> bool:
        counts = 2048 + (goals(k) * 4096 / (2.0 * np.pi)).astype(int)
        for i, count in enumerate(counts, start=1):
            write.addParam(i, list(int(count).to_bytes(4, "little")))
        write.txPacket()
        write.clearParam()
        good = read.txRxPacket() == COMM_SUCCESS
        for i in range(1, N_SERVOS + 1):
            for address, size in ((126, 2), (128, 4), (132, 4)):
                if read.isAvailable(i, address, size):
                    read.getData(i, address, size)
        return good

    try:
        return measure(virtual, cycle)
    finally:
        port.closePort()


def main() -> None:
    spec = BusSpec(servos=tuple(ServoSpec(id=i, model="XM430-W350") for i in range(1, N_SERVOS + 1)), baud=BAUD)
    print(f"control cycle, {N_SERVOS} servos, {BAUD} baud, virtual bus with wire timing, {CYCLES} cycles")
    with tempfile.TemporaryDirectory() as folder, VirtualBus(spec, link=Path(folder) / "ttyDXL") as virtual:
        # Ours first: it sets the return delay to 0, and the SDK's loop has the use of that, too.
        runs = {
            "ours, sync read": ours(virtual, fast=False),
            "SDK's own loop, sync read": the_sdk(virtual),
            "ours, fast sync read": ours(virtual, fast=True),
            f"ours, a reply spoilt every {CORRUPT_EVERY}": ours(virtual, fast=False, corrupt=True),
            f"ours, fast, spoilt every {CORRUPT_EVERY}": ours(virtual, fast=True, corrupt=True),
        }
    for label, run in runs.items():
        share = run.rate_hz / run.allowed_hz
        print(
            f"  {label:32s} {run.rate_hz:6.1f} Hz of {run.allowed_hz:6.1f} that the wire allows "
            f"({100 * share:3.0f} %), {run.cpu_us:6.0f} us of processor a cycle, {run.bad} cycles lost"
        )
    sdk, plain = runs["SDK's own loop, sync read"], runs["ours, sync read"]
    print(f"  share of the wire's rate: {plain.rate_hz / plain.allowed_hz:.2f} (target {TARGET_SHARE:g} or more)")
    print(f"  processor, ours / SDK's: {plain.cpu_us / sdk.cpu_us:.2f} (target {TARGET_CPU:g} or less)")


if __name__ == "__main__":
    main()
