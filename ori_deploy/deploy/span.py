"""A span in segments: folded and unfolded by hand, measured by nothing."""

from __future__ import annotations

from ori_deploy.deploy.result import StartRefused
from ori_deploy.motion.plan import Plan


class SpanMayBeFolded(StartRefused):
    """Somebody's word is wanted that the span is unfolded."""


def require_unfolded(plan: Plan, unfolded: bool) -> None:
    """Refuse to open cells while the span may be folded: its hinges sit on panels that would turn apart.

    Parameters
    ----------
    plan
        What is to be carried out.
    unfolded
        Whether somebody says that the span is unfolded.

    Raises
    ------
    SpanMayBeFolded
        The plan has a span stage, and nobody says so.
    """
    if plan.span is not None and not unfolded:
        raise SpanMayBeFolded(
            f"plan {plan.design_name}: the span may still be folded",
            value=f"{plan.span.segments} segments, hinges {', '.join(plan.span.hinge_ids)}",
            limit="unfolded before any cell opens",
            remedy="unfold the span by hand, see that every hinge is straight, then say so: --span-unfolded",
        )
