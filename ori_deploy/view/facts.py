"""The figures of a design, a plan and a run as words and numbers for people: degrees, millimetres, per cent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.files import Design
from ori_deploy.motion import Mechanism, MotionCheck, Plan, SpanFolding
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run
from ori_deploy.telemetry.summary import Summary, TrackingWorst, summarise

_MM = 1e3


@dataclass(frozen=True)
class Fact:
    """A line of a table: what, how much with its unit, and what else belongs to it."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class CellRow:
    """A cell's line: texts in the order of the table's columns."""

    cell: str
    angles_deg: tuple[str, ...]
    rim_mm: tuple[str, ...]
    offset_mm: tuple[str, ...]
    margin_deg: tuple[str, ...]


def _clearance(check: MotionCheck, where: str) -> Fact:
    if not check.has_clearance:
        return Fact("smallest clearance", "none", "no two panels that could meet")
    return Fact(
        "smallest clearance", _mm(check.smallest_clearance_m), f"{' and '.join(check.clearance_panels)} {where}"
    )


def _mm(length_m: float) -> str:
    """Millimetres to three figures, never in powers of ten."""
    return f"{np.format_float_positional(_MM * length_m, precision=3, fractional=False, trim='-')} mm"


def _sides(lengths_m: Sequence[float]) -> str:
    return " by ".join(_mm(length) for length in lengths_m)


def key_facts(
    design: Design | None, plan: Plan | None, run: Run | None, folding: SpanFolding | None = None
) -> tuple[Fact, ...]:
    """The few figures that a person looks for first."""
    facts: list[Fact] = []
    if design is not None:
        structure, ratio = design.structure, design.entries.packaging()["box_ratio"]
        whole = "cross-section" if isinstance(structure, Structure) else "volume"
        facts += [
            Fact("packaging ratio η", f"{structure.eta:.4f}", "cross-section over material"),
            Fact(
                "volume reduction", f"{100.0 * (1.0 - 1.0 / structure.eta):.1f} %", "material against cross-section"
            ),
            Fact("box ratio", f"{ratio:.3f}", f"{whole} over folded box"),
        ]
    if folding is not None:
        note = f"the span of {folding.span_m:.4g} m in {folding.segments} segments"
        facts.append(Fact("stowed length", _mm(folding.length_m), note))
    if plan is not None:
        facts.append(_clearance(plan.check, f"at fold {plan.check.clearance_fold:.2f}, touching ends left out"))
    if run is not None:
        worst = summarise(run).worst_tracking
        facts.append(_tracking_fact(worst, "" if worst is None else worst.hinge_id))
        facts += [Fact(f"{r.command} took", _told(r.duration_s, " s"), str(r.outcome)) for r in run.results]
    elif plan is not None:
        facts.append(Fact("planned duration", f"{plan.duration_s:.2f} s", "flat to deployed"))
    return tuple(facts)


def folding_of(design: Design | None) -> SpanFolding | None:
    """How the span folds; None where it is in one piece."""
    if design is None or design.span_segments == 1 or not isinstance(design.structure, Structure):
        return None
    return SpanFolding(Mechanism(design.structure), design.span_m, design.span_segments)


def span_facts(folding: SpanFolding | None, plan: Plan | None) -> tuple[Fact, ...]:
    """Of a span in segments: its hinges, how it is folded by hand, what it stows to. Nothing of one in one piece."""
    facts: list[Fact] = []
    stage = None if plan is None else plan.span
    if folding is not None:
        facts.append(Fact("segments", str(folding.segments), f"each {_mm(folding.length_m)} long"))
        facts += [
            Fact(
                f"piano hinge {hinge.id}",
                f"panel {hinge.panel}",
                f"{hinge.side} face of the flat stack, up to {_mm(hinge.length_m)} long",
            )
            for hinge in folding.hinges
        ]
        facts.append(Fact("stowed box", _sides(folding.stowed_box_m), f"box ratio {folding.stowed_box_ratio:.3f}"))
    elif stage is not None:
        facts.append(Fact("segments", str(stage.segments), f"on piano hinges {', '.join(stage.hinge_ids)}"))
        facts.append(Fact("stowed box", _sides(stage.stowed_box_m)))
    if stage is not None:
        orders = ", ".join(order.replace("_", " ") for order in stage.free_orders)
        facts += [
            Fact(
                "unfolding",
                f"{stage.duration_s:.2f} s, by hand",
                "only while the cells are flat: before they open, after they have closed",
            ),
            Fact("hinges may fold", orders or "in no order", "checked for contact between segments"),
            Fact(
                "deepest penetration",
                f"at most {_mm(stage.deepest_penetration_m)}",
                f"between segments, all hinges in step; allowed {_mm(stage.allowed_penetration_m)}",
            ),
        ]
    return tuple(facts)


