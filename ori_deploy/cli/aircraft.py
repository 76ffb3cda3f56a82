"""`ori-deploy aircraft`: what flies on a deployable wing, figure by figure beside what was published."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count, groupby, product
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from ori_deploy.aero.assessment import Assessment, Fidelity, assessed, fidelity
from ori_deploy.aero.figures import Figure, all_figures
from ori_deploy.aero.pressure import SectionPressure, density_of, flight_loads, section_pressure
from ori_deploy.aero.remarks import remarks
from ori_deploy.aero.section import Section
from ori_deploy.cli.frame import IN, console
from ori_deploy.errors import InputError
from ori_deploy.files import load_aircraft, save_loads, write_atomically
from ori_deploy.files.aircraft_file import AircraftGiven

_OUT = click.Path(path_type=Path, dir_okay=False, writable=True, allow_dash=True)
_DOTS_PER_INCH = 150


@dataclass(frozen=True)
class Found:
    """All that is computed from an aircraft file.

    Attributes
    ----------
    pressures
        By the condition of flight: load factor and pressures of the section.
    """

    given: AircraftGiven
    assessment: Assessment
    built: Fidelity | None
    pressures: dict[str, tuple[float, SectionPressure]]

    @property
    def figures(self) -> tuple[Figure, ...]:
        return all_figures(self.assessment, self.built)

    @property
    def remarks(self) -> tuple[str, ...]:
        return remarks(self.assessment, self.built, tuple(p for _, p in self.pressures.values()))


def find(path: Path, *, for_loads: bool = False) -> Found:
    """Everything about the aircraft of a file.

    Parameters
    ----------
    for_loads
        Whether a structure is needed that bears loads.

    Raises
    ------
    InputError
        The file, or what it describes, cannot be used; a package is missing.
    """
    given = load_aircraft(path)
    if for_loads and given.built is None:
        raise InputError(
            "--loads-out: there is no structure that bears the loads", limit="a wing with a design",
            remedy="add wing.design to the aircraft file", source=str(path),
        )  # fmt: skip
    try:
        section = Section.of_profile(given.profile, given.section_name)
        found = assessed(given.craft, section)
        built = given.built
        faithful = None if built is None else fidelity(found, given.profile, built.structure, built.slit_gap_m)
        # Loads are told along the outline of the structure that bears them.
        outline = given.profile if built is None else built.structure.profile
        states = {"cruise": (1.0, found.wing_lift), "gust": (found.gust.carried, found.gust.lift)}
        pressures = {
            name: (
                factor, section_pressure(section, found.section_polar, outline, lift, given.craft.air.n_crit)
            )
            for name, (factor, lift) in states.items()
        }  # fmt: skip
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise
    return Found(given, found, faithful, pressures)


@click.command(
    epilog="\b\nExample:\n  ori-deploy aircraft examples/uav_table1.toml --plot polars.png --loads-out loads"
)
@click.argument("aircraft_file", metavar="AIRCRAFT", type=IN)
@click.option("--json", "json_file", type=_OUT, help="Write figures, polars and remarks as JSON; - prints them.")
@click.option("--plot", type=_OUT, help="Draw polars, pressures and the built section (PNG).")
@click.option(
    "--loads-out", type=click.Path(path_type=Path, file_okay=False),
    help="Write cruise.loads.toml and gust.loads.toml there, for `ori-deploy size --deployed`.",
)  # fmt: skip
def aircraft(aircraft_file: Path, json_file: Path | None, plot: Path | None, loads_out: Path | None) -> None:
    """Print polar, trim, stability, endurance and section of AIRCRAFT.

    Every figure with its method, beside what was published. Assumptions of the file are marked.
    """
    found = find(aircraft_file, for_loads=loads_out is not None)
    to_stdout = json_file is not None and str(json_file) == "-"
    if to_stdout:
        click.echo(json.dumps(_data(found), allow_nan=False))
    else:
        _tell(found)
    written = []
    if json_file is not None and not to_stdout:
        write_atomically(json_file, json.dumps(_data(found), allow_nan=False, indent=1) + "\n")
        written.append(json_file)
    if plot is not None:
        write_atomically(plot, _drawn(found))
        written.append(plot)
    if loads_out is not None:
        written += _write_loads(found, loads_out, aircraft_file)
    if to_stdout:
        return
    for path in written:
        console.print(f"written {path}", markup=False, soft_wrap=True)


def _tell(found: Found) -> None:
    figures, craft = found.figures, found.given.craft
    marks = dict(zip(craft.assumed, _letters(), strict=False))
    console.print(_table(craft.name, figures, marks))
    if craft.published.source:
        console.print(f"published: {craft.published.source}", markup=False)
    used = [key for key in craft.assumed if any(key in f.assumed for f in figures)]
    if used:
        console.print("assumed: " + ", ".join(f"{marks[k]} {k}" for k in used), markup=False)
    for remark in found.remarks:
        console.print(f"\n{remark}", markup=False)


def _table(name: str, figures: tuple[Figure, ...], marks: dict[str, str]) -> Table:
    table = Table(title=escape(name), title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0))
    for column in ("", "value", "unit", "method", "published", "off by", "assumed"):
        numbers = column in ("value", "published", "off by")
        table.add_column(column, justify="right" if numbers else "left", no_wrap=True)
    for group, rows in groupby(figures, lambda f: f.group):
        table.add_row(f"[bold]{escape(group)}[/bold]")
        for f in rows:
            table.add_row(
                escape(f.quantity), number(f.value), f.unit, escape(f.method), published(f), difference(f),
                _marked(f.assumed, marks),
            )  # fmt: skip
    return table


def _letters() -> Iterator[str]:
    """a, b, …, z, aa, ab, …"""
    for length in count(1):
        yield from map("".join, product(ascii_lowercase, repeat=length))


def _marked(keys: tuple[str, ...], marks: dict[str, str]) -> str:
    used = sorted({marks[k] for k in keys}, key=lambda mark: (len(mark), mark))
    return ("" if all(len(mark) == 1 for mark in used) else " ").join(used)


def number(value: float) -> str:
    """Three or four digits that tell figures apart; whole numbers from a thousand on."""
    if abs(value) >= 1000.0:
        return f"{value:,.0f}"
    return f"{value:.4f}" if abs(value) < 0.1 else f"{value:.3f}" if abs(value) < 10.0 else f"{value:.1f}"


def published(figure: Figure) -> str:
    """The published figure; empty where there is none."""
    said = figure.published
    if said is None:
        return ""
    return "-".join(f"{s:g}" for s in said) if isinstance(said, tuple) else f"{said:.3g}"


def difference(figure: Figure) -> str:
    """Of the figure from the published one, in per cent of that."""
    off = figure.difference
    if off is None:
        return ""
    return (
        "within"
        if isinstance(figure.published, tuple) and off == 0.0
        else f"{100.0 * off:+.0f}%"
        if abs(off) >= 1.0
        else f"{100.0 * off:+.1f}%"
    )


def _data(found: Found) -> dict[str, Any]:
    """For JSON: everything in SI but what a unit says otherwise."""
    ways = (found.assessment.lattice, found.assessment.build_up)
    return {
        "schema": "ori-deploy/aircraft-figures/1",
        "name": found.given.craft.name,
        "source": found.given.craft.published.source,
        "figures": [
            {**vars(f), "published": f.published, "difference": f.difference, "assumed": list(f.assumed)}
            for f in found.figures
        ],
        "polars": {
            way.name: {
                "alpha_rad": way.sweep.alpha_rad.tolist(),
                "lift": way.sweep.lift.tolist(),
                "drag": way.sweep.drag.tolist(),
                "fit": vars(way.sweep.polar),
                "misfit": way.sweep.misfit,
            }
            for way in ways
        },
        "remarks": list(found.remarks),
    }


def _drawn(found: Found) -> bytes:
    from ori_deploy.view.polar_sheet import draw_polars

    pressures = [(name, each) for name, (_, each) in found.pressures.items()]
    figure = draw_polars(found.assessment, found.built, pressures)
    page = io.BytesIO()
    figure.savefig(page, format="png", dpi=_DOTS_PER_INCH)
    return page.getvalue()


def _write_loads(found: Found, folder: Path, source: Path) -> list[Path]:
    """Loads files of the deployed wing at cruise and in the gust."""
    craft, built = found.given.craft, found.given.built
    assert built is not None
    mass = craft.wing.mass_kg
    density = None if mass is None else density_of(mass, float(built.structure.panel_areas.sum()), built.span_m)
    written = []
    for name, (factor, pressure) in found.pressures.items():
        path = folder / f"{name}.loads.toml"
        head = (
            f"{craft.name}, {name}: {factor:.3f} times its weight, C_l {pressure.lift:.3f} at "
            f"{craft.cruise_m_s:g} m/s; made by ori-deploy aircraft {source.name}.",
            "Pressures are those of the deployed section: ori-deploy size DESIGN --deployed --loads THIS_FILE",
        )
        save_loads(flight_loads(craft, pressure, factor, density, built.clamp), path, head)
        written.append(path)
    return written
