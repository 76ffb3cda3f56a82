"""The design specification: what a person writes (TOML, schema ori-deploy/spec/1)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ori_deploy.design import Structure, build, embed
from ori_deploy.errors import InputError, LayoutError, ProfileError
from ori_deploy.files.text import read_text, read_toml, refuse_keys
from ori_deploy.layout import Layout, Vertex, make_layout, ring
from ori_deploy.motion.slits import with_free_slits
from ori_deploy.profiles import Naca4, PointOutline, Profile, Superellipse, parse_dat

SPEC_SCHEMA = "ori-deploy/spec/1"
TURN = 6.2832

Length = Annotated[float, Field(strict=True, ge=1e-6, le=1e4, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0.0, le=100.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, ge=-1e4, le=1e4, allow_inf_nan=False)]
Angle = Annotated[float, Field(strict=True, ge=-TURN, le=TURN, allow_inf_nan=False)]
"""Radians, a turn either way: more is likelier to be degrees."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class EllipseSpec(_Strict):
    """`[profile] kind = "ellipse"`."""

    kind: Literal["ellipse"]
    a_m: Length
    b_m: Length

    def make(self, folder: Path) -> Profile:
        del folder
        return Superellipse(self.a_m, self.b_m)


class SuperellipseSpec(_Strict):
    """`[profile] kind = "superellipse"`."""

    kind: Literal["superellipse"]
    a_m: Length
    b_m: Length
    exponent: Positive

    def make(self, folder: Path) -> Profile:
        del folder
        return Superellipse(self.a_m, self.b_m, self.exponent)


class NacaSpec(_Strict):
    """`[profile] kind = "naca"`."""

    kind: Literal["naca"]
    code: str
    chord_m: Length

    def make(self, folder: Path) -> Profile:
        del folder
        return Naca4(self.code, self.chord_m)


class PointsSpec(_Strict):
    """`[profile] kind = "points"`; `file` is looked up beside the specification."""

    kind: Literal["points"]
    file: str
    chord_m: Length = 1.0
    smooth: bool = True

    def make(self, folder: Path) -> Profile:
        path = folder / self.file
        try:
            return PointOutline(parse_dat(read_text(path), str(path)), self.chord_m, smooth=self.smooth)
        except ProfileError as wrong:
            wrong.source = wrong.source or str(path)
            raise


ProfileSpec = Annotated[EllipseSpec | SuperellipseSpec | NacaSpec | PointsSpec, Field(discriminator="kind")]


class StructureSpec(_Strict):
    """`[structure]`."""

    span_m: Length
    wall_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4, allow_inf_nan=False)]


class VertexSpec(_Strict):
    """`[[vertex]]`: inner with `xy_m`, or on the outline with exactly one way to say where."""

    id: Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_+.]+$")]
    role: Literal["closing", "opening"]
    inner: bool = False
    xy_m: tuple[Finite, Finite] | None = None
    arc: Finite | None = None
    angle_rad: Angle | None = None
    x_chord: Finite | None = None
    side: Literal["upper", "lower"] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> VertexSpec:
        given = [k for k in ("xy_m", "arc", "angle_rad", "x_chord") if getattr(self, k) is not None]
        wanted = "xy_m" if self.inner else "exactly one of arc, angle_rad, x_chord"
        if len(given) != 1 or (given == ["xy_m"]) != self.inner:
            where = "an inner" if self.inner else "an outline"
            raise ValueError(
                f"vertex {self.id}: {where} vertex needs {wanted}, given {', '.join(given) or 'nothing'}"
            )
        if self.side is not None and self.x_chord is None:
            raise ValueError(f"vertex {self.id}: side goes with x_chord")
        if self.x_chord is not None and self.side is None and self.x_chord not in (0.0, 1.0):
            raise ValueError(f'vertex {self.id}: x_chord needs side = "upper" or "lower"')
        return self

    def parameter(self, profile: Profile) -> float:
        """Where on the outline this vertex is."""
        if self.arc is not None:
            return profile.at_arc(self.arc)
        if self.angle_rad is not None:
            if not isinstance(profile, Superellipse):
                raise LayoutError(
                    "angle_rad: not defined on this profile",
                    value=self.angle_rad,
                    limit="ellipses and superellipses",
                    remedy="use arc, or x_chord and side on airfoils",
                )
            return profile.at_natural(self.angle_rad)
        assert self.x_chord is not None
        return profile.at_chord(self.x_chord, self.side or "upper")


