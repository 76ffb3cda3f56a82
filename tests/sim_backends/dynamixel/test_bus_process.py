"""The process behind the pty: its port, its control socket, its faults on the wire, its start and its end."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from click.testing import CliRunner

from ori_deploy.errors import InputError
from sim_backends.dynamixel.launcher import VirtualBusError
from sim_backends.dynamixel.plug import claim
from sim_backends.dynamixel.process import Process
from sim_backends.dynamixel_bus import BusSpec, ServoSpec, VirtualBus, main
from sim_backends.priority import PRIORITY
from tests.sim_backends.dynamixel.wire import BROADCAST, Status, frame, slow_crc, statuses, word

BAUD = 1_000_000
PATIENCE_S = 10.0
SPEC = BusSpec(servos=(ServoSpec(id=1), ServoSpec(id=2, load_nm=0.0)), wire_timing=False)
PING_2 = frame(2, b"\x01")


class Port:
    """A host's end of the pty."""

    def __init__(self, link: Path, baud: int = BAUD) -> None:
        self.serial = serial.Serial(str(link), baud, timeout=PATIENCE_S)

    def close(self) -> None:
        self.serial.close()

    def ask(self, raw: bytes, size: int) -> bytes:
        """The `size` bytes that come back."""
        self.serial.write(raw)
        return self.serial.read(size)

    def status(self, raw: bytes, data: int = 0) -> Status:
        (one,) = statuses(self.ask(raw, 11 + data))
        return one

    def silent(self, raw: bytes) -> bool:
        """Whether nothing comes back; the next answer shows that it was no matter of waiting."""
        self.serial.write(raw)
        good = statuses(self.ask(frame(1, b"\x01"), 14))
        return [one.id for one in good] == [1]

    def read(self, servo_id: int, address: int, size: int) -> bytes:
        return self.status(frame(servo_id, b"\x02" + word(address) + word(size)), size).data

    def write(self, servo_id: int, address: int, data: bytes) -> int:
        return self.status(frame(servo_id, b"\x03" + word(address) + data)).error


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualBus]:
    """One process for all tests that leave it as they found it."""
    with VirtualBus(SPEC, link=tmp_path_factory.mktemp("shared") / "tty") as bus:
        yield bus


@pytest.fixture
def port(shared: VirtualBus) -> Iterator[Port]:
    port = Port(shared.link)
    yield port
    port.close()


def until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def tell(bus: VirtualBus, line: bytes) -> bytes:
    """What the control socket answers to a line; nothing when it hangs up."""
    with contextlib.closing(socket.socket(socket.AF_UNIX)) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(bus._control))
        connection.sendall(line)
        with connection.makefile("rb") as stream:
            return stream.readline()


# -- the port ----------------------------------------------------------------------------------------


def test_a_port_answers_in_any_pieces_at_the_rate_that_is_set(shared: VirtualBus, port: Port) -> None:
    for byte in PING_2:
        port.serial.write(bytes((byte,)))
    assert statuses(port.serial.read(14))[0].id == 2
    before = shared.account().received
    port.serial.baudrate = 57_600
    port.serial.write(PING_2)
    until(lambda: shared.account().received == before + len(PING_2))
    assert port.serial.in_waiting == 0
    port.serial.baudrate = BAUD
    assert statuses(port.ask(PING_2, 14))[0].id == 2


def test_the_account_counts_bytes_and_reads(shared: VirtualBus, port: Port) -> None:
    before = shared.account()
    port.ask(PING_2, 14)
    port.read(1, 64, 1)
    after = shared.account()
    assert after.received - before.received == len(PING_2) + 14
    assert after.sent - before.sent == 14 + 12
    assert after.reads - before.reads == 1
    wires = 10.0 * (len(PING_2) + 14 + 14 + 12) / BAUD
    pauses = 2 * (SPEC.turnaround_s + SPEC.usb_latency_s + 500e-6)
    assert after.wire_s - before.wire_s == pytest.approx(wires + pauses)


def test_with_wire_timing_an_answer_is_never_early(tmp_path: Path) -> None:
    spec = BusSpec(servos=SPEC.servos, usb_latency_s=0.02)
    with VirtualBus(spec, link=tmp_path / "tty") as bus, contextlib.closing(Port(bus.link)) as port:
        begun = time.monotonic()
        for _ in range(3):
            port.ask(PING_2, 14)
        taken = time.monotonic() - begun
        account = bus.account()
        assert taken >= account.wire_s >= 3 * 0.02
        assert account.late_s >= 0.0


