"""Mock bus: simulated servos and latches in this process, with faults that tests inject by method.

The simulation advances on a grid of its own, from the last call to the clock's now, so that what happens
does not depend on how often anybody looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.bus import (
    ActuatorBus,
    BusClosed,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HardwareError,
    HealthReadings,
    HingeReadings,
    LatchReading,
    LatchTripped,
)
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.actuators.rig import Latch, MockSettings
from ori_deploy.clock import Clock
from sim_backends.load import Load
from sim_backends.mock_latches import GRIP_RAD, SimulatedLatch
from sim_backends.mock_servos import STEP_S, ServoLimits, ServoPhysics

FloatArray = NDArray[np.float64]

Start = Literal["stowed", "deployed"]


class MockBus(ActuatorBus):
    """Simulated servos and latches.

    Parameters
    ----------
    clock
        Paces the simulation.
    hinge_ids, position_limits_rad
        As in `ActuatorBus`.
    limits, settings
        What the servos can do.
    latches
        Simulated latches, in the order of `latch_ids`.
    start_rad
        (n_hinges,) shaft positions at the start; torque is off.
    load
        What the servos drive and the latches hold; None for servos that know nothing of each other.
    """

    limits_effort = True

    def __init__(
        self,
        clock: Clock,
        hinge_ids: Sequence[str],
        position_limits_rad: FloatArray,
        limits: ServoLimits,
        settings: MockSettings,
        latches: Sequence[SimulatedLatch],
        start_rad: FloatArray,
        load: Load | None = None,
    ) -> None:
        super().__init__(hinge_ids, [latch.id for latch in latches], position_limits_rad)
        self._clock = clock
        self._settings = settings
        self._load = load
        self._servos = ServoPhysics(limits, settings, start_rad, load)
        self._latches = tuple(latches)
        self._random = np.random.default_rng(settings.seed)
        self._epoch = clock.now()
        self._steps = 0
        n = len(self.hinge_ids)
        self._free_lower, self._free_upper = np.full(n, -np.inf), np.full(n, np.inf)
        self._plugged = True
        self._mute = np.zeros(n, dtype=np.bool_)
        self._drop = np.zeros(n, dtype=np.int64)
        self._corrupt = np.zeros(n, dtype=np.int64)
        self._delays: list[float] = []
        self._latch_drop = 0
        self._latch_silence = 0
        self._health_silence = 0

    @classmethod
    def from_rig(
        cls,
        rig: ResolvedRig,
        clock: Clock,
        stowed_rad: ArrayLike,
        deployed_rad: ArrayLike,
        *,
        start: Start = "stowed",
        start_rad: ArrayLike | None = None,
        load: Load | None = None,
    ) -> MockBus:
        """Simulate what a rig file describes.

        Parameters
        ----------
        rig
            Fitted to the design.
        clock
            Paces the simulation.
        stowed_rad, deployed_rad
            (n_cells, 4) crease angles at the two ends of the motion: where stow locks and latches close.
        start
            At which end the structure is found, its latches engaged there.
        start_rad
            (n_cells, 4) crease angles to start from instead, no latch engaged.
        load
            What the servos drive, standing where they start; by default what `mock.plant` in the rig names.
        """
        stowed, deployed = rig.to_actuator(stowed_rad), rig.to_actuator(deployed_rad)
        latches = [_simulated(latch, rig, deployed) for latch in rig.latches]
        locks = [_simulated(lock, rig, stowed) for lock in rig.stow_locks]
        if start_rad is None:
            for latch in latches if start == "deployed" else locks:
                latch.start_closed()
            position = deployed if start == "deployed" else stowed
        else:
            position = rig.to_actuator(start_rad)
        if load is None and rig.mock.plant is not None:
            from sim_backends.plant import plant_for_rig  # needs MuJoCo

            angles = start_rad if start_rad is not None else deployed_rad if start == "deployed" else stowed_rad
            load = plant_for_rig(rig, angles)
        limits = ServoLimits(
            velocity_rad_s=np.array([a.max_velocity_rad_s for a in rig.actuators]),
            torque_nm=np.array([a.max_torque_nm for a in rig.actuators]),
        )
        return cls(clock, rig.hinge_ids, rig.position_limits_rad, limits, rig.mock, latches + locks, position, load)

    # -- truth, for tests and for judging the controller ---------------------------------------------

    @property
    def true_shaft_rad(self) -> FloatArray:
        """(n_hinges,) where the shafts truly are."""
        self._advance()
        return self._servos.shaft_rad.copy()

    @property
    def true_output_rad(self) -> FloatArray:
        """(n_hinges,) where the creases truly are, as shaft positions: behind the free play."""
        self._advance()
        return self._servos.output_rad.copy()

    @property
    def true_torque_on(self) -> NDArray[np.bool_]:
        """(n_hinges,) which servos hold their goal."""
        self._advance()
        return self._servos.torque_on.copy()

    @property
    def true_torque_nm(self) -> FloatArray:
        """(n_hinges,) what every servo pushes with."""
        self._advance()
        return self._servos.torque_nm.copy()

    @property
    def true_effort(self) -> FloatArray:
        """(n_hinges,) part of its stall torque that every servo may use."""
        return self._servos.effort.copy()

    def truly_closed(self, latch_id: str) -> bool:
        """Whether a latch is truly closed, whatever its sensor says."""
        self._advance()
        return self._latches[self._latch_index(latch_id)].closed(self._servos.output_rad)

    # -- faults --------------------------------------------------------------------------------------

    def drop_replies(self, hinge_id: str, count: int = 1) -> None:
        """Lose the next `count` replies of a servo."""
        self._drop[self._hinge_index(hinge_id)] += count

    def corrupt_replies(self, hinge_id: str, count: int = 1) -> None:
        """Spoil the next `count` replies of a servo."""
        self._corrupt[self._hinge_index(hinge_id)] += count

    def drop_latch_replies(self, count: int = 1) -> None:
        """Lose the next `count` replies of every latch."""
        self._latch_drop += count

    def silence_latches(self, count: int = 1) -> None:
        """Make the next `count` reads of the latches raise `BusTimeout`."""
        self._latch_silence += count

    def silence_health(self, count: int = 1) -> None:
        """Make the next `count` reads of the health raise `BusTimeout`."""
        self._health_silence += count

    def delay_reads(self, count: int, delay_s: float) -> None:
        """Make the next `count` reads of the hinges take `delay_s` longer."""
        self._delays.extend([delay_s] * count)

    def mute(self, hinge_id: str) -> None:
        """Make a servo silent; it goes on doing what it was told."""
        self._mute[self._hinge_index(hinge_id)] = True

    def unmute(self, hinge_id: str) -> None:
        """Let a silent servo speak again."""
        self._mute[self._hinge_index(hinge_id)] = False

    def jam(self, hinge_id: str) -> None:
        """Block a shaft where it stands."""
        self._advance()
        self._servos.jammed[self._hinge_index(hinge_id)] = True

    def free(self, hinge_id: str) -> None:
        """Let a jammed shaft turn again."""
        self._advance()
        self._servos.jammed[self._hinge_index(hinge_id)] = False

    def end_stop(self, hinge_id: str, shaft_rad: float) -> None:
        """Put something in the way of a crease, where its servo would be at `shaft_rad`; it stays on its side of it.

        Not for servos with a load of their own: its obstacles are the load's business.
        """
        if self._load is not None:
            raise ValueError("what servos drive has obstacles of its own, see sim_backends.physics.model.Obstacle")
        self._advance()
        i = self._hinge_index(hinge_id)
        if self._servos.output_rad[i] <= shaft_rad:
            self._free_upper[i] = shaft_rad
        else:
            self._free_lower[i] = shaft_rad

    def clear_stops(self) -> None:
        """Take everything out of the way again."""
        self._advance()
        self._free_lower[:], self._free_upper[:] = -np.inf, np.inf

    def push(self, hinge_id: str, by_rad: float) -> None:
        """Turn a shaft by hand, at once."""
        self._advance()
        i = self._hinge_index(hinge_id)
        self._servos.shaft_rad[i] += by_rad
        self._servos.output_rad[i] += by_rad

    def reboot(self, hinge_id: str) -> None:
        """Restart a servo: torque off, errors and limits gone, position as it was."""
        self._advance()
        i = self._hinge_index(hinge_id)
        self._servos.torque_on[i] = False
        self._servos.hardware_error[i] = 0
        self._servos.effort[i] = 1.0

    def overheat(self, hinge_id: str, temperature_c: float) -> None:
        """Bring a servo to a temperature, from which it cools."""
        self._advance()
        self._servos.temperature_c[self._hinge_index(hinge_id)] = temperature_c

    def overload(self, hinge_id: str) -> None:
        """Make a servo shut itself off as it does under overload."""
        self._advance()
        which = np.arange(len(self.hinge_ids)) == self._hinge_index(hinge_id)
        self._servos.fail(which, HardwareError.OVERLOAD)

    def sag(self, volts: float) -> None:
        """Take `volts` off the supply; 0 restores it."""
        self._advance()
        self._servos.sag_v = volts

    def unplug(self) -> None:
        """Pull the cable: every call raises `BusClosed` until `replug` and `connect`."""
        self._plugged = False

    def replug(self) -> None:
        """Put the cable back."""
        self._plugged = True

    def latch_stuck(self, latch_id: str) -> None:
        """Freeze a latch as it is: a closed one stays closed and holds, an open one stays open."""
        self._advance()
        self._latches[self._latch_index(latch_id)].get_stuck(self._servos.output_rad)

    def latch_blind(self, latch_id: str) -> None:
        """Break a latch's sensor: it can no longer tell."""
        self._latches[self._latch_index(latch_id)].blind = True

    def latch_mend(self, latch_id: str) -> None:
        """Let a stuck or blind latch work again."""
        self._advance()
        latch = self._latches[self._latch_index(latch_id)]
        latch.stuck = latch.blind = False

    # -- the bus -------------------------------------------------------------------------------------

    def _open(self) -> None:
        if not self._plugged:
            raise BusClosed("nothing is plugged in; remedy: plug the bus in, then connect")
        if self._mute.any():
            raise BusTimeout(f"no answer from {self._names(self._mute)}; remedy: check power and wiring")

    def _close(self) -> None:
        self._advance()

    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None) -> None:
        del velocity_rad_s  # these servos know only where to go
        self._require_plug()
        self._advance()
        self._servos.goal_rad = np.array(position_rad, dtype=np.float64)

    def _limit_effort(self, part: float) -> None:
        self._require_plug()
        self._advance()
        self._servos.effort[:] = part

    def _set_torque(self, on: bool) -> None:
        self._require_plug()
        self._advance()
        servos = self._servos
        servos.torque_on = (servos.hardware_error == 0) if on else np.zeros_like(servos.torque_on)

    def _read_hinges(self) -> HingeReadings:
        self._require_plug()
        if self._delays:
            self._clock.sleep_until(self._clock.now() + self._delays.pop())
        self._advance()
        valid = self._replies()
        n, step = len(valid), self._settings.encoder_step_rad
        noisy = self._servos.shaft_rad + self._random.normal(0.0, self._settings.noise_rad, n)
        position = np.round(noisy / step) * step
        nan = np.nan
        return HingeReadings(
            position_rad=np.where(valid, position, nan),
            velocity_rad_s=np.where(valid, self._servos.velocity_rad_s, nan),
            current_a=np.where(valid, self._servos.current_a, nan),
            alert=valid & (self._servos.hardware_error != 0),
            valid=valid,
            time_s=np.where(valid, self._clock.now(), nan),
        )

    def _read_health(self) -> HealthReadings:
        self._require_plug()
        self._advance()
        if self._health_silence > 0:
            self._health_silence -= 1
            raise BusTimeout("no servo answered")
        valid = ~self._mute
        if not valid.any():
            raise BusTimeout("no servo answered")
        nan, servos = np.nan, self._servos
        return HealthReadings(
            temperature_c=np.where(valid, servos.temperature_c, nan),
            voltage_v=np.where(valid, servos.supply_v, nan),
            hardware_error=np.where(valid, servos.hardware_error, 0).astype(np.uint8),
            torque_on=valid & servos.torque_on,
            valid=valid,
            time_s=np.where(valid, self._clock.now(), nan),
        )

    def _replies(self) -> NDArray[np.bool_]:
        """Which servos answer correctly this time; uses up the losses that were ordered."""
        dropped, corrupt = self._drop > 0, self._corrupt > 0
        silent = self._mute | dropped
        self._drop -= dropped
        self._corrupt -= corrupt
        if silent.all():
            raise BusTimeout("no servo answered")
        valid = ~(silent | corrupt)
        if not valid.any():
            raise CorruptReply("no servo's answer could be believed")
        return valid

    def _reset_errors(self) -> None:
        self._require_plug()
        self._advance()
        servos = self._servos
        hot = servos.temperature_c > 70.0
        persistent = hot & (servos.hardware_error & HardwareError.OVERHEATING != 0)
        if persistent.any():
            raise CommandRefused(f"{self._names(persistent)} is still too hot; remedy: let it cool")
        servos.hardware_error[:] = 0

    def _set_latch(self, index: int, engaged: bool) -> None:
        self._require_plug()
        self._advance()
        latch = self._latches[index]
        if engaged and latch.trip is not None:
            raise LatchTripped(latch.id, latch.trip)
        latch.commanded = engaged

    def _read_latches(self) -> tuple[LatchReading, ...]:
        self._require_plug()
        self._advance()
        if self._latch_silence > 0:
            self._latch_silence -= 1
            raise BusTimeout("no latch answered")
        if self._latch_drop > 0:
            self._latch_drop -= 1
            return tuple(
                LatchReading(latch.id, latch.commanded, None, valid=False, time_s=np.nan) for latch in self._latches
            )
        now, output = self._clock.now(), self._servos.output_rad
        return tuple(
            LatchReading(
                latch.id,
                latch.commanded,
                None if latch.blind else latch.closed(output),
                valid=True,
                time_s=now,
                fault=latch.trip,
            )
            for latch in self._latches
        )

    def _advance(self) -> None:
        """Bring the simulation to the last point of its grid that is not after now."""
        target = int((self._clock.now() - self._epoch) / STEP_S + 1e-6)
        while self._steps < target:
            self._steps += 1
            lower, upper = self._bounds()
            if self._load is not None:
                self._load.secure(latch.secures for latch in self._latches if latch.restrains)
            self._servos.step(lower, upper)
            for latch in self._latches:
                latch.step(STEP_S, self._servos.output_rad)

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """(n_hinges,) each: the range that end stops and closed latches leave to the creases."""
        lower, upper = self._free_lower, self._free_upper
        for latch in self._latches:
            if latch.restrains:
                held = np.isfinite(latch.range_rad)
                output = self._servos.output_rad  # what is caught off centre may come closer, not leave
                low, high = latch.closed_rad - GRIP_RAD, latch.closed_rad + GRIP_RAD
                lower = np.where(held, np.maximum(lower, np.minimum(output, low)), lower)
                upper = np.where(held, np.minimum(upper, np.maximum(output, high)), upper)
        return lower, upper

    def _require_plug(self) -> None:
        if not self._plugged:
            self._connected = False
            raise BusClosed("the bus was unplugged; remedy: plug it in, then connect")

    def _hinge_index(self, hinge_id: str) -> int:
        return self.hinge_ids.index(hinge_id)


def _simulated(latch: Latch, rig: ResolvedRig, closed_rad: FloatArray) -> SimulatedLatch:
    reach = rig.latch_reach(latch)
    return SimulatedLatch(
        id=latch.id, model=latch, closed_rad=closed_rad.copy(), range_rad=reach, secures=latch.secures
    )
