"""Whole turns: a servo whose range is wider than one forgets how many it has made when it restarts.

Until somebody says where the structure stands its position is known only up to whole turns, and it gets no
torque. The word is kept in a register that a restart clears.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, read, write
from ori_deploy.actuators.dynamixel.wiring import HingeServo
from ori_deploy.wire.dynamixel.registers import COUNTS_PER_TURN

FloatArray = NDArray[np.float64]


def unvouched(line: ServoLine, servos: Sequence[HingeServo]) -> tuple[HingeServo, ...]:
    """Servos that may be whole turns from where they say."""
    return tuple(
        servo for servo in servos if not servo.one_turn and read(line, servo.id, mark_of(servo.model)) != MARK_ADDRESS
    )


def vouch(
    line: ServoLine,
    servos: Sequence[HingeServo],
    measured_rad: FloatArray,
    shaft_rad: FloatArray,
    tolerance_rad: FloatArray,
) -> None:
    """Take somebody's word for where the shafts stand, as far as the servos can bear it out.

    Homing offsets are set so that servos which restarted read the turn that is meant.

    Parameters
    ----------
    servos
        Of all hinges.
    measured_rad
        (n_hinges,) where they say they stand; all valid.
    shaft_rad, tolerance_rad
        (n_hinges,) where they are said to stand, and how far off they may be measured, whole turns apart.

    Raises
    ------
    CommandRefused
        A shaft is measured elsewhere, or is held by torque. Nothing was changed.
    """
    # With long gears a tolerance of the crease is many turns of the shaft, and would tell nothing.
    tolerance_rad = np.minimum(tolerance_rad, 0.5 * np.pi)
    lost = set(unvouched(line, servos))
    turns = np.array([servo in lost for servo in servos]) * np.rint((shaft_rad - measured_rad) / (2.0 * np.pi))
    off = np.abs(measured_rad + 2.0 * np.pi * turns - shaft_rad)
    if (off > tolerance_rad).any():
        k = int(np.argmax(off - tolerance_rad))
        raise CommandRefused(
            f"{servos[k].name} is not where the structure is said to stand: measured {off[k]:.3f} rad from there; "
            f"limit: {tolerance_rad[k]:.3f} rad; remedy: bring it there by hand, or say where it does stand"
        )
    offsets = [_new_offset(line, servo, int(turn)) for servo, turn in zip(servos, turns, strict=True) if turn]
    for servo, offset in offsets:
        write(line, servo.id, servo.model.table.homing_offset, offset)
    for servo in lost:
        write(line, servo.id, mark_of(servo.model), MARK_ADDRESS)


def _new_offset(line: ServoLine, servo: HingeServo, turns: int) -> tuple[HingeServo, int]:
    register = servo.model.table.homing_offset
    if read(line, servo.id, servo.model.table.torque_enable):
        raise CommandRefused(f"{servo.name}: torque is on; remedy: disarm, then say where the structure stands")
    offset = read(line, servo.id, register) + turns * COUNTS_PER_TURN
    low, high = register.minimum or 0, register.maximum or 0
    if not low <= offset <= high:
        raise CommandRefused(
            f"{servo.name}: its homing offset would be {offset} counts; limit: {low} to {high}; "
            "remedy: set it to 0 with DYNAMIXEL Wizard and calibrate again"
        )
    return servo, offset
