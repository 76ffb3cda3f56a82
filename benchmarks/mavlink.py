"""What a flood on the vehicle's network does to the control loop: `python -m benchmarks.mavlink` from the root.

The controller deploys on a bus that answers at once, with its component on a link of the loopback and the priority
that it asks for; once in peace, and once while somebody sends a thousand commands a second, and ten thousand. All are
refused. Lateness is that of the cycle's begin against its absolute deadline; the loop shares its machine with the
process that reads the flood, and with the one that sends it.
"""

from __future__ import annotations

import multiprocessing
import socket
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.control import NullBus, example_plan, example_rig
from ori_deploy import realtime
from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord
from ori_deploy.mav.interlock import VehicleInterlock
from ori_deploy.mav.links import parse_link
from ori_deploy.mav.network import Network
from ori_deploy.mav.settings import Settings
from ori_deploy.operate.desk import Desk, Session
from ori_deploy.operate.orders import StandingOrders
from ori_deploy.wire.vehicle import Party, Writer, dialect

RATE_HZ = 100.0
SECONDS = 6.0
FLOODS_PER_S = (0, 1_000, 10_000)


def _loop(port: int, result: Connection) -> None:
    plan = example_plan(duration_s=SECONDS, rate_hz=RATE_HZ)
    rig = example_rig(plan)
    clock = MonotonicClock()
    bus = NullBus(rig, clock, rig.to_actuator(plan.crease_angles_rad[0]))  # type: ignore[arg-type]
    late: list[float] = []

    def note(record: CycleRecord) -> None:
        late.append(record.time_s - record.deadline_s)

    controller = Controller(plan, rig, bus, clock, [note])
    settings = Settings(links=(parse_link(f"udpin:127.0.0.1:{port}"),))
    interlock = VehicleInterlock("always", 2.0, False, clock.now)
    orders = StandingOrders(controller, clock, 1.0 / RATE_HZ, lambda: None)
    session = Session(Path("plan"), Path("rig"), None)
    desk = Desk(controller, session, plan, rig, bus, clock.now(), orders, interlock)  # type: ignore[arg-type]
    controller.add_observer(desk)
    controller.connect()
    with Network(settings, desk, controller, interlock, rig, clock.now) as network:
        controller.add_observer(network)
        realtime.ask()
        orders.deploy()
        late.clear()
        result.send("ready")
        while orders.running:
            network.poll()
            ended = orders.step()
        realtime.give_back()
    assert ended is not None
    result.send((np.array(late[1:]), ended.overruns, str(ended.outcome)))


def _flood(port: int, per_s: int, seconds: float) -> int:
    """Send; how many."""
    writer, sent = Writer(Party(255, 191)), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        end, due = time.monotonic() + seconds, time.monotonic()
        while per_s and time.monotonic() < end:
            for _ in range(per_s // 100):
                fold = dialect.MAVLink_command_long_message(1, 140, dialect.ORI_CMD_FOLD, 0, 0, 0, 0, 0, 0, 0, 0)
                link.send(writer.pack(fold))
                sent += 1
            due += 0.01
            time.sleep(max(due - time.monotonic(), 0.0))
    return sent


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def main() -> None:
    """Print the table."""
    print(f"control loop at {RATE_HZ:g} Hz with a MAVLink component, lateness in ms")
    print(f"{'commands/s':>12} {'median':>8} {'p99.9':>8} {'worst':>8} {'missed':>8}  outcome")
    for per_s in FLOODS_PER_S:
        port = _free_port()
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("spawn").Process(target=_loop, args=(port, theirs))
        process.start()
        assert ours.recv() == "ready"
        sent = _flood(port, per_s, SECONDS - 1.0)
        late, missed, outcome = ours.recv()
        process.join()
        low, high = np.quantile(late, (0.5, 0.999)) * 1e3
        rate = sent / (SECONDS - 1.0)
        print(f"{rate:12.0f} {low:8.3f} {high:8.3f} {1e3 * late.max():8.3f} {missed:8d}  {outcome}")


if __name__ == "__main__":
    main()
