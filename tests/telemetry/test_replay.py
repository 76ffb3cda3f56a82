"""A recorded run is decided again: the same when nothing differs, and if not, where and how."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ori_deploy.deploy.cycle import Cycle
from ori_deploy.deploy.journal import Entry
from ori_deploy.deploy.result import FaultKind
from ori_deploy.deploy.states import State
from ori_deploy.errors import FileError, OriDeployError, RigError
from ori_deploy.motion.recovery import Recovery
from ori_deploy.telemetry.replay import replay
from ori_deploy.telemetry.tape import PIECE, Tape
from sim_backends.mock import MockBus
from tests.deploy.synthetic import NARROWING, synthetic_plan, synthetic_rig
from tests.telemetry.flights import Flight, flown

PLAN = synthetic_plan(4, duration_s=1.6, curvature=0.2)
LATCHES = [
    {"id": "pin", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.1, "timeout_s": 0.4},
    {"id": "coil", "secures": "cell:c1", "kind": "electromagnet", "max_on_s": 30.0, "duty_cycle": 0.5},
    {"id": "lock", "secures": "stow", "kind": "lock_pin", "travel_s": 0.1, "timeout_s": 0.4},
]


def deploy(f: Flight) -> None:
    with f.controller as controller:
        controller.connect()
        controller.arm()
        controller.deploy()
        controller.run()


def begun(f: Flight, steps: int = 40) -> None:
    f.controller.connect()
    f.controller.arm()
    f.controller.deploy()
    for _ in range(steps):
        f.controller.step()


def deploy_and_stow(f: Flight) -> None:
    deploy(f)
    f.controller.connect()
    f.controller.arm()
    f.controller.stow()
    while f.controller.under_way:
        f.controller.step()
    assert f.controller.result().succeeded


def hold_and_resume(f: Flight) -> None:
    begun(f)
    f.controller.hold()
    f.controller.run()
    f.controller.resume()
    assert f.controller.run().succeeded


def stop(f: Flight) -> None:
    begun(f)
    f.controller.stop()
    f.controller.run()
    f.controller.close()


def refused(f: Flight) -> None:
    for command in ("deploy", "resume", "step"):
        with pytest.raises(OriDeployError):
            getattr(f.controller, command)()
    deploy(f)


def faulted(spoil: Callable[[MockBus], object]) -> Callable[[Flight], None]:
    def script(f: Flight) -> None:
        begun(f)
        spoil(f.bus)
        f.controller.run()
        assert f.controller.state is State.FAULT
        f.controller.close()

    return script


SCRIPTS = {
    "deploy": deploy,
    "deploy and stow": deploy_and_stow,
    "hold and resume": hold_and_resume,
    "stop": stop,
    "refused": refused,
    "close on the way": begun,
    "jam": faulted(lambda bus: bus.jam("servo_c2")),
    "overload": faulted(lambda bus: bus.overload("servo_c1")),
    "reboot": faulted(lambda bus: bus.reboot("servo_c3")),
    "silence": faulted(lambda bus: bus.mute("servo_c4")),
    "unplug": faulted(lambda bus: bus.unplug()),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_run_is_decided_the_same_again(name: str) -> None:
    f, pieces = flown(PLAN, SCRIPTS[name], latch=LATCHES)
    done = replay(pieces, f.plan, f.rig)
    assert done.differences == ()
    assert done.gap == ""
    assert done.cycles == len(f.records) > 0
    assert done.decisions > done.cycles // 2
    assert done.commands > 0


@pytest.mark.parametrize("stop", [None, 0.95])
def test_seating_is_decided_the_same_again_and_differs_with_another_effort(stop: float | None) -> None:
    plan = synthetic_plan(4, duration_s=6.0, tolerance=NARROWING)

    def seat(f: Flight) -> None:
        if stop is not None:
            shaft = f.rig.to_actuator(plan.crease_angles_rad)[:, 1]
            f.bus.end_stop("servo_c2", float(np.interp(stop, plan.fold, shaft)))
        deploy(f)

    f, pieces = flown(plan, seat)
    done = replay(pieces, plan, f.rig)
    assert done.differences == ()
    assert done.cycles == len(f.records)
    fault = f.records[-1].fault
    assert (fault is None) == (stop is None)
    assert fault is None or fault.kind is FaultKind.SEATING_EARLY
    assert replay(pieces, plan, synthetic_rig(plan, controller={"seating_effort": 0.3})).differences


class Slow:
    """A journal on a disk that takes its time, and fails once."""

    def __init__(self, last: Entry | None) -> None:
        self.last = last
        self.failure: str | None = None
        self.entries: list[Entry] = []
        self._left = 0

    def post(self, entry: Entry) -> None:
        self.entries.append(entry)
        self.failure = "disk full" if len(self.entries) == 2 else None
        self._left = 7

    def settled(self) -> bool:
        self._left -= 1
        return self._left < 0


@pytest.mark.parametrize(
    "last", [None, Entry("deploy", "open", "moving", 0.0, 1.0), Entry("", "", "armed", 0.9, 1.0)]
)
def test_what_a_journal_says_is_on_the_tape(last: Entry | None) -> None:
    def script(f: Flight) -> None:
        with contextlib.suppress(OriDeployError):  # the last one does not agree with what is measured
            deploy(f)

    journal = Slow(last)
    f, pieces = flown(PLAN, script, "stowed", journal)
    done = replay(pieces, f.plan, f.rig)
    assert done.differences == ()
    assert done.cycles == len(f.records)
    assert (len(journal.entries) > 1) == (last is None or last.command == "deploy")


def recover(f: Flight) -> None:
    """To the middle of where the cells stand."""
    folds = np.nan_to_num(f.records[-1].folds, nan=0.5) if f.records else np.zeros(4)
    f.controller.recover(Recovery(np.array([folds, np.full(4, folds.mean())]), 2))


COMMANDS: dict[str, Callable[[Flight], object]] = {
    "deploy": lambda f: f.controller.deploy(span_unfolded=True),
    "half as fast": lambda f: f.controller.limit_speed(0.5),
    "nonsense": lambda f: f.controller.limit_speed(-1.0),
    "emergency stop": lambda f: f.controller.emergency_stop("somebody"),
    "recover": recover,
    "connect": lambda f: f.controller.connect(),
    "arm": lambda f: f.controller.arm(),
    "disarm": lambda f: f.controller.disarm(),
    "stow": lambda f: f.controller.stow(),
    "hold": lambda f: f.controller.hold(),
    "resume": lambda f: f.controller.resume(),
    "stop": lambda f: f.controller.stop(),
    "clear fault": lambda f: f.controller.clear_fault(),
    "trust": lambda f: f.controller.trust_measured(),
    "disconnect": lambda f: f.controller.disconnect(),
    "close": lambda f: f.controller.close(),
}
FAULTS: dict[str, Callable[[MockBus, str], object]] = {
    "drop": lambda bus, hinge: bus.drop_replies(hinge, 2),
    "mute": lambda bus, hinge: bus.mute(hinge),
    "jam": lambda bus, hinge: bus.jam(hinge),
    "push": lambda bus, hinge: bus.push(hinge, 0.3),
    "reboot": lambda bus, hinge: bus.reboot(hinge),
    "overload": lambda bus, hinge: bus.overload(hinge),
    "overheat": lambda bus, hinge: bus.overheat(hinge, 90.0),
    "sag": lambda bus, _: bus.sag(6.0),
    "no latches": lambda bus, _: bus.silence_latches(5),
    "no health": lambda bus, _: bus.silence_health(3),
    "late": lambda bus, _: bus.delay_reads(4, 0.03),
    "unplug": lambda bus, _: bus.unplug(),
    "replug": lambda bus, _: bus.replug(),
}


def campaign(seed: int) -> Callable[[Flight], None]:
    """A random operator, and random misfortune."""
    draw = random.Random(seed)

    def script(f: Flight) -> None:
        for command in ("connect", "arm", "deploy"):
            getattr(f.controller, command)()
        for _ in range(draw.randrange(4, 14)):
            for _ in range(draw.choice((1, 3, 10, 40))):
                if f.controller.state is not State.DISCONNECTED:
                    f.controller.step()
            if draw.random() < 0.3:
                FAULTS[draw.choice(list(FAULTS))](f.bus, draw.choice(f.bus.hinge_ids))
            with contextlib.suppress(OriDeployError):
                COMMANDS[draw.choice(list(COMMANDS))](f)
        if draw.random() < 0.7:
            f.controller.close()

    return script


@given(st.integers(0, 2**32), st.sampled_from(["stowed", "deployed"]))
@example(1, "stowed")
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
def test_whatever_an_operator_does_is_decided_the_same_again(seed: int, start: str) -> None:
    f, pieces = flown(PLAN, campaign(seed), start, latch=LATCHES, controller={"settle_timeout_s": 0.4})
    done = replay(pieces, f.plan, f.rig)
    assert done.differences == ()
    assert done.cycles == len(f.records)


@pytest.mark.slow
@given(st.integers(0, 2**32), st.sampled_from(["stowed", "deployed"]))
@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])
def test_whatever_many_operators_do_is_decided_the_same_again(seed: int, start: str) -> None:
    test_whatever_an_operator_does_is_decided_the_same_again.hypothesis.inner_test(seed, start)


class Interrupting(MockBus):
    """A bus during whose n-th reading somebody presses Ctrl-C twice."""

    left = 30

    def _read_hinges(self) -> Any:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt
        return super()._read_hinges()


def test_a_run_that_was_interrupted_between_calls_is_decided_the_same_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def script(f: Flight) -> None:
        begun(f)
        judge, pending = Cycle._judge, [KeyboardInterrupt()]

        def interrupted(*given: Any) -> None:
            if pending:
                raise pending.pop()
            judge(*given)

        with monkeypatch.context() as patch:
            patch.setattr(Cycle, "_judge", interrupted)
            with pytest.raises(KeyboardInterrupt):
                f.controller.step()
        f.controller.close()

    flight, pieces = flown(PLAN, script)
    done = replay(pieces, PLAN, flight.rig)
    assert done.same, done.differences


def test_a_command_that_was_refused_and_would_be_carried_out_now_is_a_difference() -> None:
    """Reproduced: whatever ended a command in the log was raised again, and that was found to be the same."""

    def script(f: Flight) -> None:
        f.controller.connect()
        f.controller.arm()
        with pytest.raises(OriDeployError):
            f.controller.deploy()
        f.controller.close()

    flight, pieces = flown(PLAN, script, controller={"start_tolerance_rad": 1e-7})
    assert replay(pieces, PLAN, flight.rig).same
    done = replay(pieces, PLAN, synthetic_rig(PLAN))
    assert not done.same
    assert any("StartRefused" in difference.logged for difference in done.differences), done.differences


def test_a_run_that_was_interrupted_in_a_call_is_decided_the_same_again() -> None:
    def script(f: Flight) -> None:
        f.bus.__class__ = Interrupting
        with pytest.raises(KeyboardInterrupt):
            deploy(f)

    f, pieces = flown(PLAN, script)
    done = replay(pieces, f.plan, f.rig)
    assert done.differences == ()
    assert done.cycles == len(f.records)
    assert f.records[-1].fault is not None


@pytest.mark.parametrize("cut", [1, 7, 60])
def test_a_tape_that_was_cut_off_is_decided_the_same_up_to_there(cut: int) -> None:
    f, pieces = flown(PLAN, deploy)
    done = replay(pieces[:-cut], f.plan, f.rig)
    assert done.differences == ()
    assert 0 < done.cycles <= len(f.records)


def test_dropped_records_are_told_and_what_came_before_is_decided_the_same() -> None:
    f, pieces = flown(PLAN, deploy)
    done = replay(pieces[:50] + pieces[53:], f.plan, f.rig)
    assert done.differences == ()
    assert "3 pieces of the tape are missing" in done.gap
    assert 40 < done.cycles < 50
    assert not done.same  # what is missing, and what follows, may have been otherwise


@pytest.mark.parametrize("first", [1, 2])
def test_a_tape_without_its_beginning_is_not_called_the_same(first: int) -> None:
    f, pieces = flown(PLAN, begun)
    done = replay(pieces[first:], f.plan, f.rig)
    assert (done.cycles, done.commands, done.differences) == (0, 0, ())
    assert done.nothing
    assert not done.same
    missing = "1 piece of the tape is" if first == 1 else "2 pieces of the tape are"
    assert done.gap.startswith(f"{missing} missing before the first cycle")


def test_a_tape_of_nothing_is_not_called_the_same() -> None:
    done = replay([], PLAN, synthetic_rig(PLAN))
    assert done.nothing
    assert not done.same


@pytest.mark.parametrize(
    "pick", [lambda p: [*p[:30], p[29], *p[30:]], lambda p: [*p[:30], p[3]], lambda p: [*p, p[0]]]
)
def test_a_piece_that_comes_twice_or_too_late_is_damage(pick: Callable[[list[bytes]], list[bytes]]) -> None:
    f, pieces = flown(PLAN, begun)
    with pytest.raises(FileError, match=r"damaged after cycle \d+; found piece \d+ where piece \d+ is due"):
        replay(pick(pieces), f.plan, f.rig)


def test_a_refused_start_is_something_to_compare() -> None:
    def script(f: Flight) -> None:
        f.controller.connect()
        with pytest.raises(OriDeployError):
            f.controller.resume()

    f, pieces = flown(PLAN, script)
    done = replay(pieces, f.plan, f.rig)
    assert (done.cycles, done.same) == (0, True)
    assert done.commands == 2


def tampered(pieces: list[bytes], old: np.ndarray[Any, Any], new: np.ndarray[Any, Any]) -> tuple[list[bytes], int]:
    """The tape with one measurement changed, and in which piece."""
    (k,) = [k for k, piece in enumerate(pieces) if old.tobytes() in piece[PIECE.size :]]
    return [*pieces[:k], pieces[k].replace(old.tobytes(), new.tobytes()), *pieces[k + 1 :]], k


@pytest.mark.parametrize(("by_rad", "what"), [(1e-6, "measured fold of c1"), (2.0, "fault")])
def test_a_measurement_that_was_tampered_with_is_found_and_told_where(by_rad: float, what: str) -> None:
    f, pieces = flown(PLAN, deploy)
    record = f.records[60]
    old = record.readings.position_rad
    new = old + np.array([by_rad, 0.0, 0.0, 0.0])
    spoilt, _ = tampered(pieces, old, new)
    done = replay(spoilt, f.plan, f.rig)
    assert done.cycles == 60
    assert {d.cycle for d in done.differences} == {record.index}
    assert done.differences[0].what == what
    assert any(d.what == "measured fold of c1" for d in done.differences)
    assert done.differences[0].time_s == pytest.approx(record.time_s - f.records[0].time_s)


def test_a_goal_that_was_tampered_with_is_found() -> None:
    f, pieces = flown(PLAN, deploy)
    goal = f.records[60].commanded_rad
    spoilt, _ = tampered(pieces, goal, goal + np.array([0.0, 1e-6, 0.0, 0.0]))
    done = replay(spoilt, f.plan, f.rig)
    assert (done.cycles, done.differences[0].what) == (60, "goal")
    assert "hinge 2" in done.differences[0].here


def test_bytes_that_were_spoilt_are_a_file_error_or_a_difference() -> None:
    f, pieces = flown(PLAN, begun)
    draw = random.Random(5)
    refused = different = 0
    for _ in range(25):
        k = draw.randrange(len(pieces))
        data = bytearray(pieces[k])
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        try:
            done = replay([*pieces[:k], bytes(data), *pieces[k + 1 :]], f.plan, f.rig)
        except FileError:
            refused += 1
        else:
            different += not done.same or done.gap != ""
    assert refused > 0
    assert different > 0


def test_a_stricter_limit_shows_what_would_have_happened() -> None:
    f, pieces = flown(PLAN, deploy)
    worst = max(abs(r.readings.position_rad - r.commanded_rad).max() for r in f.records) / 4.0
    strict = synthetic_rig(PLAN, controller={"path_tolerance_rad": 0.5 * worst, "goal_tolerance_rad": 0.5 * worst})
    done = replay(pieces, f.plan, strict)
    first = done.differences[0]
    assert first.what == "fault"
    assert first.here.startswith("path_tolerance of servo_c")
    assert first.logged == "none"
    assert 0 < done.cycles == first.cycle < len(f.records)
    assert ("state", "fault", "moving") in {(d.what, d.here, d.logged) for d in done.differences}


def test_a_gentler_ramp_sends_other_goals() -> None:
    f, pieces = flown(PLAN, hold_and_resume)
    slow = synthetic_rig(PLAN, controller={"hold_ramp_s": 1.0})
    done = replay(pieces, f.plan, slow)
    assert "goal" in {d.what for d in done.differences}


def test_a_rig_that_does_not_fit_is_refused() -> None:
    f, pieces = flown(PLAN, deploy)
    other = synthetic_plan(5)
    with pytest.raises(RigError):
        replay(pieces, f.plan, synthetic_rig(other))


@pytest.mark.parametrize("name", ["_trip", "nothing", "__class__"])
def test_a_tape_asks_for_nothing_but_commands(name: str) -> None:
    _, pieces = flown(PLAN, lambda f: f.controller.connect())
    tape = Tape()
    for _ in pieces:
        tape.take()
    tape.begun(name, (), {})
    with pytest.raises(FileError, match="does not have"):
        replay([*pieces, tape.take()], PLAN, synthetic_rig(PLAN))
