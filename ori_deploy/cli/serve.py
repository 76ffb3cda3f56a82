"""`ori-deploy serve`: a controller that stays, and takes its orders from a vehicle's network or another terminal."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.flight import controller_for, flight_recorder
from ori_deploy.cli.frame import IN, OUT, Heeding, example, nothing_moved
from ori_deploy.cli.given import held, named, refuse_shared
from ori_deploy.cli.journal import journal
from ori_deploy.cli.live import Live
from ori_deploy.cli.session import (
    Place,
    StopRequest,
    lost_observers,
    make_bus,
    punctual,
    rig_for,
    tell_advice,
    vouch_for,
)
from ori_deploy.cli.viewing import view_options, viewed, viewing
from ori_deploy.clock import Clock, MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.states import State
from ori_deploy.files import load_plan
from ori_deploy.motion import Plan
from ori_deploy.operate.desk import Desk, Interlock, Session
from ori_deploy.operate.messages import Answer, Request
from ori_deploy.operate.orders import StandingOrders
from ori_deploy.operate.server import OperatorSocket
from ori_deploy.telemetry.recorder import Recorder

if TYPE_CHECKING:
    from ori_deploy.mav.network import Network
    from ori_deploy.mav.settings import Settings


@dataclass(frozen=True, kw_only=True)
class Serving:
    """How it is served.

    Attributes
    ----------
    log, port, mcu_port, journal, trust_measured, stands, span_unfolded, also_read
        As for one command.
    start
        Where simulated servos of the mock are found.
    """

    log: Path | None = None
    port: str | None = None
    mcu_port: str | None = None
    journal: Path | None = None
    trust_measured: bool = False
    stands: Place | None = None
    span_unfolded: bool = False
    start: Place = "stowed"
    also_read: tuple[Path, ...] = ()


def serve_orders(plan_path: Path, rig_path: Path, settings: Settings | None, how: Serving) -> None:
    """Take orders until a signal comes; what is under way then is brought to rest along its path.

    Parameters
    ----------
    plan_path, rig_path
        Files.
    settings
        Of the vehicle's network; None for other terminals alone.
    how
        The rest.

    Raises
    ------
    InputError
        Plan or rig cannot be used.
    BusError, LinksFailed
        The bus, or the network, cannot be opened.
    """
    plan_file, rig_file = held(plan_path), held(rig_path)
    plan = load_plan(plan_file)
    rig = rig_for(rig_file, plan)
    keys = () if settings is None else (settings.key_file, settings.parameters_file)
    refuse_shared(how.log, how.journal, rig, how.port, rig_path, plan_path, *named((*how.also_read, *keys)))
    clock = MonotonicClock()
    bus = make_bus(rig, plan, clock, how.start, how.port, how.stands, how.mcu_port)
    session = Session(plan_path.absolute(), rig_path.absolute(), how.log and how.log.absolute())
    with (
        StopRequest() as stop,
        Live(rig, real=True) as live,
        flight_recorder(how.log, plan_file, rig_file, plan, rig, clock) as recorder,
        journal(how.journal, rig_path, rig, how.port, clock) as left_word,
        controller_for(plan, rig, bus, clock, (live,), recorder, left_word) as controller,
    ):
        live.begin("connect")
        with nothing_moved():
            controller.connect()
            tell_advice(bus)
            if how.trust_measured:
                controller.trust_measured()
        orders = StandingOrders(
            controller,
            clock,
            1.0 / rig.rate_hz,
            lambda: vouch_for(bus, rig, plan, how.stands),
            span_unfolded=how.span_unfolded,
        )
        with (
            _network(settings, controller, session, plan, rig, bus, clock, orders, recorder) as (desk, network),
            OperatorSocket(desk) as socket,
            _warnings(live),
            punctual(True),
        ):
            live.line(f"serving {plan.design_name}: {_where(settings)}; Ctrl-C ends it")
            _Loop(controller, orders, stop, desk, socket, network, recorder, live).run()


class _OnScreen(logging.Handler):
    """Shows warnings without ever making the loop wait for a terminal."""

    def __init__(self, live: Live) -> None:
        super().__init__(logging.WARNING)
        self._live = live

    def emit(self, record: logging.LogRecord) -> None:
        """Show one."""
        self._live.line(f"{record.levelname.lower()}: {record.getMessage()}")


@contextmanager
def _warnings(live: Live) -> Iterator[None]:
    """What the network and the operators' socket have to say is seen: nobody is told of it by a result."""
    handler = _OnScreen(live)
    loggers = [logging.getLogger(f"ori_deploy.{room}") for room in ("mav", "operate")]
    for logger in loggers:
        logger.setLevel(logging.WARNING)
        logger.propagate = False
        logger.addHandler(handler)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
            logger.propagate = True
            logger.setLevel(logging.NOTSET)


@contextmanager
def _network(
    settings: Settings | None,
    controller: Controller,
    session: Session,
    plan: Plan,
    rig: ResolvedRig,
    bus: ActuatorBus,
    clock: Clock,
    orders: StandingOrders,
    recorder: Recorder | None,
) -> Iterator[tuple[Desk, Network | None]]:
    """The desk, with the network's interlock and bridge where there is a network."""

    def desk_with(interlock: Interlock | None) -> Desk:
        noted = None if recorder is None else partial(_note, recorder)
        desk = Desk(controller, session, plan, rig, bus, clock.now(), orders, interlock, noted)
        controller.add_observer(desk)
        return desk

    if settings is None:
        yield desk_with(None), None
        return
    from ori_deploy.mav.interlock import VehicleInterlock
    from ori_deploy.mav.network import Network

    interlock = VehicleInterlock(settings.deploy_when, settings.facts_fresh_s, settings.force_allowed, clock.now)
    desk = desk_with(interlock)
    with Network(settings, desk, controller, interlock, rig, clock.now) as network:
        controller.add_observer(network)
        yield desk, network


