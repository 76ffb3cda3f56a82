"""Parts files (TOML, schema ori-deploy/parts/1): what printed panels leave room for. Every key has a default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from ori_deploy.files.profile_spec import Strict
from ori_deploy.files.text import read_toml, refuse_keys

PARTS_SCHEMA = "ori-deploy/parts/1"

_Positive = Annotated[float, Field(strict=True, gt=0.0, le=1e5, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=1e5, allow_inf_nan=False)]


class PrintSpec(Strict):
    """`[print]`: the machine. The skin's polygon strays from the true outline by `chord_mm` at most."""

    bed_mm: tuple[_Positive, _Positive, _Positive] = (256.0, 256.0, 256.0)
    part_gap_mm: _NotNegative = 5.0
    wall_mm: _Positive = 0.8
    overhang_deg: Annotated[float, Field(strict=True, gt=0.0, lt=90.0)] = 45.0
    chord_mm: Annotated[float, Field(strict=True, ge=1e-4, le=10.0)] = 0.02


class MaterialSpec(Strict):
    """`[material]`: of the panels, infill counted."""

    name: Annotated[str, Field(min_length=1, max_length=60)] = "PLA, 20 % infill"
    density_kg_m3: _NotNegative = 300.0


class FilmSpec(Strict):
    """`[film]`: hinges every crease; its recess is as deep as film and glue are thick, `glue_mm` wide on each panel.

    `floor_mm` of the panel have to be left under it.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)] = "polyester film"
    thickness_um: _Positive = 100.0
    glue_mm: _Positive = 6.0
    floor_mm: _Positive = 0.2
    density_kg_m3: _NotNegative = 1390.0


class ClearanceSpec(Strict):
    """`[clearance]`: taken off each of two faces that meet: half of the gap between them.

    `joint_mm` beside creases, `slit_mm` at slits, `inner_mm` on inner faces, which meet when flat, `bond_mm` at
    bonds (room for glue), `segment_mm` at cuts across the span.
    """

    joint_mm: _NotNegative = 0.1
    slit_mm: _NotNegative = 0.05
    inner_mm: _NotNegative = 0.05
    bond_mm: _NotNegative = 0.0
    segment_mm: _NotNegative = 0.1


class MagnetSpec(Strict):
    """`[magnet]`: round ones in both faces of every slit; the pocket is wider by `clearance_mm` all round."""

    name: Annotated[str, Field(min_length=1, max_length=60)] = "magnet 5 x 1 mm"
    diameter_mm: _Positive = 5.0
    depth_mm: _Positive = 1.0
    clearance_mm: _NotNegative = 0.1
    spacing_mm: _Positive = 100.0
    mark_mm: _NotNegative = 2.0
    mass_g: _NotNegative = 0.15

    @property
    def pocket_mm(self) -> float:
        """Diameter of the pocket."""
        return self.diameter_mm + 2.0 * self.clearance_mm


class HornSpec(Strict):
    """`[horn]`: a servo's horn about a driven crease, let into the end of the span.

    `hub_diameter_mm` and `thickness_mm` of the horn, screws of `screw_diameter_mm` (the hole's) on a circle of
    diameter `screw_circle_mm`, as many of `screws` as hit the panel, `depth_mm` deep below the horn.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)] = "servo"
    hub_diameter_mm: _Positive = 20.0
    thickness_mm: _Positive = 2.0
    screw_circle_mm: _Positive = 16.0
    screws: Annotated[int, Field(strict=True, ge=1, le=24)] = 8
    screw_diameter_mm: _Positive = 1.6
    depth_mm: _Positive = 6.0
    mass_g: _NotNegative = 18.0


class SpanHingeSpec(Strict):
    """`[span_hinge]`: piano hinges between span segments: the pin's knuckles, and a leaf on either side."""

    pin_diameter_mm: _Positive = 1.2
    leaf_width_mm: _Positive = 6.0
    leaf_thickness_mm: _Positive = 0.3
    mass_g_m: _NotNegative = 10.0


class TextSpec(Strict):
    """`[text]`: part numbers, engraved into inner faces, which no one sees and nothing touches until flat."""

    height_mm: _Positive = 5.0
    depth_mm: _Positive = 0.4


class PartsSpec(Strict):
    """The file. Units are in the keys."""

    schema_: Literal["ori-deploy/parts/1"] = Field(alias="schema", default="ori-deploy/parts/1")
    print: PrintSpec = PrintSpec()
    material: MaterialSpec = MaterialSpec()
    film: FilmSpec = FilmSpec()
    clearance: ClearanceSpec = ClearanceSpec()
    magnet: MagnetSpec = MagnetSpec()
    horn: HornSpec = HornSpec()
    span_hinge: SpanHingeSpec = SpanHingeSpec()
    text: TextSpec = TextSpec()


def load_parts_spec(path: Path) -> PartsSpec:
    """Read a parts file.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown keys, values out of range; names file and key.
    """
    data = read_toml(path, PARTS_SCHEMA)
    try:
        return PartsSpec.model_validate(data)
    except ValidationError as wrong:
        raise refuse_keys(str(path), data, wrong) from wrong
