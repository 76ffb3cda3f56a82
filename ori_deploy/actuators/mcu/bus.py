"""The abstract actuator bus on a microcontroller."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import (
    ActuatorBus,
    ActuatorFault,
    ActuatorRestarted,
    BusClosed,
    BusError,
    BusTimeout,
    CommandRefused,
    HealthReadings,
    HingeReadings,
    LatchReading,
    LatchTripped,
)
from ori_deploy.actuators.mcu.faults import WHOLE, Naming, fault_error, fault_name, refusal, state_name
from ori_deploy.actuators.mcu.grid import Grid
from ori_deploy.actuators.mcu.latches import latch_readings, tripped_words
from ori_deploy.actuators.mcu.line import McuLine, Notice, Reports
from ori_deploy.actuators.mcu.port import SerialPort
from ori_deploy.actuators.mcu.readings import Decoder, stalls_only
from ori_deploy.actuators.mcu.records import config_hash, device_record, device_velocity, records
from ori_deploy.actuators.mcu.settings import FRAME_S
from ori_deploy.actuators.mcu.startup import check_config, check_feedback, check_firmware, find_device
from ori_deploy.actuators.mcu.stream import Stream
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import HINGES, Brake, Disable, Enable, FaultClear, LatchCommand, LatchState, State, dialect

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)

SYNC_EXCHANGES = 20
"""Questions for the device's clock when the bus is connected."""

CATCH_UP_EXCHANGES = 4
"""Questions for it after a long pause."""

REST_PATIENCE_S = 0.5
"""How much longer than planned a motion may take to end."""

FAULTS_IN_A_ROW = 4
"""Faults that are cleared at once: behind one that is cleared another may be found."""

STEPPED_BACK_S = 0.05
"""A device's clock that shows so much less than before was started anew."""

