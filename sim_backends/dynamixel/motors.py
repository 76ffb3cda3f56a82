"""The motors of all servos on a bus, advanced together on a fixed grid.

A profile generator makes a trajectory from the goal; the shaft follows it with a first-order response, as
fast as voltage and load let it; a blocked shaft pushes as hard as its limit allows. Current comes from
torque, heat from current, and the supply sags under the sum of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.wire.dynamixel import model_named
from sim_backends.dynamixel.spec import BusSpec, PinSpec
from sim_backends.load import shaft_rates
from sim_backends.mock_latches import GRIP_RAD, PIN_ENTRY

FloatArray = NDArray[np.float64]

STEP_S = 0.002
IDLE_A = 0.05
FRICTION = 0.02
"""Viscous friction at the no-load speed, as a part of the stall torque."""

STALL_ERROR_RAD = 0.1
"""Error at which a blocked servo pushes with all it has."""

OVERLOAD_AFTER_S = 1.0
HEAT_C_PER_A2_S = 0.15
COOLING_S = 120.0
MOVING_RAD_S = 0.02


class Motors:
    """State of n motors; arrays have shape (n,), shaft positions in rad, any number of turns.

    Attributes
    ----------
    goal_rad, torque_on, limit_nm, duty, profile_rad_s, profile_rad_s2
        What the servo's registers say; `duty` is the part of the supply that the motor may have, profiles are inf
        for none.
    frozen
        Stopped by a watchdog: holds where it is.
    shaft_rad, output_rad, velocity_rad_s
        Shaft, and crease behind the free play.
    torque_nm, current_a, temperature_c
        What it takes.
    strained_s
        How long it has pushed with all it has.
    jammed
        Blocked where it stands.
    moved_s
        When it last moved, on the bus's clock.
    now
        Time of the last step.
    """

    def __init__(self, spec: BusSpec) -> None:
        servos = spec.servos
        models = [model_named(servo.model) for servo in servos]
        n = len(servos)
        self.stall_nm = np.array([model.stall_torque_nm for model in models])
        self._stall_a = np.array([model.stall_current_a for model in models])
        self._no_load = np.array([model.no_load_rad_s for model in models])
        self._nominal_v = np.array([model.nominal_v for model in models])
        self._load_nm = np.array([servo.load_nm for servo in servos])
        self._gain = np.array([(1.0 - np.exp(-STEP_S / servo.time_constant_s)) / STEP_S for servo in servos])
        self._play = 0.5 * np.array([servo.backlash_rad for servo in servos])
        self._supply_v = self._nominal_v if spec.supply_v is None else np.full(n, spec.supply_v)
        self._supply_ohm, self._ambient_c = spec.supply_ohm, spec.ambient_c
        self._stop_low = np.array([-np.inf if s.lower_stop_rad is None else s.lower_stop_rad for s in servos])
        self._stop_high = np.array([np.inf if s.upper_stop_rad is None else s.upper_stop_rad for s in servos])
        self._pins = [_Pin(pin, [servo.id for servo in servos]) for pin in spec.pins]

        self.shaft_rad = np.array([servo.start_rad for servo in servos])
        self.output_rad = self.shaft_rad.copy()
        self.velocity_rad_s = np.zeros(n)
        self.goal_rad = self.shaft_rad.copy()
        self.torque_on = np.zeros(n, dtype=np.bool_)
        self.frozen = np.zeros(n, dtype=np.bool_)
        self.jammed = np.zeros(n, dtype=np.bool_)
        self.limit_nm = self.stall_nm.copy()
        self.duty = np.ones(n)
        self.profile_rad_s = np.full(n, np.inf)
        self.profile_rad_s2 = np.full(n, np.inf)
        self.torque_nm = np.zeros(n)
        self.current_a = np.full(n, IDLE_A)
        self.temperature_c = np.full(n, spec.ambient_c)
        self.strained_s = np.zeros(n)
        self.sag_v = 0.0
        self.now = 0.0
        self._noise_counts = [servo.noise_counts for servo in servos]
        self._random = np.random.default_rng(spec.seed)
        self.moved_s = np.full(n, -np.inf)
        self._way_rad = self.shaft_rad.copy()  # of the profile generator
        self._way_rad_s = np.zeros(n)
        self.plant = None if spec.plant is None else spec.plant.make()
        self._driving = slice(0, 0 if spec.plant is None else len(spec.plant.names))
        self._pull_nm = np.zeros(self._driving.stop)  # of the plant, with its sign

    @property
    def supply_v(self) -> FloatArray:
        """Voltage at every servo."""
        volts: FloatArray = np.maximum(0.0, self._supply_v - self.sag_v - self._supply_ohm * self.current_a.sum())
        return volts

    def trajectory(self, k: int) -> tuple[float, float]:
        """Where a profile generator is, and how fast."""
        return float(self._way_rad[k]), float(self._way_rad_s[k])

    def noise(self, k: int) -> float:
        """What an encoder adds to the next reading, in counts."""
        spread = self._noise_counts[k]
        return float(self._random.normal(0.0, spread)) if spread else 0.0

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which shafts turn."""
        return np.abs(self.velocity_rad_s) > MOVING_RAD_S

    def hold(self, k: int) -> None:
        """Begin anew from where a shaft stands: torque went on, or a watchdog stopped it."""
        self._way_rad[k] = self.shaft_rad[k]
        self._way_rad_s[k] = 0.0

    def push(self, k: int, by_rad: float) -> None:
        """Turn a shaft by hand, at once."""
        self.shaft_rad[k] += by_rad
        self.output_rad[k] += by_rad
        self.hold(k)

    def step(self, now: float) -> None:
        """Advance by `STEP_S`, to `now`."""
        self.now = now
        self._profile()
        spare = np.clip(self.duty - self._load_nm / self.stall_nm, 0.0, 1.0)
        speed = self._no_load * spare * (self.supply_v / self._nominal_v)
        error = self._way_rad - self.shaft_rad
        strong = self.limit_nm > self._load_nm  # a limit below the load leaves nothing to move with
        wish = np.clip(self._gain * error, -speed, speed) * (self.torque_on & strong)
        if self.plant is not None:
            strong[self._driving] = True
            wish[self._driving] = self._rates(error)
        wanted = self.shaft_rad + STEP_S * wish
        lower, upper = self._bounds()
        # What stands outside (a crease that was pushed there) may come back, and no farther out.
        reached = np.clip(
            wanted, np.minimum(lower - self._play, self.shaft_rad), np.maximum(upper + self._play, self.shaft_rad)
        )
        reached[self.jammed] = self.shaft_rad[self.jammed]
        blocked = (np.abs(wanted - reached) > 1e-9) | (self.torque_on & ~strong & (np.abs(error) > 1e-3))
        self.velocity_rad_s = (reached - self.shaft_rad) / STEP_S
        self.shaft_rad = reached
        self.output_rad = np.clip(self.output_rad, reached - self._play, reached + self._play)
        if self.plant is not None:
            reaction = self.plant.step(reached[self._driving], STEP_S)
            self._pull_nm, self.output_rad[self._driving] = reaction.torque_nm, reaction.output_rad
            self._load_nm[self._driving] = np.abs(self._pull_nm)
        self.moved_s[self.moving] = now
        self._electrics(error, blocked)

    def _rates(self, error: FloatArray) -> FloatArray:
        """Speeds of the servos that drive the plant."""
        some = self._driving
        fastest = self._no_load[some] * (self.supply_v[some] / self._nominal_v[some])
        most = self.limit_nm[some] * self.torque_on[some]
        wish = np.clip(self._gain[some] * error[some], -fastest, fastest) * self.torque_on[some]
        return shaft_rates(wish, self._pull_nm, fastest, self.stall_nm[some], most)

    def _profile(self) -> None:
        """Trajectory of every servo: trapezoids within its profile velocity and acceleration."""
        goal = np.where(self.frozen | ~self.torque_on, self._way_rad, self.goal_rad)
        left = goal - self._way_rad
        instant = np.isinf(self.profile_rad_s)
        change = self.profile_rad_s2 * STEP_S
        away = np.abs(left) / STEP_S
        with np.errstate(invalid="ignore"):  # the fastest from which whole steps of braking end exactly there
            steps = np.maximum(1.0, np.ceil(0.5 * (np.sqrt(1.0 + 8.0 * away / change) - 1.0)))
            braking = away / steps + 0.5 * (steps - 1.0) * change
        top = np.minimum(self.profile_rad_s, np.where(np.isinf(change), np.inf, braking))
        with np.errstate(invalid="ignore"):
            target = np.where(instant, 0.0, np.sign(left) * np.where(np.isinf(top), 0.0, top))
            rate = self._way_rad_s + np.clip(target - self._way_rad_s, -change, change)
        step = rate * STEP_S
        there = instant | (np.abs(step) >= np.abs(left)) & (step * left >= 0.0) & (np.abs(rate) <= 1.01 * change)
        self._way_rad = np.where(there, goal, self._way_rad + step)
        self._way_rad_s = np.where(instant, 0.0, np.where(there, left / STEP_S, rate))  # at rest a step later
        limp = ~self.torque_on
        self._way_rad[limp] = self.shaft_rad[limp]
        self._way_rad_s[limp] = 0.0

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Range that stops and pins leave to every shaft."""
        if not self._pins:
            return self._stop_low, self._stop_high
        lower, upper = self._stop_low.copy(), self._stop_high.copy()
        for pin in self._pins:
            pin.restrain(self.output_rad, lower, upper)
        if self.plant is not None:  # it holds what a pin holds, and the shafts may wind up against it
            self.plant.secure(pin.secures for pin in self._pins if pin.is_in(self.output_rad))
            some = self._driving
            lower[some], upper[some] = self._stop_low[some], self._stop_high[some]
        return lower, upper

    def _electrics(self, error: FloatArray, blocked: NDArray[np.bool_]) -> None:
        push = np.minimum(np.abs(error) / STALL_ERROR_RAD, 1.0) * self.stall_nm
        running = self._load_nm + FRICTION * self.stall_nm * np.abs(self.velocity_rad_s) / self._no_load
        self.torque_nm = np.minimum(np.where(blocked, push, running), self.limit_nm) * self.torque_on
        self.current_a = IDLE_A + (self._stall_a - IDLE_A) * self.torque_nm / self.stall_nm
        cooling = (self.temperature_c - self._ambient_c) / COOLING_S
        self.temperature_c += STEP_S * (HEAT_C_PER_A2_S * self.current_a**2 - cooling)
        straining = self.torque_nm >= 0.95 * self.stall_nm
        self.strained_s = np.where(straining, self.strained_s + STEP_S, 0.0)


class _Pin:
    """A lock pin between its servo and the hinges that it locks."""

    def __init__(self, spec: PinSpec, ids: Sequence[int]) -> None:
        self._servo = ids.index(spec.servo_id)
        self._released, self._engaged = spec.released_rad, spec.engaged_rad
        self._hinges = np.array([ids.index(hinge) for hinge in spec.hinge_ids], dtype=np.intp)
        self._closed, self._range = np.array(spec.closed_rad), np.array(spec.range_rad)
        self.secures = spec.secures

    def is_in(self, output: FloatArray) -> bool:
        """Whether it is through its hole."""
        travel = (output[self._servo] - self._released) / (self._engaged - self._released)
        return bool(travel > PIN_ENTRY + 1e-9)

    def restrain(self, output: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        """Narrow the bounds: a pin outside its hole stops there, hinges with the pin in stay."""
        there = output[self._hinges]
        if self.is_in(output):
            closed, grip = self._closed, GRIP_RAD
            lower[self._hinges] = np.maximum(lower[self._hinges], np.minimum(there, closed - grip))
            upper[self._hinges] = np.minimum(upper[self._hinges], np.maximum(there, closed + grip))
        elif not (np.abs(there - self._closed) <= self._range).all():
            edge = self._released + PIN_ENTRY * (self._engaged - self._released)
            if self._engaged > self._released:
                upper[self._servo] = min(upper[self._servo], edge)
            else:
                lower[self._servo] = max(lower[self._servo], edge)
