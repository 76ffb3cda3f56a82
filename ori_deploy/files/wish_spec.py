"""`[optimize]` of a specification: what to maximise, bounds, and pins by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ori_deploy.design import Embedding
from ori_deploy.files.profile_spec import Finite, Strict
from ori_deploy.search import Fixed, OnLine, Pin, Spar, Symmetric, Wish

Name = Annotated[str, Field(min_length=1)]


class PinSpec(Strict):
    """One of `fixed`, `line`, `spar`, with what goes with it."""

    fixed: Name | None = None
    at_m: tuple[Finite, Finite] | None = None
    line: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    through_m: tuple[Finite, Finite] | None = None
    direction: tuple[Finite, Finite] | None = None
    spar: Annotated[tuple[Name, ...], Field(min_length=2)] | None = None
    x_m: Finite | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> PinSpec:
        kinds = [k for k in ("fixed", "line", "spar") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(f"a pin is one of fixed, line, spar; given {', '.join(kinds) or 'none'}")
        goes = {"fixed": ("at_m",), "line": ("through_m", "direction"), "spar": ("x_m",)}
        for kind, keys in goes.items():
            stray = [k for k in keys if getattr(self, k) is not None and kind != kinds[0]]
            if stray:
                raise ValueError(f"{', '.join(stray)} goes with {kind}")
        if self.line is not None and (self.through_m is None or self.direction in (None, (0.0, 0.0))):
            raise ValueError("line needs through_m = [x, y] and direction = [dx, dy], not both zero")
        return self

    def pin(self) -> Pin:
        """What it says."""
        if self.fixed is not None:
            return Fixed(self.fixed, None if self.at_m is None else complex(*self.at_m))
        if self.line is not None:
            assert self.through_m is not None
            assert self.direction is not None
            return OnLine(self.line, complex(*self.through_m), complex(*self.direction))
        assert self.spar is not None
        return Spar(self.spar, self.x_m)


class OptimizeSpec(Strict):
    """`[optimize]`; every key may be left out."""

    objective: Literal["eta", "box_ratio", "wall"] = "eta"
    eta_at_least: Annotated[float, Field(strict=True, gt=0.0, le=1e3, allow_inf_nan=False)] | None = None
    margin_rad: Annotated[float, Field(strict=True, ge=0.0, lt=1.57, allow_inf_nan=False)] = float(np.radians(2.0))
    panel_m: Annotated[float, Field(strict=True, ge=0.0, le=1e4, allow_inf_nan=False)] = 0.0
    symmetric: Literal["x", "y"] | None = None
    symmetric_at_m: Finite = 0.0
    pins: tuple[PinSpec, ...] = ()
    spars: Annotated[int, Field(strict=True, ge=0, le=4)] = 0
    locked: bool = True

    @model_validator(mode="after")
    def _wall_has_a_bound(self) -> OptimizeSpec:
        if (self.objective == "wall") != (self.eta_at_least is not None):
            raise ValueError('eta_at_least goes with objective = "wall", and that needs it')
        return self

    def wish(self, start: Embedding | None) -> Wish:
        """The wish; `start` says where vertices are that stay, and which are mirror images of each other."""
        pins = [p.pin() for p in self.pins]
        if start is not None:
            places = {v.id: complex(z) for v, z in zip(start.layout.vertices, start.z, strict=True)}
            pins = [
                replace(p, place=places.get(p.vertex)) if isinstance(p, Fixed) and p.place is None else p
                for p in pins
            ]
        if self.symmetric is not None and start is not None:
            pins.append(Symmetric.of(start, self.symmetric, self.symmetric_at_m))
        return Wish(self.objective, self.margin_rad, self.panel_m, tuple(pins), self.eta_at_least or 1.0)
