"""Times and stages: of a plan, of a flight, and of a design that has neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ori_deploy.errors import FileError
from ori_deploy.files import load_plan
from ori_deploy.page.curves import Recent, crease_curves, flown_curves
from ori_deploy.page.placing import Mover
from ori_deploy.page.playing import plan_rows, timeline_of
from ori_deploy.page.sources import source_of
from ori_deploy.page.timeline import PREVIEW_S, planned, preview


def test_a_plan_is_shown_at_its_own_times(made: Path) -> None:
    plan = load_plan(made / "wing.plan.json")
    timeline = planned(plan)
    assert timeline.duration_s == plan.duration_s
    for t in (0.0, 1.234, plan.duration_s):
        assert timeline.at(t).fold == pytest.approx(np.interp(t, plan.time_s, plan.fold))
    assert [stage.name for stage in timeline.stages] == ["open"]


def test_the_span_unfolds_before_the_cells_open(made: Path) -> None:
    plan = load_plan(made / "span.plan.json")
    assert plan.span is not None
    timeline = planned(plan)
    span, opening = timeline.stages
    assert (span.name, opening.name) == ("span_unfold", "open")
    assert (span.begin_s, span.end_s) == (0.0, pytest.approx(plan.span.duration_s))
    assert opening.end_s == pytest.approx(plan.span.duration_s + plan.duration_s)
    for t in np.linspace(0.0, timeline.duration_s, 41):
        pose = timeline.at(float(t))
        assert pose.span_folded == 0.0 or pose.fold.max() == 0.0  # or our own kinematics would refuse it
    assert timeline.at(0.0).span_folded == pytest.approx(1.0)


def test_all_stages_of_a_plan_are_told_in_order(made: Path) -> None:
    rows = plan_rows(load_plan(made / "span.plan.json"))
    assert [name for name, _ in rows] == ["1. unlock", "2. span unfold", "3. open", "4. latch"]


def test_a_design_is_shown_without_times_of_its_own() -> None:
    timeline = preview(3, 1)
    assert timeline.duration_s == PREVIEW_S
    assert (timeline.at(-1.0).fold == 0.0).all()
    assert (timeline.at(99.0).fold == 1.0).all()
    assert preview(3, 2).at(0.0).span_folded == 1.0


def test_a_flight_is_shown_as_it_was_measured(made: Path) -> None:
    source = source_of(made / "run.mcap")
    assert source.run is not None
    timeline = timeline_of(source)
    assert timeline.at(0.0).fold.max() < 0.01
    assert timeline.at(timeline.duration_s).fold.min() > 0.99
    names = [stage.name for stage in timeline.stages]
    assert names.index("unlock") < names.index("open") < names.index("latch")
    current, temperature = flown_curves(source.run)
    assert len(current.y) == 4
    assert "°C" in temperature.title
    assert np.nanmax(current.y[0]) > 0.0


def test_a_file_is_found_out_and_its_design_beside_it(made: Path, tmp_path: Path) -> None:
    assert source_of(made / "wing.design.json").plan is None
    assert source_of(made / "wing.plan.json").design.structure.layout.n_cells == 4
    alone = tmp_path / "deep" / "deeper" / "wing.plan.json"
    alone.parent.mkdir(parents=True)
    alone.write_bytes((made / "wing.plan.json").read_bytes())
    with pytest.raises(FileError, match="--design"):
        source_of(alone)
    assert source_of(alone, made / "wing.design.json").plan is not None
    with pytest.raises(FileError, match="not the design"):
        source_of(alone, made / "span.design.json")
    with pytest.raises(FileError, match="nothing to show"):
        source_of(Path(__file__))


def test_crease_curves_are_the_mechanism_s_angles(made: Path) -> None:
    source = source_of(made / "wing.design.json")
    mechanism = Mover(source.design).mechanism
    curves = crease_curves(mechanism, timeline_of(source), "c2", over_fold=True)
    assert curves.y[2][-1] == pytest.approx(np.degrees(mechanism.four_bars.angles(np.ones((1, 4)))[0, 1, 2]))
    assert len(crease_curves(mechanism, timeline_of(source), "all cells", over_fold=True).y) == 4


def test_recent_values_keep_to_their_room_and_leave_gaps() -> None:
    recent = Recent("a", ("x", "y"), rows=3)
    for t in (0.0, 1.0, 1.0, 2.0, 3.0):
        recent.add(t, (t, None))
    curves = recent.curves
    assert curves.x.tolist() == [1.0, 2.0, 3.0]
    assert curves.y[0].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(curves.y[1]).all()
