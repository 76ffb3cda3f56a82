"""An aircraft's polars by every method, its section's polar and pressures, and where the built section deviates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ori_deploy.aero.assessment import Assessment, Fidelity
from ori_deploy.aero.figures import polars
from ori_deploy.aero.pressure import SectionPressure
from ori_deploy.view.ink import FAINT, INK, SLIT, cell_colour, house_style

_WAYS = 3


def draw_polars(
    found: Assessment,
    built: Fidelity | None,
    pressures: Sequence[tuple[str, SectionPressure]],
) -> Figure:
    """Draw four panels: the aircraft's polar, the section's, pressures, and where the built section deviates."""
    with house_style():
        figure = Figure(figsize=(9.5, 7.6), layout="constrained")
        (one, two), (three, four) = figure.subplots(2, 2)
        _draw_aircraft(one, found)
        _draw_section(two, found, built)
        _draw_pressures(three, pressures)
        _draw_built(four, built)
    return figure


def _draw_aircraft(axes: Axes, found: Assessment) -> None:
    low, high = float(found.lattice.sweep.lift[0]), float(found.lattice.sweep.lift[-1])
    lift = np.linspace(min(0.0, low), high, 100)
    points = {way.name: way.sweep for way in (found.lattice, found.build_up)}
    for k, (name, polar) in enumerate(polars(found).items()):
        colour = cell_colour(k, _WAYS + 1)
        axes.plot(polar.drag(lift), lift, color=colour, label=name)
        if name in points:
            axes.plot(points[name].drag, points[name].lift, "o", markersize=3.5, color=colour)
    axes.axhline(found.lift_needed, color=FAINT, linewidth=0.8)
    axes.annotate("cruise", (1.0, found.lift_needed), (-2.0, 2.0), xycoords=("axes fraction", "data"),
                  textcoords="offset points", ha="right", va="bottom", color=FAINT)  # fmt: skip
    axes.set(title=f"{found.craft.name}: polar", xlabel="C_D", ylabel="C_L")
    axes.set_xlim(left=0.0)
    axes.legend(loc="lower right")


def _draw_section(axes: Axes, found: Assessment, built: Fidelity | None) -> None:
    forces = found.section_polar.forces
    axes.plot(forces.drag, forces.lift, color=INK, label=found.section.name)
    for k, standing in enumerate(built.standings if built is not None else ()):
        axes.plot(
            standing.forces.drag, standing.forces.lift, "os"[k % 2], markersize=6.0, fillstyle="none",
            color=SLIT if standing.fold < 1.0 else cell_colour(0, _WAYS), label=standing.state,
        )  # fmt: skip
    axes.set(title=f"section at Re {found.craft.reynolds:.3g}, NeuralFoil", xlabel="C_d", ylabel="C_l")
    axes.set_xlim(0.0, float(np.percentile(forces.drag, 90)) * 1.3)
    axes.legend(loc="center right")


def _draw_pressures(axes: Axes, pressures: Sequence[tuple[str, SectionPressure]]) -> None:
    for k, (name, each) in enumerate(pressures):
        x = each.profile.point(each.s).real / each.profile_chord
        axes.plot(x, each.cp, color=cell_colour(k, _WAYS), label=f"{name}, C_l {each.lift:.2f}")
    axes.invert_yaxis()
    axes.set(title="pressure on the section", xlabel="x / chord", ylabel="C_p")
    axes.legend(loc="upper right")


def _draw_built(axes: Axes, built: Fidelity | None) -> None:
    if built is None:
        axes.set_axis_off()
        return
    axes.set(title="built section: outwards of the wanted one", xlabel="x / chord", ylabel="mm")
    for standing in built.standings:
        colour = SLIT if standing.fold < 1.0 else cell_colour(0, _WAYS)
        off = standing.deviation
        x, away = off.aligned.real / built.chord_m, 1e3 * off.outwards
        nose = int(x.argmin())
        axes.plot(x[: nose + 1], away[: nose + 1], color=colour, label=f"{standing.state}, above")
        axes.plot(x[nose:], away[nose:], color=colour, linestyle="--", label=f"{standing.state}, below")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
