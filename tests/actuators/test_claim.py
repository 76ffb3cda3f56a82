"""One program per serial device, and the others are told which."""

from __future__ import annotations

import errno
import gc
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.actuators.claim import DeviceClaim, held_devices
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.actuators.mcu.port import SerialPort

pytestmark = pytest.mark.usefixtures("runtime_folder")

HOLD = """
import sys, time
from ori_deploy.actuators.{module} import {port}
port = {port}(sys.argv[1], 500_000)
port.open()
print("open", flush=True)
time.sleep(60.0)
"""
FLOCK = """
import fcntl, sys, time
device = open(sys.argv[1], "rb+", buffering=0)
fcntl.flock(device, fcntl.LOCK_EX)
print("open", flush=True)
time.sleep(60.0)
"""
DYNAMIXEL = HOLD.format(module="dynamixel.port", port="BlockingPort")
MCU = HOLD.format(module="mcu.port", port="SerialPort")
PORTS: list[Callable[[str, int], BlockingPort | SerialPort]] = [BlockingPort, SerialPort]


@pytest.fixture
def device() -> Iterator[str]:
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(slave)
    os.close(master)


@contextmanager
def holder(code: str, path: str | Path) -> Iterator[subprocess.Popen[str]]:
    """Another program that has a device open."""
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "open\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("make", PORTS)
@pytest.mark.parametrize("code", [DYNAMIXEL, MCU], ids=["dynamixel", "mcu"])
def test_whichever_backend_has_it_the_other_program_is_named_and_kill_9_lets_go(
    device: str,
    tmp_path: Path,
    code: str,
    make: Callable[[str, int], BlockingPort | SerialPort],
) -> None:
    link = tmp_path / "ttyDXL"
    link.symlink_to(device)
    port = make(device, 500_000)
    with holder(code, link) as other:  # by another name of the same device
        with pytest.raises(BusClosed) as refused:
            port.open()
        said = str(refused.value)
        assert said.startswith(f"{device} cannot be opened: another program has it (pid {other.pid}, ")
        assert str(link) in said  # its command line
        assert "; remedy: end that program" in said
        assert not port.is_open
        other.send_signal(signal.SIGKILL)
        other.wait()
    port.open()
    assert held_devices() == (device,)
    port.close()
    assert held_devices() == ()


def test_a_program_that_is_not_ours_is_named_where_the_kernel_lists_it(device: str) -> None:
    with holder(FLOCK, device) as other:
        port = BlockingPort(device, 500_000)
        with pytest.raises(BusClosed, match=rf"another program has it \(pid {other.pid}, .*remedy: end that"):
            port.open()
        assert held_devices() == ()
        other.kill()
        other.wait()
        port.open()
        port.close()


def test_in_one_program_a_device_is_opened_once(device: str) -> None:
    first, second = BlockingPort(device, 500_000), SerialPort(device, 500_000)
    first.open()
    with pytest.raises(BusClosed, match=r"this program has it already.*remedy: name another device"):
        second.open()
    second.close()
    assert held_devices() == (device,)
    first.close()
    second.open()
    second.close()


@pytest.mark.parametrize("make", PORTS)
def test_a_port_that_is_forgotten_lets_go(device: str, make: Callable[[str, int], BlockingPort | SerialPort]) -> None:
    port = make(device, 500_000)
    port.open()
    assert held_devices() == (device,)
    del port
    gc.collect()
    assert held_devices() == ()
    with DeviceClaim(device):
        pass


def test_a_child_made_by_fork_keeps_nothing(device: str) -> None:
    """A log or a worker process must not hold the device when the controller was killed."""
    read, write = os.pipe()
    middle = os.fork()
    if middle == 0:
        claim = DeviceClaim(device)
        claim.take()
        child = os.fork()
        if child == 0:
            time.sleep(60.0)
            os._exit(0)
        os.write(write, f"{child}\n".encode())
        time.sleep(60.0)
        os._exit(0)
    child = int(os.read(read, 100))
    try:
        with pytest.raises(BusClosed, match=f"pid {middle}, "):
            DeviceClaim(device).take()
        os.kill(middle, signal.SIGKILL)
        os.waitpid(middle, 0)
        with DeviceClaim(device):
            assert held_devices() == (device,)
    finally:
        os.kill(child, signal.SIGKILL)
        os.close(read)
        os.close(write)


def test_names_of_any_bytes_are_no_hindrance(
    device: str, runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Latin-1 file name on the command line of a UTF-8 system."""
    monkeypatch.setattr(sys, "argv", ["ori-deploy", "deploy", os.fsdecode(b"Fl\xfcgel.plan.json")])
    port = BlockingPort(device, 57_600)
    port.open()
    try:
        assert device in held_devices()
        (lock,) = (lock for lock in runtime_folder.iterdir() if str(os.getpid()) in lock.read_text())
        assert "ori-deploy deploy Fl?gel.plan.json" in lock.read_text()
    finally:
        port.close()


def test_a_lock_that_cannot_be_written_is_a_closed_port_and_let_go(
    device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("ori_deploy.actuators.claim.os.ftruncate", full)
        with pytest.raises(BusClosed, match="No space left"):
            BlockingPort(device, 57_600).open()
    port = BlockingPort(device, 57_600)
    port.open()
    port.close()


def test_what_cannot_be_opened_is_not_kept(runtime_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for make in PORTS:
        with pytest.raises(BusClosed):
            make(str(tmp_path / "file"), 500_000).open()
        with pytest.raises(BusClosed, match="no such device"):
            make(str(tmp_path / "nothing"), 500_000).open()
    assert held_devices() == ()
    assert not runtime_folder.exists()


def test_without_a_safe_folder_nothing_is_opened(runtime_folder: Path, device: str) -> None:
    runtime_folder.mkdir()
    runtime_folder.chmod(0o777)
    with pytest.raises(BusClosed, match=r"cannot be locked.*mode 777.*remedy: "):
        BlockingPort(device, 500_000).open()


def test_the_number_of_a_pseudo_terminal_that_is_gone_is_nobodys() -> None:
    master, slave = os.openpty()
    name = os.ttyname(slave)
    old = DeviceClaim(name)
    old.take()
    os.close(slave)
    os.close(master)
    master, slave = os.openpty()  # the lowest number that is free: mostly the same again
    try:
        with DeviceClaim(os.ttyname(slave)):
            assert len(held_devices()) == 2
    finally:
        old.release()
        os.close(slave)
        os.close(master)
    assert held_devices() == ()


@pytest.mark.parametrize("make", [BlockingPort, SerialPort])
@pytest.mark.parametrize(("what", "told"), [("", "a folder"), ("text", "a file")])
def test_what_is_no_serial_port_is_told_so(
    tmp_path: Path, make: Callable[[str, int], BlockingPort | SerialPort], what: str, told: str
) -> None:
    path = tmp_path / what
    if what:
        path.write_text("x")
    with pytest.raises(BusClosed, match=f"it is {told}; limit: a serial port.*; remedy: correct the port"):
        make(str(path), 57_600).open()
