"""The simulated servos' physics, all servos at once, advanced in steps of a fixed grid.

Simple and honest: first-order position response; speed that falls with load and supply voltage; friction
that holds a servo whose torque is off; free play between shaft and crease; current from torque; heat from
current; a supply with inner resistance. A servo that is blocked draws its stall current and shuts itself
off after a while, as real ones do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import HardwareError
from ori_deploy.actuators.rig import MockSettings
from sim_backends.load import Load, shaft_rates

FloatArray = NDArray[np.float64]

STEP_S = 0.002
"""Grid of the integration: a fifteenth of the default time constant."""

IDLE_A = 0.05
AMP_PER_NM = 0.56  # XM430-W350: 2.3 A at 4.1 N m
FRICTION_NM_S = 0.02
STALL_ERROR_RAD = 0.1  # goal error at which a blocked servo pushes with all it has
OVERLOAD_AFTER_S = 1.0
OVERHEAT_C = 80.0
HEAT_C_PER_A2_S = 0.3
COOLING_S = 120.0


@dataclass(frozen=True, eq=False)
class ServoLimits:
    """Per servo, (n,): speed without load at nominal voltage, and stall torque."""

    velocity_rad_s: FloatArray
    torque_nm: FloatArray


class ServoPhysics:
    """State of n servos.

    Parameters
    ----------
    limits, settings
        What they can do.
    start_rad
        (n,) shaft positions; the creases start in the middle of their free play.
    load
        What the shafts drive, instead of `settings.load_nm` and `settings.backlash_rad`.
    """

    def __init__(
        self, limits: ServoLimits, settings: MockSettings, start_rad: FloatArray, load: Load | None = None
    ) -> None:
        n = len(start_rad)
        self._limits = limits
        self._settings = settings
        self._gain = (1.0 - np.exp(-STEP_S / settings.time_constant_s)) / STEP_S
        self.shaft_rad = np.array(start_rad, dtype=np.float64)
        self.output_rad = self.shaft_rad.copy()
        self.goal_rad = self.shaft_rad.copy()
        self.velocity_rad_s = np.zeros(n)
        self.torque_on = np.zeros(n, dtype=np.bool_)
        self.jammed = np.zeros(n, dtype=np.bool_)
        self.temperature_c = np.full(n, settings.ambient_c)
        self.effort = np.ones(n)  # part of the stall torque that each may use
        self.torque_nm = np.zeros(n)
        self.current_a = np.full(n, IDLE_A)
        self.hardware_error = np.zeros(n, dtype=np.uint8)
        self.sag_v = 0.0
        self._overload_s = np.zeros(n)
        self._load = load
        self._load_nm = np.zeros(n)

    @property
    def supply_v(self) -> float:
        """Voltage at the servos."""
        drop = self._settings.supply_ohm * float(self.current_a.sum())
        return max(0.0, self._settings.supply_v - self.sag_v - drop)

    def step(self, lower_rad: FloatArray, upper_rad: FloatArray) -> None:
        """Advance by `STEP_S`; `lower_rad` and `upper_rad` (n,) bound what latches let the creases do."""
        if self._load is not None:
            self._step_loaded(self._load)
            return
        limits, load = self._limits, self._settings.load_nm
        most = limits.torque_nm * self.effort
        strong = most > load  # a limit below the load leaves nothing to move with
        spare = np.clip(1.0 - load / limits.torque_nm, 0.0, 1.0)
        speed = limits.velocity_rad_s * spare * (self.supply_v / self._settings.supply_v)
        error = self.goal_rad - self.shaft_rad
        wish = np.clip(self._gain * error, -speed, speed) * (self.torque_on & strong)
        play = 0.5 * self._settings.backlash_rad
        wanted = self.shaft_rad + STEP_S * wish
        reached = np.clip(wanted, lower_rad - play, upper_rad + play)
        reached[self.jammed] = self.shaft_rad[self.jammed]
        blocked = (np.abs(wanted - reached) > 1e-9) | (~strong & (np.abs(error) > 1e-3))
        self.velocity_rad_s = (reached - self.shaft_rad) / STEP_S
        self.shaft_rad = reached
        self.output_rad = np.clip(self.output_rad, reached - play, reached + play)
        push = np.minimum(np.abs(error) / STALL_ERROR_RAD, 1.0) * limits.torque_nm
        running = load + FRICTION_NM_S * np.abs(self.velocity_rad_s)
        self._electrics(np.minimum(np.where(blocked, push, running), most) * self.torque_on)

    def _step_loaded(self, load: Load) -> None:
        """Advance by `STEP_S` with a load that pulls back; what holds it is the load's business."""
        limits = self._limits
        no_load = limits.velocity_rad_s * (self.supply_v / self._settings.supply_v)
        wish = np.clip(self._gain * (self.goal_rad - self.shaft_rad), -no_load, no_load) * self.torque_on
        most = limits.torque_nm * self.effort * self.torque_on
        self.velocity_rad_s = shaft_rates(wish, self._load_nm, no_load, limits.torque_nm, most)
        self.velocity_rad_s[self.jammed] = 0.0
        self.shaft_rad = self.shaft_rad + STEP_S * self.velocity_rad_s
        reaction = load.step(self.shaft_rad, STEP_S)
        self._load_nm, self.output_rad = reaction.torque_nm, reaction.output_rad
        rubbing = FRICTION_NM_S * np.abs(self.velocity_rad_s)
        self._electrics(np.minimum(np.abs(self._load_nm) + rubbing, most))

    def _electrics(self, torque_nm: FloatArray) -> None:
        self.torque_nm = torque_nm
        self.current_a = IDLE_A + AMP_PER_NM * torque_nm
        heating = HEAT_C_PER_A2_S * self.current_a**2
        self.temperature_c += STEP_S * (heating - (self.temperature_c - self._settings.ambient_c) / COOLING_S)
        straining = torque_nm >= 0.95 * self._limits.torque_nm
        self._overload_s = np.where(straining, self._overload_s + STEP_S, 0.0)
        self.fail(self._overload_s > OVERLOAD_AFTER_S, HardwareError.OVERLOAD)
        self.fail(self.temperature_c > OVERHEAT_C, HardwareError.OVERHEATING)

    def fail(self, which: NDArray[np.bool_], error: HardwareError) -> None:
        """Give some servos a hardware error; it takes their torque off."""
        self.hardware_error[which] |= np.uint8(error)
        self.torque_on &= ~which
        self._overload_s[which] = 0.0
