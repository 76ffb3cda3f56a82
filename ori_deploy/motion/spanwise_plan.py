"""From span segments and hinge limits to a checked, timed span stage."""

from __future__ import annotations

import numpy as np

from ori_deploy.errors import MotionError
from ori_deploy.motion.plan import SpanStage
from ori_deploy.motion.spanwise import ORDERS, SpanFolding, order_of_hinges
from ori_deploy.motion.spanwise_contact import SegmentCollision
from ori_deploy.profiles.profile import Reals

_MOST_SAMPLES = 1_000_000


def span_limits(velocity: Reals, acceleration: Reals) -> tuple[float, float]:
    """Limits of the span hinges where a rig gives none: those of the slowest crease, rad/s and rad/s2.

    Parameters
    ----------
    velocity, acceleration
        Limits of creases, any shape; inf where there is none.

    Raises
    ------
    MotionError
        No crease has a velocity limit, or none an acceleration limit.
    """
    finite = [limits[np.isfinite(limits)] for limits in (velocity, acceleration)]
    if not (len(finite[0]) and len(finite[1])):
        raise MotionError(
            "limits: no crease has a velocity limit, or none an acceleration limit",
            limit="at least one of each",
            remedy="mend the rig",
        )
    return float(finite[0].min()), float(finite[1].min())


def half_turn(velocity: float, acceleration: float, rate_hz: float) -> tuple[Reals, Reals]:
    """The quickest way of a hinge from pi to 0, at rest at both ends.

    Parameters
    ----------
    velocity, acceleration
        Limits, rad/s and rad/s2.
    rate_hz
        Sampling rate; the end falls on a sample, so that the motion takes up to one period longer.

    Returns
    -------
    time (n,), angle (n,).

    Raises
    ------
    MotionError
        A limit that is not positive, or a motion too long to be sampled.
    """
    for name, value in (("velocity", velocity), ("acceleration", acceleration), ("rate_hz", rate_hz)):
        if not (np.isfinite(value) and value > 0.0):
            raise MotionError(f"span hinges: {name} is not a positive number", value=value, limit="> 0")
    top = min(velocity, np.sqrt(np.pi * acceleration))
    ramp = top / acceleration
    duration = np.pi / top + ramp
    if not duration * rate_hz <= _MOST_SAMPLES:
        raise MotionError(
            "span hinges: the motion takes too long to be sampled",
            value=f"{duration:.3g} s at {rate_hz:g} Hz",
            limit=f"{_MOST_SAMPLES} samples",
            remedy="raise the limits or lower rate_hz",
        )
    count = max(int(np.ceil(duration * rate_hz)), 2)
    time = np.arange(count + 1) / rate_hz
    at = time * (duration * rate_hz / count)
    begun, left = np.minimum(at, ramp), np.minimum(duration - at, ramp)
    cruise = np.clip(at - ramp, 0.0, duration - 2.0 * ramp)
    gone = 0.5 * acceleration * begun**2 + top * cruise + 0.5 * acceleration * (ramp**2 - left**2)
    angle = np.pi - gone
    angle[0], angle[-1] = np.pi, 0.0
    return time, np.clip(angle, 0.0, np.pi)


def plan_span(folding: SpanFolding, velocity: float, acceleration: float, rate_hz: float) -> SpanStage | None:
    """Check the span's folding in space and time it; None for a span in one piece.

    Parameters
    ----------
    folding
        What folds.
    velocity, acceleration
        Limits of every span hinge, rad/s and rad/s2.
    rate_hz
        Sampling rate.

    Raises
    ------
    MotionError
        No hinge fits, segments reach into each other, or the limits cannot be used.
    """
    if folding.segments == 1:
        return None
    hinges, chain = folding.segments - 1, folding.chain
    found = {order: chain.first_collision(order_of_hinges(order, hinges)) for order in ORDERS}
    in_step = found["in_step"]
    if in_step is not None:
        raise _refused(in_step, folding)
    time, angle = half_turn(velocity, acceleration, rate_hz)
    return SpanStage(
        segments=folding.segments,
        hinge_ids=tuple(hinge.id for hinge in folding.hinges),
        time_s=time,
        angles_rad=np.repeat(angle[:, None], hinges, axis=1),
        free_orders=tuple(order for order, collision in found.items() if collision is None),
        deepest_penetration_m=chain.deepest_m(order_of_hinges("in_step", hinges)),
        allowed_penetration_m=chain.allowed_m,
        stowed_box_m=folding.stowed_box_m,
    )


def _refused(collision: SegmentCollision, folding: SpanFolding) -> MotionError:
    i, j = collision.segments
    return MotionError(
        f"span segments {i + 1} and {j + 1} reach into each other at hinge angle "
        f"{np.degrees(max(collision.angles_rad)):.4g} deg",
        value=f"depth {1e3 * collision.depth_m:.3g} mm",
        limit=f"{1e3 * folding.chain.allowed_m:.3g} mm",
        remedy="span_segments = 1",
    )
