"""`ori-deploy replay`: a log decided again, with its own plan and rig or with others."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

import ori_deploy
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.flight import PLAN_NAME, RIG_NAME
from ori_deploy.cli.frame import EXIT_NOT_DONE, IN, warn
from ori_deploy.errors import FileError
from ori_deploy.files import load_plan
from ori_deploy.files.text import HeldFile
from ori_deploy.motion import Plan
from ori_deploy.telemetry.read import Recording, read_recording
from ori_deploy.telemetry.replay import Replay
from ori_deploy.telemetry.replay import replay as decide_again


@click.command(epilog="\b\nExample:\n  ori-deploy replay run.mcap --rig stricter.toml")
@click.argument("log", type=IN)
@click.option("--plan", "plan_file", type=IN, help="Plan file, instead of the one in the log.")
@click.option("--rig", "rig_file", type=IN, help="Rig file, instead of the one in the log.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document.")
def replay(log: Path, plan_file: Path | None, rig_file: Path | None, as_json: bool) -> None:
    """Run the measurements in LOG through the controller again, and see whether it decides the same.

    Ends with status 0 when all that was recorded is decided the same; with 1 when something is not, telling at which
    cycle and how, and when not all of it, or nothing, could be compared.
    """
    recording = read_recording(log)
    plan, rig = _inputs(log, recording, plan_file, rig_file)
    if recording.info["version"] != ori_deploy.__version__:
        warn(f"{log} was recorded by version {recording.info['version']}; this is {ori_deploy.__version__}")
    _check_buses(log, recording, rig)
    try:
        done = decide_again(recording.tape, plan, rig)
    except FileError as wrong:
        wrong.source = wrong.source or str(log)
        raise
    end = _End(done.gap, recording.unread, "the log is cut off there" if recording.cut_off else "")
    same = done.same and not end.left_out
    if as_json:
        click.echo(json.dumps(_document(done, end), allow_nan=False))
    else:
        click.echo("\n".join(_lines(done, end)))
    sys.exit(0 if same else EXIT_NOT_DONE)


@dataclass(frozen=True)
class _End:
    """Why a tape does not go on, in words or "".

    Attributes
    ----------
    gap
        Records are missing that came before others.
    unread
        What of the log could not be read: some of the tape may be in it.
    cut
        The session went on, and was not recorded.
    """

    gap: str
    unread: str
    cut: str

    @property
    def left_out(self) -> str:
        """What was recorded, as far as anybody knows, and could not be compared."""
        return "; ".join(filter(None, (self.gap, self.unread and f"in the log, {self.unread}")))

    def __str__(self) -> str:
        return self.left_out or self.cut


def _inputs(
    log: Path, recording: Recording, plan_file: Path | None, rig_file: Path | None
) -> tuple[Plan, ResolvedRig]:
    """Plan and rig, from the log where no file is given."""
    plan = load_plan(plan_file or _kept(log, recording, PLAN_NAME))
    rig = load_rig(rig_file or _kept(log, recording, RIG_NAME))
    return plan, resolve_rig(rig, plan.cell_ids, plan.latch_points)


def _kept(log: Path, recording: Recording, name: str) -> HeldFile:
    """A file that the log keeps; it is in no folder, and errors name it as what it is."""
    if name not in recording.files:
        raise FileError(
            f"{log}: holds no {name}", limit="a log with its plan and rig", remedy="give them with --plan and --rig"
        )
    data = recording.files[name].encode()
    kind = name.partition(".")[0]
    ran_with, found = str(recording.info[f"{kind}_sha256"]), hashlib.sha256(data).hexdigest()
    if ran_with not in ("", found):  # once, files were read again for the log, and pipes were empty by then
        raise FileError(
            f"{log}: its {name} is not the {kind} that moved the structure",
            value=found[:12],
            limit=f"{ran_with[:12]}, the one in use",
            remedy=f"give that one with --{kind}",
        )
    return HeldFile.of(f"{log}: its {name}", data)


def _check_buses(log: Path, recording: Recording, rig: ResolvedRig) -> None:
    """Refuse a rig of other actuators: what they measured cannot be handed on to these."""
    for key, ids in (("hinge_ids", rig.hinge_ids), ("latch_ids", rig.latch_ids)):
        if list(ids) != recording.info[key]:
            raise FileError(
                f"{log}: recorded on other actuators than this rig's",
                value=", ".join(recording.info[key]),
                limit=", ".join(ids),
                remedy="change limits and times of the rig, not its hinges and latches",
            )


def _lines(done: Replay, end: _End) -> list[str]:
    if done.nothing:
        return [f"nothing was compared: {str(end) or 'the tape ends before a command was over'}"]
    same = f"{done.cycles:,} cycles, {done.decisions:,} decisions, {done.commands} commands the same"
    if done.differences:
        first = done.differences[0]
        when = "" if math.isnan(first.time_s) else f", {first.time_s:.3f} s after the first"
        return [
            f"{same}; then it decides otherwise, in cycle {first.cycle}{when}:",
            *(f"  {difference}" for difference in done.differences),
        ]
    if done.gap:
        return [f"{same}; what follows was not compared: {end}"]
    if end.left_out:
        return [f"{same}; not all may have been compared: {end}"]
    return [f"{same}; {end}" if end.cut else same]


def _document(done: Replay, end: _End) -> dict[str, Any]:
    """Whether it is the same is null where nothing differs and not all of it was there to compare."""
    differences = [
        {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in asdict(d).items()}
        for d in done.differences
    ]
    unknown = not differences and (done.nothing or end.left_out)
    return {
        "same": None if unknown else done.same,
        "cycles": done.cycles,
        "decisions": done.decisions,
        "commands": done.commands,
        "differences": differences,
        "ends_early": str(end) or None,
    }
