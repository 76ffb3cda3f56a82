"""What the report is made of, tells, and keeps out."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from ori_deploy.deploy.result import Fault, FaultKind
from ori_deploy.design import Structure
from ori_deploy.motion import Mechanism, Plan, SpanFolding, plan_span
from ori_deploy.telemetry.read import Run
from ori_deploy.view import render_report
from ori_deploy.view.facts import provenance_facts

VOID = {"meta", "br", "hr", "img", "link", "input"}
HOSTILE = "<script>alert('x')</script>&\"'$\\frac{"


class Page(HTMLParser):
    """Tags, attributes and text of a page; fails on tags that do not match."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.ids: list[str] = []
        self.text = ""
        self.verdict = ""
        self._in_verdict = 0
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {k: v or "" for k, v in attrs}
        self.tags.append(tag)
        self.attributes += given.items()
        if "id" in given:
            self.ids.append(given["id"])
        if given.get("id") == "verdict":
            self._in_verdict = len(self.open) + 1
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if len(self.open) < self._in_verdict:
            self._in_verdict = 0

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data
        if self._in_verdict:
            self.verdict += data


@pytest.fixture(scope="session")
def full(wing: Structure, wing_plan: Plan, good_run: Run) -> str:
    return render_report("wing", structure=wing, span_m=1.26, plan=wing_plan, run=good_run)


def test_page_is_self_contained_and_has_no_scripts(full: str) -> None:
    page = Page(full)
    assert "http://" not in full
    assert "https://" not in full
    assert not set(page.tags) & {"script", "link", "iframe", "object", "img", "base"}
    for name, value in page.attributes:
        assert not name.startswith("on")
        if name in ("href", "xlink:href", "src"):
            assert value.startswith("#")
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", full))
    assert "@import" not in full


def test_page_has_one_top_heading_all_sections_and_unique_ids(full: str) -> None:
    page = Page(full)
    assert page.tags.count("h1") == 1
    assert len(page.ids) == len(set(page.ids))
    assert {"section", "strip", "plan", "tracking"} <= {i.removeprefix("title-") for i in page.ids}
    assert {"figures", "summary", "events", "cells", "provenance"} <= set(page.ids)
    assert page.tags.count("svg") == 4
    labels = [value for name, value in page.attributes if name == "aria-label"]
    assert sum("wing" in label for label in labels) == 4
    targets = {v[1:] for k, v in page.attributes if k in ("href", "xlink:href")}
    assert targets <= set(page.ids)


def test_page_tells_the_figures_of_the_wing(full: str, wing_plan: Plan, good_run: Run) -> None:
    text = Page(full).text
    for figure in ("2.1311", "53.1 %", "250 mm", "1.26 m", "c3, closing crease b", wing_plan.design_sha256):
        assert figure in text
    assert f"{wing_plan.duration_s:.2f} s" in text
    assert " and ".join(wing_plan.check.clearance_panels) in text
    assert good_run.results[0].worst_tracking_hinge in text
    assert "latch confirmed" in text


def test_page_is_the_same_for_the_same_input(full: str, wing: Structure, wing_plan: Plan, good_run: Run) -> None:
    assert render_report("wing", structure=wing, span_m=1.26, plan=wing_plan, run=good_run) == full


def test_page_of_a_design_a_plan_or_a_log_alone(wing: Structure, wing_plan: Plan, good_run: Run) -> None:
    design, plan, log = (
        Page(render_report("wing", **{key: value}))  # type: ignore[arg-type]
        for key, value in (("structure", wing), ("plan", wing_plan), ("run", good_run))
    )
    assert "A design: not planned, not carried out" in design.verdict
    assert design.tags.count("svg") == 2
    assert "A checked plan: not carried out" in plan.verdict
    assert plan.tags.count("svg") == 1
    assert "Deployed with every latch confirmed" in log.verdict
    assert log.tags.count("svg") == 1
    assert good_run.info["plan_sha256"] in log.text
    with pytest.raises(ValueError, match="a design, a plan or a log"):
        render_report("nothing")


def test_page_of_a_fault_says_so_and_never_that_it_deployed(faulted_run: Run) -> None:
    page = Page(render_report("wing", run=faulted_run))
    fault = faulted_run.faults[0]
    assert "Not deployed" in page.verdict
    assert str(fault.kind) in page.verdict
    assert fault.detail in page.verdict
    assert fault.remedy in page.verdict
    assert "Deployed" not in page.verdict
    assert "every latch confirmed" not in page.text