# -- faults on the wire ------------------------------------------------------------------------------


def test_a_dropped_answer_never_comes(shared: VirtualBus, port: Port) -> None:
    shared.drop(2, 2)
    assert port.silent(PING_2)
    assert port.silent(PING_2)
    assert not port.silent(PING_2)
    port.serial.read(14)


def test_a_corrupt_answer_fails_its_crc_and_a_truncated_one_is_short(shared: VirtualBus, port: Port) -> None:
    good = port.ask(PING_2, 14)
    shared.corrupt(2)
    bad = port.ask(PING_2, 14)
    assert bad != good
    assert slow_crc(bad[:-2]).to_bytes(2, "little") != bad[-2:]
    shared.truncate(2, 1, 3)
    assert port.ask(PING_2 + PING_2, 25) == good[:-3] + good


def test_a_delayed_answer_takes_its_time(shared: VirtualBus, port: Port) -> None:
    before = shared.account().wire_s
    port.ask(PING_2, 14)
    usual = shared.account().wire_s - before
    shared.delay(2, 1, 0.2)
    port.ask(PING_2, 14)
    assert shared.account().wire_s - before == pytest.approx(2 * usual + 0.2)


def test_a_mute_servo_is_silent_until_it_is_let_speak(shared: VirtualBus, port: Port) -> None:
    shared.mute(2)
    assert port.silent(PING_2)
    shared.mute(2, False)
    assert statuses(port.ask(PING_2, 14))[0].id == 2


def test_noise_comes_before_the_next_answer(shared: VirtualBus, port: Port) -> None:
    shared.noise(b"\x00\xff\xff")
    assert port.ask(PING_2, 17)[:3] == b"\x00\xff\xff"


def test_faults_of_body_show_on_the_wire(tmp_path: Path) -> None:
    with VirtualBus(SPEC, link=tmp_path / "tty") as bus, contextlib.closing(Port(bus.link)) as port:
        at = port.read(2, 132, 4)
        bus.push(2, 0.5)
        pushed = int.from_bytes(port.read(2, 132, 4), "little") - int.from_bytes(at, "little")
        assert pushed == pytest.approx(0.5 * 4096 / 6.283185, abs=1)
        bus.jam(2)
        port.write(2, 63, b"\x00")  # it may push as long as it likes
        port.write(2, 64, b"\x01")
        port.write(2, 116, (1000).to_bytes(4, "little"))
        until(lambda: int.from_bytes(port.read(2, 126, 2), "little", signed=True) < -500)
        assert bus.truth()[2].velocity_rad_s == 0.0
        bus.jam(2, False)
        until(lambda: int.from_bytes(port.read(2, 132, 4), "little") in range(999, 1002))
        assert bus.truth()[2].moved_s > 0.0
        bus.heat(2, 60.0)
        assert 40 < port.read(2, 146, 1)[0] <= 60
        bus.set_register(2, "led", 1)
        assert port.read(2, 65, 1) == b"\x01"
        assert bus.register(2, "led") == 1
        bus.sag(1.0)
        assert port.read(2, 144, 2)[0] in (109, 110)
        assert bus.register(1, "present_input_voltage") in (109, 110)
        bus.sag(0.0)
        bus.overload(2)
        assert port.status(PING_2, 3).error == 0x80
        assert port.read(2, 70, 1) == b"\x20" == bytes((bus.truth()[2].hardware_error,))
        bus.fail(1, 0x04)
        assert port.read(1, 70, 1) == b"\x04"
        bus.reboot(2)
        assert port.silent(PING_2)
        until(
            lambda: port.serial.write(PING_2) == 10 and select.select([port.serial.fileno()], [], [], 0.05)[0] != []
        )
        assert statuses(port.serial.read(14))[0].error == 0
        assert port.read(2, 65, 1) == b"\x00"


# -- the plug ----------------------------------------------------------------------------------------


def test_unplugging_hangs_up_and_replugging_gives_the_same_servos_a_new_port(tmp_path: Path) -> None:
    with VirtualBus(SPEC, link=tmp_path / "tty") as bus:
        with contextlib.closing(Port(bus.link)) as port:
            port.write(2, 65, b"\x01")
            bus.unplug()
            bus.unplug()
            assert not bus.link.is_symlink()
            with pytest.raises((OSError, serial.SerialException)):
                port.ask(PING_2, 14)
        bus.replug()
        bus.replug()
        with contextlib.closing(Port(bus.link)) as port:
            assert port.read(2, 65, 1) == b"\x01"
        bus.unplug()
        bus.replug()
        with contextlib.closing(Port(bus.link)) as port:
            assert port.status(PING_2, 3).id == 2
    assert list(tmp_path.iterdir()) == []


