"""What all commands share: one line for what is wrong, a quiet end when interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from ori_deploy.actuators.bus import BusClosed, CommandRefused
from ori_deploy.cli import main
from ori_deploy.cli.commands import ENTRIES
from ori_deploy.cli.frame import EXIT_STATUSES, Commands, nothing_moved
from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.errors import InputError, OriDeployError
from ori_deploy.operate.client import NoController


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("design", "."), "is a directory"),
        (("design", "a.toml", "--optimize", "--starts", "0"), "--starts"),
        (("design", "a.toml", "--nonsense"), "--nonsense"),
        (("poses", "a.json", "--fold", "x"), "--fold"),
        (("poses", "a.json"), "--fold"),
        (("figures", "--out", "x", "fig9"), "fig9"),
        (("desing",), "desing"),
        (("limit",), "SPEC"),
    ],
)
def test_words_that_click_refuses_are_one_line_like_all_other_errors(words: tuple[str, ...], why: str) -> None:
    done = CliRunner().invoke(main, list(words))
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert why in done.stderr
    assert f"remedy: see main{' ' + words[0] if words[0] != 'desing' else ''} --help" in done.stderr


@pytest.mark.parametrize("words", [["--help"], ["limit", "--help"], ["--version"]])
def test_help_is_no_error(words: list[str]) -> None:
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0
    assert done.stderr == ""


def test_the_list_of_commands_loads_none_of_them() -> None:
    code = (
        "import sys; from click.testing import CliRunner; from ori_deploy.cli import main;"
        "assert 'deploy' in CliRunner().invoke(main, ['--help']).output; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "pydantic", "matplotlib", "ori_deploy.motion", "ori_deploy.deploy.states"}


@pytest.mark.parametrize("name", ENTRIES)
def test_every_command_is_where_the_list_says_and_called_so(name: str) -> None:
    done = CliRunner().invoke(main, [name, "--help"], prog_name="ori-deploy")
    assert done.output.startswith(f"Usage: ori-deploy {name} "), done.output
    assert len(ENTRIES[name].line) < 64


class _Odd(OriDeployError):
    """Neither a refusal nor bad input: something may have moved."""


@pytest.mark.parametrize(
    ("wrong", "status"),
    [
        (InputError("x"), 2),
        (StartRefused("x"), 3),
        (CommandRefused("x"), 3),
        (NoController("x"), 3),
        (IllegalCommand(State.HOLD, "hold"), 3),
        (BusClosed("x"), 1),
        (_Odd("x"), 1),
    ],
)
def test_every_error_has_the_status_that_the_help_tells(wrong: OriDeployError, status: int) -> None:
    @click.command()
    def fails() -> None:
        raise wrong

    done = CliRunner().invoke(Commands("group", {"fails": fails}), ["fails"])
    assert (done.exit_code, done.stderr) == (status, f"error: {wrong}\n")
    page = CliRunner().invoke(main, ["--help"]).output
    assert f"\n  {status:<4} {EXIT_STATUSES[status]}"[:70] in page.replace("\n    ", "\n  ")


def test_what_fails_before_anything_can_move_is_a_refusal_and_bad_input_stays_that() -> None:
    for wrong, refused in ((BusClosed("x"), True), (InputError("x"), False), (StartRefused("x"), True)):
        with pytest.raises(OriDeployError) as caught, nothing_moved():
            raise wrong
        assert caught.value.refused == refused


def test_no_words_at_all_show_the_help() -> None:
    assert "Commands:" in CliRunner().invoke(main, []).output


def test_an_interrupt_while_loading_is_one_line(tmp_path: Path) -> None:
    """Python's import of numpy is held up on purpose; there the interrupt comes."""
    (tmp_path / "numpy.py").write_text("print('loading', flush=True)\nimport time\ntime.sleep(60)\n")
    process = subprocess.Popen(
        [sys.executable, "-m", "ori_deploy.cli", "limit", "--help"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "loading\n"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert (process.returncode, error) == (130, "interrupted\n")


def test_loading_leaves_interrupts_as_they_were() -> None:
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN) if sys.argv[1:] else None;"
        "before = signal.getsignal(signal.SIGINT); import ori_deploy.cli;"
        "assert signal.getsignal(signal.SIGINT) is before"
    )
    for words in ((), ("ignored",)):
        subprocess.run([sys.executable, "-c", code, *words], check=True, timeout=60)
