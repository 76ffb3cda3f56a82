"""Why figures disagree, in words around the numbers that came out: no figure is written here."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ori_deploy.aero.assessment import Assessment, Fidelity
from ori_deploy.aero.figures import drag_n
from ori_deploy.aero.flight import gust_alleviation, mass_ratio, power_w
from ori_deploy.aero.friction import fin_drag, fuselage_drag, tail_drag
from ori_deploy.aero.pressure import SectionPressure

_SAME = 0.01
"""Relative difference up to which two figures are one."""
_CUT_ALIKE = 1e-5
"""In chords: an outline nearer than this is the same outline."""


def remarks(found: Assessment, built: Fidelity | None, pressures: tuple[SectionPressure, ...]) -> tuple[str, ...]:
    """All there is to say, a paragraph each."""
    return (
        *_lift(found),
        *_drag(found),
        *_curvature(found),
        *_methods(found),
        *_margin(found),
        *_endurance(found),
        *_gust(found),
        *(_section(built) if built is not None else ()),
        *_pressures(pressures),
    )


def _than(value: float, other: float) -> str:
    share = 100.0 * (value / other - 1.0)
    return f"{abs(share):.1f} % {'more' if share > 0.0 else 'less'} than"


def _lift(found: Assessment) -> Iterator[str]:
    craft, said, needed = found.craft, found.craft.published.cruise_cl, found.lift_needed
    if said is None:
        return
    if abs(said / needed - 1.0) <= _SAME:
        yield f"C_L: the published {said:g} is what weight, speed, area and density give, {needed:.3f}."
        return
    ratio = said / needed
    alone = (
        f"{ratio * craft.mass_kg:.3f} kg",
        f"{craft.cruise_m_s / np.sqrt(ratio):.2f} m/s",
        f"{craft.wing.area_m2 / ratio:.4f} m2",
        f"air of {craft.air.density_kg_m3 / ratio:.3f} kg/m3",
    )
    yield (
        f"C_L: weight, speed, area and density give {needed:.3f}; the published {said:g} is {_than(said, needed)} "
        f"that: these published figures do not all belong to one state. Any of these alone would make them agree: "
        f"{', '.join(alone)}."
    )
    steps, reached = _what_may_count(found)
    if steps:
        yield (
            f"C_L: what may lie behind it, one upon the other: {'; '.join(steps)}. That leaves "
            f"{100.0 * (said / reached - 1.0):+z.1f} %. Which of them was counted is not said."
        )


def _what_may_count(found: Assessment) -> tuple[list[str], float]:
    """Definitions by which C_L is larger, and what it is with all of them."""
    wing, reached = found.craft.wing, found.lift_needed
    steps = []
    if wing.mount_m > 0.0:
        reached *= wing.span_m / (wing.span_m - wing.mount_m)
        steps.append(f"only the wing outside its mounts counted, {reached:.3f}")
    if wing.dihedral_rad:
        reached /= float(np.cos(wing.dihedral_rad))
        steps.append(f"lift square on halves with dihedral, {reached:.3f}")
    download = -found.lattice.trim.found.tail_lift / found.lift_needed
    if download > 0.0:
        reached *= 1.0 + download
        steps.append(f"a wing that carries the tail's download at this centre of gravity, too, {reached:.3f}")
    return steps, reached


def _drag(found: Assessment) -> Iterator[str]:
    craft, said, ours = found.craft, found.craft.published.polar, found.lattice
    plain = ours.trim.found
    parts = {
        "the wing's boundary layer": plain.profile,
        "trailing vortices": plain.induced,
        "tail": tail_drag(craft),
        "fin": fin_drag(craft),
        "fuselage": fuselage_drag(craft),
    }
    told = ", ".join(f"{name} {value:.4f}" for name, value in parts.items() if value)
    yield f"C_D at cruise by {ours.name}: {told}. Its parabola is within {ours.sweep.misfit:.1g} of its points."
    if said is None:
        return
    theirs, base = float(said.drag(found.lift_needed)), said.cd0 - ours.sweep.polar.cd0
    plate_cm2 = 1e4 * abs(base) * craft.wing.area_m2
    where = (
        "that is not modelled here (gaps of the skin, hinges, mounts, motor, propeller), or a margin there"
        if base > 0.0
        else "less there than here"
    )
    yield (
        f"C_D: at C_L {found.lift_needed:.3f} the published polar gives {theirs:.4f}, {_than(theirs, plain.drag)} "
        f"the {plain.drag:.4f} here. Of this difference of {theirs - plain.drag:+.4f}, {base:+.4f} is in C_D0: a "
        f"drag area of {plate_cm2:.0f} cm2 {where}."
    )


def _curvature(found: Assessment) -> Iterator[str]:
    said, aspect = found.craft.published.polar, found.craft.wing.aspect_ratio
    if said is None:
        return
    one, other = found.lattice.sweep, found.build_up.sweep
    yield (
        f"k: vortices alone of an elliptic wing would make it 1 / (π A) = {1.0 / (np.pi * aspect):.4f}. The "
        f"published {said.k:g} stands for a span efficiency of {said.oswald(aspect):.2f}, the {one.polar.k:.4f} of "
        f"{found.lattice.name} for {one.polar.oswald(aspect):.2f}, the {other.polar.k:.4f} of "
        f"{found.build_up.name} for {other.polar.oswald(aspect):.2f}. The section's drag, which grows with lift, is "
        f"in all of them; k and C_L0 move with the range that is fitted, here C_L {one.lift[0]:.2f} to "
        f"{one.lift[-1]:.2f}."
    )


def _methods(found: Assessment) -> Iterator[str]:
    one, other, craft = found.lattice, found.build_up, found.craft
    own = np.degrees(found.section_polar.alpha_rad(found.wing_lift))
    down = np.degrees(found.wing_lift / (np.pi * craft.wing.aspect_ratio))
    yield (
        f"Methods: {one.name} flies level at {np.degrees(one.trim.alpha_rad):.1f} deg, {other.name} at "
        f"{np.degrees(other.trim.alpha_rad):.1f}. By NeuralFoil the section has the wing's C_l at {own:.1f} deg, and "
        f"an elliptic wing's downwash is {down:.1f} deg: together {own + down:.1f} to the chord. "
        f"{other.name} takes its sections' lift from NeuralFoil, boundary layer and all; a lattice has it from their "
        "camber alone."
    )
    if craft.tail is None:
        return
    behind = 100.0 * (other.stability.neutral_chord - one.stability.neutral_chord)
    yield (
        f"Methods: {other.name} has the neutral point {abs(behind):.1f} % of the chord "
        f"{'behind' if behind > 0.0 else 'ahead of'} that of {one.name}. Its tail does not feel the wing's downwash, "
        "which moves the point aft, and it has the fuselage, which moves it forward; the lattice has downwash and no "
        "fuselage."
    )


def _margin(found: Assessment) -> Iterator[str]:
    craft, said = found.craft, found.craft.published.static_margin
    if craft.tail is None or said is None:
        return
    fore, aft = (100.0 * (found.lattice.stability.neutral_chord - m) for m in reversed(said))
    yield (
        f"Static margin: the neutral point is computed, the centre of gravity is the file's, "
        f"{100.0 * craft.cg_chord:.1f} % of the chord. With this tail (volume {craft.tail.volume(craft.wing):.2f}) "
        f"the published {100.0 * said[0]:g} to {100.0 * said[1]:g} % are had at {fore:.1f} to {aft:.1f} %: where "
        "these are assumptions, agreement is a choice and no finding."
    )


def _endurance(found: Assessment) -> Iterator[str]:
    craft, said, power = found.craft, found.craft.published.endurance_s, found.craft.power
    if said is None:
        return
    polar = craft.published.polar
    drag = found.lattice.trim.found.drag if polar is None else float(polar.drag(found.lift_needed))
    by = found.lattice.name if polar is None else "the published polar"
    drawn = power_w(drag_n(craft, drag), craft.cruise_m_s, power)
    yield (
        f"Endurance: at the {drawn:.1f} W of {by} the published {said / 60.0:g} min take "
        f"{drawn * said / 3600.0:.2f} Wh; the file's battery has {power.battery_wh * power.usable:.2f} Wh to fly "
        f"with ({100.0 * power.usable:.0f} % of {power.battery_wh:g}). The time says as much about battery and "
        "reserve as about drag: alone it neither confirms nor refutes a polar."
    )


def _gust(found: Assessment) -> Iterator[str]:
    craft, gust = found.craft, found.gust
    alleviated = gust_alleviation(mass_ratio(craft, found.lattice.stability.slope))
    text = (
        f"Gust: {craft.gust_m_s:g} m/s up at {craft.cruise_m_s:g} m/s loads the aircraft {gust.factor:.2f} times, "
        f"{1.0 + (gust.factor - 1.0) / alleviated:.2f} times were it sharp-edged. Its section's largest C_l is "
        f"{found.section_polar.largest_lift:.2f}: "
    )
    if gust.stalls:
        yield text + f"it stalls before, at {gust.carried:.2f} times its weight, and pressures are taken there."
    else:
        yield text + f"at {gust.lift:.2f} it does not stall."


def _section(built: Fidelity) -> Iterator[str]:
    exact, *opened = built.standings
    mm, off = 1e3 * built.chord_m, exact.deviation.largest
    if off < _CUT_ALIKE * built.chord_m:
        why = f"{1e6 * off:.2g} µm off the wanted one, the fineness of the comparison: its skin is cut from it"
    else:
        why = f"{1e3 * off:.2f} mm off the wanted one, because its skin is cut from another profile"
    yield f"Section, {exact.state}: {why}. NeuralFoil sees a smooth curve, here within {mm * exact.unseen:.2f} mm."
    for standing in opened:
        at = 1e3 * standing.deviation.at
        lift = float(standing.forces.lift[0] - built.wanted.lift[0])
        drag = 100.0 * float(standing.forces.drag[0] / built.wanted.drag[0] - 1.0)
        yield (
            f"Section, {standing.state}: at fold {standing.fold:.5f} it is off most, "
            f"{1e3 * standing.deviation.largest:.2f} mm, at ({at.real:.0f}, {at.imag:.0f}) mm. C_l moves by "
            f"{lift:+.3f}, C_d by {drag:+.1f} %; of steps and slots NeuralFoil does not see "
            f"{mm * standing.unseen:.2f} mm, nor that they trip the boundary layer."
        )


def _pressures(pressures: tuple[SectionPressure, ...]) -> Iterator[str]:
    for each in pressures:
        summed = each.integrated_lift
        yield (
            f"Pressures at C_l {each.lift:.3f}: integrated they give {summed:.3f}, {_than(summed, each.lift)} "
            f"NeuralFoil's own; least C_p {each.cp.min():.2f}."
        )
