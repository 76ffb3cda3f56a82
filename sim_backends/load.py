"""What hangs on simulated servos' shafts: nothing much, or a structure that pulls back.

A servo model moves its shaft, tells the load, and is told what torque that takes. Models of servos use it in
the same way whatever bus they are on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

BACKDRIVE = 0.1
"""Friction of a servo's own gears, as a part of its stall torque: what holds it while its motor does not."""


@dataclass(frozen=True, eq=False)
class Reaction:
    """How a load answers; (n,) each, at the shafts.

    Attributes
    ----------
    torque_nm
        What it takes to turn the shaft on: positive resists turning to larger positions.
    output_rad
        Where the creases are, as shaft positions.
    """

    torque_nm: FloatArray
    output_rad: FloatArray


class Load(Protocol):
    """What n shafts drive."""

    def rest(self) -> Reaction:
        """How it stands and pulls now."""

    def step(self, shaft_rad: FloatArray, duration_s: float) -> Reaction:
        """Let time pass while the shafts turn evenly to `shaft_rad` (n,)."""

    def secure(self, points: Iterable[str]) -> None:
        """Hold what latches hold from now on: slits "slit:P-T2", cells "cell:c3", "stow"; let go of all else."""


def shaft_rates(
    wish_rad_s: FloatArray, load_nm: FloatArray, no_load_rad_s: FloatArray, stall_nm: FloatArray, limit_nm: FloatArray
) -> FloatArray:
    """How fast loaded shafts turn, (n,) each.

    A motor's speed falls in proportion to its torque, from the no-load speed to nothing at the stall torque. Its
    controller gives what the wished speed takes under the load, as far as its limit goes. What the limit cannot
    hold turns back, against the friction of the gears.

    Parameters
    ----------
    wish_rad_s
        Speed that the position controller asks for.
    load_nm
        As in `Reaction`.
    no_load_rad_s, stall_nm
        Of the motors at the voltage they have.
    limit_nm
        Most that the controllers give; 0 where torque is off.
    """
    slope = np.where(no_load_rad_s > 0.0, stall_nm / np.maximum(no_load_rad_s, 1e-9), np.inf)
    with np.errstate(invalid="ignore"):
        needed = np.where(wish_rad_s == 0.0, load_nm, wish_rad_s * slope + load_nm)
        drive = np.clip(needed, -limit_nm, limit_nm)
        net = drive - load_nm
        # Where the motor gives less than is needed the gears' friction keeps the load from turning it back.
        short = np.abs(needed) > limit_nm
        held = short & (net * drive <= 0.0)
        net = np.where(held, np.sign(net) * np.maximum(np.abs(net) - BACKDRIVE * stall_nm, 0.0), net)
        return np.asarray(np.where(np.isfinite(slope), net / slope, 0.0))