def test_a_half_sent_instruction_does_not_outlive_its_plug(tmp_path: Path) -> None:
    with VirtualBus(SPEC, link=tmp_path / "tty") as bus:
        with contextlib.closing(Port(bus.link)) as port:
            port.ask(PING_2, 14)
            port.serial.write(PING_2[:-2])
            until(lambda: bus.account().received == 2 * len(PING_2) - 2)
        bus.unplug()
        bus.replug()
        with contextlib.closing(Port(bus.link)) as port:
            assert port.ask(PING_2[-2:] + PING_2, 14) == port.ask(PING_2, 14)


# -- the control socket ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        {"do": "explode"},
        {"do": ["truth"]},
        {},
        [],
        5,
        None,
        {"do": "truth", "more": 1},
        {"do": "jam"},
        {"do": "jam", "id": 99, "on": True},
        {"do": "push", "id": 1, "by_rad": "far"},
        {"do": "push", "id": 1, "by_rad": float("nan")},
        {"do": "heat", "id": 1, "temperature_c": float("inf")},
        {"do": "sag", "volts": "much"},
        {"do": "fault", "id": 1, "kind": "use", "count": 1},
        {"do": "fault", "id": 1, "kind": "drop", "count": "many"},
        {"do": "fault", "id": 1, "kind": "drop", "count": 1, "mute": True},
        {"do": "fail", "id": 1, "bits": 300},
        {"do": "set", "id": 1, "name": "led", "value": 300},
        {"do": "set", "id": 1, "name": "led", "value": "on"},
        {"do": "set", "id": 1, "name": "LED", "value": 1},
        {"do": "get", "id": 1, "name": []},
        {"do": "noise", "data": "xyz"},
        {"do": "noise", "data": 7},
    ],
)
def test_what_the_control_does_not_understand_is_answered_without_harm(
    words: object, shared: VirtualBus, port: Port
) -> None:
    answer = tell(shared, json.dumps(words).encode() + b"\n")
    assert answer == b"" or "error" in json.loads(answer)
    assert statuses(port.ask(PING_2, 14)) == [Status(2, 0, b"\xfc\x03\x30")]
    assert set(shared.truth()) == {1, 2}
    assert abs(shared.truth()[1].shaft_rad) < 1e-9


@pytest.mark.parametrize("line", [b"\xff\xfe\n", b"{\n", b"\n", b"[" * 5000 + b"\n"])
def test_nonsense_is_hung_up_on_without_harm(line: bytes, shared: VirtualBus, port: Port) -> None:
    assert tell(shared, line) == b""
    assert statuses(port.ask(PING_2, 14))[0].id == 2


def test_asking_for_what_there_is_not_raises(shared: VirtualBus) -> None:
    with pytest.raises(VirtualBusError, match="99"):
        shared.mute(99)
    with pytest.raises(VirtualBusError):
        shared.register(1, "no_such_register")


# -- start and end -----------------------------------------------------------------------------------


def test_the_end_takes_link_and_socket_along(tmp_path: Path) -> None:
    link, control = tmp_path / "tty", tmp_path / "tty.control"
    for end in (signal.SIGTERM, signal.SIGINT):
        with _command("--servos", "1-2:xm430", "--link", link) as process:
            assert process.stdout is not None
            ready = process.stdout.readline()
            assert str(link) in ready
            assert link.is_symlink()
            assert control.is_socket()
            process.send_signal(end)
            assert process.wait(PATIENCE_S) == 0
        assert list(tmp_path.iterdir()) == []