_IN_MOTION = (dialect.ORI_STREAMING, dialect.ORI_BRAKING)

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _noticing_loss(method: Callable[Concatenate[McuBus, _P], _R]) -> Callable[Concatenate[McuBus, _P], _R]:
    """A call that finds the port gone leaves the bus disconnected."""

    @wraps(method)
    def noticing(self: McuBus, /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return method(self, *args, **kwargs)
        except BusClosed:
            self._connected = False
            self._port.close()
            raise

    return noticing


class McuBus(ActuatorBus):
    """Hinges and latches on a microcontroller.

    Goals are queued in the device, `delay_s` ahead, and follow each other on an even grid. One goal is
    expected per cycle of the loop. While torque is off, or a fault is latched, goals are remembered and not
    sent; a fault is told by `read_health`, and by the alerts of `read_hinges`, until `reset_errors`.

    Parameters
    ----------
    wiring
        What is wired to which pin.
    clock
        Real time: stamps the readings.
    rate_hz
        Of the control loop.
    port
        Instead of the one in the rig.
    source
        The rig file, for messages.
    """

    def __init__(
        self, wiring: McuWiring, clock: Clock, rate_hz: float, port: str | None = None, source: str | None = None
    ) -> None:
        limits = np.array([(hinge.min_rad, hinge.max_rad) for hinge in wiring.hinges], dtype=np.float64)
        super().__init__(
            [hinge.name for hinge in wiring.hinges],
            [latch.name for latch in wiring.latches],
            limits.reshape(len(wiring.hinges), 2),
        )
        settings = wiring.settings
        self._wiring, self._clock, self._source = wiring, clock, source
        self._settings = settings
        config = records(wiring)
        self._hash = config_hash(config)
        self._port = SerialPort(port or settings.port, settings.baud)
        where = f"--rig {source}" if source and not port else f"--port {port or settings.port}"
        self._naming = Naming(
            self.hinge_ids, self.latch_ids, f"ori-deploy mcu clear-fault {where}", device_record(config)
        )
        self._line = McuLine(self._port, clock, settings.reply_timeout_s)
        self._decoder = Decoder(wiring)
        self._grid = Grid(wiring.hinges, 1.0 / rate_hz, settings.lead_s, settings.min_lead_s)
        self._fastest = np.array([device_velocity(hinge.max_velocity_rad_s) for hinge in wiring.hinges])
        self._all = (1 << len(wiring.hinges)) - 1
        self._stream: Stream | None = None
        self._goal = np.full(len(wiring.hinges), np.nan)
        self._goal_velocity = np.zeros(len(wiring.hinges))
        self._pending = False
        self._boot = 0
        self._restarted = False
        self._braked = False  # by ourselves: that fault is no news
        self._shown_us = 0

    @property
    def delay_s(self) -> float:
        """How long after `command_hinges` a goal is due."""
        return self._settings.lead_s if self._wiring.hinges else 0.0

    def due_s(self, now: float) -> float:
        """When the goal that was commanded last is due: on the grid, whenever its command came."""
        base, last_s = self._line.timebase, self._grid.last.time_s
        if self._stream is None or not np.isfinite(last_s) or not base.good_at(now):
            return now + self.delay_s
        return base.host_s(last_s, now)

    @property
    def brake_s(self) -> float:
        """How long `brake` takes from full speed to rest, once it begins."""
        return self._settings.brake_s if self._wiring.hinges else 0.0

    @property
    def events(self) -> deque[Notice]:
        """The last things that the device said by itself."""
        return self._line.events

    # -- hinges without feedback ---------------------------------------------------------------------

    @_noticing_loss
    def unvouched(self) -> tuple[str, ...]:
        """Hinges that are driven blind, are off, and of which nobody said where they stand."""
        self._require_connection()
        state = self._ask_state()
        off = ~np.array([bool(state.outputs_on >> k & 1) for k in range(len(self.hinge_ids))], dtype=np.bool_)
        lost = self._decoder.blind & off & np.isnan(self._decoder.vouched_rad)
        return tuple(self.hinge_ids[k] for k in np.flatnonzero(lost))

    @_noticing_loss
    def vouch(self, shaft_rad: FloatArray, tolerance_rad: FloatArray) -> None:
        """Take somebody's word for where the structure stands, as far as measured hinges bear it out.

        Parameters
        ----------
        shaft_rad, tolerance_rad
            (n_hinges,) where the shafts are said to stand, and how far off they may be measured.

        Raises
        ------
        CommandRefused
            A shaft is measured elsewhere, or does not say where it is. Nothing was changed.
        """
        self._decoder.require_borne_out(self.read_hinges(), self.hinge_ids, shaft_rad, tolerance_rad)
        self._decoder.vouched_rad = np.where(self._decoder.blind, shaft_rad, np.nan)

    # -- connection ----------------------------------------------------------------------------------

    def _open(self) -> None:
        self._port.open()
        try:
            self._start()
        except BaseException:
            self._port.close()
            raise

    def _start(self) -> None:
        self._line.begin()
        info = find_device(self._line, self._clock, self._settings.boot_wait_s)
        check_firmware(info, self._port.path)
        check_config(info, self._hash, self._port.path)
        # An answer whatever the token was that another program used last, and nothing is turned off by it.
        self._line.command(lambda token: Disable(token, 0), "greeting")
        state = check_feedback(self._line, self._wiring, self._clock)
        self._line.synchronise(SYNC_EXCHANGES)
        self._boot, self._shown_us = info.boot, state.time_us
        self._restarted = self._braked = False
        self._decoder.forget()
        self._decoder.vouched_rad[:] = np.nan
        self._take_over(state)  # a fault that is latched is told when torque is to go on

    def _take_over(self, state: State) -> None:
        """Hinges that another program left on go on holding, and take goals where it ended."""
        self._stream, self._pending = None, False
        if self._all and state.outputs_on == self._all and state.state == dialect.ORI_HOLDING:
            self._goal = 1e-6 * np.array(state.output_urad[: len(self.hinge_ids)], dtype=np.float64)
            self._stream = Stream(state.stream, state.contiguous)
            self._grid.stand(self._goal)

    def _close(self) -> None:
        """Hinges hold on. What is queued is waited for: silence would stop it on the way, and latch a fault."""
        try:
            if self._port.is_open:
                self._stop()
                self._await_rest()
        except BusError as error:
            log.error("the microcontroller is left alone while hinges may move; it stops them: %s", error)
        finally:
            self._stream = None
            self._port.close()

    # -- goals ---------------------------------------------------------------------------------------

    @_noticing_loss
    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None = None) -> None:
        velocity = np.zeros_like(position_rad) if velocity_rad_s is None else np.array(velocity_rad_s)
        self._check_speed(velocity)
        self._goal, self._goal_velocity = np.array(position_rad, dtype=np.float64), velocity
        self._port.check()
        if self._stream is not None:
            self._pending = True
            self._queue_goal()

    def _queue_goal(self) -> None:
        """Send the goal that was commanded last, if there is one and the queue has room."""
        stream = self._stream
        if stream is None or not self._pending:
            return
        device_now, rate = self._device_now(), self._line.timebase.rate
        if stream.oldest_due_s < device_now:
            self._stream = None
            raise BusTimeout(
                f"the microcontroller has not taken goals for {self._settings.lead_s:g} s; "
                f"remedy: check the cable, and {self._naming.clear} if a fault is latched"
            )
        if not self._grid.has_room(device_now, rate, self._goal_velocity):
            if self._goal_velocity.any():
                raise CommandRefused(
                    f"{self._grid.last.time_s - device_now:.2f} s of goals are queued; limit: {self.delay_s:g} s and "
                    "a few cycles; remedy: command one goal in every cycle, as rate_hz says"
                )
            return  # a later one takes its place, or the next reading sends it
        knots = self._grid.next(device_now, rate, self._goal, self._goal_velocity)
        self._pending = False
        for message in stream.append(knots):
            self._line.send(message)

    def _device_now(self) -> float:
        base = self._line.timebase
        if not base.good_at(self._clock.now()):  # nobody has asked anything for long
            self._line.synchronise(CATCH_UP_EXCHANGES)
        return base.device_s(self._clock.now())

    def _check_speed(self, velocity: FloatArray) -> None:
        fast = np.abs(velocity) > self._fastest
        if fast.any():
            k = int(np.argmax(fast))
            raise CommandRefused(
                f"velocity of {self.hinge_ids[k]} is {velocity[k]:.4g} rad/s; limit: {self._fastest[k]:.4g} rad/s; "
                "nothing was sent"
            )

    # -- torque --------------------------------------------------------------------------------------

    @_noticing_loss
    def _set_torque(self, on: bool) -> None:
        if not self._wiring.hinges:
            return
        if on:
            self._torque_on()
        else:
            self._torque_off()

    def _torque_on(self) -> None:
        goal = self._goal
        self._pending = False
        self._await_rest()
        state = self._ask_state(with_info=True)
        wrong = self._restart_error() or fault_error(state, self._naming) or self._decoder.thermistor_error(state)
        if wrong is not None:
            raise CommandRefused(f"torque stays off: {wrong}")
        name = (state.stream + 1) % 256
        urad = [int(p) for p in np.rint(1e6 * goal)] + [0] * (HINGES - len(goal))
        ack = self._line.command(lambda token: Enable(urad, token, self._all, name), "torque on")
        if ack.result != dialect.ORI_ACCEPTED:
            raise refusal(ack, "torque stays off", self._naming.hinge(ack.index), self._naming)
        state = self._ask_state()
        if state.outputs_on != self._all or state.stream != name:
            self._torque_off()
            missing = next((k for k in range(len(goal)) if not state.outputs_on >> k & 1), 0)
            raise ActuatorFault(
                self.hinge_ids[missing], f"takes no torque; all torque is off; remedy: {self._naming.clear}"
            )
        self._stream, self._braked = Stream(name), False
        # Hinges that were on ask for what they asked for: the motion begins there, wherever they are measured.
        self._grid.stand(1e-6 * np.array(state.output_urad[: len(goal)], dtype=np.float64))
        self._decoder.vouched_rad[:] = np.nan

    def _torque_off(self) -> None:
        self._stop()
        self._pending = False
        self._await_rest()
        self._stream = None
        ack = self._line.command(lambda token: Disable(token, self._all), "torque off")
        if ack.result != dialect.ORI_ACCEPTED:
            raise refusal(ack, "torque stays on", self._naming.hinge(ack.index), self._naming)
        self._decoder.vouched_rad[:] = np.nan
        if self._ask_state().outputs_on & self._all:
            raise ActuatorFault(WHOLE, "does not turn its outputs off; remedy: switch the servos' supply off")

    @_noticing_loss
    def _brake(self) -> float:
        """Time until the device rests: two frames, and `brake_s`. One that rests or brakes already is left so."""
        self._stream, self._pending = None, False
        if not self._wiring.hinges:
            return 0.0
        self._line.command(Brake, "braking")
        self._braked = True
        return self._settings.brake_s + 2.0 * FRAME_S

    def _stop(self) -> None:
        """Brake a motion that nobody will lead to its end; one that ends by itself is let go on."""
        if self._stream is not None and not self._grid.last.at_rest:
            self._brake()

    def _await_rest(self) -> None:
        """Wait until nothing is queued any more, or the device has braked; polls are the sign of life meanwhile."""
        while self._pending and not self._goal_velocity.any() and self._stream is not None:
            self._queue_goal()
            self._breathe()
        end = self._clock.now()
        if self._stream is not None:
            end += max(0.0, self._grid.last.time_s - self._device_now()) + FRAME_S
        deadline = end + REST_PATIENCE_S
        while True:
            state = self._ask_state()
            now = self._clock.now()
            if state.state not in _IN_MOTION and (now >= end or self._stream is None):
                return
            if now > deadline:
                raise CommandRefused(
                    f"the microcontroller is still {state_name(state.state)}; remedy: wait until nothing moves"
                )
            self._breathe()

    def _breathe(self) -> None:
        self._clock.sleep_until(self._clock.now() + FRAME_S)

    # -- readings ------------------------------------------------------------------------------------

    @_noticing_loss
    def _read_hinges(self) -> HingeReadings:
        reports = self._line.poll(dialect.ORI_POLL_STATE)
        state = self._notice(reports)
        if self._pending and not self._goal_velocity.any():
            self._queue_goal()  # one that moves is followed by the next, in a moment
        alarm = self._restarted or self._fault_error(state) is not None
        return self._decoder.hinges(state, self._time_of(state, reports), alarm=alarm)

    @_noticing_loss
    def _read_health(self) -> HealthReadings:
        reports = self._line.poll(dialect.ORI_POLL_STATE | dialect.ORI_POLL_INFO)
        state = self._notice(reports)
        wrong = self._fault_error(state) or self._restart_error()
        if wrong is not None:
            raise wrong
        return self._decoder.health(state, self._time_of(state, reports))

    def _ask_state(self, *, with_info: bool = False) -> State:
        what = dialect.ORI_POLL_STATE | (dialect.ORI_POLL_INFO if with_info else 0)
        return self._notice(self._line.poll_patiently(what))

    def _notice(self, reports: Reports) -> State:
        """Draw the consequences of a state: what was lost goes out again, a fault ends the stream."""
        state = reports.state
        assert state is not None
        if state.time_us < self._shown_us - 1e6 * STEPPED_BACK_S or (
            reports.info and reports.info.boot != self._boot
        ):
            self._restarted = True
            self._line.timebase.forget()
        self._shown_us = state.time_us
        if self._restarted or state.fault or state.outputs_on != self._all:
            self._stream, self._pending = None, False
        stream = self._stream
        if stream is not None and state.stream == stream.name:
            stream.acknowledge(state.contiguous)
            for message in stream.again():
                self._line.send(message)
        return state

    def _time_of(self, report: State | LatchState, reports: Reports) -> float:
        """Host time of a report: by the device's clock, and between question and answer in any case."""
        base = self._line.timebase
        if not base.good_at(reports.received_s):
            return reports.sent_s
        time_s = base.host_s(1e-6 * report.time_us, reports.received_s)
        return min(max(time_s, reports.sent_s), reports.received_s)

    def _fault_error(self, state: State) -> ActuatorFault | None:
        """The latched fault, unless it is told by the hinges that stalled, or is what we asked for."""
        asked_for = self._braked and state.fault == dialect.ORI_FAULT_HOST_BRAKE
        return None if asked_for or stalls_only(state) else fault_error(state, self._naming)

    def _restart_error(self) -> ActuatorRestarted | None:
        if not self._restarted:
            return None
        return ActuatorRestarted(
            WHOLE,
            "restarted, and every hinge and latch is off; remedy: hold the structure, check the board's supply and "
            "USB cable, then give the command again",
        )

    # -- errors --------------------------------------------------------------------------------------

    @_noticing_loss
    def _reset_errors(self) -> None:
        """Clear what is latched, once the hinges are at rest; a device that restarted is accepted as it is."""
        state = self._ask_state(with_info=True)
        if state.state == dialect.ORI_BRAKING:
            self._await_rest()
        for _ in range(FAULTS_IN_A_ROW):
            state = self._ask_state()
            if state.fault == dialect.ORI_FAULT_NONE:
                break
            self._clear(state.fault)
        else:
            raise CommandRefused(f"the fault {fault_name(state.fault)} comes back; remedy: remove its cause")
        if self._restarted:
            info = self._line.poll_patiently(dialect.ORI_POLL_INFO).info
            assert info is not None
            check_config(info, self._hash, self._port.path)
            self._line.timebase.forget()
            self._line.synchronise(SYNC_EXCHANGES)
            self._boot, self._restarted = info.boot, False
            self._decoder.vouched_rad[:] = np.nan
        self._braked = False
        self._decoder.forget()

    def _clear(self, fault: int) -> None:
        ack = self._line.command(lambda token: FaultClear(token, fault), f"clearing the fault {fault_name(fault)}")
        if ack.result not in (dialect.ORI_ACCEPTED, dialect.ORI_REFUSED_FAULT):  # another fault came in between
            raise refusal(ack, f"the fault {fault_name(fault)} stays", WHOLE, self._naming)

    # -- latches -------------------------------------------------------------------------------------

    @_noticing_loss
    def _set_latch(self, index: int, engaged: bool) -> None:
        name = self.latch_ids[index]
        what = f"{name} is not {'engaged' if engaged else 'released'}"
        ack = self._line.command(lambda token: LatchCommand(token, index, int(engaged)), what)
        if ack.result == dialect.ORI_REFUSED_TRIPPED:
            report = self._line.poll_patiently(dialect.ORI_POLL_LATCHES).latches
            assert report is not None
            raise LatchTripped(name, tripped_words(report, index))
        if ack.result != dialect.ORI_ACCEPTED:
            raise refusal(ack, what, name, self._naming)

    @_noticing_loss
    def _read_latches(self) -> tuple[LatchReading, ...]:
        if not self.latch_ids:
            self._port.check()
            return ()
        reports = self._line.poll(dialect.ORI_POLL_LATCHES)
        report = reports.latches
        assert report is not None
        return latch_readings(report, self.latch_ids, self._time_of(report, reports))
