"""Loads files (TOML, schema ori-deploy/loads/1): what the servos have to overcome. Every key has a default."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import Field

from ori_deploy.files.profile_spec import Finite, Strict
from ori_deploy.files.text import read_toml, validated, write_atomically
from ori_deploy.loads import Air, Film, Loads, Magnets

LOADS_SCHEMA = "ori-deploy/loads/1"
_PAIR = re.compile(r"\[\s*([-+.\deE]+),\s*([-+.\deE]+),\s*\]")
"""Two numbers in brackets, on lines of their own: a table of pressures reads better with a pair a line."""


def _between(low: float, high: float) -> Any:
    return Field(strict=True, ge=low, le=high, allow_inf_nan=False)


_Angle = Annotated[float, _between(0.0, 360.0)]
_Positive = Annotated[float, Field(strict=True, gt=0.0, le=1e6, allow_inf_nan=False)]
_NotNegative = Annotated[float, _between(0.0, 1e6)]
_Vector = tuple[Finite, Finite, Finite]


class _Panels(Strict):
    """`[panels]`."""

    density_kg_m3: Annotated[float, _between(0.0, 3e4)] = 300.0
    extra_kg: dict[str, _NotNegative] = Field(default_factory=dict)


class _Film(Strict):
    """`[film]`."""

    thickness_um: Annotated[float, _between(0.0, 1e4)] = 50.0
    gap_mm: _Positive = 1.0
    modulus_gpa: _NotNegative = 4.0
    width_m: _Positive | None = None
    rest_open_deg: _Angle = 180.0
    rest_close_deg: _Angle = 180.0


class _Hinge(Strict):
    """`[hinge]`."""

    friction_nm: _NotNegative = 0.0
    damping_nm_s: _NotNegative = 0.0


class _Air(Strict):
    """`[air]`."""

    pressure_pa: Finite = 0.0
    pressure_at: tuple[tuple[Finite, Finite], ...] = ()
    wind_m_s: _Vector = (0.0, 0.0, 0.0)
    density_kg_m3: _NotNegative = 1.2
    coefficient: _NotNegative = 1.2


class _Magnet(Strict):
    """`[magnet]`."""

    force_n: _NotNegative = 0.0
    reach_mm: _Positive = 2.0
    capture_mm: _Positive = 8.0
    seat_mm: _Positive = 0.25


class _Drive(Strict):
    """`[drive]`."""

    efficiency: Annotated[float, Field(strict=True, gt=0.0, le=1.0, allow_inf_nan=False)] = 0.9


class LoadsFile(Strict):
    """The file."""

    schema_: Literal["ori-deploy/loads/1"] = Field(alias="schema")
    clamp: str | None = None
    gravity_m_s2: _Vector = (0.0, -9.81, 0.0)
    panels: _Panels = _Panels()
    film: _Film = _Film()
    hinge: _Hinge = _Hinge()
    air: _Air = _Air()
    magnet: _Magnet = _Magnet()
    drive: _Drive = _Drive()

    def loads(self) -> Loads:
        """In SI."""
        film, magnet, air = self.film, self.magnet, self.air
        return Loads(
            density_kg_m3=self.panels.density_kg_m3,
            extra_kg=dict(self.panels.extra_kg),
            gravity_m_s2=self.gravity_m_s2,
            film=Film(
                1e-6 * film.thickness_um, 1e-3 * film.gap_mm, 1e9 * film.modulus_gpa, film.width_m,
                float(np.radians(film.rest_open_deg)), float(np.radians(film.rest_close_deg)),
            ),
            air=Air(air.pressure_pa, air.pressure_at, air.wind_m_s, air.density_kg_m3, air.coefficient),
            magnets=Magnets(
                magnet.force_n, 1e-3 * magnet.reach_mm, 1e-3 * magnet.capture_mm, 1e-3 * magnet.seat_mm
            ),
            friction_nm=self.hinge.friction_nm,
            damping_nm_s=self.hinge.damping_nm_s,
            clamp=self.clamp,
            efficiency=self.drive.efficiency,
        )  # fmt: skip


def load_loads(path: Path) -> Loads:
    """Read a loads file.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown keys, values out of range; names file and key.
    """
    return validated(LoadsFile, read_toml(path, LOADS_SCHEMA), str(path)).loads()


def loads_data(loads: Loads) -> dict[str, Any]:
    """What a loads file says for these loads: the way back from `LoadsFile.loads`."""
    film, air, magnets = loads.film, loads.air, loads.magnets
    rest_open, rest_close = (float(np.degrees(a)) for a in (film.rest_open_rad, film.rest_close_rad))
    return {
        "schema": LOADS_SCHEMA,
        **({} if loads.clamp is None else {"clamp": loads.clamp}),
        "gravity_m_s2": list(loads.gravity_m_s2),
        "panels": {"density_kg_m3": loads.density_kg_m3, "extra_kg": dict(loads.extra_kg)},
        "film": {
            "thickness_um": 1e6 * film.thickness_m,
            "gap_mm": 1e3 * film.gap_m,
            "modulus_gpa": 1e-9 * film.modulus_pa,
            **({} if film.width_m is None else {"width_m": film.width_m}),
            "rest_open_deg": rest_open,
            "rest_close_deg": rest_close,
        },
        "hinge": {"friction_nm": loads.friction_nm, "damping_nm_s": loads.damping_nm_s},
        "air": {
            "pressure_pa": air.pressure_pa,
            "pressure_at": [list(pair) for pair in air.pressure_at],
            "wind_m_s": list(air.wind_m_s),
            "density_kg_m3": air.density_kg_m3,
            "coefficient": air.coefficient,
        },
        "magnet": {
            "force_n": magnets.force_n,
            "reach_mm": 1e3 * magnets.reach_m,
            "capture_mm": 1e3 * magnets.capture_m,
            "seat_mm": 1e3 * magnets.seat_m,
        },
        "drive": {"efficiency": loads.efficiency},
    }


def save_loads(loads: Loads, path: Path, head: tuple[str, ...] = ()) -> None:
    """Write a loads file, whole or not at all.

    Parameters
    ----------
    head
        Lines of comment above it.

    Raises
    ------
    FileError
        It cannot be written, or could not be read again.
    """
    data = loads_data(loads)
    validated(LoadsFile, data, str(path))
    text = _PAIR.sub(r"[\1, \2]", tomli_w.dumps(data))
    write_atomically(path, "".join(f"# {line}\n" for line in head) + text)
