"""A microcontroller written from the dialect's words and not from the firmware, in virtual time or on a pty.

It keeps what the protocol promises and no more: hinges are where their outputs are, segments are not
checked for limits. Every message on its way in or out passes a hook of the test, which may lose it, spoil it
or hold it back.
"""

from __future__ import annotations

import os
import select
import threading
import time
import tty
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.clock import VirtualClock
from ori_deploy.wire.generated import ori_deploy as d

Hook = Callable[[Any, bytes], list[tuple[float, bytes]]]
"""From a message and its frame to what arrives: delays and bytes."""

HINGE_PLACES, LATCH_PLACES = 12, 8


def unharmed(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
    """Everything arrives."""
    del message
    return [(0.0, frame)]


@dataclass
class Knot:
    number: int
    time_us: int
    position: list[int]
    velocity: list[int]


@dataclass
class Latch:
    engaged: bool = False
    closed: bool = False
    sensed: bool = True
    tripped: bool = False
    duty_left: int = 1000


@dataclass
class ScriptedDevice:
    """The device; attributes may be changed while it runs."""

    config: list[Any]
    now: Callable[[], float] = time.monotonic
    drift: float = 0.0
    offset_s: float = 12.0
    to_host: Hook = unharmed
    to_device: Hook = unharmed
    measured: list[int] = field(default_factory=lambda: [0] * HINGE_PLACES)
    silent: int = 0
    garbled: int = 0
    stalled: int = 0
    outputs_on: int = 0
    state: int = d.ORI_IDLE
    fault: int = 0
    fault_index: int = 255
    cause_persists: bool = False
    thermistor: int = 512
    supply_mv: int = 6000
    boot: int = 7
    firmware: int = 0x01010000
    dead: bool = False
    stream: int = 0
    contiguous: int = 0
    stream_open: bool = False
    knots: list[Knot] = field(default_factory=list)
    taken: list[Knot] = field(default_factory=list)
    commands: list[Any] = field(default_factory=list)
    asked: list[int] = field(default_factory=lambda: [0] * HINGE_PLACES)
    droop_urad: int = 0

    def __post_init__(self) -> None:
        device = self.config[0]
        self.n = device.hinges
        self.brake_s, self.silence_s = 1e-3 * device.brake_ms, 1e-3 * device.silence_ms
        self.latches = [Latch() for _ in range(device.latches)]
        self.stored = list(self.config)
        self.begun: list[Any] = []
        self._epoch = self.now()
        self._heard = 0.0
        self._last_ack: Any = None
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._parser = d.MAVLink(None)
        self._parser.robust_parsing = True
        self._writer = d.MAVLink(None, 1, 1)
        self.out: Callable[[bytes], object] = len

    def step(self, data: bytes = b"") -> None:
        """Take bytes in, and do what is due by now."""
        now = self.now()
        due = [action for at, action in self._later if at <= now]
        self._later = [(at, action) for at, action in self._later if at > now]
        for action in due:
            action()
        for message in self._parser.parse_buffer(data) or []:
            self._arrive(message)
        self._advance()

    def now_us(self) -> int:
        return int(1e6 * (self.offset_s + (1.0 + self.drift) * (self.now() - self._epoch)))

    def _arrive(self, message: Any) -> None:
        if message.get_type() == "BAD_DATA" or self.dead:
            return
        for delay, _ in self.to_device(message, bytes(message.get_msgbuf())):
            self._after(delay, lambda: self._take(message))

    def _after(self, delay: float, action: Callable[[], None]) -> None:
        if delay > 0.0:
            self._later.append((self.now() + delay, action))
        else:
            action()

    def send(self, message: Any) -> None:
        frame = bytes(message.pack(self._writer))
        self._writer.seq = (self._writer.seq + 1) % 256
        for delay, data in self.to_host(message, frame):
            self._after(delay, lambda data=data: self.out(data))  # type: ignore[misc]

    # -- what it does --------------------------------------------------------------------------------

    def trip(self, fault: int, index: int = 255) -> None:
        if self.fault == 0:
            self.fault, self.fault_index, self.stream_open = fault, index, False
            self.knots = []  # braking is at once here
            self.state = d.ORI_FAULTED

    def restart(self, fault: int = 0) -> None:
        self.boot += 1
        self._epoch, self.offset_s = self.now(), 0.3
        self.outputs_on = self.contiguous = self.stream = 0
        self.stream_open, self.knots, self._last_ack = False, [], None
        self.fault, self.fault_index = fault, 255
        self.state = d.ORI_FAULTED if fault else d.ORI_IDLE

    def stall(self, index: int) -> None:
        self.stalled |= 1 << index
        self.outputs_on &= ~(1 << index)
        self.trip(d.ORI_FAULT_STALL, index)

    def _advance(self) -> None:
        if self.state == d.ORI_STREAMING and self.now() - self._heard > self.silence_s - self.brake_s - 0.02:
            self.trip(d.ORI_FAULT_HOST_SILENT)
        now = self.now_us()
        while self.state == d.ORI_STREAMING and len(self.knots) > 1 and self.knots[1].time_us <= now:
            del self.knots[0]
        if self.state == d.ORI_STREAMING and self.knots:
            last = self.knots[-1]
            if any(last.velocity[: self.n]) and last.time_us - now < 65_000:
                self.trip(d.ORI_FAULT_UNDERRUN)
            elif now >= self.knots[0].time_us:
                self._follow(now)
        for k in range(self.n):
            if self.outputs_on >> k & 1:
                self.measured[k] = self.asked[k] - self.droop_urad

    def _follow(self, now: int) -> None:
        a = self.knots[0]
        if len(self.knots) == 1:
            self.asked[: self.n] = a.position[: self.n]
            self.knots, self.state = [], d.ORI_HOLDING
            return
        b = self.knots[1]
        u = (now - a.time_us) / (b.time_us - a.time_us)
        for k in range(self.n):
            self.asked[k] = round(a.position[k] + u * (b.position[k] - a.position[k]))

    # -- messages ------------------------------------------------------------------------------------

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        self._heard = self.now()
        if kind == "TIMESYNC" and message.tc1 == 0:
            self.send(d.MAVLink_timesync_message(1000 * self.now_us(), message.ts1))
        elif kind == "ORI_POLL":
            self._report(message.token, message.what)
        elif kind == "ORI_SETPOINTS":
            self._setpoints(message)
        elif kind == "ORI_CONFIG_READ":
            self._read_record(message)
        elif self._last_ack is not None and self._last_ack.token == message.token:
            self.send(self._last_ack)
        else:
            self.commands.append(message)
            result, index, value = getattr(self, f"_on_{kind.lower()}")(message)
            self._last_ack = d.MAVLink_ori_ack_message(value, message.token, result, index)
            self.send(self._last_ack)

    def _report(self, token: int, what: int) -> None:
        if what & d.ORI_POLL_STATE:
            hinges = (1 << self.n) - 1
            sensed = hinges & ~self.silent & ~self.garbled
            sensed &= sum(1 << k for k in range(self.n) if self.config[1 + k].flags & d.ORI_HINGE_HAS_FEEDBACK)
            self.send(
                d.MAVLink_ori_state_message(
                    self.now_us(),
                    [self.measured[k] if sensed >> k & 1 else 0 for k in range(HINGE_PLACES)],
                    [self.asked[k] if self.outputs_on >> k & 1 else 0 for k in range(HINGE_PLACES)],
                    token,
                    self.contiguous,
                    self.supply_mv,
                    self.thermistor,
                    self.outputs_on,
                    sensed,
                    self.silent,
                    self.stalled,
                    len(self.knots),
                    self.stream,
                    self.state,
                    self.fault,
                    self.fault_index,
                )
            )
        if what & d.ORI_POLL_LATCHES:

            def mask(name: str) -> int:
                return sum(1 << k for k, latch in enumerate(self.latches) if getattr(latch, name))

            left = [latch.duty_left for latch in self.latches] + [1000] * (LATCH_PLACES - len(self.latches))
            self.send(
                d.MAVLink_ori_latch_state_message(
                    self.now_us(), token, mask("engaged"), mask("closed"), mask("sensed"), mask("tripped"), 0, left
                )
            )
        if what & d.ORI_POLL_INFO:
            stored = self.stored[0] if self.stored else None
            self.send(
                d.MAVLink_ori_info_message(
                    self.now_us(),
                    self.boot,
                    self.firmware,
                    self.hash(self.stored) if stored else 0,
                    token,
                    0,
                    stored.hinges if stored else 0,
                    stored.latches if stored else 0,
                    b"scripted",
                )
            )

    def _setpoints(self, message: Any) -> None:
        if not self.stream_open or message.stream != self.stream:
            return
        for j in range(message.count):
            number = (message.first + j) % 65536
            if number != self.contiguous or len(self.knots) >= 20:
                continue
            knot = Knot(
                number,
                self._unwrapped(message.time_us[j]),
                list(message.position_urad[12 * j : 12 * j + 12]),
                list(message.velocity_mrad_s[12 * j : 12 * j + 12]),
            )
            if not self.knots:
                away = max((abs(p - q) for p, q in zip(knot.position[: self.n], self.asked, strict=False)), default=0)
                if any(knot.velocity[: self.n]) or away > 200:
                    self.trip(d.ORI_FAULT_DISCONTINUITY, 0)
                    return
                self.state = d.ORI_STREAMING
            elif not 1000 <= knot.time_us - self.knots[-1].time_us <= 1_000_000:
                self.trip(d.ORI_FAULT_KNOT_TIME)
                return
            self.contiguous = (self.contiguous + 1) % 65536
            self.knots.append(knot)
            self.taken.append(knot)

    def _unwrapped(self, time_us: int) -> int:
        now = self.now_us()
        return now + (time_us - now + (1 << 31)) % (1 << 32) - (1 << 31)

    def _on_ori_enable(self, m: Any) -> tuple[int, int, int]:
        if self.fault:
            return d.ORI_REFUSED_FAULT, 255, self.fault
        if self.state not in (d.ORI_IDLE, d.ORI_HOLDING):
            return d.ORI_REFUSED_STATE, 255, self.state
        for k in range(self.n):
            measured = self.config[1 + k].flags & d.ORI_HINGE_HAS_FEEDBACK
            if measured and abs(m.position_urad[k] - self.measured[k]) > self.config[0].seat_urad:
                return d.ORI_REFUSED_POSITION, k, self.measured[k]
        for k in range(self.n):
            if not self.outputs_on >> k & 1:
                self.asked[k] = m.position_urad[k]
        self.outputs_on |= m.hinges
        self.stream, self.contiguous, self.stream_open, self.taken = m.stream, 0, True, []
        self.state = d.ORI_HOLDING
        return d.ORI_ACCEPTED, 255, 0

    def _on_ori_disable(self, m: Any) -> tuple[int, int, int]:
        if self.state in (d.ORI_STREAMING, d.ORI_BRAKING):
            return d.ORI_REFUSED_STATE, 255, self.state
        self.outputs_on &= ~m.hinges
        if self.state == d.ORI_HOLDING and not self.outputs_on:
            self.state = d.ORI_IDLE
        return d.ORI_ACCEPTED, 255, 0

    def _on_ori_brake(self, m: Any) -> tuple[int, int, int]:
        del m
        if self.state == d.ORI_STREAMING:
            self.trip(d.ORI_FAULT_HOST_BRAKE)
        return d.ORI_ACCEPTED, 255, self.state

    def _on_ori_latch_command(self, m: Any) -> tuple[int, int, int]:
        if m.index >= len(self.latches):
            return d.ORI_REFUSED_INDEX, m.index, 0
        if m.engage and self.latches[m.index].tripped:
            return d.ORI_REFUSED_TRIPPED, m.index, 0
        self.latches[m.index].engaged = bool(m.engage)
        return d.ORI_ACCEPTED, m.index, 0

    def _on_ori_fault_clear(self, m: Any) -> tuple[int, int, int]:
        if self.fault and m.fault != self.fault:
            return d.ORI_REFUSED_FAULT, 255, self.fault
        if self.fault and self.cause_persists:
            return d.ORI_REFUSED_CAUSE, 255, self.fault
        self.fault, self.fault_index, self.stalled = 0, 255, 0
        self.state = d.ORI_HOLDING if self.outputs_on else d.ORI_IDLE
        return d.ORI_ACCEPTED, 255, 0

    def _on_ori_config_device(self, m: Any) -> tuple[int, int, int]:
        self.begun = [m]
        return d.ORI_ACCEPTED, 255, 0

    def _on_ori_config_hinge(self, m: Any) -> tuple[int, int, int]:
        self.begun.append(m)
        return d.ORI_ACCEPTED, m.index, 0

    _on_ori_config_latch = _on_ori_config_hinge

    def _on_ori_config_commit(self, m: Any) -> tuple[int, int, int]:
        found = self.hash(self.begun)
        if found != m.hash:
            return d.ORI_REFUSED_HASH, 255, found - (1 << 32) if found >> 31 else found
        self.stored = self.begun
        return d.ORI_ACCEPTED, 255, 0

    def _read_record(self, m: Any) -> None:
        kinds = (
            d.MAVLink_ori_config_device_message,
            d.MAVLink_ori_config_hinge_message,
            d.MAVLink_ori_config_latch_message,
        )
        found = [r for r in self.stored if isinstance(r, kinds[m.record]) and getattr(r, "index", 0) == m.index]
        if not found:
            self.send(d.MAVLink_ori_ack_message(0, m.token, d.ORI_REFUSED_INDEX, m.index))
            return
        values = {name: getattr(found[0], name) for name in found[0].fieldnames}
        self.send(kinds[m.record](**{**values, "token": m.token}))

    @staticmethod
    def hash(records: list[Any]) -> int:
        """CRC-32 of the payloads with their tokens 0, packed here field by field."""
        crc = 0
        for record in records:
            values = [0 if name == "token" else getattr(record, name) for name in record.ordered_fieldnames]
            crc = zlib.crc32(record.unpacker.pack(*values), crc)
        return crc


STEP_S = 0.001


class SteppedClock(VirtualClock):
    """Virtual time that passes in steps, in each of which the devices live."""

    def __init__(self) -> None:
        super().__init__(100.0)
        self.lives: list[Callable[[], None]] = []

    def sleep_until(self, deadline: float) -> None:
        while self.now() < deadline:
            super().sleep_until(min(deadline, self.now() + STEP_S))
            for live in self.lives:
                live()


class VirtualPort:
    """A `SerialPort` to a device in virtual time; a message takes a step or two to the device and back."""

    def __init__(self, device: ScriptedDevice, clock: SteppedClock) -> None:
        self.path = "virtual"
        self.is_open = False
        self.plugged = True
        self._device, self._clock = device, clock
        self._there = b""
        self._back = bytearray()
        device.out = self._back.extend
        clock.lives.append(self._live)

    def _live(self) -> None:
        data, self._there = self._there, b""
        self._device.step(data)

    def open(self) -> None:
        if not self.plugged:
            raise BusClosed("virtual is not plugged in")
        self.is_open = True
        self._back.clear()

    def close(self) -> None:
        self.is_open = False

    def check(self) -> None:
        if not (self.is_open and self.plugged):
            raise BusClosed("virtual is gone")

    def write(self, data: bytes) -> None:
        self.check()
        self._there += data

    def read(self, wait_s: float = 0.0) -> bytes:
        self.check()
        deadline = self._clock.now() + wait_s
        while not self._back and self._clock.now() < deadline:
            self._clock.sleep_until(min(deadline, self._clock.now() + STEP_S))
        data = bytes(self._back)
        self._back.clear()
        return data


class Pty:
    """A device on a pty, for `with`; `lock` holds it still."""

    def __init__(self, device: ScriptedDevice) -> None:
        self.device = device
        self.lock = threading.RLock()
        self._error: Exception | None = None

    def __enter__(self) -> Self:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.device.out = lambda data: os.write(self._master, data)
        self._running = True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()
        if self._error is not None:
            raise self._error

    def unplug(self) -> None:
        self._running = False
        self._thread.join()
        for fd in (self._master, self._slave):
            if fd >= 0:
                os.close(fd)
        self._master = self._slave = -1

    def _serve(self) -> None:
        try:
            while self._running:
                ready, _, _ = select.select([self._master], [], [], STEP_S)
                data = os.read(self._master, 4096) if ready else b""
                with self.lock:
                    self.device.step(data)
        except Exception as error:  # noqa: BLE001  told to the test by __exit__
            self._error = error
