"""What the vehicle has to be doing before the structure may move."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.mav.settings import DEPLOY_RULES, DeployWhen
from ori_deploy.mav.words import Vehicle
from ori_deploy.operate.desk import Refusal
from ori_deploy.operate.messages import Code, Do
from ori_deploy.wire.vehicle import dialect

ON_GROUND = dialect.MAV_LANDED_STATE_ON_GROUND
_LANDED_NAMES = {
    dialect.MAV_LANDED_STATE_UNDEFINED: "undefined",
    dialect.MAV_LANDED_STATE_IN_AIR: "in the air",
    dialect.MAV_LANDED_STATE_TAKEOFF: "taking off",
    dialect.MAV_LANDED_STATE_LANDING: "landing",
}


class VehicleInterlock:
    """Folds only on the ground and disarmed; deploys by the rule that was chosen.

    What the autopilot never said, or not lately, counts as against it. Force goes past all of it, where the
    settings allow force.

    Parameters
    ----------
    deploy_when
        The rule for deploying.
    fresh_s
        How old the autopilot's word may be.
    force_allowed
        Whether force is heeded at all.
    now
        The monotonic clock on which the vehicle's words were timed.
    """

    def __init__(
        self, deploy_when: DeployWhen, fresh_s: float, force_allowed: bool, now: Callable[[], float]
    ) -> None:
        self.deploy_when: DeployWhen = deploy_when
        self._fresh_s, self._force_allowed, self._now = fresh_s, force_allowed, now
        self._vehicle = Vehicle()

    def told(self, vehicle: Vehicle) -> None:
        """What the autopilot says of itself."""
        self._vehicle = vehicle

    def tune(self, rule: int) -> None:
        """Take another rule for deploying, by its index."""
        self.deploy_when = DEPLOY_RULES[rule]

    def refuses(self, do: Do, force: bool) -> Refusal | None:
        """Why DEPLOY or STOW may not be begun now; None where it may."""
        if force and not self._force_allowed:
            return Refusal(Code.FORCE_NOT_ALLOWED, "force is not allowed by the settings (force_allowed = false)")
        if force:
            return None
        ground, disarmed = self._needs(do)
        return (self._off_ground() if ground else None) or (self._armed() if disarmed else None)

    def _needs(self, do: Do) -> tuple[bool, bool]:
        """Whether the vehicle has to be on the ground, and disarmed."""
        if do is Do.STOW:
            return True, True
        rule = self.deploy_when
        return rule in ("on-ground", "on-ground-and-disarmed"), rule in ("disarmed", "on-ground-and-disarmed")

    def _off_ground(self) -> Refusal | None:
        landed, said_s = self._vehicle.landed, self._vehicle.landed_s
        if landed == dialect.MAV_LANDED_STATE_UNDEFINED or not self._fresh(said_s):
            return Refusal(Code.LANDED_UNKNOWN, f"not known to be on the ground: {self._how_old(said_s, landed)}")
        if landed != ON_GROUND:
            return Refusal(Code.AIRBORNE, f"not on the ground: {_LANDED_NAMES.get(landed or 0, 'unknown')}")
        return None

    def _armed(self) -> Refusal | None:
        armed, said_s = self._vehicle.armed, self._vehicle.armed_s
        if not self._fresh(said_s):
            return Refusal(Code.ARMING_UNKNOWN, f"not known to be disarmed: {self._how_old(said_s, None)}")
        return Refusal(Code.ARMED, "the autopilot is armed") if armed else None

    def _fresh(self, said_s: float | None) -> bool:
        return said_s is not None and 0.0 <= self._now() - said_s <= self._fresh_s

    def _how_old(self, said_s: float | None, landed: int | None) -> str:
        if said_s is None:
            return "the autopilot has not said so"
        if landed == dialect.MAV_LANDED_STATE_UNDEFINED and self._fresh(said_s):
            return "the autopilot says that it does not know"
        return f"the autopilot said so {self._now() - said_s:.1f} s ago; limit: {self._fresh_s:g} s"
