"""The physics plant of a design: `python -m sim_backends.plant DESIGN --rig RIG`, `… --mjcf FILE`.

Simulated servos of every bus can drive it: `plant` under `[mock]` in a rig, `--plant DESIGN` of the virtual
buses. MuJoCo is an extra: `pip install 'ori-deploy[physics]'`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.errors import InputError, OriDeployError
from ori_deploy.files import Design, load_design, load_loads, write_atomically
from ori_deploy.loads import Loads
from sim_backends.physics.model import mjcf
from sim_backends.physics.plant import Plant, drives_of, plant_of
from sim_backends.physics.trial import Trial, deploy_slowly

__all__ = ["Plant", "main", "mjcf", "plant_for_files", "plant_for_rig", "plant_of"]

EXIT_BAD_INPUT = 2


def plant_for_files(
    design_file: Path, loads_file: Path | None, rig: ResolvedRig, crease_rad: ArrayLike, play_rad: float = 0.0
) -> Plant:
    """The plant of a design file, driven as a rig says, at inner angles (n_cells, 4).

    Raises
    ------
    InputError
        A file cannot be used, they do not belong together, or MuJoCo is missing.
    """
    loads = None if loads_file is None else load_loads(loads_file)
    return plant_of(load_design(design_file), rig, loads, crease_rad=crease_rad, play_rad=play_rad)


def plant_for_rig(rig: ResolvedRig, crease_rad: ArrayLike) -> Plant:
    """The plant that `[mock]` of a rig names, at inner angles (n_cells, 4). Raises as `plant_for_files`."""
    folder = Path(rig.source).parent if rig.source is not None else Path()
    mock = rig.mock
    if mock.plant is None:
        raise InputError("mock.plant: the rig names none", remedy="name a design file", source=rig.source)
    loads = None if mock.loads is None else folder / mock.loads
    return plant_for_files(folder / mock.plant, loads, rig, crease_rad, mock.backlash_rad)


def _tell(design: Design, plant: Plant, seen: Trial) -> None:
    click.echo(f"{design.name}: largest torque at the driven creases, N m, in {plant.world.time_s:.3g} s")
    low, high = float(seen.fold.min()), float(seen.fold.max())
    click.echo(f"compared from fold {low:.3f} to {high:.3f}; of what lies beyond `ori-deploy size` alone tells")
    click.echo(f"{'hinge':<12} {'plant':>8} {'size':>8} {'apart':>8}")
    apart = np.abs(seen.torque_nm - seen.sized_nm).max(axis=0)
    for k, drive in enumerate(plant.world.model.drives):
        most, sized = np.abs(seen.torque_nm[:, k]).max(), np.abs(seen.sized_nm[:, k]).max()
        click.echo(f"{drive.name:<12} {most:8.3f} {sized:8.3f} {apart[k]:8.3f}")
    for slit, gap in zip(plant.world.model.slits, seen.slit_gap_m, strict=True):
        click.echo(f"{slit.point}: open by {1e3 * gap:.3g} mm")
    work = seen.work
    click.echo(
        f"energy: gained {seen.gained_j:.4g} J, motors {work.motors:.4g}, air {work.air:.4g}, "
        f"magnets {work.magnets:.4g}, friction {-work.lost:.4g}, unexplained {seen.unexplained_j:.2g}"
    )
    click.echo(f"loops apart by {1e6 * seen.loop_gap_m:.2g} um at most; {seen.contacts} contacts at most")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("design_file", metavar="DESIGN", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--rig", "rig_file", type=click.Path(path_type=Path, dir_okay=False), help="Rig file: what is driven.")
@click.option("--loads", "loads_file", type=click.Path(path_type=Path, dir_okay=False), help="Loads file.")
@click.option("--mjcf", "mjcf_file", type=click.Path(path_type=Path, dir_okay=False), help="Write the model as MJCF.")
@click.option("--seconds", type=click.FloatRange(0.1, 600.0), default=10.0, show_default=True, help="Of the motion.")
@click.option("--contact/--no-contact", default=True, show_default=True, help="Whether panels push each other.")
def main(
    design_file: Path, rig_file: Path | None, loads_file: Path | None, mjcf_file: Path | None, seconds: float,
    contact: bool,
) -> None:  # fmt: skip
    """Deploy DESIGN slowly in MuJoCo, and compare its hinges' torques with those of `ori-deploy size`.

    \b
    Examples:
      python -m sim_backends.plant wing.design.json --rig examples/rig_mock.toml
      python -m sim_backends.plant wing.design.json --mjcf wing.xml
    """
    try:
        if rig_file is None and mjcf_file is None:
            raise InputError("nothing to do", limit="--rig or --mjcf", remedy="give one of them")
        design = load_design(design_file)
        loads = Loads() if loads_file is None else load_loads(loads_file)
        layout = design.structure.layout
        rig = None if rig_file is None else resolve_rig(load_rig(rig_file), layout.cell_ids, layout.latch_points)
        if mjcf_file is not None:
            write_atomically(mjcf_file, mjcf(design, loads, () if rig is None else drives_of(rig)))
            click.echo(f"written {mjcf_file}")
        if rig is not None:
            plant = plant_of(design, rig, loads, contact=contact)
            _tell(design, plant, deploy_slowly(plant, seconds))
    except OriDeployError as wrong:
        click.echo(f"error: {wrong}", err=True)
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
