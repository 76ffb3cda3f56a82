"""How hard the hinges' servos may push: the registers that say so, and the packet that sets them."""

from __future__ import annotations

from collections.abc import Sequence

from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.startup import current_limit, read
from ori_deploy.actuators.dynamixel.wiring import HingeServo
from ori_deploy.wire.dynamixel import OperatingMode, Register


class Effort:
    """The part of their strength that the servos may use.

    In current-based position mode Goal Current (102) says so; in the other position modes Goal PWM (100) bounds the
    output (e-manual, "Goal PWM(100)"), and with it the speed. Both are in RAM: a restart forgets a limit.

    Parameters
    ----------
    line
        To the servos.
    every
        Goals after which a limit is sent again: nobody answers a sync write, so one may have missed it.
    """

    def __init__(self, line: ServoLine, every: int) -> None:
        self._line = line
        self._every = every
        self._goals = 0
        self._part: float | None = None  # as it was found: nobody limited it yet
        self._registers: tuple[Register, ...] = ()
        self._most: dict[int, int] = {}

    def find(self, servos: Sequence[HingeServo], current_limit_a: float | None) -> None:
        """See what each servo may use: the rig's current limit, or the servo's own PWM limit. Changes nothing."""
        self._part = None
        found = [self._limiter(servo, current_limit_a) for servo in servos]
        self._registers = tuple(dict.fromkeys(register for register, _ in found))
        self._most = {servo.id: most for servo, (_, most) in zip(servos, found, strict=True)}

    def limit(self, part: float) -> None:
        """Let every servo use this part, in one packet: all are in modes with the same register."""
        self._part, self._goals = part, 0
        (register,) = self._registers
        units = {servo_id: max(1, round(part * most)) for servo_id, most in self._most.items()}
        self._line.sync_write(register.address, register.size, {i: register.encode(n) for i, n in units.items()})

    def remind(self) -> None:
        """Called with every goal."""
        self._goals += 1
        if self._part is not None and self._goals >= self._every:
            self.limit(self._part)

    def _limiter(self, servo: HingeServo, current_limit_a: float | None) -> tuple[Register, int]:
        table = servo.model.table
        if servo.mode is OperatingMode.CURRENT_BASED_POSITION and current_limit_a is not None:
            *_, goal = current_limit(servo.model, current_limit_a)
            return goal
        return table.goal_pwm, read(self._line, servo.id, table.pwm_limit)
