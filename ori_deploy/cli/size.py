"""`ori-deploy size`: what every driven hinge has to give along the motion, and what its actuator has."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.markup import escape
from rich.table import Table

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.frame import IN, console, warn
from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Design, load_design, load_loads, load_plan
from ori_deploy.loads import HingeTorques, Loads, Solids, hinge_torques
from ori_deploy.motion import Plan, mechanism_of

_POSES = 401


@dataclass(frozen=True)
class HingeSize:
    """One driven hinge at its worst place. Torques in N m, positive where they open the crease.

    Attributes
    ----------
    fold, time_s
        Where along the motion, and when by the plan; `time_s` is None without one.
    gravity, film, air, friction
        Parts of the torque at the crease.
    crease, shaft
        Largest torque at the crease and, through gear and efficiency, at the shaft; not negative.
    available
        The actuator's max_torque_nm.
    """

    hinge: str
    cell: str
    driven: str
    fold: float
    time_s: float | None
    gravity: float
    film: float
    air: float
    friction: float
    crease: float
    shaft: float
    available: float

    @property
    def share(self) -> float:
        """Part of the actuator's torque that is used."""
        return self.shaft / self.available

    @property
    def margin(self) -> float:
        """How many times over the torque is there."""
        return self.available / self.shaft if self.shaft > 0.0 else np.inf


def sizes(
    built: Design, rig: ResolvedRig, loads: Loads, plan: Plan | None = None, *, deployed: bool = False
) -> tuple[HingeSize, ...]:
    """Every driven hinge at its worst place along the motion, in the order of the cells.

    Parameters
    ----------
    deployed
        Only at fold 1, and not by a plan: air that blows at the deployed shape blows at no other.

    Raises
    ------
    InputError
        The loads do not fit the design.
    """
    linkage = mechanism_of(built.structure, built.unit_m)
    fold = np.ones(1) if deployed else np.linspace(0.0, 1.0, _POSES) if plan is None else plan.fold
    solids = Solids.of(built.structure, built.span_m, built.r_min_m)
    torques = hinge_torques(linkage, solids, loads, rig.crease_index, fold)
    return tuple(_at_worst(torques, rig, loads, cell, plan) for cell in range(len(rig.cell_ids)))


def _at_worst(torques: HingeTorques, rig: ResolvedRig, loads: Loads, cell: int, plan: Plan | None) -> HingeSize:
    worst = torques.worst[:, cell]
    at = int(np.argmax(np.where(np.isnan(worst), np.inf, worst)))
    hinge, actuator = rig.hinges[cell], rig.actuators[cell]
    crease = float(worst[at])
    return HingeSize(
        hinge=actuator.id,
        cell=hinge.cell,
        driven=hinge.crease,
        fold=float(torques.fold[at]),
        time_s=None if plan is None else float(plan.time_s[at]),
        gravity=float(torques.gravity[at, cell]),
        film=float(torques.film[at, cell]),
        air=float(torques.air[at, cell]),
        friction=float(torques.friction[at, cell]),
        crease=crease,
        shaft=crease / (hinge.gear_ratio * loads.efficiency),
        available=actuator.max_torque_nm,
    )


def given_loads(
    path: Path | None,
    film_um: float | None,
    density: float | None,
    clamp: str | None,
    gravity: tuple[float, float, float] | None,
    wind: tuple[float, float, float] | None,
    pressure: float | None,
) -> Loads:
    """The loads of a file, or the defaults, with what the command line says instead."""
    loads = Loads() if path is None else load_loads(path)
    for name, value in (("--film-um", film_um), ("--density", density)):
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise InputError(name, value=value, limit="0 or more", remedy="give a number of 0 or more")
    for name, vector in (("--gravity", gravity), ("--wind", wind), ("--pressure", pressure)):
        if vector is not None and not np.isfinite(vector).all():
            raise InputError(name, value=vector, limit="finite numbers", remedy="give finite numbers")
    if film_um is not None:
        loads = replace(loads, film=replace(loads.film, thickness_m=1e-6 * film_um))
    if wind is not None:
        loads = replace(loads, air=replace(loads.air, wind_m_s=wind))
    if pressure is not None:
        loads = replace(loads, air=replace(loads.air, pressure_pa=pressure))
    changed: dict[str, Any] = {"density_kg_m3": density, "clamp": clamp, "gravity_m_s2": gravity}
    return replace(loads, **{key: value for key, value in changed.items() if value is not None})


