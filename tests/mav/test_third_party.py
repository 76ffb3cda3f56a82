"""The component on virtual servos, with an autopilot and ground stations that nobody here wrote, each a process."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from ori_deploy.mav.commands import FORCE, SENT_AGAIN_S
from ori_deploy.mav.ground import GroundStation, Structure, Verdict
from ori_deploy.operate.client import ask, find
from ori_deploy.operate.messages import Do, Request, Status
from ori_deploy.wire.vehicle import Party, Writer, dialect
from sim_backends.dynamixel.from_rig import spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from tests.cli.inside import run
from tests.cli.test_operate import Session, session
from tests.cli.virtual import patient_wing
from tests.mav.stations import Autopilot, MavProxy, MavsdkStation, free_port
from tests.mav.test_fuzz import frames
from tests.mav.world import command

ROOT = Path(__file__).parents[2]
USER_1 = dialect.MAV_CMD_USER_1
DEPLOY, FOLD, STOP = 1, 2, 3
ACCEPTED, REJECTED, DENIED, CANCELLED = 0, 1, 2, 6

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("runtime_folder")]


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return patient_wing(tmp_path_factory.mktemp("third_party"), slack_s=0.05, watchdog_s=0.8, lost=10)


@dataclass
class Flight:
    """A vehicle's network: servos, the component, and where it listens."""

    servos: VirtualBus
    serving: Session
    port: int
    folder: Path

    @property
    def link(self) -> str:
        return f"udpout:127.0.0.1:{self.port}"

    def stands(self) -> tuple[tuple[int, float], ...]:
        """Goal of every servo, and when it turned last."""
        return tuple((servo.goal_count, servo.moved_s) for servo in self.servos.truth().values())

    def state(self) -> str:
        """What the operator's socket says: no MAVLink."""
        return str(self.told().state)

    def may_fold(self) -> bool:
        """What the network says."""
        with GroundStation(self.link) as station:
            return station.status(timeout_s=20.0).may_fold

    def speaks(self) -> bool:
        """Whether it is heard on the network, and at rest there."""
        with GroundStation(self.link) as station:
            told = station.monitor(timeout_s=3.0)
            return any(isinstance(one, Structure) and one.at_rest for one in told)

    def deploy(self) -> Verdict:
        with GroundStation(self.link) as station:
            return station.deploy()

    def until(self, condition: Callable[[], bool], within_s: float = 30.0) -> None:
        deadline = time.monotonic() + within_s
        while not condition():
            assert time.monotonic() < deadline, f"not within {within_s} s; {self.state()}"
            time.sleep(0.1)

    def moving(self) -> None:
        """Wait until it is under way."""
        self.until(lambda: self.state() == "moving")

    def told(self) -> Status:
        """What another terminal of the same user is told."""
        with closing(ask(find(self.serving.pid), Request(Do.STATUS))) as answers:
            status = next(answers).status
        assert status is not None
        return status


@contextmanager
def flight(plan: Path, folder: Path, start: str = "stowed", **keys: object) -> Iterator[Flight]:
    """Servos and component, ended at the end."""
    port = free_port()
    words = {"links": f'["udpin:127.0.0.1:{port}"]', **keys}
    lines = ['schema = "ori-deploy/mavlink/1"', *(f"{key} = {value}" for key, value in words.items())]
    (folder / "mavlink.toml").write_text("\n".join(lines))
    rig = plan.with_name("rig.toml")
    with (
        VirtualBus(spec_for_files(rig, plan, start), link=folder / "ttyDXL") as servos,
        session(folder, "serve", plan, "--rig", rig, "--port", servos.link, "--mavlink", "mavlink.toml") as serving,
    ):
        serving.until("serving")
        yield Flight(servos, serving, port, folder)


def test_a_stock_station_deploys_and_folds_only_on_the_ground(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path) as f, Autopilot(f.port) as autopilot, MavProxy(f.port) as station:
        assert station.parameters() == 6
        before = f.stands()
        assert f.state() == "ready", f.told().fault
        time.sleep(1.0)
        assert f.stands() == before  # nothing moves before somebody orders it
        station.command(USER_1, DEPLOY)
        assert station.acknowledged() == "IN_PROGRESS"
        while (told := station.acknowledged(within=60.0)) == "IN_PROGRESS":
            pass
        assert told == "ACCEPTED", f.told()
        assert f.state() == "deployed"
        assert autopilot.authorize() == ACCEPTED

        for change in (
            lambda: autopilot.landed("in_air"),
            lambda: autopilot.landed("unknown"),
            lambda: autopilot.landed("none"),
            lambda: (autopilot.landed("on_ground"), autopilot.armed(True)),
            lambda: autopilot.silent(),
        ):
            change()
            f.until(lambda: not f.may_fold())
            before = f.stands()
            station.command(USER_1, FOLD)
            assert station.acknowledged() == "TEMPORARILY_REJECTED"
            assert f.stands() == before
        autopilot.armed(False)
        autopilot.landed("on_ground")
        autopilot.speak()
        f.until(f.may_fold)
        station.command(USER_1, FOLD)
        f.moving()
        autopilot.armed(True)  # with the wing half folded
        f.until(lambda: f.state() == "hold")
        while (told := station.acknowledged(within=60.0)) == "IN_PROGRESS":
            pass
        assert told == "FAILED"
        autopilot.armed(False)
        f.until(f.may_fold)
        time.sleep(SENT_AGAIN_S)  # sooner it might be the first one, sent again
        station.command(USER_1, FOLD)
        while (told := station.acknowledged(within=60.0)) == "IN_PROGRESS":
            pass
        assert told == "ACCEPTED", f.told()
        assert f.state() == "stowed"
        assert autopilot.authorize() == DENIED


