"""The controller never opens cells while a span in segments may be folded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.states import State
from ori_deploy.motion.plan import Plan, SpanStage
from tests.deploy.synthetic import bench, synthetic_plan

STAGE = SpanStage(
    segments=3,
    hinge_ids=("h1", "h2"),
    time_s=np.array([0.0, 1.0]),
    angles_rad=np.array([[np.pi, np.pi], [0.0, 0.0]]),
    free_orders=("in_step",),
    deepest_penetration_m=0.0,
    allowed_penetration_m=1e-5,
    stowed_box_m=(0.2, 0.1, 0.4),
)


def in_segments() -> Plan:
    return replace(synthetic_plan(), span=STAGE)


def test_the_plan_tells_all_stages_in_order() -> None:
    plan = in_segments()
    assert plan.deploy_stages == ("unlock", "span_unfold", "open", "latch")
    assert plan.stow_stages == ("unlatch", "close", "span_fold", "lock")
    assert synthetic_plan().deploy_stages == ("unlock", "open", "latch")
    assert synthetic_plan().stow_stages == ("unlatch", "close", "lock")


def test_deploy_is_refused_until_somebody_says_that_the_span_is_unfolded() -> None:
    b = bench(in_segments())
    before = b.bus.read_hinges().position_rad
    with pytest.raises(
        StartRefused, match=r"span may still be folded; found 3 segments, hinges h1, h2.*--span-unfolded"
    ):
        b.controller.deploy()
    assert b.controller.state is State.ARMED
    b.steps(20)
    assert b.bus.read_hinges().position_rad == pytest.approx(before, abs=0.02)
    assert not [record for record in b.records if record.state is State.MOVING]
    b.controller.deploy(span_unfolded=True)
    assert b.controller.run().state is State.DEPLOYED


def test_the_word_holds_for_one_deployment_only() -> None:
    b = bench(in_segments())
    b.controller.deploy(span_unfolded=True)
    b.controller.run()
    b.controller.stow()
    assert b.controller.run().state is State.STOWED
    with pytest.raises(StartRefused, match="span may still be folded"):
        b.controller.deploy()
    assert b.controller.state is State.STOWED


def test_it_is_wanted_again_after_a_stop_on_the_way() -> None:
    b = bench(in_segments())
    b.controller.deploy(span_unfolded=True)
    b.step_until_fold(0.3)
    b.controller.stop()
    b.controller.run()
    with pytest.raises(StartRefused, match="span may still be folded"):
        b.controller.deploy()
    b.controller.stow()  # closing cells folds nothing else
    assert b.controller.run().state is State.STOWED


def test_a_span_in_one_piece_needs_no_word() -> None:
    b = bench()
    b.controller.deploy()
    assert b.controller.run().state is State.DEPLOYED
