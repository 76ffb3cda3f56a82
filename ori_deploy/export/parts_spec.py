"""Parts files (TOML, schema ori-deploy/parts/1): what printed panels leave room for. Every key has a default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ori_deploy.files.profile_spec import Strict
from ori_deploy.files.text import read_toml, validated

PARTS_SCHEMA = "ori-deploy/parts/1"

_Positive = Annotated[float, Field(strict=True, gt=0.0, le=1e5, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=1e5, allow_inf_nan=False)]
_Signed = Annotated[float, Field(strict=True, ge=-1e5, le=1e5, allow_inf_nan=False)]


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
    """`[magnet]`: round ones in both faces of every slit.

    The pocket is wider by `clearance_mm` all round, and deeper by `axial_mm` below the finished face, so that no
    magnet keeps a slit open. `spacing_mm` along the span, about.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)] = "magnet 5 x 1 mm"
    diameter_mm: _Positive = 5.0
    depth_mm: _Positive = 1.0
    clearance_mm: _NotNegative = 0.1
    axial_mm: _NotNegative = 0.05
    spacing_mm: _Positive = 100.0
    mark_mm: _NotNegative = 2.0
    mass_g: _NotNegative = 0.15

    @property
    def pocket_mm(self) -> float:
        """Diameter of the pocket."""
        return self.diameter_mm + 2.0 * self.clearance_mm

    @property
    def pocket_depth_mm(self) -> float:
        """Depth of the pocket below the finished face."""
        return self.depth_mm + self.axial_mm


class HornSpec(Strict):
    """`[horn]`: a servo's horn about a driven crease, let into the end of the span.

    `hub_diameter_mm` and `thickness_mm` of the horn, screws of `screw_diameter_mm` (the hole's) on a circle of
    diameter `screw_circle_mm`, as many of `screws` as hit the panel, `depth_mm` deep below the horn. The recess is
    wider by `clearance_mm` all round and as much deeper; in panels that turn against the horn twice as much deeper.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)] = "servo"
    hub_diameter_mm: _Positive = 20.0
    thickness_mm: _Positive = 2.0
    clearance_mm: _NotNegative = 0.2
    screw_circle_mm: _Positive = 16.0
    screws: Annotated[int, Field(strict=True, ge=1, le=24)] = 8
    screw_diameter_mm: _Positive = 1.6
    depth_mm: _Positive = 6.0
    mass_g: _NotNegative = 18.0

    @property
    def recess_mm(self) -> float:
        """Diameter of the recess."""
        return self.hub_diameter_mm + 2.0 * self.clearance_mm

    @model_validator(mode="after")
    def _screws_lie_on_the_hub(self) -> Self:
        taken = self.screw_circle_mm + self.screw_diameter_mm
        if taken > self.hub_diameter_mm:
            raise ValueError(
                f"horn.screw_circle_mm + horn.screw_diameter_mm ({taken:g} mm) at most horn.hub_diameter_mm "
                f"({self.hub_diameter_mm:g} mm)"
            )
        return self


class ServoSpec(Strict):
    """`[servo]`: how a servo's body is fixed beyond the end of the panel before its crease.

    `bolts_mm` are places (x, y) of its screws from the shaft, seen from the servo; the pattern is turned about the
    shaft until most of them hit the panel. None: the body's mount is left to the user. `reach_mm` is how far the
    body reaches from the shaft; servos that could meet are told. 0: not looked at.
    """

    bolts_mm: tuple[tuple[_Signed, _Signed], ...] = ()
    bolt_diameter_mm: _Positive = 2.0
    depth_mm: _Positive = 8.0
    reach_mm: _NotNegative = 0.0


class SpanHingeSpec(Strict):
    """`[span_hinge]`: piano hinges between span segments: the pin's knuckles, and a leaf on either side.

    Grooves of knuckles are wider by `clearance_mm` all round.
    """

    pin_diameter_mm: _Positive = 1.2
    clearance_mm: _NotNegative = 0.15
    leaf_width_mm: _Positive = 6.0
    leaf_thickness_mm: _Positive = 0.3
    mass_g_m: _NotNegative = 10.0

    @model_validator(mode="after")
    def _leaves_are_thinner_than_knuckles(self) -> Self:
        if self.leaf_thickness_mm > 0.5 * self.pin_diameter_mm:
            raise ValueError(
                f"span_hinge.leaf_thickness_mm ({self.leaf_thickness_mm:g} mm) at most half of "
                f"span_hinge.pin_diameter_mm ({0.5 * self.pin_diameter_mm:g} mm): the pin lies in the face"
            )
        return self


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
    servo: ServoSpec = ServoSpec()
    span_hinge: SpanHingeSpec = SpanHingeSpec()
    text: TextSpec = TextSpec()

    @property
    def magnet_pitch_mm(self) -> float:
        """Least distance of two magnets along the span: a pocket, its mark, and a wall on both sides of the mark."""
        mark = self.magnet.mark_mm + self.print.wall_mm if self.magnet.mark_mm > 0.0 else 0.0
        return self.magnet.pocket_mm + mark + self.print.wall_mm

    @model_validator(mode="after")
    def _tables_agree(self) -> Self:
        magnet, horn, wall = self.magnet, self.horn, self.print.wall_mm
        if magnet.spacing_mm < self.magnet_pitch_mm:
            raise ValueError(
                f"magnet.spacing_mm ({magnet.spacing_mm:g} mm) at least {self.magnet_pitch_mm:g} mm: "
                "magnet.diameter_mm + 2 magnet.clearance_mm + magnet.mark_mm, and print.wall_mm on either side of it"
            )
        if self.clearance.slit_mm >= magnet.depth_mm:
            raise ValueError(
                f"clearance.slit_mm ({self.clearance.slit_mm:g} mm) less than magnet.depth_mm "
                f"({magnet.depth_mm:g} mm): magnets do not pull across a wider gap"
            )
        apart = horn.screw_circle_mm * float(np.sin(np.pi / horn.screws))
        if horn.screws > 1 and apart < horn.screw_diameter_mm + wall:
            raise ValueError(
                f"horn.screws = {horn.screws} stand {apart:.2f} mm apart on horn.screw_circle_mm; at least "
                f"horn.screw_diameter_mm + print.wall_mm ({horn.screw_diameter_mm + wall:g} mm)"
            )
        return self


def load_parts_spec(path: Path) -> PartsSpec:
    """Read a parts file.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown keys, values out of range; names file and key.
    """
    data = read_toml(path, PARTS_SCHEMA)
    return validated(PartsSpec, data, str(path))
