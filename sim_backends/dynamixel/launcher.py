"""A virtual bus in a process of its own, started, spoilt and ended from Python."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ori_deploy.errors import OriDeployError
from sim_backends.dynamixel.servo import OVERLOAD
from sim_backends.dynamixel.spec import BusSpec
from sim_backends.priority import wait_for_no_processor

START_PATIENCE_S = 30.0
END_PATIENCE_S = 5.0


class VirtualBusError(OriDeployError):
    """The virtual bus did not start, or does not know what it was asked."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What is really the case with one servo.

    Attributes
    ----------
    frozen, watchdog
        Its watchdog has stopped it; the register.
    moved_s
        When it last turned, on CLOCK_MONOTONIC.
    """

    id: int
    shaft_rad: float
    output_rad: float
    velocity_rad_s: float
    goal_rad: float
    goal_count: int
    torque_on: bool
    frozen: bool
    watchdog: int
    temperature_c: float
    current_a: float
    hardware_error: int
    moved_s: float


@dataclass(frozen=True, slots=True)
class Account:
    """What has gone over the wire.

    Attributes
    ----------
    wire_s
        Simulated time of bytes, pauses and adapter.
    reads, received, sent
        Instructions that read, bytes from the host, bytes to it.
    late_s
        By how much answers came later than simulated, summed up.
    """

    wire_s: float
    reads: int
    received: int
    sent: int
    late_s: float


class VirtualBus:
    """A bus behind a pty, for `with`.

    Parameters
    ----------
    spec
        What is on it.
    link
        Name of the port; the control socket is beside it.
    """

    def __init__(self, spec: BusSpec, link: Path) -> None:
        self.link = link
        self._spec = spec
        self._folder = tempfile.TemporaryDirectory(prefix="vbus")
        self._control = Path(self._folder.name) / "control"  # a socket's name has to be short
        self._process: subprocess.Popen[str] | None = None

    @property
    def pid(self) -> int:
        """Of the process."""
        if self._process is None:
            raise VirtualBusError("the virtual bus has not been started")
        return self._process.pid

    @property
    def control(self) -> Path:
        """Its control socket."""
        return self._control

    def __enter__(self) -> Self:
        spec = Path(self._folder.name) / "spec.json"
        spec.write_text(json.dumps(self._spec.to_json()))
        command = [sys.executable, "-m", "sim_backends.dynamixel_bus", "--spec", str(spec)]
        command += ["--link", str(self.link), "--control", str(self._control)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], START_PATIENCE_S)
        if not ready or not self._process.stdout.readline():
            self._process.kill()
            _, wrong = self._process.communicate()
            self._folder.cleanup()
            raise VirtualBusError(f"the virtual bus did not start: {wrong.strip() or 'it says nothing'}")
        if self._spec.plant is None:  # which computes as long as it needs, and would keep the processor from others
            wait_for_no_processor(self._process.pid)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        process = self._process
        if process is not None:
            process.terminate()
            try:
                process.communicate(timeout=END_PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
        self._folder.cleanup()

    # -- what is the case ----------------------------------------------------------------------------

    def truth(self) -> dict[int, Truth]:
        """Every servo, by id."""
        return {entry["id"]: Truth(**entry) for entry in self._ask(do="truth")}

    def account(self) -> Account:
        """What has gone over the wire since the start, or since `reset_account`."""
        return Account(**self._ask(do="account"))

    def reset_account(self) -> None:
        """Begin the account anew."""
        self._ask(do="reset_account")

    def register(self, servo_id: int, name: str) -> int:
        """A register as it stands."""
        value: int = self._ask(do="get", id=servo_id, name=name)
        return value

    # -- faults --------------------------------------------------------------------------------------

    def drop(self, servo_id: int, count: int = 1) -> None:
        """Lose the next `count` answers of a servo."""
        self._ask(do="fault", id=servo_id, kind="drop", count=count)

    def corrupt(self, servo_id: int, count: int = 1) -> None:
        """Flip a bit in the next `count` answers of a servo."""
        self._ask(do="fault", id=servo_id, kind="corrupt", count=count)

    def truncate(self, servo_id: int, count: int = 1, n_bytes: int = 1) -> None:
        """Cut `n_bytes` off the next `count` answers of a servo."""
        self._ask(do="fault", id=servo_id, kind="truncate", count=count, cut_bytes=n_bytes)

    def delay(self, servo_id: int, count: int, delay_s: float) -> None:
        """Hold the next `count` answers of a servo back."""
        self._ask(do="fault", id=servo_id, kind="delay", count=count, delay_s=delay_s)

    def mute(self, servo_id: int, on: bool = True) -> None:
        """Make a servo silent, or let it speak again; it goes on doing what it was told."""
        self._ask(do="mute", id=servo_id, on=on)

    def noise(self, data: bytes) -> None:
        """Bytes that come before the next answer."""
        self._ask(do="noise", data=data.hex())

    def reboot(self, servo_id: int) -> None:
        """Restart a servo, as a loose plug does."""
        self._ask(do="reboot", id=servo_id)

    def jam(self, servo_id: int, on: bool = True) -> None:
        """Block a shaft where it stands, or free it."""
        self._ask(do="jam", id=servo_id, on=on)

    def push(self, servo_id: int, by_rad: float) -> None:
        """Turn a shaft by hand, at once."""
        self._ask(do="push", id=servo_id, by_rad=by_rad)

    def overload(self, servo_id: int) -> None:
        """Make a servo find itself overloaded, now."""
        self.fail(servo_id, OVERLOAD)

    def fail(self, servo_id: int, bits: int) -> None:
        """Set bits of a servo's hardware error status."""
        self._ask(do="fail", id=servo_id, bits=bits)

    def heat(self, servo_id: int, temperature_c: float) -> None:
        """Bring a servo to a temperature, from which it cools."""
        self._ask(do="heat", id=servo_id, temperature_c=temperature_c)

    def sag(self, volts: float) -> None:
        """Take so much off the supply; 0 restores it."""
        self._ask(do="sag", volts=volts)

    def set_register(self, servo_id: int, name: str, value: int) -> None:
        """Set a register past all rules."""
        self._ask(do="set", id=servo_id, name=name, value=value)

    def unplug(self) -> None:
        """Pull the adapter out: whoever has the port open is hung up on, and its name is gone."""
        self._ask(do="unplug")

    def replug(self) -> None:
        """Put the adapter back under its name."""
        self._ask(do="replug")

    def _ask(self, **words: Any) -> Any:
        with contextlib.closing(socket.socket(socket.AF_UNIX)) as connection:
            connection.settimeout(START_PATIENCE_S)
            connection.connect(str(self._control))
            with connection.makefile("rwb") as stream:
                stream.write(json.dumps(words).encode() + b"\n")
                stream.flush()
                answer = json.loads(stream.readline())
        if "error" in answer:
            raise VirtualBusError(answer["error"])
        return answer["ok"]
