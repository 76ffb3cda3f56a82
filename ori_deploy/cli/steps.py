"""The steps from file to file, for commands and demo alike."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.frame import warn
from ori_deploy.cli.optimise import Optimum, Request, optimise, tell
from ori_deploy.design import ConeStructure, Structure
from ori_deploy.errors import FileError, MotionError, StripError
from ori_deploy.files import (
    Design,
    Spec,
    build_from_file,
    load_design,
    save_design,
    save_plan,
    save_spec,
)
from ori_deploy.motion import Mechanism, Plan, SpanFolding, mechanism_of, plan_motion, plan_span, span_limits

_SPARE_DEG = 1.0
"""Dead-centre margin below which a person is told (geometry: some degrees to spare)."""

SPEC_ENDING, DESIGN_ENDING, PLAN_ENDING = ".toml", ".design.json", ".plan.json"


def refuse_overwriting(output: Path, *inputs: Path) -> None:
    """Refuse an output that is one of the inputs: a specification somebody wrote would be gone."""
    for path in inputs:
        if output.exists() and path.exists() and output.samefile(path):
            raise FileError(f"{output}: is an input", limit="another file", remedy="choose another name with -o")


def refuse_unwritable(*outputs: Path) -> None:
    """Refuse outputs that cannot be written, or are one another, before anything is worked out for them."""
    for k, path in enumerate(outputs):
        if any(path.resolve() == other.resolve() for other in outputs[:k]):
            raise FileError(f"{path}: two outputs of one name", remedy="choose another name for one of them")
        folder = path.resolve().parent
        while not folder.exists():
            folder = folder.parent
        if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK) or (path.exists() and not path.is_file()):
            raise FileError(
                f"{path}: cannot be written", limit="a file in a folder that can be written to",
                remedy="check the name and the permissions",
            )  # fmt: skip


def make_design(spec: Path, output: Path) -> tuple[Design, dict[str, Any], Path]:
    """Specification in, design file out; warns about a structure that will not fold."""
    refuse_overwriting(output, spec)
    parsed, structure = build_from_file(spec)
    return _saved(spec, parsed, structure, output)


def make_optimum(
    spec: Path, output: Path, request: Request, save_as: Path | None = None
) -> tuple[tuple[Design, dict[str, Any], Path], list[tuple[str, str]]]:
    """Specification in, design file of the best structure found out; and what is to be told about the search.

    Parameters
    ----------
    save_as
        Where to write the structure as a specification of its own, too.
    """
    refuse_overwriting(output, spec)
    if save_as is not None:
        refuse_overwriting(save_as, spec)
    refuse_unwritable(output, *([] if save_as is None else [save_as]))
    parsed, optimum = optimise(spec, request)
    made, told = _saved(spec, parsed, optimum.structure, output), tell(optimum)
    if save_as is not None:
        save_spec(save_as, optimum.structure, spec, _comment(spec, request, optimum))
        told.append(("specification", str(save_as)))
    return made, told


def _comment(spec: Path, request: Request, optimum: Optimum) -> str:
    """How to find it again."""
    cut = ", interrupted: the best of what it had tried" if optimum.interrupted else ""
    return (
        f"Found by ori-deploy design {spec.name} {request.words}{cut}.\n"
        f"eta {optimum.solution.eta:.6g}; layout {optimum.layout_name}."
    )


def _saved(
    spec: Path, parsed: Spec, structure: Structure | ConeStructure, output: Path
) -> tuple[Design, dict[str, Any], Path]:
    cut = parsed.structure
    made = Design(
        spec.name.removesuffix(SPEC_ENDING),
        cut.span_m,
        structure,
        span_segments=cut.span_segments,
        r_min_m=cut.r_min_m,
        strip=parsed.strip,
    )
    try:
        data = save_design(made, output)
    except StripError as wrong:
        wrong.source = wrong.source or str(spec)
        raise
    margin = float(np.degrees(structure.cells.dead_centre_margin.min()))
    if margin < _SPARE_DEG:
        warn(f"the smallest dead-centre margin is {margin:.2g} deg: below {_SPARE_DEG:g} deg a motor has little hold")
    for vertex, cells in structure.layout.overfull_vertices:
        warn(
            f"this structure cannot fold flat: cells {', '.join(cells)} are bonded in a row at opening vertex "
            f"{vertex} and each opens there to 180 degrees; choose slits that part them"
        )
    return load_design(output), data, output


def make_plan(design_file: Path, rig_file: Path, output: Path) -> Plan:
    """Design and rig in, plan file out."""
    refuse_overwriting(output, design_file, rig_file)
    built = load_design(design_file)
    layout = built.structure.layout
    rig = resolve_rig(load_rig(rig_file), layout.cell_ids, layout.latch_points)
    mechanism = mechanism_of(built.structure, built.unit_m)
    rig.check_range(mechanism.four_bars.angles(np.linspace(0.0, 1.0, 1001)))
    velocity, acceleration = rig.crease_limits()
    try:
        made = plan_motion(
            built.structure,
            velocity,
            acceleration,
            rig.rate_hz,
            r_max_m=built.unit_m,
            design_sha256=built.sha256,
            design_name=built.name,
        )
        if built.span_segments > 1 and isinstance(mechanism, Mechanism):
            folding = SpanFolding(mechanism, built.span_m, built.span_segments)
            made = replace(made, span=plan_span(folding, *span_limits(velocity, acceleration), rig.rate_hz))
    except MotionError as wrong:
        wrong.source = wrong.source or str(design_file)
        if output.exists():
            warn(f"{output} is still there, from an earlier plan")
        raise
    save_plan(made, output)
    return made
