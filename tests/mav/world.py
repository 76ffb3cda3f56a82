"""A vehicle on a virtual clock: component, bridge, controller and mock servos in one process, without sockets."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from ori_deploy.deploy.result import CycleRecord
from ori_deploy.deploy.states import State
from ori_deploy.mav.bridge import Bridge
from ori_deploy.mav.component import Component
from ori_deploy.mav.interlock import VehicleInterlock
from ori_deploy.mav.links import Heard
from ori_deploy.mav.parameters import Parameters, parameters_of
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.words import Word, item_of, word_of
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.orders import StandingOrders
from ori_deploy.wire.vehicle import Message, dialect
from tests.deploy.synthetic import Bench, bench, synthetic_plan
from tests.operate.served import SESSION

GROUND, AUTOPILOT = (255, 190), (1, 1)
US = (1, 140)
ON_GROUND, IN_AIR = dialect.MAV_LANDED_STATE_ON_GROUND, dialect.MAV_LANDED_STATE_IN_AIR


def heartbeat(base_mode: int = 0, kind: int = dialect.MAV_TYPE_GCS) -> Message:
    return dialect.MAVLink_heartbeat_message(kind, dialect.MAV_AUTOPILOT_INVALID, base_mode, 0, 4, 3)


def command(number: int, p1: float = 0.0, p2: float = 0.0, *, confirmation: int = 0, to: Any = US) -> Message:
    return dialect.MAVLink_command_long_message(*to, number, confirmation, p1, p2, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass
class World:
    """Everything, stepped by hand."""

    settings: Settings
    bench: Bench
    orders: StandingOrders
    desk: Desk
    interlock: VehicleInterlock
    bridge: Bridge
    component: Component
    parameters: Parameters
    sent: list[tuple[Message, Any]]
    to_loop: deque[tuple[Any, ...]]
    to_component: deque[tuple[Any, ...]]
    loop_hangs: bool = False
    cut: bool = False
    words: list[Word] = field(default_factory=list)

    @property
    def now(self) -> float:
        return self.bench.clock.now()

    @property
    def state(self) -> State:
        return self.bench.controller.state

    @property
    def record(self) -> CycleRecord:
        return self.bench.records[-1]

    def hear(self, message: Message, sender: tuple[int, int] = GROUND, peer: Any = "ground") -> None:
        self.component.heard(Heard(message, peer, *sender), self.now)

    def autopilot(self, *, armed: bool | None = False, landed: int | None = ON_GROUND) -> None:
        """What it says of itself now."""
        if armed is not None:
            mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
            self.hear(heartbeat(mode, dialect.MAV_TYPE_FIXED_WING), AUTOPILOT, "autopilot")
        if landed is not None:
            self.hear(dialect.MAVLink_extended_sys_state_message(0, landed), AUTOPILOT, "autopilot")

    def cycle(self) -> None:
        """One of the loop, and what the component makes of it."""
        if self.loop_hangs:
            self.bench.clock.sleep_until(self.now + 0.01)
        else:
            while self.to_loop:
                word = word_of(self.to_loop.popleft())
                assert word is not None
                self.words.append(word)
                self.bridge.attend(word)
            self.bridge.cycle()
            result = self.orders.step()
            if result is not None:
                self.bridge.ended(result)
        self.tell_component()

    def tell_component(self) -> None:
        """What the component hears of the loop, and what is due there."""
        while self.to_component:
            word = word_of(self.to_component.popleft())
            assert word is not None
            if not self.cut:
                self.component.told(word, self.now)
        self.component.tick(self.now)

    def run(
        self, seconds: float, *, armed: bool | None = False, landed: int | None = ON_GROUND, ground: bool = True
    ) -> None:
        """Pass time with everybody saying once in a while how they are."""
        cycles = round(100.0 * seconds)
        for index in range(cycles):
            if index % 50 == 0:
                self.autopilot(armed=armed, landed=landed)
                if ground:
                    self.hear(heartbeat())
            self.cycle()

    def until(self, condition: Any, seconds: float = 20.0, **how: Any) -> None:
        """Pass time until something is so."""
        for _ in range(round(10.0 * seconds)):
            if condition():
                return
            self.run(0.1, **how)
        raise AssertionError(f"not within {seconds} s; state {self.state}")

    def take(self, kind: type[Message]) -> list[Any]:
        """Messages of a kind sent since the last time, out of all."""
        found = [message for message, _ in self.sent if isinstance(message, kind)]
        self.sent[:] = [(message, peer) for message, peer in self.sent if not isinstance(message, kind)]
        return found

    def answers(self) -> list[tuple[int, int]]:
        """Result and reason of every acknowledgement since the last time, without progress."""
        told = [one for one in self.take(dialect.MAVLink_command_ack_message)]
        return [(one.result, one.result_param2) for one in told if one.result != dialect.MAV_RESULT_IN_PROGRESS]

    def texts(self) -> list[str]:
        return [
            one.text.rstrip(b"\0").decode() if isinstance(one.text, bytes) else one.text
            for one in self.take(dialect.MAVLink_statustext_message)
        ]


def world(*, start: str = "stowed", bench_of: Bench | None = None, **settings: Any) -> World:
    """A vehicle with a structure that is not armed yet."""
    made = Settings(**settings)
    b = bench(synthetic_plan(duration_s=1.4), start=start, armed=False) if bench_of is None else bench_of
    b.controller.connect()
    interlock = VehicleInterlock(made.deploy_when, made.facts_fresh_s, made.force_allowed, b.clock.now)
    orders = StandingOrders(b.controller, b.clock, 0.01, lambda: None)
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now(), orders, interlock)
    b.controller.add_observer(desk)
    to_loop: deque[tuple[Any, ...]] = deque()
    to_component: deque[tuple[Any, ...]] = deque()
    sent: list[tuple[Message, Any]] = []
    bridge = Bridge(desk, b.controller, interlock, b.rig, lambda w: to_component.append(item_of(w)), b.clock.now)
    b.controller.add_observer(bridge)
    parameters = Parameters(parameters_of(made), made.parameters_file)
    component = Component(
        made,
        parameters,
        lambda message, peer: sent.append((message, peer)),
        lambda word: to_loop.append(item_of(word)),
        b.clock.now(),
    )
    return World(made, b, orders, desk, interlock, bridge, component, parameters, sent, to_loop, to_component)


__all__ = ["AUTOPILOT", "GROUND", "IN_AIR", "ON_GROUND", "US", "World", "command", "heartbeat", "world"]
