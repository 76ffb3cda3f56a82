"""Commands run in this process against servos that run in another."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from ori_deploy.cli import main
from sim_backends.dynamixel_bus import BusSpec, ServoSpec, VirtualBus
from tests.cli.inside import run

BAUD = 1_000_000
EXAMPLES = Path(__file__).parents[2] / "examples"


def virtual_bus(folder: Path, *servos: ServoSpec, **words: Any) -> VirtualBus:
    """A bus that answers as fast as it can, behind a link in `folder`."""
    return VirtualBus(BusSpec(servos=servos, wire_timing=False, **words), folder / "tty")


def command(*words: object, answer: str | None = None) -> Result:
    """A command of `ori-deploy`, with what is typed at its questions."""
    return CliRunner().invoke(main, [str(word) for word in words], input=answer)


def bus_command(name: str, bus: VirtualBus, *words: object, answer: str | None = None, baud: int = BAUD) -> Result:
    """A command of `ori-deploy bus` at one rate."""
    return command("bus", name, *words, "--port", bus.link, "--baud", baud, answer=answer)


def document(result: Result) -> Any:
    """What a command with --json told: standard output is one document and nothing else."""
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def is_one_line(result: Result, *parts: str) -> None:
    """An error is one line on the error stream that says all of these."""
    errors = [line for line in result.stderr.splitlines() if "error: " in line]
    assert len(errors) == 1, result.output
    assert "Traceback" not in result.output
    for part in parts:
        assert part in errors[0]


class Running:
    """A command in a process of its own, to be interrupted; for `with`."""

    def __init__(self, *words: object, cwd: Path) -> None:
        line = [sys.executable, "-m", "ori_deploy.cli", *(str(word) for word in words)]
        self._process = subprocess.Popen(
            line,
            cwd=cwd,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def line(self) -> str:
        """The next line on standard output."""
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], 60.0)
        return self._process.stdout.readline() if ready else ""

    @property
    def alive(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    def interrupt(self) -> tuple[int, str, str]:
        """Press Ctrl-C; exit status, standard output and errors."""
        self._process.send_signal(signal.SIGINT)
        return self.end()

    def end(self) -> tuple[int, str, str]:
        """Wait for its end; exit status, standard output and errors."""
        out, err = self._process.communicate(timeout=60.0)
        return self._process.returncode, out, err


@contextmanager
def simulator(line: str, folder: Path) -> Iterator[str]:
    """A simulator by the command of an example, and the first line it says; it ends well when it is told to."""
    words = line.replace("python ", f"{sys.executable} ").split()
    with subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline()
            process.terminate()
            assert process.wait(30.0) == 0
        finally:
            process.kill()


def patient_wing(folder: Path, *, slack_s: float, watchdog_s: float, lost: int) -> Path:
    """A plan of the example wing in `folder`, and beside it `rig.toml`, which is patient.

    The machine that runs the tests has other things to do as well.
    """
    text = (EXAMPLES / "rig_wing_dynamixel.toml").read_text()
    for before, after in (
        ("watchdog_s = 0.08 ", f"reply_slack_s = {slack_s}\nwatchdog_s = {watchdog_s} "),
        ("[controller]\n", f"[controller]\nlost_replies_allowed = {lost}\n"),
    ):
        assert before in text
        text = text.replace(before, after)
    (folder / "rig.toml").write_text(text)
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "w.design.json", cwd=folder).returncode == 0
    done = run("plan", "w.design.json", "--rig", "rig.toml", "-o", "w.plan.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "w.plan.json"
