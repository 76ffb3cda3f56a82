"""The report: one HTML file that shows what was designed, planned and carried out, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.files import Design
from ori_deploy.motion import Plan, SpanFolding
from ori_deploy.telemetry.read import Run
from ori_deploy.view.events import run_events
from ori_deploy.view.facts import (
    cell_rows,
    design_facts,
    folding_of,
    key_facts,
    plan_facts,
    provenance_facts,
    run_facts,
    span_facts,
)
from ori_deploy.view.plan_curves import draw_plan
from ori_deploy.view.section import draw_section
from ori_deploy.view.sheet import to_inline_svg
from ori_deploy.view.spanwise import draw_spanwise
from ori_deploy.view.strip import draw_strip
from ori_deploy.view.tracking import draw_tracking
from ori_deploy.view.verdict import verdict


@dataclass(frozen=True)
class Illustration:
    """A figure on the page.

    Attributes
    ----------
    id
        Of its section, for links.
    title, caption
        What it shows, and how to read it.
    svg
        The drawing.
    """

    id: str
    title: str
    caption: str
    svg: Markup


def render_report(
    name: str,
    *,
    structure: Structure | ConeStructure | None = None,
    span_m: float | None = None,
    r_min_m: float = 0.0,
    span_segments: int = 1,
    plan: Plan | None = None,
    run: Run | None = None,
    design_sha256: str = "",
    plan_sha256: str = "",
) -> str:
    """The page as text: self-contained, without scripts, the same for the same input.

    Parameters
    ----------
    name
        Of the design, for people.
    structure, span_m, r_min_m
        The design; its span, and the radius from the apex at which a cone's begins, in metres.
    span_segments
        How many segments the span is cut into.
    plan
        The plan.
    run
        The flight log. At least one of structure, plan and run has to be given.
    design_sha256, plan_sha256
        Digests of the files these came from; empty where unknown.

    Raises
    ------
    ValueError
        There is nothing to report on.
    """
    if structure is None and plan is None and run is None:
        raise ValueError("a report needs a design, a plan or a log")
    design = None
    if structure is not None:
        design = Design(
            name, 1.0 if span_m is None else span_m, structure, span_segments=span_segments, r_min_m=r_min_m
        )
    folding = folding_of(design)
    facts, warnings = provenance_facts(design_sha256, plan_sha256, plan, run, version("ori-deploy"))
    template = _environment().get_template("report.html.j2")
    return template.render(
        name=name,
        verdict=verdict(plan, run, mixed=bool(warnings)),
        warnings=warnings,
        key_facts=key_facts(design, plan, run, folding),
        figures=_figures(name, structure, folding, plan, run),
        tables=_tables(design, folding, span_m is not None, plan, run),
        cells=cell_rows(design) if design is not None else (),
        events=run_events(run) if run is not None else (),
        provenance=facts,
    )


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("ori_deploy", "view"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _tables(
    design: Design | None, folding: SpanFolding | None, span_known: bool, plan: Plan | None, run: Run | None
) -> dict[str, tuple[object, ...]]:
    tables: dict[str, tuple[object, ...]] = {}
    if design is not None:
        tables["Design"] = design_facts(design, span_known=span_known)
    span = span_facts(folding, plan)
    if span:
        tables["Span in segments"] = span
    if plan is not None:
        tables["Plan"] = plan_facts(plan)
    if run is not None:
        tables["Run"] = run_facts(run)
    return tables


def _figures(
    name: str,
    structure: Structure | ConeStructure | None,
    folding: SpanFolding | None,
    plan: Plan | None,
    run: Run | None,
) -> tuple[Illustration, ...]:
    figures: list[Illustration] = []
    if structure is not None:
        figures += [_section(name, structure), _strip(name, structure)]
    if folding is not None:
        figures.append(_span(name, folding))
    if plan is not None:
        figures.append(_plan(name, plan))
    if run is not None:
        figures.append(_tracking(name, run, plan))
    return tuple(figures)


def _section(name: str, structure: Structure | ConeStructure) -> Illustration:
    scale = "in degrees seen from the apex" if isinstance(structure, ConeStructure) else "to scale in millimetres"
    label = (
        f"Deployed cross-section of {name} with {structure.layout.n_cells} cells, their panels, creases, bonds and "
        f"slits, {scale}"
    )
    return Illustration(
        "section",
        "Deployed cross-section",
        "Panels are coloured by cell; what is white inside the outline is empty. Opening creases lie on the outline, "
        "closing creases inside. Panels are bonded along the thin lines and apart at the slits.",
        to_inline_svg(draw_section(structure), "section", label),
    )


def _strip(name: str, structure: Structure | ConeStructure) -> Illustration:
    label = f"The cross-section of {name} at seven stages of its fold, from the flat stack to the deployed shape"
    return Illustration(
        "strip",
        "The fold, flat to deployed",
        "All frames at one scale. Angles are inner angles at the creases, smallest to largest over the cells.",
        to_inline_svg(draw_strip(structure), "strip", label),
    )


def _span(name: str, folding: SpanFolding) -> Illustration:
    label = (
        f"Seven stages of stowing {name}: its cells close, then the flat stack folds zig-zag in {folding.segments} "
        "segments"
    )
    return Illustration(
        "span",
        "The span, deployed to stowed",
        "All frames at one scale, seen along the panels. First the cells close; then the flat stack, and only it, "
        "folds at the piano hinges.",
        to_inline_svg(draw_spanwise(folding), "span", label),
    )


def _plan(name: str, plan: Plan) -> Illustration:
    label = (
        f"Planned motion of {name}: fold over time, safe step tolerance, angles and transmission of all creases "
        "over the fold"
    )
    return Illustration(
        "plan",
        "The plan",
        "Cells that move alike lie on top of each other. Transmission is how fast a crease's angle changes with the "
        "fold. While seating, contact at the slits is expected.",
        to_inline_svg(draw_plan(plan), "plan", label),
    )


def _tracking(name: str, run: Run, plan: Plan | None) -> Illustration:
    label = (
        f"Driven creases of {name} commanded and measured over time, tracking error and spread of fold, with states, "
        "latch confirmations and faults"
    )
    limit = "" if plan is None else ", and what the plan allows (dashed red)"
    return Illustration(
        "tracking",
        "Commanded against measured",
        "Shades are the controller's states. Top: stage and driven creases. Middle: measured minus commanded, the "
        "worst moment circled. Bottom: difference of fold between the cells furthest open and furthest "
        f"behind{limit}.",
        to_inline_svg(draw_tracking(run, plan), "tracking", label),
    )
