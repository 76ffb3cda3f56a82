"""The `[profile]` of a specification: one table per kind of shape."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ori_deploy.errors import ProfileError
from ori_deploy.files.text import read_text
from ori_deploy.profiles import (
    Clover,
    Cone,
    Heart,
    PointOutline,
    Profile,
    Superellipse,
    naca_section,
    parse_dat,
)
from ori_deploy.profiles.fourier import MOST_LEAVES

TURN = 6.2832

Length = Annotated[float, Field(strict=True, ge=1e-6, le=1e4, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0.0, le=100.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, ge=-1e4, le=1e4, allow_inf_nan=False)]
Angle = Annotated[float, Field(strict=True, ge=-TURN, le=TURN, allow_inf_nan=False)]
"""Radians, a turn either way: more is likelier to be degrees."""


class Strict(BaseModel):
    """A table without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class EllipseSpec(Strict):
    """`[profile] kind = "ellipse"`."""

    kind: Literal["ellipse"]
    a_m: Length
    b_m: Length

    def make(self, folder: Path) -> Profile:
        del folder
        return Superellipse(self.a_m, self.b_m)


class SuperellipseSpec(Strict):
    """`[profile] kind = "superellipse"`."""

    kind: Literal["superellipse"]
    a_m: Length
    b_m: Length
    exponent: Positive

    def make(self, folder: Path) -> Profile:
        del folder
        return Superellipse(self.a_m, self.b_m, self.exponent)


class NacaSpec(Strict):
    """`[profile] kind = "naca"`: four or five digits."""

    kind: Literal["naca"]
    code: str
    chord_m: Length

    def make(self, folder: Path) -> Profile:
        del folder
        return naca_section(self.code, self.chord_m)


class CloverSpec(Strict):
    """`[profile] kind = "clover"`."""

    kind: Literal["clover"]
    radius_m: Length
    depth: Annotated[float, Field(strict=True, gt=0.0, lt=1.0, allow_inf_nan=False)]
    leaves: Annotated[int, Field(strict=True, ge=2, le=MOST_LEAVES)] = 3

    def make(self, folder: Path) -> Profile:
        del folder
        return Clover(self.radius_m, self.depth, self.leaves)


class HeartSpec(Strict):
    """`[profile] kind = "heart"`."""

    kind: Literal["heart"]
    width_m: Length

    def make(self, folder: Path) -> Profile:
        del folder
        return Heart(self.width_m)


class PointsSpec(Strict):
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


PlaneProfileSpec = Annotated[
    EllipseSpec | SuperellipseSpec | NacaSpec | PointsSpec | CloverSpec | HeartSpec, Field(discriminator="kind")
]
"""Outlines in the plane: cross-sections of cylinders, and what a cone's rays run through."""


class ConeSpec(Strict):
    """`[profile] kind = "cone"`: by its half-angle, or by its apex over a plane profile."""

    kind: Literal["cone"]
    half_angle_rad: Annotated[float, Field(strict=True, ge=1e-4, allow_inf_nan=False)] | None = None
    aspect: Positive = 1.0
    apex_m: tuple[Finite, Finite, Finite] | None = None
    base: PlaneProfileSpec | None = None

    @model_validator(mode="after")
    def _one_way(self) -> ConeSpec:
        if (self.half_angle_rad is None) == (self.apex_m is None):
            raise ValueError("a cone needs either half_angle_rad (and aspect) or apex_m and base")
        if (self.apex_m is None) != (self.base is None):
            raise ValueError("apex_m and base go together: the rays run from the apex through the base's outline")
        if self.apex_m is not None and self.aspect != 1.0:
            raise ValueError("aspect goes with half_angle_rad: over an apex the base gives the shape")
        return self

    def make(self, folder: Path) -> Cone:
        if self.half_angle_rad is not None:
            return Cone.of_half_angle(self.half_angle_rad, self.aspect)
        assert self.base is not None
        assert self.apex_m is not None
        return Cone(self.base.make(folder), self.apex_m)


ProfileSpec = Annotated[
    EllipseSpec | SuperellipseSpec | NacaSpec | PointsSpec | CloverSpec | HeartSpec | ConeSpec,
    Field(discriminator="kind"),
]
