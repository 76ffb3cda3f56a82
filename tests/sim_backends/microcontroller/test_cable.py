"""The cable's faults, the plug, and the start and end of the process; on both ports."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import serial

from ori_deploy.errors import InputError
from sim_backends.microcontroller.build import Port, firmware
from sim_backends.microcontroller.launcher import Microcontroller, MicrocontrollerError
from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec
from tests.sim_backends.microcontroller.bench import CORES, need

BOTH: tuple[Port, ...] = ("host", "atmega2560")
POWER, EXTERNAL, BROWN_OUT, WATCHDOG = range(4)


def echo(port: Port, link: Path, seed: int = 0) -> Microcontroller:
    need(port)
    return Microcontroller(WorldSpec(seed=seed), link, port=port, program=firmware(port, CORES / "echo"))


def spoilt(link: Path, seed: int) -> tuple[bytes, dict[str, int]]:
    """What comes back over a bad cable, in lockstep."""
    program = firmware("atmega2560", CORES / "echo")
    with Microcontroller(WorldSpec(seed=seed), link, program=program, lockstep=True) as board:
        board.wait_ready()
        board.tap()
        board.drop("to_device", 0.05)
        board.flip("to_device", 0.05)
        board.noise("from_device", 0.05)
        board.feed(bytes(range(256)) * 4)
        board.run(0.05)
        account = board.account()
        return board.tapped(), {**account["to_device"], "noise": account["from_device"]["added"]}


def test_faults_are_the_same_for_the_same_seed(tmp_path: Path) -> None:
    need("atmega2560")
    first, account = spoilt(tmp_path / "tty", 3)
    assert spoilt(tmp_path / "tty", 3) == (first, account)
    assert spoilt(tmp_path / "tty", 4)[0] != first
    assert 20 < account["lost"] < 100
    assert 20 < account["flipped"] < 100
    assert 20 < account["noise"] < 100
    assert len(first) == 1024 - account["lost"] + account["noise"]


@pytest.mark.parametrize("port", BOTH)
def test_a_cut_cable_carries_nothing(tmp_path: Path, port: Port) -> None:
    with echo(port, tmp_path / "tty") as board:
        board.wait_ready()
        with serial.Serial(str(board.link), 500_000, timeout=2.0) as line:
            line.write(b"one")
            assert line.read(3) == b"one"
            board.cut("from_device")
            line.write(b"two")
            line.timeout = 0.1
            assert line.read(3) == b""
            board.cut("from_device", False)
            line.timeout = 2.0
            line.write(b"three")
            assert line.read(5) == b"three"


@pytest.mark.parametrize("port", BOTH)
def test_unplugging_hangs_up_and_takes_the_name_away(tmp_path: Path, port: Port) -> None:
    with echo(port, tmp_path / "tty") as board:
        board.wait_ready()
        with serial.Serial(str(board.link), 500_000, timeout=2.0) as line:
            board.unplug()
            with pytest.raises((serial.SerialException, OSError)):
                line.read(1)
        assert not board.link.is_symlink()
        board.replug()
        with serial.Serial(str(board.link), 500_000, timeout=2.0) as line:
            line.write(b"again")
            assert line.read(5) == b"again"
    assert not (tmp_path / "tty").is_symlink()


def test_the_host_port_resets_hangs_and_remembers(tmp_path: Path) -> None:
    need("host")
    program = firmware("host", CORES / "probe")

    def ask(line: serial.Serial, letter: str, which: int = 0, value: int = 0) -> int:
        line.write(bytes((ord(letter), which, value & 255, value >> 8, 0)))
        answer = line.read(9)
        assert answer[:1] == letter.encode()
        return int.from_bytes(answer[1:], "little")

    world = WorldSpec(hinges=(HingeSpec(output=2, adc=1),))
    with Microcontroller(world, tmp_path / "tty", port="host", program=program, eeprom=tmp_path / "e") as board:
        board.wait_ready()
        with serial.Serial(str(board.link), 500_000, timeout=2.0) as line:
            assert ask(line, "R") == POWER
            ask(line, "W", 9, 17)
            ask(line, "P", 2, 3400)
            time.sleep(0.15)
            assert ask(line, "A", 1) > 512
            assert board.truth().shaft_rad[0] > 0.1
            pulses = board.pulses()
            assert set(pulses.width_s.tolist()) == {0.0017}
            assert ask(line, "F") % 20_000 == 0
            board.reset("brown_out")
            board.wait_ready()
            assert ask(line, "R") == BROWN_OUT
            assert ask(line, "G", 0, 17) == 9
            board.hang()
            time.sleep(0.4)
            assert ask(line, "R") == WATCHDOG
            board.power(False)
            assert not board.status().power
            board.power(True)
            assert ask(line, "R") == POWER
            assert board.truth().shaft_rad[0] > 0.1


def test_what_it_does_not_know_it_says(tmp_path: Path) -> None:
    with echo("host", tmp_path / "tty") as board:
        with pytest.raises(MicrocontrollerError, match="no hinge 3"):
            board.jam(3)
        with pytest.raises(MicrocontrollerError, match="no number from 0 to 1023"):
            board.thermistor(2000)
        with pytest.raises(MicrocontrollerError, match="no command"):
            board.measure("core_frame")
        with pytest.raises(MicrocontrollerError, match="another microcontroller has it"), echo("host", board.link):
            pass
    (tmp_path / "file").write_text("mine")
    with pytest.raises(MicrocontrollerError, match="there is a file"), echo("host", tmp_path / "file"):
        pass
    assert (tmp_path / "file").read_text() == "mine"


def test_a_world_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="output of a hinge"):
        HingeSpec(output=12)
    with pytest.raises(InputError, match="output of a latch"):
        LatchSpec("electromagnet", output=8)
    with pytest.raises(InputError, match="latches name hinges"):
        WorldSpec(latches=(LatchSpec("magnet", hinges=(0,), closed_rad=(0.0,), range_rad=(0.1,)),))


@pytest.mark.parametrize("port", BOTH)
def test_from_the_command_line_until_told_to_end(tmp_path: Path, port: Port) -> None:
    need(port)
    program = firmware(port, CORES / "echo")
    command = [sys.executable, "-m", "sim_backends.mcu", "--link", str(tmp_path / "tty"), "--port", port]
    with subprocess.Popen([*command, "--elf", str(program)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert str(tmp_path / "tty") in process.stdout.readline()
        assert (tmp_path / "tty").is_symlink()
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
    assert not (tmp_path / "tty").is_symlink()