def test_another_stock_station_sends_int_is_heard_twice_and_cancels(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path) as f, Autopilot(f.port), MavsdkStation(f.port) as station:
        station.tell(f"dialect {ROOT / 'ori_deploy' / 'wire' / 'ori_vehicle.xml'}")
        station.command(USER_1, DEPLOY, kind="int")
        f.moving()
        assert f.told().command == "deploy"
        cancel = f'{{"target_system": 1, "target_component": 140, "command": {USER_1}}}'
        station.tell(f"send COMMAND_CANCEL {cancel}")
        assert station.final(60.0) == CANCELLED
        f.until(lambda: f.state() == "armed")
        time.sleep(SENT_AGAIN_S)  # sooner it might be the first one, sent again
        station.command(USER_1, DEPLOY)
        f.moving()
        station.command(USER_1, DEPLOY)  # again, in the middle
        assert station.final(60.0) == ACCEPTED
        assert f.state() == "deployed"


def test_a_station_that_dies_leaves_the_structure_held(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path, link_loss='"hold"', link_timeout_s=2.0) as f, Autopilot(f.port):
        with MavProxy(f.port) as station:
            station.parameters()
            station.command(USER_1, DEPLOY)
            f.moving()
            os.kill(station.pid, signal.SIGKILL)
        f.until(lambda: f.state() == "hold" and f.told().at_rest)
        f.until(f.speaks)
        assert f.deploy().accepted


def test_a_process_that_speaks_and_dies_comes_again_and_the_structure_is_held(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path, deploy_when='"always"') as f, MavProxy(f.port) as station:
        station.parameters()
        station.command(USER_1, DEPLOY)
        f.moving()
        children = Path(f"/proc/{f.serving.pid}/task/{f.serving.pid}/children").read_text().split()
        speaking = [pid for pid in children if b"ori_deploy.mav.process" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        os.kill(int(speaking[0]), signal.SIGKILL)
        f.until(lambda: f.state() == "hold")
        f.until(lambda: f.told().at_rest)
        f.until(f.speaks)
        assert f.deploy().accepted


def test_a_flood_of_commands_changes_nothing(plan: Path, tmp_path: Path) -> None:
    """A thousand a second, each refused, while the structure deploys; `benchmarks.mavlink` has the lateness."""
    with flight(plan, tmp_path) as f, Autopilot(f.port) as autopilot, MavProxy(f.port) as station:
        station.parameters()
        autopilot.landed("in_air")
        station.command(USER_1, DEPLOY)
        f.moving()
        writer = Writer(Party(255, 191))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
            flood.connect(("127.0.0.1", f.port))
            due, sent = time.monotonic(), 0
            while f.servos.truth() and sent < 5000:
                for _ in range(20):
                    order = command(dialect.ORI_CMD_FOLD if sent % 2 else USER_1, 0.0 if sent % 2 else 7.0)
                    flood.send(writer.pack(order))
                    sent += 1
                due += 0.02
                time.sleep(max(due - time.monotonic(), 0.0))
        while (told := station.acknowledged(within=60.0)) == "IN_PROGRESS":
            pass
        assert told == "ACCEPTED", f.told()
        assert f.told().fault is None


def test_fuzzed_frames_on_the_network_move_nothing(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path, start="deployed", force_allowed="true", deploy_when='"always"') as f:
        before = f.stands()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as anybody:
            anybody.connect(("127.0.0.1", f.port))
            for index, (frame, _) in enumerate(frames(20_000, 5)):
                anybody.send(frame)
                if index % 50 == 0:
                    time.sleep(0.005)
        assert f.state() == "ready"
        assert f.stands() == before
        assert f.told().fault is None


def test_strangers_without_the_key_are_not_heard(plan: Path, tmp_path: Path) -> None:
    for name, phrase in (("key", "open"), ("other", "sesame")):
        (tmp_path / name).write_text(f"passphrase:{phrase}\n")
        (tmp_path / name).chmod(0o600)
    with flight(plan, tmp_path, key_file='"key"', deploy_when='"always"') as f:
        link, before = ("--link", f.link), f.stands()
        for words in ((), ("--key", tmp_path / "other")):
            refused = run("gcs", "deploy", *link, *words, cwd=tmp_path)
            assert refused.returncode == 1, refused.stdout
            assert "is not heard" in refused.stderr or "did not answer" in refused.stderr
        assert f.stands() == before
        done = run("gcs", "deploy", *link, "--key", tmp_path / "key", cwd=tmp_path)
        assert done.returncode == 0, done.stderr


def test_force_is_a_number_that_nobody_sends_by_mistake(plan: Path, tmp_path: Path) -> None:
    with flight(plan, tmp_path, start="deployed", force_allowed="true") as f, MavProxy(f.port) as station:
        station.parameters()
        before = f.stands()
        station.command(USER_1, FOLD)
        assert station.acknowledged() == "TEMPORARILY_REJECTED"
        station.command(USER_1, FOLD, 1)
        assert station.acknowledged() == "DENIED"
        assert f.stands() == before
        station.command(USER_1, FOLD, FORCE)
        assert station.acknowledged() == "IN_PROGRESS"
        f.moving()
        station.command(USER_1, STOP)
        f.until(lambda: f.state() == "armed")
