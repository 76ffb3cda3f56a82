"""The design specification: what a person writes (TOML, schema ori-deploy/spec/1)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from ori_deploy.design import ConeStructure, Embedding, Structure, build, build_cone, embed, embed_cone
from ori_deploy.errors import InputError, LayoutError
from ori_deploy.files.profile_spec import Angle, ConeSpec, Finite, Length, ProfileSpec, Strict
from ori_deploy.files.strip_entry import StripSpec
from ori_deploy.files.sweep_spec import SweepSpec
from ori_deploy.files.text import read_toml, validated
from ori_deploy.files.wish_spec import OptimizeSpec
from ori_deploy.layout import Layout, Vertex, make_layout, ring
from ori_deploy.motion.slits import with_free_slits
from ori_deploy.motion.spanwise import MOST_SEGMENTS
from ori_deploy.profiles import Cone, FourierOutline, Profile, Superellipse

SPEC_SCHEMA = "ori-deploy/spec/1"


class StructureSpec(Strict):
    """`[structure]`."""

    span_m: Length
    span_segments: Annotated[int, Field(strict=True, ge=1, le=MOST_SEGMENTS)] = 1
    wall_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4, allow_inf_nan=False)]

    @property
    def r_min_m(self) -> float:
        """A cylinder has no apex to be cut off from."""
        return 0.0


class ConeStructureSpec(Strict):
    """`[structure]` of a cone: the spheres round the apex between which it is cut off, and its wall."""

    span_m: Length = 1.0
    r_min_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4, allow_inf_nan=False)] = 0.0
    r_max_m: Length = 1.0
    wall_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4, allow_inf_nan=False)] | None = None
    wall_rad: Annotated[float, Field(strict=True, ge=0.0, le=1.5, allow_inf_nan=False)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, data: Any) -> Any:
        """Fill in what two of the three lengths, and the defaults, say about the others."""
        keys = ("span_m", "r_min_m", "r_max_m")
        if not isinstance(data, dict) or any(type(data.get(k, 0.0)) not in (int, float) for k in keys):
            return data
        given = {k: float(data[k]) for k in keys if k in data}
        span, r_min = given.get("span_m"), given.get("r_min_m")
        r_max = given.get("r_max_m", max(1.0, span or 0.0) if span is None or r_min is None else r_min + span)
        if r_min is None:
            r_min = 0.0 if span is None else r_max - span
        lengths = {"span_m": r_max - r_min if span is None else span, "r_min_m": r_min, "r_max_m": r_max}
        if r_min < 0.0 or r_max <= r_min:
            shown = ", ".join(f"{k} = {v:g}" for k, v in lengths.items())
            raise ValueError(f"0 <= r_min_m < r_max_m, and span_m the difference; these give {shown}")
        return {**data, **lengths}

    @model_validator(mode="after")
    def _fits(self) -> ConeStructureSpec:
        if not abs(self.r_max_m - self.r_min_m - self.span_m) <= 1e-9 * self.r_max_m:
            raise ValueError(
                f"span_m = {self.span_m:g} is not r_max_m - r_min_m = {self.r_max_m:g} - {self.r_min_m:g}: give two"
            )
        if (self.wall_m is None) == (self.wall_rad is None):
            raise ValueError("a cone needs exactly one of wall_rad and wall_m (at r_max_m)")
        return self

    @property
    def span_segments(self) -> int:
        """A cone's span stays in one piece."""
        return 1

    @property
    def wall_angle_rad(self) -> float:
        """The least wall offset seen from the apex."""
        return self.wall_rad if self.wall_m is None else self.wall_m / self.r_max_m  # type: ignore[return-value]


class VertexSpec(Strict):
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
            if not isinstance(profile, Superellipse | FourierOutline):
                raise LayoutError(
                    "angle_rad: not defined on this profile",
                    value=self.angle_rad,
                    limit="ellipses, superellipses, clovers, hearts",
                    remedy="use arc, or x_chord and side on airfoils",
                )
            return profile.at_natural(self.angle_rad)
        assert self.x_chord is not None
        return profile.at_chord(self.x_chord, self.side or "upper")


class RingSpec(Strict):
    """`[layout] ring`: cells round one inner vertex P, evenly in the natural parameter."""

    cells: Annotated[int, Field(strict=True, le=200)]
    center_m: tuple[Finite, Finite] = (0.0, 0.0)
    phase_rad: Angle = 0.0


class LayoutSpec(Strict):
    """`[layout]`: cells and slits by vertex ids, or a ring."""

    cells: tuple[tuple[str, ...], ...] | None = None
    slits: tuple[tuple[str, ...], ...] | None = None
    ring: RingSpec | None = None

    @model_validator(mode="after")
    def _one_way(self) -> LayoutSpec:
        if (self.cells is None) == (self.ring is None):
            raise ValueError("give either cells (and slits) or ring")
        return self


