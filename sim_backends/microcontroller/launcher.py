"""A simulated microcontroller in a process of its own, started, spoilt and ended from Python."""

from __future__ import annotations

import json
import select
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import OriDeployError
from sim_backends.microcontroller.build import Port, emulator, firmware
from sim_backends.microcontroller.plant_link import PlantLink
from sim_backends.microcontroller.spec import WorldSpec
from sim_backends.priority import wait_for_no_processor

START_PATIENCE_S = 10.0
ANSWER_PATIENCE_S = 120.0
END_PATIENCE_S = 5.0
CYCLES_PER_S = 16_000_000
BOOT_S = 0.03
"""By then the firmware listens; bytes that come earlier are lost, as on the board."""

Direction = Literal["to_device", "from_device"]
Wire = Literal["good", "open", "short"]
SensorFault = Literal["good", "low", "high", "bounces"]


class MicrocontrollerError(OriDeployError):
    """The simulated microcontroller did not start, or does not know what it was asked."""


@dataclass(frozen=True, slots=True)
class Pulses:
    """Recorded servo pulses, one place of every array for each, in order of their ends.

    Attributes
    ----------
    output
        Servo output.
    rise, width
        In units of 1 / hz, exact.
    time_s, width_s
        The same in seconds, since the start of the emulation.
    """

    hz: int
    output: NDArray[np.int64]
    rise: NDArray[np.int64]
    width: NDArray[np.int64]

    @property
    def time_s(self) -> NDArray[np.float64]:
        return self.rise / self.hz

    @property
    def width_s(self) -> NDArray[np.float64]:
        return self.width / self.hz

    def of(self, output: int) -> Pulses:
        """Those of one output."""
        mine = self.output == output
        return Pulses(self.hz, self.output[mine], self.rise[mine], self.width[mine])


@dataclass(frozen=True, slots=True)
class LatchTruth:
    """What is really the case with a latch: whether it holds, how far its pin is in, how long its coil was on."""

    closed: bool
    travel: float
    energised_s: float


@dataclass(frozen=True, slots=True)
class Truth:
    """What is really the case.

    Attributes
    ----------
    time_us
        Since the start of the emulation; goes on through resets.
    shaft_rad, latches
        In the order of the specification.
    magnets, sensors
        Bit per output and input.
    """

    time_us: int
    shaft_rad: tuple[float, ...]
    latches: tuple[LatchTruth, ...]
    magnets: int
    sensors: int
    estop: bool


@dataclass(frozen=True, slots=True)
class Status:
    """How the emulation is.

    Attributes
    ----------
    cycle, booted
        Of 16 MHz since the start; at the last reset.
    resets
        Since the start, of every cause.
    crashed
        The program has run into what is no instruction.
    overruns
        Bytes lost because the program read too slowly.
    """

    cycle: int
    booted: int
    resets: int
    power: bool
    crashed: bool
    overruns: int


@dataclass(frozen=True, slots=True)
class Tally:
    """Cycles of something that happened `count` times."""

    count: int
    least: int
    most: int
    mean: float


@dataclass(frozen=True, slots=True)
class Cycles:
    """Cycles of a function: all, and without the interrupts that came between."""

    all: Tally
    own: Tally


@dataclass(frozen=True, slots=True)
class Stack:
    """Bytes of stack: used at most since the last reset, never used, in use now."""

    used: int
    free: int
    now: int


class Microcontroller:
    """A microcontroller with its firmware behind a pty, for `with`.

    Parameters
    ----------
    world
        What is at its pins.
    link
        Name of the port.
    port
        "atmega2560" emulates the chip, cycle by cycle; "host" runs the same core on Linux.
    program
        Another program than the firmware of that port.
    eeprom
        File that keeps the EEPROM; None for an erased one that is forgotten.
    lockstep
        Time stands still but for `run` (atmega2560 only).
    """

    def __init__(
        self,
        world: WorldSpec,
        link: Path,
        *,
        port: Port = "atmega2560",
        program: Path | None = None,
        eeprom: Path | None = None,
        lockstep: bool = False,
    ) -> None:
        if lockstep and port == "host":
            raise MicrocontrollerError("the host port lives in real time; remedy: lockstep with atmega2560")
        self.link = link
        self._world = world
        self._port: Port = port
        self._program = program
        self._eeprom = eeprom
        self._lockstep = lockstep
        self._folder = tempfile.TemporaryDirectory(prefix="mcu")
        self._control = Path(self._folder.name) / "control"  # a socket's name has to be short
        self._process: subprocess.Popen[str] | None = None
        self._stream: Any = None
        self._plant = None if world.plant is None else PlantLink(world, world.plant)
        self.greeting = ""

    @property
    def pid(self) -> int:
        """Of the process."""
        if self._process is None:
            raise MicrocontrollerError("the microcontroller has not been started")
        return self._process.pid

    def __enter__(self) -> Self:
        plant = self._plant
        self._process = subprocess.Popen(
            self._command(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            pass_fds=() if plant is None else (plant.far_end,),
        )  # fmt: skip
        if self._port == "host":  # an emulated one computes without a pause
            wait_for_no_processor(self._process.pid)
        if plant is not None:
            plant.start()
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], START_PATIENCE_S)
        self.greeting = self._process.stdout.readline().strip() if ready else ""
        if not self.greeting:
            self._process.kill()
            _, wrong = self._process.communicate()
            self._folder.cleanup()
            raise MicrocontrollerError(f"the microcontroller did not start: {wrong.strip() or 'it says nothing'}")
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(ANSWER_PATIENCE_S)
        connection.connect(str(self._control))
        self._stream = connection.makefile("rwb")
        connection.close()  # the stream holds it open
        return self

    def _command(self) -> list[str]:
        world = Path(self._folder.name) / "world"
        world.write_text(self._world.to_text() + ("" if self._plant is None else f"plant_fd {self._plant.far_end}\n"))
        program = self._program or firmware(self._port)
        command = [str(program)] if self._port == "host" else [str(emulator()), "--elf", str(program)]
        command += ["--link", str(self.link), "--control", str(self._control), "--world", str(world)]
        command += ["--seed", str(self._world.seed)]
        if self._eeprom is not None:
            command += ["--eeprom", str(self._eeprom)]
        if self._lockstep:
            command += ["--lockstep"]
        return command

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.communicate(timeout=END_PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
        if process is not None:
            process.communicate()
        if self._stream is not None:
            self._stream.close()
        if self._plant is not None:
            self._plant.close()
        self._folder.cleanup()

    def wait_ready(self) -> None:
        """Until the firmware listens, after the start or a reset."""
        if self._lockstep:
            self.run(BOOT_S)
            return
        while (now := self.status()).cycle < now.booted + BOOT_S * CYCLES_PER_S:
            time.sleep(0.005)

    def wait(self) -> int:
        """Until the process ends; its exit code."""
        assert self._process is not None
        return self._process.wait()

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._process is not None and self._process.poll() is None

    def kill(self) -> None:
        """End the process at once, as when its host dies. The link stays behind, pointing nowhere."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    # -- what is the case ----------------------------------------------------------------------------

    def truth(self) -> Truth:
        """Shafts, latches and levels."""
        answer = self._ask("truth")
        latches = tuple(LatchTruth(**latch) for latch in answer.pop("latches"))
        return Truth(latches=latches, shaft_rad=tuple(answer.pop("shaft_rad")), **answer)

    def status(self) -> Status:
        """Cycles, resets, power."""
        return Status(**self._ask("status"))

    def pulses(self) -> Pulses:
        """Pulses since the start, or since `forget_pulses`; the newest 65536 at most."""
        answer = self._ask("pulses")
        rows = np.array(answer["pulses"], dtype=np.int64).reshape(-1, 3)
        return Pulses(answer["hz"], rows[:, 0], rows[:, 1], rows[:, 2])

    def forget_pulses(self) -> None:
        """Begin the record anew."""
        self._ask("forget_pulses")

    def account(self) -> dict[Direction, dict[str, int]]:
        """Bytes passed, lost, flipped and added in each direction of the cable."""
        answer: dict[Direction, dict[str, int]] = self._ask("account")
        return answer

    def lost_s(self) -> float:
        """Real time that the emulation of the chip could not keep up with."""
        lost: float = self._ask("pace")["lost_s"]
        return lost

    # -- cycles (atmega2560 only) --------------------------------------------------------------------

    def measure(self, *functions: str) -> None:
        """Count cycles of functions from now on, by their names; slows the emulation down. Without a name: stop."""
        self._ask("measure", *functions)

    def measured(self) -> dict[str, Cycles]:
        """What `measure` has counted."""
        return {
            name: Cycles(Tally(**entry["all"]), Tally(**entry["own"]))
            for name, entry in self._ask("measured").items()
        }

    def latency(self) -> dict[int, Tally]:
        """By vector number: cycles from an interrupt's being due to its vector."""
        return {int(vector): Tally(**entry) for vector, entry in self._ask("latency").items()}

    def forget_latency(self) -> None:
        """Count latencies anew."""
        self._ask("forget_latency")

    def stack(self) -> Stack:
        """How deep the stack went."""
        return Stack(**self._ask("stack"))

    def run(self, duration_s: float) -> None:
        """In lockstep: let so much time pass. What the host has sent by now is heard at its beginning."""
        self.run_cycles(round(duration_s * CYCLES_PER_S))

    def run_cycles(self, cycles: int) -> None:
        """In lockstep: let so many cycles pass; the last instruction may take some more."""
        self._ask("run", cycles)

    # -- the cable -----------------------------------------------------------------------------------

    def drop(self, direction: Direction, probability: float) -> None:
        """Lose bytes."""
        self._ask("spoil", direction, "drop", round(1e6 * probability))

    def flip(self, direction: Direction, probability: float) -> None:
        """Flip a bit of bytes."""
        self._ask("spoil", direction, "flip", round(1e6 * probability))

    def noise(self, direction: Direction, probability: float) -> None:
        """Put bytes of noise before bytes."""
        self._ask("spoil", direction, "noise", round(1e6 * probability))

    def cut(self, direction: Direction, on: bool = True) -> None:
        """Let bytes go nowhere."""
        self._ask("spoil", direction, "cut", int(on))

    def seed(self, seed: int) -> None:
        """Of the cable's faults."""
        self._ask("seed", seed)

    def unplug(self) -> None:
        """Pull the cable out: whoever has the port open is hung up on, and its name is gone."""
        self._ask("unplug")

    def replug(self) -> None:
        """Put the cable back under its name."""
        self._ask("replug")

    def feed(self, data: bytes) -> None:
        """Bytes as if the host had sent them, through the cable."""
        for i in range(0, len(data), 4096):
            self._ask("feed", data[i : i + 4096].hex())

    def tap(self, on: bool = True) -> None:
        """Collect what the host is sent, for `tapped`."""
        self._ask("tap", int(on))

    def tapped(self) -> bytes:
        """What has been collected since the last time; 65536 bytes at most."""
        return bytes.fromhex(self._ask("tapped"))

    # -- faults --------------------------------------------------------------------------------------

    def reset(self, cause: Literal["external", "brown_out"] = "external") -> None:
        """Reset it; `hang` for the watchdog's."""
        self._ask("reset", cause)

    def hang(self, interrupts: bool = False) -> None:
        """Let the program go round in circles for ever, with interrupts on or off: the watchdog resets it."""
        self._ask("hang", *(["irq"] if interrupts else []))

    def power(self, on: bool) -> None:
        """Switch the board's own supply; EEPROM and shafts stay as they are, and so does the cable."""
        self._ask("power", int(on))

    def power_cycle(self) -> None:
        """Off and on again, at once."""
        self.power(False)
        self.power(True)

    def eeprom(self, address: int = 0, size: int = 4096) -> bytes:
        """A part of the EEPROM."""
        return bytes.fromhex(self._ask("eeprom", address, size))

    def put_eeprom(self, address: int, data: bytes) -> None:
        """Change the EEPROM past the program."""
        self._ask("put_eeprom", address, data.hex())

    def jam(self, hinge: int, on: bool = True) -> None:
        """Block a shaft where it stands, or free it."""
        self._ask("jam", hinge, int(on))

    def push(self, hinge: int, by_rad: float) -> None:
        """Turn a shaft by hand, at once; a closed latch does not let it."""
        self._ask("push", hinge, round(1e6 * by_rad))

    def wire(self, hinge: int, state: Wire) -> None:
        """Break the wire of a pot, so that it reads 0, or short it, so that it reads 1023."""
        self._ask("wire", hinge, state)

    def open_wire(self, hinge: int) -> None:
        """Break the wire of a pot."""
        self.wire(hinge, "open")

    def short_wire(self, hinge: int) -> None:
        """Short the wire of a pot to its supply."""
        self.wire(hinge, "short")

    def sensor(self, sensor: int, fault: SensorFault) -> None:
        """Let the level of a sensor input be stuck, or bounce; "good" heals it."""
        self._ask("sensor", sensor, fault)

    def latch_stuck(self, latch: int, on: bool = True) -> None:
        """Freeze a latch as it is: a closed one stays closed and holds, an open one stays open."""
        self._ask("latch_stuck", latch, int(on))

    def supply(self, volts: float) -> None:
        """The servos' supply."""
        self._ask("supply", round(1e6 * volts))

    def thermistor(self, count: int) -> None:
        """What the thermistor reads."""
        self._ask("thermistor", count)

    def adc(self, adc_input: int, count: int | None) -> None:
        """Force an analogue input to a count; None releases it."""
        self._ask("adc", adc_input, -1 if count is None else count)

    def estop(self, pressed: bool = True) -> None:
        """Press the emergency stop, or release it."""
        self._ask("estop", int(pressed))

    def _ask(self, *words: str | int) -> Any:
        if self._stream is None:
            raise MicrocontrollerError("the microcontroller has not been started")
        try:
            self._stream.write(" ".join(str(word) for word in words).encode() + b"\n")
            self._stream.flush()
            answer = self._stream.readline()
        except OSError as wrong:
            raise MicrocontrollerError(f"the microcontroller does not answer: {wrong}") from wrong
        if not answer:
            raise MicrocontrollerError("the microcontroller has ended")
        said = json.loads(answer)
        if "error" in said:
            raise MicrocontrollerError(said["error"])
        return said["ok"]
