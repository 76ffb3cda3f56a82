"""The bus that a rig asks for: servos, a microcontroller, or both."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.dynamixel.bus import DynamixelBus
from ori_deploy.actuators.mcu.bus import McuBus
from ori_deploy.actuators.mcu.mixed import MixedBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock


def hardware_bus(
    rig: ResolvedRig,
    clock: Clock,
    stowed_rad: ArrayLike,
    deployed_rad: ArrayLike,
    *,
    port: str | None = None,
    mcu_port: str | None = None,
) -> ActuatorBus:
    """The bus that a rig file describes, not connected yet.

    Parameters
    ----------
    rig
        Fitted to the design, with a backend that is hardware.
    clock
        Real time.
    stowed_rad, deployed_rad
        (n_cells, 4) crease angles at the two ends of the motion: where stow locks and latches close.
    port
        Of the hinges, instead of the one in the rig.
    mcu_port
        Of a microcontroller that has latches alone.
    """
    if rig.wiring is None:
        if rig.mcu is None:
            raise ValueError(f"backend {rig.backend} is no hardware")
        return McuBus(rig.mcu, clock, rig.rate_hz, port, rig.source)
    servos = DynamixelBus.from_rig(rig, clock, stowed_rad, deployed_rad, port=port)
    if rig.mcu is None:
        return servos
    latches = McuBus(rig.mcu, clock, rig.rate_hz, mcu_port, rig.source)
    return MixedBus(servos, latches, rig.latch_ids, rig.position_limits_rad)