def design_facts(design: Design, *, span_known: bool) -> tuple[Fact, ...]:
    """What was designed; where the span is not known, a cross-section."""
    structure = design.structure
    layout = structure.layout
    margin = np.degrees(structure.cells.dead_centre_margin)
    cell, end = np.unravel_index(int(margin.argmin()), margin.shape)
    inner = sum(v.inner for v in layout.vertices)
    if isinstance(structure, ConeStructure):
        shape, box_of = _cone_shape(design, structure), "truncated cone, folded flat"
    else:
        shape, box_of = _plane_shape(structure), "flat cross-section"
    if span_known:
        ends = f"from {design.r_min_m:.4g} m to {design.r_max_m:.4g} m from the apex"
        span = Fact("span", f"{design.span_m:.4g} m", ends if isinstance(structure, ConeStructure) else "")
        shape = (shape[0], span, *shape[1:])
    return (
        *shape,
        Fact(
            "layout",
            f"{layout.n_cells} cells",
            f"{layout.n_panels} panels, {inner} inner vert{'ex' if inner == 1 else 'ices'}",
        ),
        Fact("folded stack", _sides(design.entries.packaging()["stack_box_m"]), f"smallest box round the {box_of}"),
        Fact(
            "smallest dead-centre margin",
            f"{margin[cell, end]:.2f}°",
            f"{layout.cell_ids[cell]}, closing crease {'ab'[end]}",
        ),
        Fact("latch points", ", ".join(layout.latch_points) or "none"),
    )


def _plane_shape(structure: Structure) -> tuple[Fact, ...]:
    profile = structure.profile
    extent = profile.table_f
    return (
        Fact("profile", profile.kind, f"{_mm(float(np.ptp(extent.real)))} by {_mm(float(np.ptp(extent.imag)))}"),
        Fact("least wall offset", _mm(structure.wall_m)),
        Fact(
            "cross-section", f"{1e4 * profile.area:.2f} cm²", f"material {1e4 * structure.panel_areas.sum():.2f} cm²"
        ),
    )


def _cone_shape(design: Design, structure: ConeStructure) -> tuple[Fact, ...]:
    cone = structure.profile
    return (
        Fact("profile", f"cone over {cone.base.kind}", f"rays up to {np.degrees(cone.size):.4g}° apart"),
        Fact(
            "least wall offset",
            _mm(structure.wall_rad * design.r_max_m),
            f"at the outer radius; {np.degrees(structure.wall_rad):.4g}° seen from the apex",
        ),
        Fact("solid angle", f"{cone.solid_angle:.4g} sr", f"material {structure.panel_areas.sum():.4g} sr"),
    )


def plan_facts(plan: Plan) -> tuple[Fact, ...]:
    """What was planned, and what the check found."""
    check, steps = plan.check, plan.step_tolerance
    low, high = check.clearance_fold_range
    return (
        Fact("planned duration", f"{plan.duration_s:.2f} s", f"flat to deployed, {plan.rate_hz:g} Hz"),
        _clearance(check, f"at fold {check.clearance_fold:.3g}; taken from fold {low:g} to {high:g}"),
        Fact(
            "deepest penetration",
            f"at most {_mm(check.deepest_penetration_m)}",
            f"allowed {_mm(check.allowed_penetration_m)}; {check.n_poses} poses checked",
        ),
        Fact(
            "safe step tolerance",
            f"{steps.smallest:.4f} of the fold",
            "smallest before seating begins; see the plan's curves",
        ),
        Fact(
            "seating",
            f"from fold {steps.seating_fold:.3g}" if steps.seating_fold < 1.0 else "none",
            f"contact at the slits up to {_mm(steps.seating_depth_m)} deep" if steps.seating_fold < 1.0 else "",
        ),
    )


def run_facts(run: Run) -> tuple[Fact, ...]:
    """What was carried out."""
    s: Summary = summarise(run)
    how = "" if s.complete else ", damaged" if run.unread else ", cut off"
    facts = [
        Fact("length of the log", f"{s.duration_s:.2f} s", f"{s.cycles} cycles{how}"),
        *(
            Fact(r.command, f"{r.outcome}{_in_time(r.duration_s)}", f"final state {r.state}, {r.cycles} cycles")
            for r in s.results
        ),
        _tracking_fact(s.worst_tracking, _tracking_note(s)),
        Fact("largest spread of fold", _known(s.largest_spread, ".4f"), "between any two cells, measured"),
        Fact("overruns", str(s.overruns), f"worst lateness {_told(1e3 * s.worst_lateness_s, ' ms')}"),
        *_timing_facts(run),
        Fact("lost replies", str(s.lost_replies)),
        Fact("hottest", _known(s.hottest_c, ".1f", " °C")),
        Fact("lowest supply", _known(s.lowest_v, ".2f", " V")),
    ]
    return tuple(facts)


