"""The `[strip]` of a specification and the `strip` entry of a design file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.design.strip import Joint, Strip, helix, spiral
from ori_deploy.errors import FileError, StripError
from ori_deploy.files.profile_spec import Finite, Length, Strict
from ori_deploy.motion.strip_gaps import strip_gaps
from ori_deploy.profiles import xy
from ori_deploy.tolerance import TOLERANCE

_FOLDS = np.linspace(0.0, 1.0, 201)
"""Folds at which gaps are looked at; they change smoothly with the fold."""

Turns = Annotated[float, Field(strict=True, gt=0.0, le=1000.0, allow_inf_nan=False)]
Arc = Annotated[float, Field(strict=True, ge=0.0, lt=1.0, allow_inf_nan=False)]


class HelixSpec(Strict):
    """`[strip] kind = "helix"`, on a cylinder."""

    kind: Literal["helix"]
    pitch_m: Finite
    width_m: Length
    turns: Turns
    start_m: Finite | None = None
    start_arc: Arc = 0.0

    def lay(self, structure: Structure | ConeStructure, r_min_m: float, r_max_m: float) -> Strip:
        """The strip on a cylinder that reaches from height `r_min_m`, 0, to `r_max_m`."""
        if isinstance(structure, ConeStructure):
            raise StripError("strip: kind", value="helix", limit="cylinders", remedy='on a cone kind = "spiral"')
        return helix(
            structure,
            r_max_m - r_min_m,
            pitch_m=self.pitch_m,
            width_m=self.width_m,
            turns=self.turns,
            start_m=self.start_m,
            start_arc=self.start_arc,
        )


class SpiralSpec(Strict):
    """`[strip] kind = "spiral"`, on a cone."""

    kind: Literal["spiral"]
    growth: Annotated[float, Field(strict=True, gt=0.0, le=1000.0, allow_inf_nan=False)]
    width_turns: Turns
    turns: Turns
    start_m: Length | None = None
    start_arc: Arc = 0.0

    def lay(self, structure: Structure | ConeStructure, r_min_m: float, r_max_m: float) -> Strip:
        """The strip on a cone cut off at these radii."""
        if not isinstance(structure, ConeStructure):
            raise StripError("strip: kind", value="spiral", limit="cones", remedy='on a cylinder kind = "helix"')
        return spiral(
            structure,
            r_min_m,
            r_max_m,
            growth=self.growth,
            width_turns=self.width_turns,
            turns=self.turns,
            start_m=self.start_m,
            start_arc=self.start_arc,
        )


StripSpec = Annotated[HelixSpec | SpiralSpec, Field(discriminator="kind")]

_ANY_SPEC: TypeAdapter[HelixSpec | SpiralSpec] = TypeAdapter(StripSpec)


def strip_data(
    spec: HelixSpec | SpiralSpec | None, structure: Structure | ConeStructure, r_min_m: float, r_max_m: float
) -> dict[str, Any]:
    """What a design file says of a strip; nothing where there is none.

    Raises
    ------
    StripError
        The strip does not fit on the structure.
    """
    if spec is None:
        return {}
    strip = spec.lay(structure, r_min_m, r_max_m)
    sagitta_m = (
        TOLERANCE.sagitta * structure.profile.size * (r_max_m if isinstance(structure, ConeStructure) else 1.0)
    )
    panel_ids = structure.layout.panel_ids
    return {
        "strip": {
            **spec.model_dump(exclude_none=True),
            "length_m": strip.band.length_m,
            "area_m2": strip.area_m2,
            "pieces": [
                {
                    "panel": panel_ids[piece.panel],
                    "turn": piece.turn,
                    "polygon": strip.polygon(piece, sagitta_m).tolist(),
                    "area_m2": piece.area_m2,
                }
                for piece in strip.pieces
            ],
            "joints": _joints(strip, structure),
            "development": {
                "outline": xy(strip.development(sagitta_m)).tolist(),
                "lines": [
                    {"at": joint.at, "kind": joint.kind, "ends": xy(strip.across(arc)).tolist()}
                    for joint in strip.joints
                    for arc in strip.crossings(joint)
                ],
            },
        }
    }


def _joints(strip: Strip, structure: Structure | ConeStructure) -> list[dict[str, Any]]:
    panel_ids = structure.layout.panel_ids
    gaps = strip_gaps(structure, strip.joints, _FOLDS)
    return [
        {
            "at": joint.at,
            "kind": joint.kind,
            "panels": [panel_ids[joint.before], panel_ids[joint.after]],
            "arc": joint.arc,
            "crossings": len(strip.crossings(joint)),
            "fold_rad": joint.fold_rad,
            "flat_gap_m": float(gap[0] * _reach(strip, joint, structure)) if joint.kind == "part" else 0.0,
            "largest_gap_m": float(gap.max() * _reach(strip, joint, structure)) if joint.kind == "part" else 0.0,
        }
        for joint, gap in zip(strip.joints, gaps, strict=True)
    ]


def _reach(strip: Strip, joint: Joint, structure: Structure | ConeStructure) -> float:
    """What a gap is to be multiplied by: 1; on a cone the largest radius at which the band crosses the joint."""
    if not isinstance(structure, ConeStructure):
        return 1.0
    return float(max((strip.band.edges(arc)[1] for arc in strip.crossings(joint)), default=0.0))


def read_strip(
    data: dict[str, Any], structure: Structure | ConeStructure, r_min_m: float, r_max_m: float
) -> HelixSpec | SpiralSpec | None:
    """The strip a design file tells of, if any.

    Raises
    ------
    FileError
        The entry is not the one its structure gives.
    StripError
        The strip does not fit on the structure.
    """
    entry = data.get("strip")
    if entry is None:
        return None
    remedy = "don't edit design files: change the specification and design again"
    if not isinstance(entry, dict):
        raise FileError("strip", value=type(entry).__name__, limit="a table", remedy=remedy)
    keys = HelixSpec.model_fields.keys() | SpiralSpec.model_fields.keys()
    try:
        spec = _ANY_SPEC.validate_python({k: v for k, v in entry.items() if k in keys})
    except ValidationError as wrong:
        first = wrong.errors()[0]
        raise FileError(f"strip: {'.'.join(map(str, first['loc']))}", limit=first["msg"], remedy=remedy) from wrong
    strip = spec.lay(structure, r_min_m, r_max_m)
    for key, built in (("length_m", strip.band.length_m), ("area_m2", strip.area_m2)):
        told = entry.get(key)
        if not (isinstance(told, int | float) and np.isclose(told, built, rtol=1e-9)):
            raise FileError(f"strip.{key}", value=told, limit=str(built), remedy=remedy)
    return spec
