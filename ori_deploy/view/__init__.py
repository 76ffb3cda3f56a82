"""Figures and the report: what a design, a plan and a run look like. Nothing depends on this room."""

from __future__ import annotations

from ori_deploy.view.plan_curves import draw_plan
from ori_deploy.view.report import render_report
from ori_deploy.view.section import draw_section
from ori_deploy.view.sheet import to_png, to_svg
from ori_deploy.view.spanwise import draw_spanwise
from ori_deploy.view.strip import draw_strip
from ori_deploy.view.tracking import draw_tracking

__all__ = [
    "draw_plan",
    "draw_section",
    "draw_spanwise",
    "draw_strip",
    "draw_tracking",
    "render_report",
    "to_png",
    "to_svg",
]