def _in_time(duration_s: float) -> str:
    return f" in {duration_s:.2f} s" if np.isfinite(duration_s) else ", how long not told"


def _tracking_fact(worst: TrackingWorst | None, note: str) -> Fact:
    value = "not read" if worst is None else f"{np.degrees(worst.error_rad):.2f}°"
    return Fact("worst tracking error", value, note)


def _tracking_note(s: Summary) -> str:
    """Whose the worst tracking error is, and of which hinges none is known while it is of others."""
    worst = s.worst_tracking
    if worst is None:
        return ""
    unread = ", ".join(w.hinge_id for w in s.tracking if not np.isfinite(w.error_rad))
    note = f"{worst.hinge_id} (cell {worst.cell_id}) after {worst.time_s:.2f} s"
    return f"{note}; not read: {unread}" if unread else note


def _timing_facts(run: Run) -> list[Fact]:
    """Where a cycle's time went, and what of it was lost to the log."""
    if not run.timing:
        return []
    parts = {name: 1e3 * run.timing[f"{name}_s"] for name in ("read", "decide", "send", "record")}
    whole = np.sum(list(parts.values()), axis=0)
    known = whole[np.isfinite(whole)]
    most = f"{known.max():.2f} ms at most" if known.size else "not told"
    medians = {
        name: np.median(part) if (part := values[np.isfinite(values)]).size else np.nan
        for name, values in parts.items()
    }
    told = ", ".join(f"{name} {_told(float(median))}" for name, median in medians.items())
    return [
        Fact("work of a cycle", most, f"medians in ms: {told}"),
        Fact("records dropped", str(run.dropped), "by a recorder that was too far behind" if run.dropped else ""),
    ]


def _told(value: float, unit: str = "") -> str:
    """A figure that the controller gives of itself; a log may hold null for it."""
    return f"{value:.2f}{unit}" if np.isfinite(value) else "not told"


def _known(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if np.isfinite(value) else "not read"


def cell_rows(design: Design) -> tuple[CellRow, ...]:
    """The cells, one by one; the four angles in the order of `motion.CREASES`. Lengths of a cone are at `r_max_m`."""
    cells, to_mm = design.structure.cells, _MM * design.unit_m

    def texts(values: Reals, form: str) -> tuple[str, ...]:
        return tuple(f"{value:{form}}" for value in values)

    return tuple(
        CellRow(
            cell=name,
            angles_deg=texts(np.degrees(cells.angle[i]), ".1f"),
            rim_mm=texts(to_mm * cells.rim[i], ".2f"),
            offset_mm=texts(to_mm * cells.offset[i], ".2f"),
            margin_deg=texts(np.degrees(cells.dead_centre_margin[i]), ".1f"),
        )
        for i, name in enumerate(design.structure.layout.cell_ids)
    )


def provenance_facts(
    design_sha256: str, plan_sha256: str, plan: Plan | None, run: Run | None, version: str
) -> tuple[tuple[Fact, ...], tuple[str, ...]]:
    """Where everything comes from, and what does not belong together.

    Parameters
    ----------
    design_sha256, plan_sha256
        Of the files at hand; empty where there is none.
    version
        Of this program.
    """
    told = {
        "design": {"its file": design_sha256, "the plan": plan.design_sha256 if plan is not None else ""},
        "plan": {"its file": plan_sha256},
        "rig": {},
    }
    facts: list[Fact] = []
    warnings: list[str] = []
    for name, digests in told.items():
        if run is not None:
            digests["the log"] = str(run.info[f"{name}_sha256"])
        by_digest: dict[str, list[str]] = {}
        for source, digest in digests.items():
            if digest:
                by_digest.setdefault(digest, []).append(source)
        facts += [Fact(f"{name} sha256", d, f"according to {' and '.join(by)}") for d, by in by_digest.items()]
        if len(by_digest) > 1:
            disagree = " and ".join(by[0].replace("its", f"the {name}") for by in by_digest.values())
            warnings.append(f"These do not belong together: {disagree} name different {name}s.")
    if run is not None:
        facts += [
            Fact("rig file", str(run.info["rig_file"]) or "none"),
            *([] if run.info["seed"] is None else [Fact("seed", str(run.info["seed"]), "of simulated servos")]),
            Fact("controller's version", str(run.info["version"])),
        ]
        if run.versions:
            v = run.versions
            facts.append(
                Fact(
                    "ran on",
                    f"Python {v.get('python')}, numpy {v.get('numpy')}, {v.get('clock')} clock",
                    f"{v.get('platform')}, {v.get('processors')} processors, scheduling {v.get('scheduling')}; "
                    f"begun {v.get('begun_utc')}",
                )
            )
    facts.append(Fact("report's version", version))
    return tuple(facts), tuple(warnings)
