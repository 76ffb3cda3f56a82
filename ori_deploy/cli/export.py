"""`ori-deploy export`: parts to print, films to cut, models for other programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import click

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.frame import EXIT_NOT_DONE, IN, OUT, print_table, warn
from ori_deploy.cli.staging import Staging, refuse_current, refuse_entangled
from ori_deploy.cli.steps import refuse_overwriting
from ori_deploy.errors import InputError
from ori_deploy.export.bodies import Bodies, Drive, plain_meshes
from ori_deploy.export.fold import FRAMES, write_fold
from ori_deploy.export.parts import Parts, build_parts
from ori_deploy.export.parts_spec import PartsSpec, load_parts_spec
from ori_deploy.export.sheets import Sheet, sheets_of
from ori_deploy.files import Design, load_design
from ori_deploy.motion import CREASES

FOLDER = click.Path(path_type=Path, file_okay=False)
TABLE = click.Path(path_type=Path, dir_okay=False, allow_dash=True)

Row = tuple[str, str]
"""What was made, and where it is."""


@dataclass(frozen=True)
class Job:
    """A design and what is asked of it; what several formats share is made once, when the first wants it."""

    design: Design
    spec: PartsSpec
    rig: ResolvedRig | None
    plain: bool
    frames: int

    @cached_property
    def _made(self) -> Parts:
        """Parts, for themselves or for films."""
        hinges = () if self.rig is None else self.rig.hinges
        driven = {hinge.cell: hinge.crease for hinge in hinges}
        return build_parts(self.design, self.spec, driven=driven, plain=self.plain)

    @cached_property
    def parts(self) -> Parts:
        """Printable parts."""
        return self._made

    @property
    def remarks(self) -> tuple[str, ...]:
        """What did not fit, of all that was asked for, each once: parts tell of their films, too."""
        made = vars(self)  # cached properties: nothing is made for this
        parts = made["parts"].remarks if "parts" in made else ()
        sheets: tuple[Sheet, ...] = made.get("sheets", ())
        told = (*parts, *(remark for sheet in sheets for remark in sheet.remarks))
        return tuple(dict.fromkeys(str(remark) for remark in told))

    @cached_property
    def sheets(self) -> tuple[Sheet, ...]:
        """Films."""
        return sheets_of(self._made)

    @cached_property
    def bodies(self) -> Bodies:
        """For models."""
        return Bodies(self.design, plain_meshes(self.design), self.spec.material.density_kg_m3, self._drives())

    def _drives(self) -> tuple[Drive, ...]:
        if self.rig is None:
            return ()
        velocity, _ = self.rig.crease_limits()
        return tuple(
            Drive(
                actuator.id,
                CREASES.index(hinge.crease),
                actuator.max_torque_nm * hinge.gear_ratio,
                float(velocity[cell, CREASES.index(hinge.crease)]),
                hinge.direction * hinge.gear_ratio,
            )
            for cell, (hinge, actuator) in enumerate(zip(self.rig.hinges, self.rig.actuators, strict=True))
        )


def _stl(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.mesh_files import write_stl

    return f"{len(write_stl(job.parts, staging.folder(target)))} parts, mm"


def _3mf(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.mesh_files import write_3mf

    placed = write_3mf(job.parts, staging.file(target))
    plates = max((item.plate for item in placed), default=-1) + 1
    too_big = sum(not item.fits for item in placed)
    bed = f"; {too_big} do not fit the bed (--check says what helps)" if too_big else ""
    return f"{len(placed)} parts on {plates} plates, mm{bed}"


def _step(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.step_file import write_step

    write_step(job.parts, staging.file(target))
    return f"{len(job.parts.parts)} parts, mm"


def _dxf(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.sheet_files import dxf_bytes

    folder = staging.folder(target)
    for sheet in job.sheets:
        (folder / f"{sheet.id}.dxf").write_bytes(dxf_bytes(sheet))
    return f"{len(job.sheets)} films, mm"


def _svg(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.sheet_files import svg_text

    folder = staging.folder(target)
    for sheet in job.sheets:
        (folder / f"{sheet.id}.svg").write_text(svg_text(sheet), encoding="utf-8")
    return f"{len(job.sheets)} films, mm"


def _fold(job: Job, staging: Staging, target: Path) -> str:
    write_fold(job.design, staging.file(target), job.frames)
    return f"{job.frames} frames, m"


def _urdf(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.urdf import mesh_folder, urdf_model

    model = urdf_model(job.bodies, mesh_folder(target))
    staging.file(target).write_text(model.xml, encoding="utf-8")
    folder = staging.folder(target.parent / mesh_folder(target))
    for name, content in model.meshes.items():
        (folder / Path(name).name).write_bytes(content)
    return f"{len(job.bodies.tree.joints)} joints, meshes in {mesh_folder(target)}"


def _mjcf(job: Job, staging: Staging, target: Path) -> str:
    from ori_deploy.export.mjcf import write_mjcf

    write_mjcf(job.bodies, staging.file(target))
    return f"{len(job.bodies.tree.joints)} joints, {len(job.bodies.tree.loops)} loops"


_WRITERS: dict[str, Callable[[Job, Staging, Path], str]] = {
    "stl": _stl, "3mf": _3mf, "step": _step, "dxf": _dxf, "svg": _svg, "fold": _fold, "urdf": _urdf, "mjcf": _mjcf,
}  # fmt: skip
"""How each format is written; they say what they wrote."""


@click.command(
    epilog="\b\nExample:\n"
    "  ori-deploy export wing.design.json --3mf wing.3mf --dxf films --bom - --rig examples/rig_mock.toml\n"
    "  ori-deploy export wing.design.json --fold wing.fold --urdf wing.urdf --mjcf wing.xml"
)
@click.argument("design_file", metavar="DESIGN", type=IN)
@click.option("--stl", type=FOLDER, help="One STL per part, where it is when deployed; mm.")
@click.option("--3mf", "threemf", type=OUT, help="All parts by name, laid on build plates; mm.")
@click.option("--step", type=OUT, help="All parts as solids for CAD; mm. Wants the extra `cad`.")
@click.option("--dxf", type=FOLDER, help="Films of the creases to cut, one sheet each; mm.")
@click.option("--svg", type=FOLDER, help="The same as drawings, true to size.")
@click.option("--fold", type=OUT, help="FOLD 1.2: the motion in frames from deployed to flat; m.")
@click.option("--urdf", type=OUT, help="A tree of links, meshes in a folder beside it; m.")
@click.option("--mjcf", type=OUT, help="A model for MuJoCo, its loops closed; m.")
@click.option("--parts", "parts_file", type=IN, help="Parts file: film, magnets, horns, clearances, printer.")
@click.option("--rig", "rig_file", type=IN, help="Rig file: which creases are driven, by what.")
@click.option("--plain", is_flag=True, help="Parts without pockets, recesses, clearance and numbers.")
@click.option("--frames", type=click.IntRange(2, 1001), help="Of the FOLD file.  [default: 21]")
@click.option("--bom", type=TABLE, help="Bill of materials and mass: JSON, or - for a table here.")
@click.option("--check", is_flag=True, help="Check that parts can be printed; exit status 1 where one cannot.")
def export(
    design_file: Path,
    parts_file: Path | None,
    rig_file: Path | None,
    plain: bool,
    frames: int | None,
    bom: Path | None,
    check: bool,
    **outputs: Path | None,
) -> None:
    """Write DESIGN as parts to print, films to cut, or models for other programs.

    Several formats at once; either all files appear or none.
    """
    outputs["3mf"] = outputs.pop("threemf")
    wanted = {name: path for name in _WRITERS if (path := outputs[name]) is not None}
    _refuse_words(wanted, bom, check, plain, frames)
    for path in (*wanted.values(), *([] if bom is None else [bom])):
        refuse_overwriting(path, *(given for given in (design_file, parts_file, rig_file) if given is not None))
    _refuse_places(wanted, bom)
    design = load_design(design_file)
    layout = design.structure.layout
    rig = None if rig_file is None else resolve_rig(load_rig(rig_file), layout.cell_ids, layout.latch_points)
    spec = PartsSpec() if parts_file is None else load_parts_spec(parts_file)
    job = Job(design, spec, rig, plain, frames or FRAMES)
    rows: list[Row] = []
    with Staging() as staging:
        for name, target in wanted.items():
            rows.append((f"{name}: {_WRITERS[name](job, staging, target)}", str(target)))
        if bom is not None:
            rows += _bill(job, staging, bom)
    for remark in job.remarks:
        warn(remark)
    if rows:
        print_table(f"{design.name}: exported", rows)
    if check and not _printable(job):
        raise SystemExit(EXIT_NOT_DONE)


def _bill(job: Job, staging: Staging, target: Path) -> list[Row]:
    from ori_deploy.export.bill import bill_of

    bill = bill_of(job.parts)
    if str(target) == "-":
        click.echo(bill.text(), nl=False)
        return []
    text = json.dumps(bill.data(), indent=1, allow_nan=False, ensure_ascii=False)
    staging.file(target).write_text(f"{text}\n", encoding="utf-8")
    return [(f"bill of materials: {len(bill.items)} lines, {1e3 * bill.mass_kg:.0f} g", str(target))]


def _printable(job: Job) -> bool:
    """Whether every part is; tells what is not."""
    from ori_deploy.export.print_check import check_text, print_check

    findings = print_check(job.parts)
    click.echo(check_text(findings), nl=False)
    return all(finding.ok for finding in findings)


def _refuse_places(wanted: Mapping[str, Path], bom: Path | None) -> None:
    """Refuse, before anything is worked out, outputs that are in each other's way."""
    outputs = [*wanted.values(), *([] if bom is None or str(bom) == "-" else [bom])]
    if "urdf" in wanted:
        from ori_deploy.export.urdf import mesh_folder

        outputs.append(wanted["urdf"].parent / mesh_folder(wanted["urdf"]))
    refuse_entangled(*outputs)
    for name in ("stl", "dxf", "svg"):
        if name in wanted:
            refuse_current(wanted[name])


def _refuse_words(wanted: Mapping[str, Path], bom: Path | None, check: bool, plain: bool, frames: int | None) -> None:
    """Refuse words that ask for nothing, or do not go with what is asked for."""
    if not (wanted or bom is not None or check):
        raise InputError(
            "export: nothing is asked for", limit="one of " + ", ".join(f"--{name}" for name in _WRITERS),
            remedy="say what to write, or --bom - or --check",
        )  # fmt: skip
    if frames is not None and "fold" not in wanted:
        raise InputError("--frames: goes with --fold", remedy="add --fold FILE")
    printed = [name for name in ("stl", "3mf", "step") if name in wanted]
    if plain and not (printed or bom is not None or check):
        raise InputError(
            "--plain: goes with parts", limit="--stl, --3mf, --step, --bom or --check", remedy="leave it out"
        )