def test_a_link_of_a_live_bus_is_refused_and_one_of_a_dead_bus_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "tty"
    with _command("--servos", "2:xm430", "--link", link) as process:
        assert process.stdout is not None
        process.stdout.readline()
        for control in (tmp_path / "tty.control", tmp_path / "other"):
            result = CliRunner().invoke(main, ["--servos", "1:xm430", "--link", str(link), "--control", str(control)])
            assert (result.exit_code, result.output.count("\n")) == (2, 1)
            assert "another virtual bus has it" in result.output
        with contextlib.closing(Port(link)) as port:
            assert port.status(PING_2, 3).id == 2
        process.kill()
        process.wait(PATIENCE_S)
    assert link.is_symlink()  # it could not clean up
    spec = BusSpec(servos=(ServoSpec(id=2),), wire_timing=False)
    with VirtualBus(spec, link=link), contextlib.closing(Port(link)) as port:
        assert port.status(PING_2, 3).id == 2
    claim(link, tmp_path / "tty.control").close()
    assert list(tmp_path.iterdir()) == []


def test_two_virtual_buses_cannot_have_one_link(tmp_path: Path) -> None:
    with VirtualBus(SPEC, link=tmp_path / "tty") as bus:
        with pytest.raises(VirtualBusError, match="another virtual bus"), VirtualBus(SPEC, link=tmp_path / "tty"):
            pass
        with contextlib.closing(Port(bus.link)) as port:
            assert port.status(PING_2, 3).id == 2


def test_files_of_others_are_left_alone(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.write_text("precious")
    for link, control in ((mine, tmp_path / "c"), (tmp_path / "tty", mine), (tmp_path, tmp_path / "c")):
        with pytest.raises(InputError):
            Process(SPEC, link, control)
    assert mine.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [mine]


BAD: dict[str, list[str]] = {
    "nothing": [],
    "two descriptions": ["--servos", "1:xm430", "--rig", "rig.toml"],
    "model": ["--servos", "1:ax12"],
    "ids": ["--servos", "x:xm430"],
    "rate": ["--servos", "1:xm430", "--baud", "12345"],
    "firmware": ["--servos", "1:xm430", "--firmware", "999"],
    "no rig": ["--rig", "{folder}/none.toml"],
    "no folder": ["--servos", "1:xm430", "--link", "{folder}/none/tty"],
    "no folder for the socket": ["--servos", "1:xm430", "--control", "{folder}/none/c"],
    "long name": ["--servos", "1:xm430", "--control", "{folder}/" + 120 * "c"],
    "broken specification": ["--spec", "{folder}/broken.json"],
    "empty specification": ["--spec", "{folder}/empty.json"],
    "other specification": ["--spec", "{folder}/other.json"],
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_exit_code_2(name: str, tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_bytes(b"\xff{")
    (tmp_path / "empty.json").write_text("{}")
    (tmp_path / "other.json").write_text('{"servos": [{"id": 1, "colour": 3}], "pins": []}')
    words = [word.format(folder=tmp_path) for word in BAD[name]]
    result = CliRunner().invoke(main, ["--link", str(tmp_path / "tty"), *words])
    assert (result.exit_code, result.output.count("\n")) == (2, 1), result.output
    assert result.output.startswith("error: ")
    assert not (tmp_path / "tty").is_symlink()


def test_the_process_says_bad_input_on_stderr(tmp_path: Path) -> None:
    with _command("--servos", "1:ax12", "--link", tmp_path / "tty") as process:
        out, wrong = process.communicate(timeout=30.0)
    assert (process.returncode, out, wrong.count("\n")) == (2, "", 1)
    assert "ax12" in wrong


def test_a_bus_that_does_not_start_says_why(tmp_path: Path) -> None:
    bus = VirtualBus(SPEC, link=tmp_path / "none" / "tty")
    with pytest.raises(VirtualBusError, match="not been started"):
        _ = bus.pid
    with pytest.raises(VirtualBusError, match="folder does not exist"), bus:
        pass


def test_a_bus_ends_with_its_block(tmp_path: Path) -> None:
    with VirtualBus(SPEC, link=tmp_path / "tty") as bus:
        pid = bus.pid
        os.kill(pid, 0)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert list(tmp_path.iterdir()) == []


@contextlib.contextmanager
def _command(*words: Any) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "sim_backends.dynamixel_bus", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_everyone_on_the_port_is_heard_in_one_line(port: Port) -> None:
    assert [one.id for one in statuses(port.ask(frame(BROADCAST, b"\x01"), 28))] == [1, 2]


def test_servos_wait_for_no_processor_where_that_is_allowed(shared: VirtualBus) -> None:
    """Real ones do not; on a busy machine those of a plant, which computes, have to."""
    if os.sched_getscheduler(shared.pid) != os.SCHED_FIFO:
        with pytest.raises(PermissionError):
            os.sched_setscheduler(shared.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
        pytest.skip("real-time priority is not allowed here")
