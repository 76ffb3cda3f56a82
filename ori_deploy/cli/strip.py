"""`ori-deploy strip`: the antenna strip of a design, unrolled."""

from __future__ import annotations

from pathlib import Path

import click

from ori_deploy.cli.frame import print_table
from ori_deploy.cli.steps import refuse_overwriting
from ori_deploy.errors import FileError, StripError
from ori_deploy.files import load_design, write_atomically
from ori_deploy.files.strip_entry import strip_data


@click.command(
    help="Tell what the antenna strip of DESIGN is made of, and draw it unrolled: what to cut, where it folds, where "
    "it parts from panel to panel and how far.",
    epilog="\b\nExample:\n  ori-deploy strip antenna_helix.design.json --draw strip.svg",
)
@click.argument("design_file", metavar="DESIGN", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--draw", type=click.Path(path_type=Path, dir_okay=False), help="Drawing to write, .svg or .png.")
def strip(design_file: Path, draw: Path | None) -> None:
    built = load_design(design_file)
    if built.strip is None:
        raise StripError(
            f"{design_file}: this design carries no strip", remedy="add [strip] to the specification and design again"
        )
    if draw is not None and draw.suffix not in (".svg", ".png"):
        raise FileError(f"{draw}: --draw", value=draw.suffix, limit=".svg | .png", remedy="choose another name")
    told = strip_data(built.strip, built.structure, built.r_min_m, built.r_max_m)["strip"]
    crossed = [joint for joint in told["joints"] if joint["crossings"]]
    parting = [joint for joint in crossed if joint["kind"] == "part"]
    widest = max(parting, key=lambda joint: float(joint["largest_gap_m"]), default=None)
    cuts, folds = (sum(j["crossings"] for j in crossed if j["kind"] == kind) for kind in ("part", "fold"))
    rows = [
        ("turns", f"{told['turns']:g}"),
        ("length", f"{1e3 * told['length_m']:.1f} mm"),
        ("area", f"{1e4 * told['area_m2']:.2f} cm2"),
        ("pieces", f"{len(told['pieces'])}, {folds} folds, {cuts} cuts between them"),
    ]
    if widest is not None:
        gap_mm = 1e3 * widest["largest_gap_m"]
        rows.append(("widest gap", f"{gap_mm:.1f} mm at {widest['at']}, on the way; {_flat(parting)} when flat"))
    if draw is not None:
        from ori_deploy.view.development import draw_development
        from ori_deploy.view.sheet import to_png, to_svg

        refuse_overwriting(draw, design_file)
        figure = draw_development(built.strip.lay(built.structure, built.r_min_m, built.r_max_m), built.structure)
        write_atomically(draw, to_svg(figure) if draw.suffix == ".svg" else to_png(figure))
        rows.append(("written", str(draw)))
    print_table(f"{built.name}: {told['kind']} strip", rows)


def _flat(parting: list[dict[str, float]]) -> str:
    return f"{1e3 * max(joint['flat_gap_m'] for joint in parting):.1f} mm"
