"""`ori-deploy serve` in a process of its own on loopback, with an autopilot that says what it is told to say."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import tomli_w

from ori_deploy.files.plan_file import save_plan
from ori_deploy.mav.ground import GroundStation, Structure
from ori_deploy.mav.link_spec import parse_link
from ori_deploy.mav.links import Links
from ori_deploy.wire.vehicle import Party, dialect
from tests.cli.test_operate import Session, session
from tests.deploy.synthetic import RIG, synthetic_plan
from tests.mav.stations import free_port
from tests.mav.world import ON_GROUND, heartbeat

WITHIN_S = 60.0
PERIOD_S = 0.1


def quick_plan(folder: Path) -> Path:
    """A plan of a second, and beside it `rig.toml`, which has patience with a busy machine."""
    cell = RIG["each_cell"]
    quick = {**cell, "actuator": {**cell["actuator"], "max_velocity_rad_s": 16.0, "max_acceleration_rad_s2": 200.0}}
    rig = {**RIG, "each_cell": quick, "controller": {"overruns_allowed": 1000}}
    (folder / "rig.toml").write_text(tomli_w.dumps(rig))
    save_plan(synthetic_plan(duration_s=1.0), folder / "quick.plan.json")
    return folder / "quick.plan.json"


class Autopilot:
    """Says ten times a second that it is disarmed and on the ground, until it is set otherwise; for `with`.

    Attributes
    ----------
    armed, landed
        What it says.
    """

    def __init__(self, port: int) -> None:
        self.armed, self.landed = False, ON_GROUND
        self._links = Links([parse_link(f"udpout:127.0.0.1:{port}")], Party(1, 1), None)
        self._ended = threading.Event()
        self._speaking = threading.Thread(target=self._speak)

    def __enter__(self) -> Self:
        self._links.__enter__()
        self._speaking.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._speaking.join()
        self._links.__exit__(kind, error, trace)

    def _speak(self) -> None:
        while not self._ended.wait(PERIOD_S):
            mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            self._links.send(heartbeat(mode, dialect.MAV_TYPE_FIXED_WING), None)
            self._links.send(dialect.MAVLink_extended_sys_state_message(0, self.landed), None)
            self._links.receive(0.0)


@dataclass(frozen=True)
class Served:
    """A component that serves.

    Attributes
    ----------
    process
        The control loop's.
    port
        Where it listens.
    folder
        Its working folder.
    """

    process: Session
    port: int
    folder: Path

    @property
    def link(self) -> str:
        return f"udpout:127.0.0.1:{self.port}"

    def station(self, system: int = 255) -> GroundStation:
        """A ground station that is not on the network yet."""
        return GroundStation(self.link, party=Party(system, dialect.MAV_COMP_ID_MISSIONPLANNER))

    def status(self) -> Structure:
        """What a station that only looks is told."""
        with self.station() as station:
            return station.status(timeout_s=WITHIN_S)

    def until(self, condition: Callable[[Structure], bool]) -> Structure:
        """Wait until a station that only looks is told so."""
        told = None
        with self.station(system=99) as station:  # not of those whose silence counts
            for told in station.monitor(timeout_s=WITHIN_S):
                if isinstance(told, Structure) and condition(told):
                    return told
        raise AssertionError(f"not within {WITHIN_S} s; last: {told}")


@contextmanager
def serving(plan: Path, folder: Path, *words: object, **keys: Any) -> Iterator[Served]:
    """A component with these settings, killed at the end if need be."""
    port = free_port()
    settings = {"schema": "ori-deploy/mavlink/1", "links": [f"udpin:127.0.0.1:{port}"], **keys}
    (folder / "mavlink.toml").write_text(tomli_w.dumps(settings))
    line = ("serve", plan, "--rig", plan.with_name("rig.toml"), "--mavlink", "mavlink.toml", *words)
    with session(folder, *line) as process:
        process.until("; Ctrl-C ends it")
        yield Served(process, port, folder)
