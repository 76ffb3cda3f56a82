"""The process behind a virtual bus: one loop over the host's bytes, the control socket and the clock."""

from __future__ import annotations

import json
import selectors
import signal
import socket
import time
from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from sim_backends.dynamixel.bus import COUNTED, MEASURED, READS, Answer, Bus, truth
from sim_backends.dynamixel.packets import Listener
from sim_backends.dynamixel.plug import Plug, claim
from sim_backends.dynamixel.spec import BusSpec

IDLE_S = 0.02
SPIN_S = 150e-6
"""Last stretch of a wait that is not slept through: waking up takes about half of that."""


class Process:
    """Runs a bus until it is told to end.

    Parameters
    ----------
    spec
        What is on it.
    link, control
        Names of the port and of the control socket.
    """

    def __init__(self, spec: BusSpec, link: Path, control: Path) -> None:
        self._claim = claim(link, control)
        self._spec = spec
        self._bus = Bus(spec, time.monotonic())
        self._listener = Listener()
        self._plug = Plug(link)
        self._control = control
        self._selector = selectors.DefaultSelector()
        self._line_free = 0.0
        self._ended = False
        self._account = _blank_account()

    def run(self, ready: Callable[[str], None]) -> None:
        """Serve until SIGINT or SIGTERM; `ready` gets a line that says where."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        server = socket.socket(socket.AF_UNIX)
        server.bind(str(self._control))
        server.listen()
        self._selector.register(server, selectors.EVENT_READ, self._accept)
        try:
            self._put_in()
            spec = self._spec
            ready(
                f"virtual bus on {self._plug.link} -> {self._plug.device}, {len(spec.servos)} servos, "
                f"{spec.baud} baud; control {self._control}"
            )
            while not self._ended:
                events = self._selector.select(IDLE_S)
                if not events:
                    self._listener.clear()  # so long a gap within a packet ends it; a servo takes 1.5 ms
                for key, _ in events:
                    key.data(key.fileobj)
                self._bus.advance(time.monotonic())
        finally:
            self._plug.pull_out()
            server.close()
            self._control.unlink(missing_ok=True)
            self._claim.close()

    def _end(self, *_: object) -> None:
        self._ended = True

    # -- the line ------------------------------------------------------------------------------------

    def _put_in(self) -> None:
        if self._plug.fileno() >= 0:
            return
        self._plug.put_in()
        self._listener.clear()
        self._selector.register(self._plug.fileno(), selectors.EVENT_READ, self._hear)

    def _pull_out(self) -> None:
        if self._plug.fileno() >= 0:
            self._selector.unregister(self._plug.fileno())
            self._plug.pull_out()

    def _hear(self, _: object) -> None:
        if self._plug.fileno() < 0:
            return  # pulled out since the host spoke
        data = self._plug.receive()
        arrived = time.monotonic()
        baud = self._plug.baud()
        self._account["received"] += len(data)
        if not baud:
            return  # a host that has hung up, in termios' words
        for instruction in self._listener.feed(data):
            asked_s = 10.0 * instruction.size / baud
            heard = max(arrived, self._line_free) + asked_s if self._spec.wire_timing else arrived
            self._bus.advance(time.monotonic())
            answer = self._bus.handle(instruction, baud, time.monotonic())
            self._answer(answer, heard, asked_s, reading=instruction.code in READS)

    def _answer(self, answer: Answer, heard: float, asked_s: float, *, reading: bool) -> None:
        """Send an answer when it would have come, and keep account of the wire's time."""
        latency = self._spec.usb_latency_s if answer.data else 0.0
        self._line_free = heard + answer.wire_s
        account = self._account
        account["wire_s"] += asked_s + answer.wire_s + latency
        account["reads"] += reading
        account["sent"] += len(answer.data)
        if not answer.data:
            return
        if self._spec.wire_timing:
            due = self._line_free + latency
            self._wait(due)
            account["late_s"] += time.monotonic() - due
        self._plug.send(bytes(answer.data))

    def _wait(self, due: float) -> None:
        """Until due; the motors are moved meanwhile, so that nobody waits for them later."""
        self._bus.advance(time.monotonic())
        left = due - time.monotonic()
        if left > SPIN_S:
            time.sleep(left - SPIN_S)
        while time.monotonic() < due:
            pass

    # -- the control socket --------------------------------------------------------------------------

    def _accept(self, server: socket.socket) -> None:
        connection, _ = server.accept()
        connection.settimeout(1.0)
        stream = connection.makefile("rwb")
        self._selector.register(connection, selectors.EVENT_READ, lambda _: self._obey(connection, stream))

    def _obey(self, connection: socket.socket, stream: Any) -> None:
        try:
            line = stream.readline()
            if line:
                words = json.loads(line)
                stream.write(json.dumps(self._command(words)).encode() + b"\n")
                stream.flush()
        except (OSError, ValueError, RecursionError):
            line = b""  # whoever sends nonsense, or has gone, is not spoken to any more
        if not line:
            self._selector.unregister(connection)
            stream.close()
            connection.close()

    def _command(self, words: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a line of JSON says: `{"do": NAME, ...}`. Answers with `ok`, or with `error`."""
        if not isinstance(words, dict):
            raise ValueError("no JSON object")
        self._bus.advance(time.monotonic())
        arguments = {key: value for key, value in words.items() if key != "do"}
        commands: dict[str, Callable[..., Any]] = {
            "truth": lambda: truth(self._bus),
            "account": lambda: dict(self._account),
            "reset_account": lambda: self._account.update(_blank_account()),
            "unplug": self._pull_out,
            "replug": self._put_in,
            "noise": self._noise,
            "sag": self._sag,
            "fault": self._fault,
            "mute": self._mute,
            "reboot": lambda id: self._each(id, lambda k: self._bus.servos[k].reboot(time.monotonic())),
            "jam": lambda id, on: self._each(id, lambda k: self._bus.motors.jammed.__setitem__(k, bool(on))),
            "push": lambda id, by_rad: self._each(id, lambda k: self._bus.motors.push(k, _number(by_rad))),
            "fail": lambda id, bits: self._each(id, lambda k: self._bus.servos[k].fail(int(bits))),
            "heat": self._heat,
            "set": self._set,
            "get": lambda id, name: self._bus.servos[self._rows(id)[0]].named(name),
        }
        try:
            return {"ok": commands[words["do"]](**arguments)}
        except (KeyError, TypeError, ValueError, OverflowError) as wrong:
            return {"error": f"{words.get('do')}: {type(wrong).__name__}: {wrong}"}

    def _rows(self, servo_id: int) -> list[int]:
        rows = [k for k, servo in enumerate(self._bus.servos) if servo.id == servo_id]
        if not rows:
            raise ValueError(f"there is no servo {servo_id}")
        return rows

    def _each(self, servo_id: int, act: Callable[[int], object]) -> None:
        for k in self._rows(servo_id):
            act(k)

    def _fault(self, id: int, kind: str, count: int, **more: float) -> None:
        if kind not in COUNTED or not set(more) <= MEASURED:
            raise ValueError(f"there is no fault {kind} with {sorted(more)}")
        for k in self._rows(id):
            fault = self._bus.faults[k]
            setattr(fault, kind, getattr(fault, kind) + int(count))
            for name, value in more.items():
                setattr(fault, name, type(getattr(fault, name))(_number(value)))

    def _mute(self, id: int, on: bool) -> None:
        for k in self._rows(id):
            self._bus.faults[k].mute = bool(on)

    def _heat(self, id: int, temperature_c: float) -> None:
        for k in self._rows(id):
            self._bus.motors.temperature_c[k] = _number(temperature_c)

    def _set(self, id: int, name: str, value: int) -> None:
        for k in self._rows(id):
            servo = self._bus.servos[k]
            servo.put(servo.table.named(name), int(value))

    def _sag(self, volts: float) -> None:
        self._bus.motors.sag_v = _number(volts)

    def _noise(self, data: str) -> None:
        self._bus.noise += bytes.fromhex(data)


def _blank_account() -> dict[str, float]:
    return {"wire_s": 0.0, "reads": 0, "received": 0, "sent": 0, "late_s": 0.0}


def _number(value: float) -> float:
    if not isfinite(value):
        raise ValueError(f"{value} is no number to reckon with")
    return float(value)