@click.command(epilog="\b\nExample:\n  ori-deploy size wing.design.json --rig examples/rig_mock.toml --clamp c1.cb")
@click.argument("design_file", metavar="DESIGN", type=IN)
@click.option("--rig", "rig_file", type=IN, required=True, help="Rig file: driven creases, gears, actuators.")
@click.option("--plan", "plan_file", type=IN, help="Plan file: look at its poses, and tell times.")
@click.option("--loads", "loads_file", type=IN, help="Loads file: masses, film, friction, air, clamp.")
@click.option("--film-um", type=float, help="Thickness of the film hinges.  [default: 50]")
@click.option("--density", type=float, help="Of the panels, kg/m3, infill counted.  [default: 300]")
@click.option("--clamp", help="Panel (c1.cb) or cell by which it is held.  [default: the first panel]")
@click.option("--gravity", type=(float, float, float), metavar="X Y Z", help="m/s2.  [default: 0 -9.81 0]")
@click.option("--wind", type=(float, float, float), metavar="X Y Z", help="Of the air, m/s.  [default: none]")
@click.option("--pressure", type=float, help="On the skin, outside less inside, Pa.  [default: 0]")
@click.option("--deployed", is_flag=True, help="Look only at the deployed pose: pressures of a wing that flies.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON: torques in N m at the worst place of every hinge.")
def size(
    design_file: Path,
    rig_file: Path,
    plan_file: Path | None,
    loads_file: Path | None,
    deployed: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Print the torque that every driven hinge of DESIGN needs along the motion.

    By virtual work: slow, all cells in step, slits open, held at one panel. Exit status 1 where an actuator's
    max_torque_nm is not enough.
    """
    if deployed and plan_file is not None:
        raise InputError("--deployed: one pose has no plan", limit="--deployed or --plan", remedy="leave one out")
    built = load_design(design_file)
    layout = built.structure.layout
    rig = resolve_rig(load_rig(rig_file), layout.cell_ids, layout.latch_points)
    plan = None if plan_file is None else load_plan(plan_file)
    if plan is not None and plan.design_sha256 != built.sha256:
        raise FileError(f"{plan_file}: made from another design", remedy=f"plan {design_file} again")
    loads = given_loads(
        loads_file, options["film_um"], options["density"], options["clamp"], options["gravity"], options["wind"],
        options["pressure"],
    )  # fmt: skip
    found = sizes(built, rig, loads, plan, deployed=deployed)
    if as_json:
        click.echo(json.dumps([_plain(each) for each in found], allow_nan=False))
    else:
        console.print(_table(built, found))
    weak = [each for each in found if not each.share <= 1.0]
    for each in weak:
        warn(
            f"{each.hinge} needs {each.shaft:.3g} N m at fold {each.fold:.3g} and has {each.available:.3g}: "
            "use a longer gear, another crease, a stronger servo, or another clamp"
        )
    if weak:
        raise SystemExit(1)


def _plain(each: HingeSize) -> dict[str, Any]:
    """For JSON: no infinities."""
    values = {**vars(each), "share": each.share, "margin": each.margin}
    return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in values.items()}


def _table(built: Design, found: tuple[HingeSize, ...]) -> Table:
    """One line per hinge; parts of the torque that are nowhere are left out."""
    columns: dict[str, list[str]] = {
        "hinge": [each.hinge for each in found],
        "drives": [f"{each.cell} {each.driven}" for each in found],
        "fold": [f"{each.fold:.3f}" for each in found],
        "s": [f"{each.time_s:.2f}" if each.time_s is not None else "" for each in found],
        "weight": [f"{each.gravity:.3f}" for each in found],
        "film": [f"{each.film:.3f}" for each in found],
        "air": [f"{each.air:.3f}" if each.air else "" for each in found],
        "rub": [f"{each.friction:.3f}" if each.friction else "" for each in found],
        "crease": [f"{each.crease:.3f}" for each in found],
        "shaft": [f"{each.shaft:.3f}" for each in found],
        "max": [f"{each.available:.3g}" for each in found],
        "of max": [f"{100.0 * each.share:.0f} %" for each in found],
        "spare": [f"{each.margin:.3g}" for each in found],
    }
    title = escape(f"{built.name}: torque, N m; max: max_torque_nm of the rig")
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 1, 0, 0))
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    for name in shown:
        table.add_column(name, justify="left" if name in ("hinge", "drives") else "right", no_wrap=True)
    for row in zip(*shown.values(), strict=True):
        table.add_row(*(escape(cell) for cell in row))
    return table