def test_a_fault_without_a_time_is_told_without_one(faulted_run: Run) -> None:
    fault = replace(faulted_run.faults[0], time_s=float("nan"))
    early = replace(faulted_run.transitions[0], time_s=float("nan"))
    run = replace(faulted_run, faults=(fault,), transitions=(early, *faulted_run.transitions[1:]))
    text = render_report("wing", run=run)
    assert f"Fault {fault.kind}: {fault.thing}" in Page(text).verdict
    assert not re.search(r"\bnan\b", Page(text).text)
    times = re.findall(r'<tr class="event-\w+"><td class="number">(.*?)</td>', text)
    assert times[-2:] == ["not told"] * 2
    known = [float(time_s) for time_s in times[:-2]]
    assert known == sorted(known)


def test_names_from_files_are_text_and_nothing_else(wing_plan: Plan, faulted_run: Run) -> None:
    fault = Fault(FaultKind.LATCH_LOST, HOSTILE, HOSTILE, HOSTILE, faulted_run.faults[0].time_s)
    info = {**faulted_run.info, "hinge_ids": [HOSTILE] * 4, "rig_file": HOSTILE, "version": HOSTILE}
    plan = replace(wing_plan, cell_ids=(HOSTILE,) * 4, latch_points=(HOSTILE,))
    text = render_report(HOSTILE, plan=plan, run=replace(faulted_run, faults=(fault,), info=info))
    page = Page(text)
    assert "<script" not in text
    assert "script" not in page.tags
    assert page.text.count(HOSTILE) >= 5


def test_files_that_do_not_belong_together_are_pointed_out(wing_plan: Plan, good_run: Run) -> None:
    def warnings(design: str, plan: str, run: Run | None) -> tuple[str, ...]:
        return provenance_facts(design, plan, wing_plan, run, "1")[1]

    assert warnings(wing_plan.design_sha256, "", None) == ()
    assert "different designs" in warnings("ee" * 32, "", None)[0]
    ours = {"design_sha256": wing_plan.design_sha256, "plan_sha256": "ab" * 32}
    run = replace(good_run, info={**good_run.info, **ours})
    assert warnings("", "ab" * 32, run) == ()
    assert "different plans" in warnings("", "00" * 32, run)[0]
    page = Page(render_report("wing", plan=wing_plan, design_sha256="ee" * 32))
    assert "do not belong together" in page.text


def test_a_page_that_mixes_two_runs_is_not_headed_by_the_good_news_of_one(wing_plan: Plan, good_run: Run) -> None:
    text = render_report("wing", plan=wing_plan, run=good_run, plan_sha256="00" * 32)
    page = Page(text)
    headline = re.findall(r"<strong>(.*?)</strong>|<title>(.*?)</title>", text)
    assert len(headline) == 2
    assert not any("Deployed" in told for pair in headline for told in pair)
    assert 'class="verdict bad"' in text
    assert "do not belong together" in page.verdict
    assert "The log by itself, of another design or plan: Deployed with every latch confirmed" in page.verdict


@pytest.mark.slow
def test_page_of_a_span_in_segments_shows_how_it_is_stowed(wing: Structure, wing_plan: Plan) -> None:
    folding = SpanFolding(Mechanism(wing), 1.26, 3)
    stage = plan_span(folding, 1.0, 2.0, 100.0)
    planned = replace(wing_plan, span=stage)
    page = Page(render_report("wing", structure=wing, span_m=1.26, span_segments=3, plan=planned))
    assert page.tags.count("svg") == 4
    assert "title-span" in page.ids
    assert "Span in segments" in page.text
    for hinge in folding.hinges:
        assert f"piano hinge {hinge.id}panel {hinge.panel}" in page.text.replace("\n", "")
    box = " by ".join(f"{1e3 * side:.3g} mm" for side in folding.stowed_box_m)
    assert f"stowed box{box}" in page.text.replace("\n", "")
    assert f"{1e3 * folding.length_m:.3g} mm" in page.text
    assert f"{stage.duration_s:.2f} s, by hand" in page.text
    assert ", ".join(order.replace("_", " ") for order in stage.free_orders) in page.text
    of_plan = Page(render_report("wing", plan=planned))
    assert f"stowed box{box}" in of_plan.text.replace("\n", "")
    whole = Page(render_report("wing", structure=wing, span_m=1.26, plan=wing_plan))
    assert "segments" not in whole.text
    assert "title-span" not in whole.ids