class RingSpec(_Strict):
    """`[layout] ring`: cells round one inner vertex P, evenly in the natural parameter."""

    cells: Annotated[int, Field(strict=True, le=200)]
    center_m: tuple[Finite, Finite] = (0.0, 0.0)
    phase_rad: Angle = 0.0


class LayoutSpec(_Strict):
    """`[layout]`: cells and slits by vertex ids, or a ring."""

    cells: tuple[tuple[str, ...], ...] | None = None
    slits: tuple[tuple[str, ...], ...] | None = None
    ring: RingSpec | None = None

    @model_validator(mode="after")
    def _one_way(self) -> LayoutSpec:
        if (self.cells is None) == (self.ring is None):
            raise ValueError("give either cells (and slits) or ring")
        return self


class Spec(_Strict):
    """A whole specification. See `load_spec`."""

    schema_: Annotated[Literal["ori-deploy/spec/1"], Field(alias="schema")]
    profile: ProfileSpec
    structure: StructureSpec
    vertex: tuple[VertexSpec, ...] = ()
    layout: LayoutSpec

    @model_validator(mode="after")
    def _vertices_fit(self) -> Spec:
        if self.layout.ring is not None and self.vertex:
            raise ValueError("layout.ring makes its own vertices: remove [[vertex]] or use layout.cells")
        return self

    def build(self, folder: Path) -> Structure:
        """The structure this specification describes; `folder` is where its files are looked up.

        Raises
        ------
        InputError
            Profile, layout or a cell cannot be made; says which and why.
        """
        profile = self.profile.make(folder)
        layout, outline, inner = self._ring(profile) if self.layout.ring else self._listed(profile)
        structure = build(embed(profile, layout, outline, inner), self.structure.wall_m)
        return structure if self.layout.slits is not None or self.layout.ring is None else with_free_slits(structure)

    def _ring(self, profile: Profile) -> tuple[Layout, dict[str, float], dict[str, tuple[float, float]]]:
        wanted = self.layout.ring
        assert wanted is not None
        vertices, cells = ring(wanted.cells)
        slits = [("P", "O1")] if self.layout.slits is None else self.layout.slits
        layout = make_layout(vertices, cells, slits)  # type: ignore[arg-type]
        step = 2.0 * 3.141592653589793 / wanted.cells
        outline = {
            v.id: profile.at_natural(
                wanted.phase_rad + step * (int(v.id[1:]) - 1 + (0.5 if v.role == "closing" else 0.0))
            )
            for v in vertices
            if not v.inner
        }
        return layout, outline, {"P": wanted.center_m}

    def _listed(self, profile: Profile) -> tuple[Layout, dict[str, float], dict[str, tuple[float, float]]]:
        vertices = [Vertex(v.id, v.role, v.inner) for v in self.vertex]
        layout = make_layout(vertices, self.layout.cells or (), self.layout.slits or ())  # type: ignore[arg-type]
        outline: dict[str, float] = {}
        for v in self.vertex:
            if v.inner:
                continue
            try:
                outline[v.id] = v.parameter(profile)
            except InputError as wrong:
                wrong.thing = f"vertex {v.id}: {wrong.thing}"
                raise
        return layout, outline, {v.id: v.xy_m for v in self.vertex if v.xy_m is not None}


def load_spec(path: Path) -> Spec:
    """Read a specification.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown or missing keys, values out of range; names file and key.
    """
    data = read_toml(path, SPEC_SCHEMA)
    try:
        return Spec.model_validate(data)
    except ValidationError as wrong:
        raise refuse_keys(str(path), data, wrong) from wrong


def build_from_file(path: str | Path) -> tuple[Spec, Structure]:
    """Read a specification and build its structure; errors name the file."""
    path = Path(path)
    spec = load_spec(path)
    try:
        return spec, spec.build(path.parent)
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise
