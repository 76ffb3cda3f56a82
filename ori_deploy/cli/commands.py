"""The program: which commands there are. Each is loaded when it is called for, and no other."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import NamedTuple

import click

import ori_deploy
from ori_deploy.cli.frame import EXIT_STATUSES, Commands
from ori_deploy.cli.starting import quiet_interrupts


class Entry(NamedTuple):
    """Where a command is, as an attribute of a module in this room, and a line on what it does."""

    module: str
    attribute: str
    line: str


ENTRIES: Mapping[str, Entry] = MappingProxyType(
    {
        "aircraft": Entry("aircraft", "aircraft", "Print polar, trim, stability, endurance of an aircraft."),
        "bus": Entry("bus", "bus", "Find, name, calibrate and watch single Dynamixel servos."),
        "clear-fault": Entry("operate", "clear_fault", "Have a controller that serves forget its fault."),
        "demo": Entry("demo", "demo", "Design, plan, deploy and stow a simulated wing; report."),
        "deploy": Entry("motions", "deploy", "Carry PLAN out: unlock, open, latch."),
        "design": Entry("making", "design", "Build the structure that SPEC describes, or the best near it."),
        "doctor": Entry("doctor", "doctor", "Check port, servos or board, and rig; say what to do."),
        "estop": Entry("operate", "estop", "Stop a running motion as fast as can be, as a fault."),
        "export": Entry("export", "export", "Write DESIGN as parts to print, films to cut, models to load."),
        "figures": Entry("figures", "figures", "Make the paper's figures, with their data."),
        "gcs": Entry("gcs", "gcs", "Command a structure on a vehicle's MAVLink network."),
        "layouts": Entry("layouts", "layouts_command", "List and draw every layout of K cells."),
        "limit": Entry("limit", "limit", "Print how much packaging every further cell buys."),
        "mcu": Entry("mcu", "mcu", "Flash, configure and watch a microcontroller."),
        "pause": Entry("operate", "pause", "Bring a running motion to rest, and hold it there."),
        "plan": Entry("making", "plan", "Plan the deployment of DESIGN: check and time it."),
        "poses": Entry("making", "poses", "Print where every panel of DESIGN is at a fold state."),
        "recover": Entry("motions", "recover", "Bring cells that are out of step back onto the path."),
        "replay": Entry("replay", "replay", "Have the controller decide a LOG again, and compare."),
        "report": Entry("report", "report", "Make a page of figures from a flight LOG."),
        "resume": Entry("operate", "resume", "Go on with a motion that is paused."),
        "schema": Entry("schema", "schema", "Print the JSON Schema of a kind of file."),
        "serve": Entry("serve", "serve", "Stay, and take orders from a MAVLink network."),
        "size": Entry("size", "size", "Print the torque that every driven hinge of DESIGN needs."),
        "span-unfolded": Entry(
            "operate", "span_unfolded", "Give your word to a controller that serves: span unfolded."
        ),
        "status": Entry("operate", "status", "Tell what a running controller is doing."),
        "stop": Entry("operate", "stop", "Bring a running motion to rest and give it up."),
        "stow": Entry("motions", "stow", "Carry PLAN out backwards: unlatch, close."),
        "strip": Entry("strip", "strip", "Tell and draw what the antenna strip of DESIGN is."),
        "sweep": Entry("sweep", "sweep", "Make the designs of a grid, one row of a table each."),
        "view": Entry("view", "view", "Show a design, a plan or a flight log in the browser."),
    }
)


class Program(Commands):
    """The commands of `ENTRIES`: loading all of their rooms takes a second, and an emergency stop cannot wait."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return sorted(ENTRIES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        entry = ENTRIES.get(cmd_name)
        if entry is None:
            return None
        with quiet_interrupts():
            command = getattr(import_module(f"ori_deploy.cli.{entry.module}"), entry.attribute)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """From the lines in the table: nothing is loaded for them."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, ENTRIES[name].line) for name in sorted(ENTRIES)])


@click.group(
    cls=Program,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\b\nExit status:\n" + "\n".join(f"  {status:<4} {words}" for status, words in EXIT_STATUSES.items()),
)
@click.version_option(ori_deploy.__version__, prog_name="ori-deploy")
def main() -> None:
    """Deployable thick origami: design it, plan it, check it, deploy it.

    \b
    spec.toml -> design -> NAME.design.json -> plan -> NAME.plan.json -> deploy -> run.mcap -> report
    """
