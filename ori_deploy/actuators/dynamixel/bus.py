"""The abstract actuator bus on Dynamixel servos."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.bus import (
    ActuatorBus,
    BusClosed,
    BusError,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HardwareError,
    HealthReadings,
    HingeReadings,
    LatchReading,
)
from ori_deploy.actuators.dynamixel.adapter import latency_advice, latency_timer_s
from ori_deploy.actuators.dynamixel.effort import Effort
from ori_deploy.actuators.dynamixel.latches import Latches
from ori_deploy.actuators.dynamixel.line import Replies, Reply, ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.actuators.dynamixel.readings import Decoder, hardware_error
from ori_deploy.actuators.dynamixel.startup import (
    by_block_address,
    clear_trip,
    configure,
    fast_read_known,
    find_servos,
    name_of,
    read,
    restarted,
    unwell,
    write,
)
from ori_deploy.actuators.dynamixel.throughput import (
    HEALTH_BYTES,
    HEALTH_SIZES,
    STATE_BYTES,
    STATE_SIZES,
    check_rate,
    planned_times,
)
from ori_deploy.actuators.dynamixel.turns import unvouched, vouch
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, HingeServo, PinServo, Wiring
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, WATCHDOG_UNIT_S

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)

REARM_EVERY = 50
"""Goals after which the watchdogs are set again: nobody answers a sync write, so one may have missed it."""

MOVED_COUNTS = 12
"""How far a shaft may have turned, one degree, between its reading and its torque."""

GOING_DOWN_S = 0.1
"""For so long a servo that was told to restart may still answer."""

RESTART_PATIENCE_S = 3.0
"""How long a servo may take to come back after a reboot."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _noticing_loss(
    method: Callable[Concatenate[DynamixelBus, _P], _R],
) -> Callable[Concatenate[DynamixelBus, _P], _R]:
    """A call that finds the port gone leaves the bus disconnected."""

    @wraps(method)
    def noticing(self: DynamixelBus, /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return method(self, *args, **kwargs)
        except BusClosed:
            self._connected = False
            self._port.close()
            raise

    return noticing


class DynamixelBus(ActuatorBus):
    """Hinges and lock pins on Dynamixel servos.

    Parameters
    ----------
    wiring
        Which servo is which.
    latches
        Of the rig, fitted to its hinges.
    latch_ids, position_limits_rad
        As in `ActuatorBus`.
    clock
        Real time: stamps the readings.
    rate_hz
        Of the control loop; refused at `connect` when the bus as it is found cannot follow.
    travel_s
        Time that each lock pin takes, by latch.
    port
        Instead of the one in the rig.
    source
        The rig file, for messages.
    """

    limits_effort = True

    def __init__(
        self,
        wiring: Wiring,
        latches: Latches,
        latch_ids: Sequence[str],
        position_limits_rad: FloatArray,
        clock: Clock,
        rate_hz: float,
        travel_s: dict[str, float],
        port: str | None = None,
        source: str | None = None,
    ) -> None:
        super().__init__([servo.name for servo in wiring.hinges], latch_ids, position_limits_rad)
        self._planned, self._latches, self._clock = wiring, latches, clock
        self._wiring = wiring
        self._settings = wiring.settings
        self._rate_hz, self._travel_s, self._source = rate_hz, travel_s, source
        slack = self._settings.usb_latency_s + self._settings.reply_slack_s
        self._port = BlockingPort(port or self._settings.port, self._settings.baud, slack)
        self._line = ServoLine(self._port)
        self.advice: tuple[str, ...] = ()

        servos = wiring.hinges
        self._ids = [servo.id for servo in servos]
        self._state_address = servos[0].model.table.effort.address
        self._health_groups = by_block_address(servos)
        self._decoder = Decoder(servos)
        self._fast = False
        self._reads = 0
        self._unarmed_writes = 0
        self._watching = False
        self._holding = False
        self._goal = np.zeros(len(servos), dtype=np.int64)
        self._effort = Effort(self._line, REARM_EVERY)
        self._recent: HingeReadings | None = None

    @classmethod
    def from_rig(
        cls,
        rig: ResolvedRig,
        clock: Clock,
        stowed_rad: ArrayLike,
        deployed_rad: ArrayLike,
        *,
        port: str | None = None,
    ) -> DynamixelBus:
        """The bus that a rig file describes.

        Parameters
        ----------
        rig
            Fitted to the design, with backend "dynamixel".
        clock
            Real time.
        stowed_rad, deployed_rad
            (n_cells, 4) crease angles at the two ends of the motion: where stow locks and latches close.
        port
            Instead of the one in the rig.
        """
        if rig.wiring is None:
            raise ValueError("the rig has no Dynamixel servos")
        elsewhere = {latch.name for latch in rig.mcu.latches} if rig.mcu is not None else set()
        ends = ((rig.latches, rig.to_actuator(deployed_rad)), (rig.stow_locks, rig.to_actuator(stowed_rad)))
        own = [(latch, closed) for latches, closed in ends for latch in latches if latch.id not in elsewhere]
        shape = (len(own), len(rig.hinges))
        bank = Latches(
            [latch for latch, _ in own],
            rig.wiring.pins,
            np.array([closed for _, closed in own], dtype=np.float64).reshape(shape),
            np.array([rig.latch_reach(latch) for latch, _ in own], dtype=np.float64).reshape(shape),
            rig.wiring.settings.watchdog_s,
        )
        return cls(
            rig.wiring,
            bank,
            [latch.id for latch, _ in own],
            rig.position_limits_rad,
            clock,
            rig.rate_hz,
            {latch.id: latch.travel_s for latch, _ in own if latch.travel_s is not None},
            port,
            rig.source,
        )

    # -- turns ---------------------------------------------------------------------------------------

    @_noticing_loss
    def unvouched(self) -> tuple[str, ...]:
        """Hinges whose position is known only up to whole turns: their servos restarted since `vouch`."""
        self._require_connection()
        return tuple(servo.name for servo in unvouched(self._line, self._wiring.hinges))

    @_noticing_loss
    def vouch(self, shaft_rad: FloatArray, tolerance_rad: FloatArray) -> None:
        """Take somebody's word for where the structure stands; see `ori_deploy.actuators.dynamixel.turns`.

        Parameters
        ----------
        shaft_rad, tolerance_rad
            (n_hinges,) where the shafts are said to stand, and how far off they may be measured.

        Raises
        ------
        CommandRefused
            A shaft does not answer, is measured elsewhere, or is held by torque. Nothing was changed.
        """
        readings = self.read_hinges()
        if not readings.valid.all():
            raise CommandRefused(f"no valid position from {self._names(~readings.valid)}; remedy: check its wiring")
        vouch(self._line, self._wiring.hinges, readings.position_rad, shaft_rad, tolerance_rad)
        self._decoder.forget()

    # -- the bus -------------------------------------------------------------------------------------

    def _open(self) -> None:
        self._port.open()
        try:
            self._start()
        except BaseException:
            self._port.close()
            raise

    def _start(self) -> None:
        pongs = find_servos(self._line, self._planned)
        self._wiring = self._planned.as_found({servo_id: pong.firmware for servo_id, pong in pongs.items()})
        self._health_groups = by_block_address(self._wiring.hinges)
        self._fast = self._settings.fast_sync_read and fast_read_known(list(pongs.values()))
        latency = latency_timer_s(self._port.path)
        times = planned_times(self._wiring, usb_latency_s=latency)
        check_rate(self._wiring, times, self._rate_hz, fast=self._fast, source=self._source)
        for servo in self._wiring.servos:
            self._configure(servo)
        self._latches.find(self._line, self._wiring.pins)
        self.advice = self._look_round()
        for text in self.advice:
            log.warning("%s", text)
        self._watching = False
        self._holding = all(
            read(self._line, servo.id, servo.model.table.torque_enable) for servo in self._wiring.hinges
        )
        self._effort.find(self._wiring.hinges, self._settings.current_limit_a)
        self._decoder.forget()
        self._recent = None

    def _configure(self, servo: HingeServo | PinServo) -> None:
        configure(self._line, servo, self._settings, self._travel_s.get(name_of(servo), 1.0))

    def _look_round(self) -> tuple[str, ...]:
        """What could be better, and what will keep torque off."""
        advice = [latency_advice(self._port.path)]
        for servo in self._wiring.servos:
            errors = hardware_error(read(self._line, servo.id, servo.model.table.hardware_error_status))
            if errors:
                advice.append(
                    f"{name_of(servo)} (id {servo.id}) reports {errors.name}; it takes no torque until cleared"
                )
        return tuple(text for text in advice if text)

    def _close(self) -> None:
        """Servos hold on: with nobody to talk to them, their watchdogs would stop what need not stop."""
        try:
            if self._port.is_open:
                self._disarm()
                self._latches.disarm(self._line)
        except BusError as error:
            log.error("watchdogs stay armed, servos stop where they are: %s", error)
        finally:
            self._port.close()

    @_noticing_loss
    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None) -> None:
        del velocity_rad_s  # a servo has a profile of its own
        self._goal = CENTRE_COUNT + np.rint(position_rad / RAD_PER_COUNT).astype(np.int64)
        self._send_goals()

    def _send_goals(self) -> None:
        self._unarmed_writes += 1
        if self._holding and (not self._watching or self._unarmed_writes >= REARM_EVERY):
            self._set_watchdogs(self._settings.watchdog_s, self._ids)
            self._watching = self._settings.watchdog_s > 0.0
            self._unarmed_writes = 0
        self._effort.remind()
        table = self._wiring.hinges[0].model.table
        data = self._goal.astype("<i4").tobytes()
        self._line.sync_write(
            table.goal_position.address,
            4,
            {servo_id: data[4 * k : 4 * k + 4] for k, servo_id in enumerate(self._ids)},
        )

    @_noticing_loss
    def _limit_effort(self, part: float) -> None:
        self._effort.limit(part)

    @_noticing_loss
    def _set_torque(self, on: bool) -> None:
        if on:
            self._torque_on()
        else:
            self._torque_off()

    def _torque_off(self) -> None:
        """All at once, then each is asked whether it heard."""
        self._holding = self._watching = False
        register = self._wiring.hinges[0].model.table.torque_enable
        self._line.sync_write(register.address, register.size, dict.fromkeys(self._ids, register.encode(0)))
        silent = []
        for servo in self._wiring.hinges:
            try:
                write(self._line, servo.id, register, 0)
                write(self._line, servo.id, servo.model.table.bus_watchdog, 0)
            except (BusTimeout, CorruptReply):
                silent.append(servo.name)
        if silent:
            raise BusTimeout(f"{', '.join(silent)} did not say that torque is off; remedy: switch the supply off")

    def _torque_on(self) -> None:
        """Torque on at the goals that were just set, once every servo is seen to have them."""
        fresh = [servo.name for servo in restarted(self._line, self._wiring.hinges)]
        if fresh:
            raise CommandRefused(
                f"torque stays off: {', '.join(fresh)} restarted since the bus was connected; "
                "remedy: check their supply, then connect again"
            )
        lost = [servo.name for servo in unvouched(self._line, self._wiring.hinges)]
        if lost:
            raise CommandRefused(
                f"torque stays off: {', '.join(lost)} restarted, and may be whole turns from where it says; "
                "remedy: say where the structure stands, for instance --stands stowed"
            )
        for servo in self._wiring.hinges:
            errors = hardware_error(read(self._line, servo.id, servo.model.table.hardware_error_status))
            if errors:
                raise unwell(servo, f"reports {errors.name}, torque stays off")
        self._stop_watching()
        self._send_goals()  # again: a servo whose watchdog had tripped took none
        for servo, goal in zip(self._wiring.hinges, self._goal, strict=True):
            kept = read(self._line, servo.id, servo.model.table.goal_position)
            if kept != goal:
                raise CommandRefused(
                    f"torque stays off: {servo.name} (id {servo.id}) has goal {kept}, not {goal}, where it stands; "
                    "remedy: check that its range and the rig's agree"
                )
        for servo, goal in zip(self._wiring.hinges, self._goal, strict=True):
            self._energise(servo, int(goal))
        self._holding = True

    def _energise(self, servo: HingeServo, goal: int) -> None:
        """Torque on for one that stands at its goal; when anything is not as it should be, off for all."""
        table = servo.model.table
        try:
            away = abs(read(self._line, servo.id, table.present_position) - goal)
            if away > MOVED_COUNTS and not read(self._line, servo.id, table.torque_enable):
                raise CommandRefused(
                    f"{servo.name} turned by {away * RAD_PER_COUNT:.3f} rad while torque went on; all torque is off; "
                    f"limit: {MOVED_COUNTS * RAD_PER_COUNT:.3f} rad; remedy: hold the structure still"
                )
            write(self._line, servo.id, table.torque_enable, 1)
            kept = read(self._line, servo.id, table.goal_position) == goal
            if not read(self._line, servo.id, table.torque_enable) or not kept or restarted(self._line, (servo,)):
                raise unwell(servo, "takes no torque; all torque is off")
        except BusError:
            self._torque_off()
            raise

    @_noticing_loss
    def _read_hinges(self) -> HingeReadings:
        size = STATE_BYTES + self._turn(STATE_SIZES)
        replies = self._line.sync_read(self._state_address, size, self._ids, fast=self._fast)
        now = self._clock.now()
        replies.require_any("hinges")
        self._recent = self._decoder.state(replies, now)
        return self._recent

    @_noticing_loss
    def _read_health(self) -> HealthReadings:
        by_id: dict[int, Reply] = {}
        garbage = False
        size = HEALTH_BYTES + self._turn(HEALTH_SIZES)
        for address, ids in self._health_groups.items():
            replies = self._line.sync_read(address, size, ids, fast=self._fast)
            by_id |= dict(replies.by_id)
            garbage |= replies.garbage
        now = self._clock.now()
        everyone = Replies(by_id, garbage)
        everyone.require_any("health")
        return self._decoder.health(everyone, now, self._settings.watchdog_s)

    @_noticing_loss
    def _reset_errors(self) -> None:
        """Only a restart clears a servo's error; it comes back limp, with its RAM as new.

        Servos that restarted by themselves, or whose watchdog tripped (it clears their profile), get their
        settings back.
        """
        servos = self._wiring.servos
        tripped = [servo for servo in servos if read(self._line, servo.id, servo.model.table.bus_watchdog) < 0]
        self._stop_watching()
        for servo in tripped:
            self._configure(servo)
        failed = list(restarted(self._line, servos))
        rebooted = [servo for servo in servos if self._must_restart(servo)]
        for servo in rebooted:
            try:
                self._line.reboot(servo.id)
            except (BusTimeout, CorruptReply):
                continue  # it may have heard all the same: whether it did shows in its error, below
        failed += [servo for servo in rebooted if servo not in failed]
        for servo in failed:
            self._await(servo)
            self._configure(servo)
            errors = hardware_error(read(self._line, servo.id, servo.model.table.hardware_error_status))
            if errors:
                raise CommandRefused(f"{name_of(servo)} reports {errors.name} again; remedy: remove its cause")
        self._holding = self._holding and not any(servo in failed for servo in self._wiring.hinges)
        self._decoder.forget()

    def _must_restart(self, servo: HingeServo | PinServo) -> bool:
        """Whether it has an error to clear. Raises `CommandRefused` while the cause persists."""
        table = servo.model.table
        errors = hardware_error(read(self._line, servo.id, table.hardware_error_status))
        heat, limit = (read(self._line, servo.id, r) for r in (table.present_temperature, table.temperature_limit))
        if errors & HardwareError.OVERHEATING and heat >= limit:
            raise CommandRefused(
                f"{name_of(servo)} is still too hot: {heat} °C; limit: {limit} °C; remedy: let it cool"
            )
        return bool(errors)

    def _await(self, servo: HingeServo | PinServo) -> None:
        """Wait until a servo that restarts answers again."""
        self._clock.sleep_until(self._clock.now() + GOING_DOWN_S)
        deadline = self._clock.now() + RESTART_PATIENCE_S
        while self._clock.now() < deadline:
            if self._line.ping_all((servo.id,)):
                return
            self._clock.sleep_until(self._clock.now() + 0.02)
        raise BusTimeout(f"{name_of(servo)} did not come back within {RESTART_PATIENCE_S:g} s of its restart")

    @_noticing_loss
    def _set_latch(self, index: int, engaged: bool) -> None:
        self._port.check()
        self._latches.command(self._line, index, engaged)

    @_noticing_loss
    def _read_latches(self) -> tuple[LatchReading, ...]:
        self._port.check()
        hinges = self._fresh_hinges() if self._latches.has_magnets else None
        return self._latches.read(self._line, hinges, self._clock)

    def _fresh_hinges(self) -> HingeReadings:
        """Readings of this cycle: those at hand, or new ones."""
        recent = self._recent
        if recent is not None and self._clock.now() - float(np.nanmax(recent.time_s)) < 0.5 / self._rate_hz:
            return recent
        return self._read_hinges()

    # -- inside --------------------------------------------------------------------------------------

    def _turn(self, sizes: int) -> int:
        """0 to `sizes` - 1, another every time: a late reply to one of the last reads has another size."""
        self._reads += 1
        return self._reads % sizes

    def _stop_watching(self) -> None:
        """Watchdogs off, tripped ones too."""
        self._watching = False
        for servo in self._wiring.hinges:
            clear_trip(self._line, servo)

    def _disarm(self) -> None:
        """Watchdogs off, but for tripped ones: those servos stand, and might go on if they were let."""
        self._watching = False
        register = self._wiring.hinges[0].model.table.bus_watchdog
        replies = self._line.sync_read(register.address, register.size, self._ids)
        self._set_watchdogs(0.0, [i for i, reply in replies.by_id.items() if register.decode(reply.data) > 0])

    def _set_watchdogs(self, period_s: float, ids: Sequence[int]) -> None:
        """Several watchdogs at once; that they took it shows in the health."""
        register = self._wiring.hinges[0].model.table.bus_watchdog
        value = register.encode(round(period_s / WATCHDOG_UNIT_S))
        if ids:
            self._line.sync_write(register.address, register.size, dict.fromkeys(ids, value))