class Spec(Strict):
    """A whole specification. See `load_spec`."""

    schema_: Annotated[Literal["ori-deploy/spec/1"], Field(alias="schema")]
    profile: ProfileSpec
    structure: StructureSpec | ConeStructureSpec
    vertex: tuple[VertexSpec, ...] = ()
    layout: LayoutSpec | None = None
    optimize: OptimizeSpec | None = None
    sweep: SweepSpec | None = None
    strip: StripSpec | None = None

    @field_validator("structure", mode="plain", json_schema_input_type=StructureSpec | ConeStructureSpec)
    @classmethod
    def _of_the_profiles_kind(cls, value: Any, info: ValidationInfo) -> StructureSpec | ConeStructureSpec:
        profile = info.data.get("profile")
        if profile is None:
            return StructureSpec.model_construct()  # the profile is refused; its kind is not known
        return (ConeStructureSpec if isinstance(profile, ConeSpec) else StructureSpec).model_validate(value)

    @model_validator(mode="after")
    def _vertices_fit(self) -> Spec:
        if self.layout is not None and self.layout.ring is not None and self.vertex:
            raise ValueError("layout.ring makes its own vertices: remove [[vertex]] or use layout.cells")
        return self

    @model_validator(mode="after")
    def _strip_in_one_piece(self) -> Spec:
        if self.strip is not None and self.structure.span_segments > 1:
            raise ValueError("strip: a span cut into segments would cut it; remove [strip] or span_segments")
        return self

    def build(self, folder: Path) -> Structure | ConeStructure:
        """The structure this specification describes; `folder` is where its files are looked up.

        Raises
        ------
        InputError
            Profile, layout or a cell cannot be made; says which and why.
        """
        profile = self.profile.make(folder)
        structure: Structure | ConeStructure
        if isinstance(profile, Cone):
            assert isinstance(self.structure, ConeStructureSpec)
            structure = build_cone(embed_cone(profile, *self._placed(profile.base)), self.structure.wall_angle_rad)
        else:
            assert isinstance(self.structure, StructureSpec)
            structure = build(embed(profile, *self._placed(profile)), self.structure.wall_m)
        chosen = self.layout is None or self.layout.slits is not None or self.layout.ring is None
        return structure if chosen else with_free_slits(structure)

    def wanted(self) -> tuple[OptimizeSpec, float]:
        """`[optimize]` and the wall in what a search measures in: metres; of a cone radians seen from the apex."""
        wish, cut = self.optimize or OptimizeSpec(), self.structure
        if isinstance(cut, StructureSpec):
            return wish, cut.wall_m
        return wish.model_copy(update={"panel_m": wish.panel_m / cut.r_max_m}), cut.wall_angle_rad

    def embedding(self, profile: Profile) -> Embedding:
        """The layout on a cylinder's profile, as specified; whether its cells can be built is another matter."""
        return embed(profile, *self._placed(profile))

    def _placed(self, plane: Profile) -> tuple[Layout, dict[str, float], dict[str, tuple[float, float]]]:
        """The layout, and where its vertices are on an outline in the plane: a cone's base, or the profile itself."""
        if self.layout is None:
            raise LayoutError(
                "layout: missing",
                limit="[layout] with cells and slits, or ring",
                remedy="add it, or let one be found: --optimize --cells K --search-layouts",
            )
        return _ring(plane, self.layout, self.layout.ring) if self.layout.ring else self._listed(plane, self.layout)

    def _listed(
        self, profile: Profile, given: LayoutSpec
    ) -> tuple[Layout, dict[str, float], dict[str, tuple[float, float]]]:
        vertices = [Vertex(v.id, v.role, v.inner) for v in self.vertex]
        layout = make_layout(vertices, given.cells or (), given.slits or ())  # type: ignore[arg-type]
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


def _ring(
    profile: Profile, given: LayoutSpec, wanted: RingSpec
) -> tuple[Layout, dict[str, float], dict[str, tuple[float, float]]]:
    vertices, cells = ring(wanted.cells)
    slits = [("P", "O1")] if given.slits is None else given.slits
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


def load_spec(path: Path) -> Spec:
    """Read a specification.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown or missing keys, values out of range; names file and key.
    """
    data = read_toml(path, SPEC_SCHEMA)
    return validated(Spec, data, str(path))


def build_from_file(path: str | Path) -> tuple[Spec, Structure | ConeStructure]:
    """Read a specification and build its structure; errors name the file."""
    path = Path(path)
    spec = load_spec(path)
    try:
        return spec, spec.build(path.parent)
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise
