"""Aircraft files (TOML, schema ori-deploy/aircraft/1): what flies on a wing, and what was published about it."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ori_deploy.aero import Air, Aircraft, Fin, Fuselage, Polar, Power, Published, Tail, Wing
from ori_deploy.design import Structure
from ori_deploy.errors import FileError, InputError
from ori_deploy.files.design_file import load_design
from ori_deploy.files.profile_spec import Strict
from ori_deploy.files.spec import build_from_file
from ori_deploy.files.text import read_toml, validated
from ori_deploy.profiles import Profile, naca_section

AIRCRAFT_SCHEMA = "ori-deploy/aircraft/1"


def _within(low: float, high: float) -> Any:
    return Field(strict=True, ge=low, le=high, allow_inf_nan=False)


def _up_to(high: float) -> Any:
    """More than nothing."""
    return Field(strict=True, gt=0.0, le=high, allow_inf_nan=False)


_Length = Annotated[float, _up_to(1e3)]
_Positive = Annotated[float, _up_to(1e6)]
_Speed = Annotated[float, _up_to(100.0)]
_Share = Annotated[float, _up_to(1.0)]
_NotNegative = Annotated[float, _within(0.0, 1e6)]
_Coefficient = Annotated[float, _within(-10.0, 10.0)]


class _MassTable(Strict):
    """`[mass]`."""

    takeoff_kg: _Positive
    cg_chord: Annotated[float, _within(-2.0, 3.0)]


class _Cruise(Strict):
    """`[cruise]`: far below the speed of sound, for nothing here knows of it."""

    speed_m_s: _Speed


class _AirTable(Strict):
    """`[air]`."""

    density_kg_m3: Annotated[float, _within(1e-4, 100.0)] = 1.225
    viscosity_pa_s: Annotated[float, _within(1e-7, 1e-3)] = 1.789e-5
    n_crit: Annotated[float, _within(1.0, 15.0)] = 9.0


class _WingTable(Strict):
    """`[wing]`."""

    naca: str | None = None
    design: str | None = None
    span_m: _Length
    area_m2: Annotated[float, _up_to(1e5)]
    taper: Annotated[float, _within(0.05, 1.0)] = 1.0
    mount_m: Annotated[float, _within(0.0, 1e3)] = 0.0
    dihedral_deg: Annotated[float, _within(-30.0, 30.0)] = 0.0
    sweep_deg: Annotated[float, _within(-45.0, 45.0)] = 0.0
    incidence_deg: Annotated[float, _within(-15.0, 15.0)] = 0.0
    mass_kg: _Positive | None = None
    slit_gap_mm: Annotated[float, _within(0.0, 100.0)] = 0.25
    clamp: str | None = None

    @model_validator(mode="after")
    def _whole(self) -> _WingTable:
        if self.naca is None and self.design is None:
            raise ValueError("a wing needs a section: naca, or design, or both")
        if self.mount_m >= self.span_m:
            raise ValueError("mount_m is a piece of the span: less than span_m")
        return self


class _TailTable(Strict):
    """`[tail]`."""

    span_m: _Length
    chord_m: _Length
    arm_m: Annotated[float, _within(-1e3, 1e3)]
    height_m: Annotated[float, _within(-1e3, 1e3)] = 0.0


class _FinTable(Strict):
    """`[fin]`."""

    height_m: _Length
    chord_m: _Length
    thickness: Annotated[float, _within(0.0, 0.5)] = 0.05


class _FuselageTable(Strict):
    """`[fuselage]`."""

    length_m: _Length
    diameter_m: _Length
    nose_m: Annotated[float, _within(0.0, 1e3)]

    @model_validator(mode="after")
    def _slender(self) -> _FuselageTable:
        if self.length_m < 4.0 * self.diameter_m:
            raise ValueError("length_m: at least 4 times diameter_m, what the drag of a body is known for")
        return self


class _PowerTable(Strict):
    """`[power]`."""

    efficiency: _Share
    battery_wh: _Positive
    usable: _Share = 0.8
    avionics_w: _NotNegative = 0.0
    motor: str = ""
    propeller_in: Annotated[float, _up_to(200.0)] | None = None


class _Gust(Strict):
    """`[gust]`."""

    speed_m_s: Annotated[float, _within(0.0, 50.0)] = 3.0


class _PolarTable(Strict):
    """`published.polar`."""

    cd0: _Coefficient
    k: Annotated[float, _up_to(10.0)]
    cl0: _Coefficient


class _PublishedTable(Strict):
    """`[published]`."""

    source: str = ""
    cruise_cl: _Coefficient | None = None
    static_margin: tuple[_Coefficient, _Coefficient] | None = None
    flight_time_min: Annotated[float, _up_to(1e5)] | None = None
    polar: _PolarTable | None = None

    @model_validator(mode="after")
    def _ordered(self) -> _PublishedTable:
        if self.static_margin is not None and self.static_margin[0] > self.static_margin[1]:
            raise ValueError("static_margin: [lowest, highest]")
        return self


class AircraftFile(Strict):
    """The file."""

    schema_: Literal["ori-deploy/aircraft/1"] = Field(alias="schema")
    name: str
    assumed: tuple[str, ...] = ()
    mass: _MassTable
    cruise: _Cruise
    air: _AirTable = _AirTable()
    wing: _WingTable
    tail: _TailTable | None = None
    fin: _FinTable | None = None
    fuselage: _FuselageTable | None = None
    power: _PowerTable
    gust: _Gust = _Gust()
    published: _PublishedTable = _PublishedTable()

    @model_validator(mode="after")
    def _parts_fit(self) -> AircraftFile:
        if self.fin is not None and self.tail is None:
            raise ValueError("fin: stands where the tail is: add a tail")
        for key in self.assumed:
            here: Any = self
            for part in key.split("."):
                if not isinstance(here, Strict) or part not in type(here).model_fields:
                    raise ValueError(f"assumed: there is no key {key!r}")
                here = getattr(here, part)
        return self

    def aircraft(self) -> Aircraft:
        """In SI."""
        wing, power, said = self.wing, self.power, self.published
        return Aircraft(
            name=self.name,
            mass_kg=self.mass.takeoff_kg,
            cg_chord=self.mass.cg_chord,
            cruise_m_s=self.cruise.speed_m_s,
            gust_m_s=self.gust.speed_m_s,
            wing=Wing(
                wing.span_m, wing.area_m2, wing.taper, wing.mount_m, radians(wing.dihedral_deg),
                radians(wing.sweep_deg), radians(wing.incidence_deg), wing.mass_kg,
            ),
            power=Power(
                power.efficiency, power.battery_wh, power.usable, power.avionics_w, power.motor,
                None if power.propeller_in is None else 0.0254 * power.propeller_in,
            ),
            tail=None if self.tail is None else Tail(**self.tail.model_dump()),
            fin=None if self.fin is None else Fin(**self.fin.model_dump()),
            fuselage=None if self.fuselage is None else Fuselage(**self.fuselage.model_dump()),
            air=Air(**self.air.model_dump()),
            published=Published(
                said.source,
                said.cruise_cl,
                said.static_margin,
                None if said.flight_time_min is None else 60.0 * said.flight_time_min,
                None if said.polar is None else Polar(**said.polar.model_dump()),
            ),
            assumed=self.assumed,
        )  # fmt: skip


@dataclass(frozen=True)
class BuiltWing:
    """The structure whose section the wing has when it is deployed.

    Attributes
    ----------
    slit_gap_m
        By how much its skin is open where slits do not quite close.
    clamp
        Panel or cell by which it is held in flight; None for the first panel.
    """

    source: Path
    structure: Structure
    span_m: float
    slit_gap_m: float
    clamp: str | None


@dataclass(frozen=True)
class AircraftGiven:
    """An aircraft file, and the files that it names.

    Attributes
    ----------
    profile, section_name
        The section that the wing is to have, and its name.
    built
        The structure; None where the file names no design.
    """

    craft: Aircraft
    profile: Profile
    section_name: str
    built: BuiltWing | None


def load_aircraft(path: Path) -> AircraftGiven:
    """Read an aircraft file and the design beside it.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown keys, values out of range; names file and key.
    InputError
        The design cannot be used, or there is no such section.
    """
    data = read_toml(path, AIRCRAFT_SCHEMA)
    given = validated(AircraftFile, data, str(path))
    built = _built(path, given.wing)
    if given.wing.naca is None:
        assert built is not None
        return AircraftGiven(given.aircraft(), built.structure.profile, built.source.name.split(".")[0], built)
    try:
        profile = naca_section(given.wing.naca, given.wing.area_m2 / given.wing.span_m)
    except InputError as wrong:
        wrong.source = wrong.source or f"{path}: key wing.naca"
        raise
    return AircraftGiven(given.aircraft(), profile, f"NACA {given.wing.naca}", built)


def _built(path: Path, wing: _WingTable) -> BuiltWing | None:
    if wing.design is None:
        return None
    source = path.parent / wing.design
    if source.suffix == ".json":
        design = load_design(source)
        structure, span = design.structure, design.span_m
    else:
        spec, structure = build_from_file(source)
        span = spec.structure.span_m
    if not isinstance(structure, Structure):
        raise FileError(
            "key wing.design",
            value=f"{wing.design}: a cone",
            limit="a cylinder: its section is one all along the span",
            remedy="name a design on an airfoil",
            source=str(path),
        )
    return BuiltWing(source, structure, span, 1e-3 * wing.slit_gap_mm, wing.clamp)
