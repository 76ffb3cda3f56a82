"""What came out, as figures with their methods, beside what was published."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ori_deploy.aero.aircraft import Aircraft
from ori_deploy.aero.assessment import Assessment, ByMethod, Fidelity
from ori_deploy.aero.flight import endurance_s, ideal_efficiency, mass_ratio, power_w
from ori_deploy.aero.polar import Polar

_FORCES = ("air", "wing.incidence_deg", "tail", "fin", "fuselage", "mass.cg_chord")
"""Keys that everything about forces rests on."""
_POWER = ("power.usable", "power.battery_wh", "power.avionics_w")


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes
    ----------
    group, quantity, unit
        Under which heading, what, and in what; empty for numbers without a unit.
    value
        The figure.
    method
        How it was found.
    published
        What was published: a number, lowest and highest, or nothing.
    assumed
        Keys of the file that it rests on and that are assumptions.
    """

    group: str
    quantity: str
    value: float
    unit: str
    method: str
    published: float | tuple[float, float] | None = None
    assumed: tuple[str, ...] = ()

    @property
    def difference(self) -> float | None:
        """Of the figure from the published one, in parts of that; from an interval's nearer end, 0 inside."""
        if self.published is None:
            return None
        if isinstance(self.published, tuple):
            low, high = self.published
            near = float(np.clip(self.value, low, high))
        else:
            near = self.published
        return 0.0 if self.value == near else self.value / near - 1.0 if near else None


