"""Interrupts before anything could move: whoever swallows them, nothing moves afterwards."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import click
import pytest

from ori_deploy.cli import bus_common, main, session
from ori_deploy.cli.bus_common import confirm
from ori_deploy.cli.frame import Heeding
from ori_deploy.cli.session import StopRequest
from ori_deploy.cli.starting import answer_interrupt, remembered_interrupts
from ori_deploy.deploy.controller import Controller
from tests.cli.inside import run

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(params=["default", "ignored"])
def as_begun(request: pytest.FixtureRequest) -> Iterator[Any]:
    """What SIGINT means when a command starts: as a terminal has it, and as a script has it for a job behind `&`."""
    handler = signal.default_int_handler if request.param == "default" else signal.SIG_IGN
    before = signal.signal(signal.SIGINT, handler)
    yield handler
    assert signal.getsignal(signal.SIGINT) is handler
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("starting")
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "wing.design.json", cwd=folder).returncode == 0
    assert run("plan", "wing.design.json", "--rig", RIG, "-o", "wing.plan.json", cwd=folder).returncode == 0
    return folder


def swallowing(call: Callable[..., Any]) -> Callable[..., Any]:
    """The same call, in which an interrupt comes and is lost, as in a library that catches all there is."""

    def swallowed(*given: Any, **named: Any) -> Any:
        with suppress(BaseException):
            signal.raise_signal(signal.SIGINT)
        return call(*given, **named)

    return swallowed


@pytest.mark.usefixtures("as_begun")
@pytest.mark.parametrize("command", ["deploy", "stow", "demo"])
def test_an_interrupt_that_is_swallowed_while_files_are_read_keeps_everything_where_it_is(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """Reproduced: pydantic lost a Ctrl-C while it read a rig, and the structure was moved."""

    def connected(_: Controller) -> None:
        raise AssertionError("it went on")

    monkeypatch.setattr(session, "load_rig", swallowing(session.load_rig))
    monkeypatch.setattr(Controller, "connect", connected)
    line = ("demo", "-o", "out") if command == "demo" else (command, made / "wing.plan.json", "--rig", RIG)
    done = run(*line, cwd=tmp_path)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1] == "interrupted"


@pytest.mark.usefixtures("as_begun")
@pytest.mark.parametrize("yes", [True, False])
def test_nothing_is_made_limp_after_an_interrupt_that_was_swallowed(yes: bool) -> None:
    """Reproduced: `bus calibrate --yes` let all servos go, and was interrupted at the first hinge."""
    with remembered_interrupts():
        swallowing(int)()
        with pytest.raises(KeyboardInterrupt):
            confirm("Torque off?", yes=yes)


def test_an_interrupt_at_a_question_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reproduced: with standard input a pipe, it was taken for its end, and told as a no."""

    def asked(*_: Any, **__: Any) -> bool:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise click.Abort from None

    monkeypatch.setattr(bus_common.click, "confirm", asked)
    with pytest.raises(click.Abort):
        confirm("Torque off?", yes=False)


@pytest.mark.usefixtures("as_begun")
def test_what_was_remembered_is_answered_once() -> None:
    with remembered_interrupts():
        swallowing(int)()
        with pytest.raises(KeyboardInterrupt):
            answer_interrupt()
        answer_interrupt()
        swallowing(int)()
    with remembered_interrupts(), StopRequest() as stop:  # one of another command
        assert not stop.requested


@pytest.mark.usefixtures("as_begun")
def test_a_stop_request_that_does_not_begin_leaves_signals_as_they_were() -> None:
    with remembered_interrupts():
        before = {number: signal.getsignal(number) for number in StopRequest.SIGNALS}
        swallowing(int)()
        with pytest.raises(KeyboardInterrupt), StopRequest():
            raise AssertionError
        assert {number: signal.getsignal(number) for number in StopRequest.SIGNALS} == before


def test_other_threads_have_no_interrupts_to_remember() -> None:
    ended = []

    def in_thread() -> None:
        with remembered_interrupts():
            ended.append(True)

    thread = threading.Thread(target=in_thread)
    thread.start()
    thread.join()
    assert ended


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_a_loop_with_something_to_say_is_not_broken_by_a_closed_error_stream(closed: str, tmp_path: Path) -> None:
    """Reproduced: somebody paused a motion, nowhere to say so was a TypeError in the loop, and that a fault."""
    said = "from ori_deploy.cli import main, operating; import os, sys; operating._say('paused'); sys.stderr.flush();"
    said += "os.mkdir('said')"
    line = f"{shlex.quote(sys.executable)} -c {shlex.quote(said)} {closed}"
    assert subprocess.run(line, shell=True, cwd=tmp_path, check=False).returncode == 0
    assert (tmp_path / "said").is_dir()


def leaves(command: click.Command, name: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    if isinstance(command, click.Group):
        context = click.Context(command)
        for sub in command.list_commands(context):
            found = command.get_command(context, sub)
            assert found is not None
            yield from leaves(found, (*name, sub))
    else:
        yield name, command


def answers(function: FunctionType, seen: set[CodeType]) -> bool:
    """Whether a command's code, or what it calls in its room, asks for interrupts that were lost."""
    pending = [function.__code__]
    while pending:
        code = pending.pop()
        if code in seen:
            continue
        seen.add(code)
        pending += [const for const in code.co_consts if isinstance(const, CodeType)]
        for name in code.co_names:
            named = function.__globals__.get(name)
            if named in (StopRequest, confirm):
                return True
            here = isinstance(named, FunctionType) and named.__module__.startswith("ori_deploy.cli")
            if here and answers(named, seen):
                return True
    return False


def test_every_command_that_moves_or_makes_limp_heeds_interrupts_from_its_begin() -> None:
    found = {name for name, leaf in leaves(main) if answers(leaf.callback, set())}  # type: ignore[arg-type]
    heeding = {name for name, leaf in leaves(main) if isinstance(leaf, Heeding)}
    assert found == heeding
    benches = {(room, what) for room in ("bus", "mcu") for what in ("jog", "torque-off")}
    assert benches | {("deploy",), ("serve",)} <= found
