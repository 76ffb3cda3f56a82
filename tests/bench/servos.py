"""Virtual servos in this process and in virtual time: what takes seconds on a bench takes none here."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.actuators.dynamixel.line import Pong
from ori_deploy.clock import VirtualClock
from sim_backends.dynamixel.bus import Bus
from sim_backends.dynamixel.packets import Instruction, Listener
from sim_backends.dynamixel.servo import Servo
from sim_backends.dynamixel.spec import BusSpec, ServoSpec
from tests.actuators.dynamixel.scripted import ScriptedPort

Hearing = Callable[[Instruction], bool]
"""Whether an instruction gets through to the servos."""


class Bench(ScriptedPort):
    """A line with servos on it, for `with`; they live by `clock`, which only who waits moves on."""

    def __init__(self, *servos: ServoSpec, hears: Hearing = lambda _: True, slack_s: float = 0.2) -> None:
        self.clock = VirtualClock(100.0)
        self.bus = Bus(BusSpec(servos=servos), self.clock.now())
        self.told: list[Instruction] = []
        self._hears, self._listener = hears, Listener()
        super().__init__(self._react, slack_s)

    def _react(self, request: bytes) -> bytes:
        answers = b""
        for instruction in self._listener.feed(request):
            self.told.append(instruction)
            if self._hears(instruction):
                now = self.clock.now()
                self.bus.advance(now)
                answers += bytes(self.bus.handle(instruction, self.port.getBaudRate(), now).data)
        return answers

    def pong(self, servo_id: int = 1) -> Pong:
        """The servo, asked who it is."""
        return self.line.ping(servo_id)

    def servo(self, servo_id: int = 1) -> Servo:
        """The servo itself."""
        return next(servo for servo in self.bus.servos if servo.id == servo_id)

    def register(self, name: str, servo_id: int = 1) -> int:
        """A register as it stands."""
        return self.servo(servo_id).named(name)

    def shaft_rad(self, servo_id: int = 1) -> float:
        """Where a shaft really stands."""
        return float(self.bus.motors.shaft_rad[self.servo(servo_id).k])

    def torque_on(self, servo_id: int = 1) -> bool:
        """Whether a servo holds."""
        return bool(self.bus.motors.torque_on[self.servo(servo_id).k])
