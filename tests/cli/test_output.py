"""Standard output that cannot be written, or that nobody reads, is an end of its own, and never a traceback."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from ori_deploy.cli import output
from ori_deploy.cli.frame import EXIT_STATUSES, Commands, console
from ori_deploy.cli.output import EXIT_UNHEARD, EXIT_UNTOLD, told

FULL = f"error: standard output cannot be written: {os.strerror(errno.ENOSPC)}; remedy: give it a file with room\n"


class Broken(io.StringIO):
    """A stream that fails when it is handed on, and keeps what it could not hand on."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def flush(self) -> None:
        if self.getvalue():
            raise OSError(self._number, os.strerror(self._number))


def ended(run: Callable[[], Any], number: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """The status of a command with such an output."""

    @click.command()
    def command() -> None:
        run()

    broken = Broken(number)
    monkeypatch.setattr(sys, "stdout", broken)
    with pytest.raises(SystemExit) as end:
        Commands("group", {"x": command}).main(["x"])
    assert sys.stdout is broken
    assert isinstance(end.value.code, int)
    return end.value.code


def echoed_and_left(status: int) -> None:
    click.echo("it decides otherwise")
    sys.exit(status)


@pytest.mark.parametrize(
    "run",
    [
        lambda: click.echo("x"),
        lambda: print("x"),
        lambda: console.print("x"),
        lambda: echoed_and_left(0),
        lambda: echoed_and_left(1),  # it did not come to say so
    ],
)
def test_a_full_output_is_one_line_and_a_status_of_its_own(
    run: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(run, errno.ENOSPC, monkeypatch) == EXIT_UNTOLD
    assert capsys.readouterr().err == FULL


def test_an_output_that_nobody_reads_is_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(lambda: click.echo("x"), errno.EPIPE, monkeypatch) == EXIT_UNHEARD
    assert capsys.readouterr().err == ""


def test_what_failed_before_keeps_its_status(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> None:
        print("x")  # handed on at the end only
        sys.exit(3)

    assert ended(fails, errno.ENOSPC, monkeypatch) == 3


def test_who_goes_on_without_an_output_has_done_what_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def motion() -> None:
        try:
            click.echo("moving")
        except OSError:
            return

    assert ended(motion, errno.ENOSPC, monkeypatch) == 0


def test_errors_of_other_files_are_no_matter_of_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> int:
        raise OSError(errno.ENOSPC, "some other file")

    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    with pytest.raises(OSError, match="some other file"):
        told(fails)
    assert sys.stdout is stream


def test_no_output_at_all_is_nothing_to_complain_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert output.told(lambda: 3) == 3


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_process_with_such_an_output_ends_as_the_help_tells(unbuffered: str) -> None:
    words = [sys.executable, "-m", "ori_deploy.cli", "--help"]
    env = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, env=env, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (EXIT_UNTOLD, FULL)
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True, env=env, timeout=60, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (EXIT_UNHEARD, "")
    assert {EXIT_UNTOLD, EXIT_UNHEARD} < EXIT_STATUSES.keys()