def _note(recorder: Recorder, request: Request, who: str, answer: Answer) -> None:
    """Put an order into the flight log: who gave it, whether by force, and what became of it."""
    by = f"{who}, FORCED" if request.force else who
    recorder.command(
        f"order {request.do}", by, "taken" if answer.took else "refused", answer.why or "", str(answer.state or "")
    )


@dataclass
class _Loop:
    """Cycle after cycle, until somebody ends it."""

    controller: Controller
    orders: StandingOrders
    stop: StopRequest
    desk: Desk
    socket: OperatorSocket
    network: Network | None
    recorder: Recorder | None
    live: Live

    def run(self) -> None:
        """Until a signal, and until what is under way then has come to rest."""
        told = told_fault = False
        while not self.stop.requested or self.controller.under_way or self.controller.state is State.HOLD:
            if self.stop.requested and self.controller.state in (State.MOVING, State.LATCHING, State.HOLD):
                self.controller.stop()  # what is held is given up, too, and says so
            was_running = self.orders.running
            self.desk.closing = self.stop.requested
            self.socket.poll()  # until all is at rest somebody may need an emergency stop
            if self.network is not None:
                self.network.poll()
            if self.orders.running and not was_running:
                self.live.begin("order")
            self._cycle()
            told = self._tell_held(told)
            told_fault = self._tell_fault(told_fault)

    def _cycle(self) -> None:
        result = self.orders.step()
        if result is None:
            return
        self.live.end(result)
        for line in lost_observers(result):  # nobody can wait for the end of a session to be told
            self.live.line(f"warning: {line}")
        if self.recorder is not None:
            self.recorder.write_result(result)
        if self.network is not None:
            self.network.ended(result)

    def _tell_held(self, told: bool) -> bool:
        held = self.controller.state is State.HOLD
        if held and not told:
            self.live.line("held: another order goes on or turns round; `ori-deploy stop` gives it up")
        return held

    def _tell_fault(self, told: bool) -> bool:
        """What leads on from a fault: here the session does not end with it."""
        faulted = self.controller.fault is not None and not self.controller.under_way
        if faulted and not told:
            by = "" if self.network is None else " or `ori-deploy gcs clear-fault`"
            self.live.line(
                f"a fault is latched: see to its cause, then `ori-deploy clear-fault`{by}; then give the order again"
            )
        return faulted


def _where(settings: Settings | None) -> str:
    if settings is None:
        return "orders from other terminals"
    who = f"system {settings.system_id} component {settings.component_id}"
    return f"{who} on {', '.join(map(str, settings.links))}"


def _options(command: Callable[..., None]) -> Callable[..., None]:
    for option in reversed(
        (
            click.argument("plan_file", metavar="PLAN", type=IN),
            click.option("--rig", type=IN, required=True, help="Rig file the plan was made with."),
            click.option("--mavlink", type=IN, help="Settings of the MAVLink component."),
            click.option(
                "--link",
                "links",
                multiple=True,
                help="As udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD; "
                "instead of those in the settings; several times for several.",
            ),
            click.option("--beyond-loopback", is_flag=True, help="Listen to other machines, too."),
            click.option("--log", type=OUT, help="Flight log to write (MCAP)."),
            click.option("--port", help="Device of the bus, instead of the one in the rig."),
            click.option("--mcu-port", help="Device of a microcontroller that has latches alone."),
            click.option(
                "--stands",
                type=click.Choice(["stowed", "deployed"]),
                help="Your word for where the structure stands, where servos alone cannot tell.",
            ),
            click.option("--journal", type=OUT, help="Where word is left before each stage."),
            click.option(
                "--trust-measured",
                is_flag=True,
                help="Your word that it stands as measured, whatever the journal says.",
            ),
            click.option(
                "--span-unfolded",
                is_flag=True,
                help="Your word that a span in segments is unfolded, for the first deployment.",
            ),
            click.option(
                "--start",
                type=click.Choice(["stowed", "deployed"]),
                default="stowed",
                show_default=True,
                help="Where the mock's simulated servos are found.",
            ),
        )
    ):
        command = option(command)
    return command


@click.command(
    cls=Heeding, epilog=example("ori-deploy serve wing.plan.json --rig rig.toml --mavlink examples/mavlink.toml")
)
@_options
@view_options
def serve(
    plan_file: Path, rig: Path, mavlink: Path | None, links: tuple[str, ...], beyond_loopback: bool, **given: Any
) -> None:
    """Stay, and take orders: from ground stations on a MAVLink network, or from another terminal.

    Nothing is powered before the first order.
    """
    given["beyond_loopback"] = beyond_loopback
    how = viewing(given)
    settings = None
    if mavlink is not None or links:
        from ori_deploy.mav.settings import Settings, load_settings, with_links

        settings = Settings(links=()) if mavlink is None else load_settings(mavlink)
        if links:
            settings = with_links(settings, links, beyond_loopback)
    with viewed(plan_file, how):
        serve_orders(plan_file, rig, settings, Serving(**given, also_read=named((mavlink, how.design))))
