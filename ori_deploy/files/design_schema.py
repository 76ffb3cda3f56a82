"""What a design file holds, key by key; `load_design` refuses whatever does not fit, `ori-deploy schema` prints it.

Which keys there are and of what type, no more: that the figures are those of the layout is found out by building
the structure again. Keys that are not known are let pass, as a newer version may write more.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ori_deploy.files.strip_entry import Arc, Turns

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Size = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, ge=0)]
Name = Annotated[str, Field(strict=True, min_length=1)]
Flag = Annotated[bool, Field(strict=True)]
Pair = tuple[Number, Number]
Place = Annotated[list[Number], Field(min_length=2, max_length=3)]
"""(x, y) of a cylinder's cross-section, metres; of a cone a unit vector from the apex, or its image."""


class Written(BaseModel):
    """A table that a program wrote."""

    model_config = ConfigDict(frozen=True)


class ProfileEntry(Written):
    """The target shape; what else there is depends on the kind, as in a specification's `[profile]`."""

    model_config = ConfigDict(extra="allow", frozen=True)

    kind: Name


class VertexEntry(Written):
    """A vertex: `xy` or `xyz`, and the profile's parameter `s` where it lies on the outline."""

    id: Name
    role: Literal["closing", "opening"]
    inner: Flag
    xy: Pair | None = None
    xyz: tuple[Number, Number, Number] | None = None
    s: Number | None = None


class LayoutCell(Written):
    """A cell's vertices; counter-clockwise they are closing, opening, closing, opening."""

    id: Name
    closing: tuple[Name, Name]
    opening: tuple[Name, Name]


class LayoutEntry(Written):
    """Which vertices, cells and slits there are."""

    vertices: list[VertexEntry]
    cells: list[LayoutCell]
    slits: list[tuple[Name, Name]]


class CreasePlaces(Written):
    """Where the cell's creases are, deployed."""

    open_c: Place
    open_d: Place
    close_a: Place
    close_b: Place


class CreaseAngles(Written):
    """Inner angles of the cell's creases, deployed, radians."""

    open_c: Number
    open_d: Number
    close_a: Number
    close_b: Number


class CellEntry(Written):
    """What the construction found for a cell: rim thicknesses and wall offsets at its two opening creases."""

    id: Name
    creases: CreasePlaces
    rim_thickness: Pair
    inner_offset: Pair
    deployed_angles_rad: CreaseAngles
    dead_centre_margin_rad: Pair
    area: Size
    material_area: Size


class PanelEntry(Written):
    """A panel: outline when deployed, counter-clockwise, and the panel of the next cell that it is bonded to."""

    id: Name
    cell: Name
    outline: list[Place]
    area: Size
    bonded_to: Name | None


class PackagingEntry(Written):
    """Areas (a cone's are solid angles), eta, and the smallest box round the folded stack."""

    area: Size
    material_area: Size
    eta: Size
    stack_box_m: Annotated[list[Size], Field(min_length=2, max_length=3)]
    box_ratio: Size
    volume_m3: Size | None = None


class SpanHinge(Written):
    """A piano hinge between two span segments."""

    id: Name
    face: Name
    panel: Name
    point: Place
    axis: Place
    length_m: Size
    line_on_panel: list[Place]


class SpanEntry(Written):
    """A span cut into segments."""

    segments: Annotated[int, Field(strict=True, ge=2)]
    segment_length_m: Size
    hinges: list[SpanHinge]
    stowed_thickness_m: Size
    stowed_box_m: list[Size]
    stowed_box_ratio: Size


class StripPiece(Written):
    """What of the strip lies on one panel; `polygon` in (arc, height) or (arc, radius)."""

    panel: Name
    turn: Annotated[int, Field(strict=True)]
    polygon: list[Pair]
    area_m2: Size


class StripJoint(Written):
    """Where the strip crosses from panel to panel, and what becomes of it there."""

    at: Name
    kind: Name
    panels: tuple[Name, Name]
    arc: Number
    crossings: Count
    fold_rad: Number
    flat_gap_m: Size
    largest_gap_m: Size


class StripLine(Written):
    """A joint's line across the flat sheet."""

    at: Name
    kind: Name
    ends: list[Pair]


class StripSheet(Written):
    """The flat sheet to cut, seen from outside, metres."""

    outline: list[Pair]
    lines: list[StripLine]


class StripEntry(Written):
    """The antenna strip; the first keys are those of the specification's `[strip]`."""

    kind: Literal["helix", "spiral"]
    pitch_m: Number | None = None
    width_m: Size | None = None
    growth: Size | None = None
    width_turns: Turns | None = None
    turns: Turns
    start_m: Number | None = None
    start_arc: Arc
    length_m: Size
    area_m2: Size
    pieces: list[StripPiece]
    joints: list[StripJoint]
    development: StripSheet


class DesignFile(Written):
    """A built structure. Lengths in metres, angles in radians."""

    schema_: Annotated[Literal["ori-deploy/design/1"], Field(alias="schema")]
    kind: Literal["cylinder", "cone"]
    name: Annotated[str, Field(strict=True)]
    profile: ProfileEntry
    span_m: Annotated[float, Field(strict=True, ge=1e-12, le=1e4)]
    wall_m: Size
    apex: tuple[Number, Number, Number] | None = None
    r_min_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4)] = 0.0
    r_max_m: Size | None = None
    wall_rad: Size | None = None
    layout: LayoutEntry
    cells: list[CellEntry]
    panels: list[PanelEntry]
    packaging: PackagingEntry
    span: SpanEntry | None = None
    strip: StripEntry | None = None


def first_fault(errors: list[Any]) -> str:
    """The key that does not fit, and why, of what pydantic found."""
    first = errors[0]
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    return f"{where}: {first['msg']}"