def assumptions(craft: Aircraft, keys: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the file's assumed keys that some keys mean or hold."""
    return tuple(
        a
        for a in craft.assumed
        if any(a == k or f"{a}.".startswith(f"{k}.") or f"{k}.".startswith(f"{a}.") for k in keys)
    )


def all_figures(found: Assessment, built: Fidelity | None) -> tuple[Figure, ...]:
    """Every figure, in the order in which they are read."""
    return (
        *_cruise(found),
        *_polar(found),
        *_trim(found),
        *_endurance(found),
        *_gust(found),
        *(_section(found, built) if built is not None else ()),
    )


def _cruise(found: Assessment) -> Iterator[Figure]:
    craft = found.craft
    air = assumptions(craft, ("air",))
    yield Figure("cruise", "C_L", found.lift_needed, "", "weight / (q S)", craft.published.cruise_cl, air)
    yield Figure("cruise", "Reynolds number", craft.reynolds, "", "mean chord", None, air)


def _ways(found: Assessment) -> tuple[ByMethod, ByMethod]:
    return found.lattice, found.build_up


def _polar(found: Assessment) -> Iterator[Figure]:
    craft, said = found.craft, found.craft.published.polar
    rests = assumptions(craft, _FORCES)
    for name in ("cd0", "k", "cl0"):
        for way in _ways(found):
            value = getattr(way.sweep.polar, name)
            shown = {"cd0": "C_D0", "k": "k", "cl0": "C_L0"}[name]
            yield Figure("polar", shown, value, "", way.name, None if said is None else getattr(said, name), rests)
    at = found.lift_needed
    published = None if said is None else float(said.drag(at))
    for way in _ways(found):
        yield Figure("polar", "C_D at cruise", way.trim.found.drag, "", way.name, published, rests)
    for way in _ways(found):
        ratio = None if published is None else at / published
        yield Figure("polar", "L / D at cruise", at / way.trim.found.drag, "", way.name, ratio, rests)


def _trim(found: Assessment) -> Iterator[Figure]:
    craft = found.craft
    rests = assumptions(craft, _FORCES)
    for way in _ways(found):
        yield Figure("trim", "angle of attack", float(np.degrees(way.trim.alpha_rad)), "deg", way.name, None, rests)
    if craft.tail is None:
        return
    for way in _ways(found):
        yield Figure("trim", "tail incidence", float(np.degrees(way.trim.tail_rad)), "deg", way.name, None, rests)
    for way in _ways(found):
        yield Figure(
            "trim", "neutral point", 100.0 * way.stability.neutral_chord, "% c", way.name, None,
            assumptions(craft, tuple(k for k in _FORCES if k != "mass.cg_chord")),
        )  # fmt: skip
    said = craft.published.static_margin
    published = None if said is None else (100.0 * said[0], 100.0 * said[1])
    for way in _ways(found):
        yield Figure("trim", "static margin", 100.0 * way.stability.margin, "% c", way.name, published, rests)


def drags(found: Assessment) -> dict[str, tuple[float, tuple[str, ...]]]:
    """C_D at cruise by every way there is to it, and the assumptions each rests on."""
    craft = found.craft
    known: dict[str, tuple[float, tuple[str, ...]]] = {}
    if craft.published.polar is not None:
        known["published polar"] = float(craft.published.polar.drag(found.lift_needed)), assumptions(craft, ("air",))
    for way in _ways(found):
        known[way.name] = way.trim.found.drag, assumptions(craft, _FORCES)
    return known


def drag_n(craft: Aircraft, coefficient: float) -> float:
    """Drag at cruise."""
    return coefficient * craft.dynamic_pressure_pa * craft.wing.area_m2


def _endurance(found: Assessment) -> Iterator[Figure]:
    craft = found.craft
    said = craft.published.endurance_s
    for name, (coefficient, rests) in drags(found).items():
        drawn = power_w(drag_n(craft, coefficient), craft.cruise_m_s, craft.power)
        more = assumptions(craft, ("power.avionics_w",))
        yield Figure("endurance", "power from battery", drawn, "W", name, None, (*rests, *more))
    for name, (coefficient, rests) in drags(found).items():
        lasts = endurance_s(drag_n(craft, coefficient), craft.cruise_m_s, craft.power)
        yield Figure(
            "endurance", "time of flight", lasts / 60.0, "min", name, None if said is None else said / 60.0,
            (*rests, *assumptions(craft, _POWER)),
        )  # fmt: skip
    if craft.power.propeller_m is not None:
        coefficient, rests = next(iter(drags(found).values()))
        ideal = ideal_efficiency(drag_n(craft, coefficient), craft.dynamic_pressure_pa, craft.power.propeller_m)
        yield Figure("endurance", "propeller's bound", 100.0 * ideal, "%", "actuator disc", None, rests)


def _gust(found: Assessment) -> Iterator[Figure]:
    craft, gust = found.craft, found.gust
    rests = assumptions(craft, ("gust", *_FORCES))
    slope = found.lattice.stability.slope
    yield Figure("gust", "dC_L / dα", slope, "1/rad", found.lattice.name, None, assumptions(craft, _FORCES))
    yield Figure("gust", "mass ratio", mass_ratio(craft, slope), "", "2 m / (ρ S c a)", None, rests)
    yield Figure("gust", f"load factor, {craft.gust_m_s:.3g} m/s", gust.factor, "", "Pratt, CS-23.341", None, rests)
    yield Figure(
        "gust", "the wing's C_L", gust.lift, "", "stalls first" if gust.stalls else "load factor", None, rests
    )


def _section(found: Assessment, built: Fidelity) -> Iterator[Figure]:
    craft = found.craft
    gap = assumptions(craft, ("wing.slit_gap_mm",))
    for standing in built.standings:
        rests = gap if standing.fold < 1.0 else ()
        for name, value in (("max", standing.deviation.largest), ("RMS", standing.deviation.rms)):
            for scaled, unit in ((1e3 * value, "mm"), (100.0 * value / built.chord_m, "% c")):
                yield Figure(
                    "section: deviation", f"{name}, {standing.state}", scaled, unit, "poses, best fit", None, rests
                )
    group = f"section: at {np.degrees(built.alpha_rad):.2f} deg"
    flow = assumptions(craft, ("air", "tail", "mass.cg_chord"))
    for symbol, key in (("C_l", "lift"), ("C_d", "drag")):
        wanted = float(getattr(built.wanted, key)[0])
        yield Figure(group, f"{symbol}, {found.section.name}", wanted, "", "NeuralFoil", None, flow)
        for standing in built.standings:
            value = float(getattr(standing.forces, key)[0])
            rests = (*flow, *(gap if standing.fold < 1.0 else ()))
            yield Figure(group, f"{symbol}, {standing.state}", value, "", "NeuralFoil", None, rests)


def polars(found: Assessment) -> dict[str, Polar]:
    """Every polar there is, by its way."""
    said = found.craft.published.polar
    known = {} if said is None else {"published": said}
    return known | {way.name: way.sweep.polar for way in _ways(found)}
