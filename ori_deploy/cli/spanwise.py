"""What the commands say of a span in segments."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeVar

import click
import numpy as np

from ori_deploy.cli.frame import console
from ori_deploy.design import Structure
from ori_deploy.errors import InputError
from ori_deploy.files import Design
from ori_deploy.motion import Mechanism, Plan, SpanFolding
from ori_deploy.profiles.profile import Reals

_Command = TypeVar("_Command", bound=Callable[..., Any])


def span_option(command: str) -> Callable[[_Command], _Command]:
    """`--span-unfolded` for `deploy`; nothing for the other commands."""
    if command != "deploy":
        return lambda function: function
    return click.option(
        "--span-unfolded",
        is_flag=True,
        help="The span, cut into segments, has been unfolded by hand: the cells may open.",
    )


def _box(sides: tuple[float, ...] | list[float]) -> str:
    return " x ".join(f"{1e3 * side:.1f}" for side in sides) + " mm"


def design_rows(data: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows on a design's span; none where it is in one piece."""
    span = data.get("span")
    if span is None:
        return []
    panels = ", ".join(f"{hinge['id']} on {hinge['panel']}" for hinge in span["hinges"])
    return [
        ("span", f"{span['segments']} segments of {1e3 * span['segment_length_m']:.1f} mm; hinges {panels}"),
        ("stowed", f"{_box(span['stowed_box_m'])}, box ratio {span['stowed_box_ratio']:.4g}"),
    ]


def plan_rows(plan: Plan) -> list[tuple[str, str]]:
    """Rows on a plan's span stage; none where there is none."""
    span = plan.span
    if span is None:
        return []
    orders = ", ".join(order.replace("_", " ") for order in span.free_orders)
    return [
        ("span, by hand", f"{span.segments} segments, {span.duration_s:.2f} s; hinges free {orders}"),
        ("stowed", _box(span.stowed_box_m)),
    ]


def tell_span(plan: Plan, command: str) -> None:
    """After a stow: the span can be folded now."""
    if command == "stow" and plan.span is not None:
        console.print(
            f"the cells are flat: the span can be folded now, by hand, at hinges {', '.join(plan.span.hinge_ids)}",
            markup=False,
            soft_wrap=True,
        )


def span_poses(design: Design, folds: Reals, span_fold: float, *, as_json: bool) -> None:
    """Print where every panel of every segment is.

    Raises
    ------
    InputError
        The span is in one piece, `span_fold` is not in [0, 1], or cells are not flat while the span is folded.
    """
    structure = design.structure
    if design.span_segments == 1 or not isinstance(structure, Structure):
        raise InputError(
            "--span-fold: the span is in one piece",
            value=span_fold,
            limit="designs with span_segments > 1",
            remedy="leave --span-fold out",
        )
    if not 0.0 <= span_fold <= 1.0:
        raise InputError(
            "--span-fold: outside the motion", value=span_fold, limit="0 (straight) to 1 (folded)", remedy="0 to 1"
        )
    folding = SpanFolding(Mechanism(structure), design.span_m, design.span_segments)
    angles = np.full((1, design.span_segments - 1), np.pi * span_fold)
    matrices = folding.poses(folds[None], angles)[0]
    ids = structure.layout.panel_ids
    if as_json:
        outlines = structure.panel_outlines()
        data = [
            {
                "segment": k + 1,
                "id": name,
                "transform": matrices[k, p].tolist(),
                "deployed_outline": [[float(w.real), float(w.imag)] for w in outlines[p]],
                "z_m": [k * folding.length_m, (k + 1) * folding.length_m],
            }
            for k in range(folding.segments)
            for p, name in enumerate(ids)
        ]
        click.echo(json.dumps(data, allow_nan=False))
        return
    for k, segment in enumerate(folding.segment_matrices(angles)[0]):
        x, y, z = segment[:3, 3]
        turned = float(np.degrees(np.arccos(np.clip(segment[2, 2], -1.0, 1.0))))
        shift = f"({1e3 * x:9.3f}, {1e3 * y:9.3f}, {1e3 * z:9.3f}) mm"
        click.echo(f"segment {k + 1:<3} turned {turned:8.3f} deg, shifted {shift}")
