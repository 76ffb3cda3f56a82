"""Times and stages: of a plan, of a flight, and of a design that has neither."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from ori_deploy.errors import FileError
from ori_deploy.files import load_plan
from ori_deploy.page.curves import Recent, crease_curves, flown_curves
from ori_deploy.page.placing import Mover
from ori_deploy.page.playing import BY_HAND, Player, _put, goals, plan_rows, timeline_of
from ori_deploy.page.sources import source_of
from ori_deploy.page.thinning import MOST, thinned
from ori_deploy.page.timeline import PREVIEW_S, Pose, Timeline, flown, planned, preview
from ori_deploy.telemetry.read import Run, read_run
from tests.page.conftest import EXAMPLES


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


def rested(run: Run, hours: float) -> Run:
    """A log that goes on for hours after its motion."""
    n = round(hours * 3600.0 / 0.01)
    last = float(run.time_s[-1])

    def longer(rows: np.ndarray) -> np.ndarray:
        return np.concatenate([rows, np.repeat(rows[-1:], n, axis=0)])

    return replace(
        run,
        time_s=np.concatenate([run.time_s, last + 0.01 * np.arange(1, n + 1)]),
        state=run.state + run.state[-1:] * n,
        stage=run.stage + run.stage[-1:] * n,
        fold=longer(run.fold),
        commanded_fold=longer(run.commanded_fold),
        current_a=longer(run.current_a),
    )


def test_an_hour_of_rest_takes_nothing_away_from_the_motion_before_it(made: Path) -> None:
    run = read_run(made / "run.mcap")
    cells = tuple(dict.fromkeys(run.info["cell_ids"]))
    short, whole = flown(run, cells), flown(rested(run, 1.0), cells)
    assert whole.duration_s > 3600.0
    for t in np.linspace(0.0, short.duration_s, 50):
        assert whole.at(float(t)).fold == pytest.approx(short.at(float(t)).fold)
    assert [one.name for one in whole.stages] == [one.name for one in short.stages]
    current = flown_curves(rested(run, 1.0))[0]
    assert len(current.x) <= 2 * MOST + 20
    assert (current.x < short.duration_s).sum() > 500
    assert np.nanmax(current.y[0]) == np.nanmax(run.current_a[:, 0])


def test_a_thinned_curve_keeps_every_high_and_low() -> None:
    rng = np.random.default_rng(2)
    y = rng.random((50_000, 2))
    y[31_234, 1], y[7, 0], y[40_000:40_500, 0] = 9.0, -9.0, np.nan
    x, thin = thinned(np.arange(50_000.0), y, rng.random(50_000) < 0.5, most=100)
    assert thin.max(axis=0)[1] == 9.0
    assert np.nanmin(thin[:, 0]) == -9.0
    assert (np.diff(x) > 0.0).all()
    x, thin = thinned(np.arange(1000.0), y[:1000], np.ones(1000, dtype=bool), most=100)
    assert len(x) <= 202
    assert thinned(np.arange(150.0), y[:150], np.ones(150, dtype=bool), most=100)[1].tolist() == y[:150].tolist()


def test_stages_that_are_not_in_the_list_are_counted() -> None:
    names = tuple(f"s{k % 2}" for k in range(150))
    n = len(names)
    told = goals(Timeline(np.arange(float(n)), np.zeros((n, 1)), None, names, np.ones(n, dtype=bool)))
    assert len(told) == 101
    assert list(told.items())[-1] == ("50 more, from 100.0 s: by the time slider", 100.0)


def test_a_flight_s_latches_are_shown_by_their_points_and_its_span_is_not_made_up(made: Path) -> None:
    run = read_run(made / "run.mcap")
    assert {one.id for one in run.latches} == {"latch_slit:P-T2"}
    cells = tuple(dict.fromkeys(run.info["cell_ids"]))
    timeline = flown(run, cells)
    assert timeline.at(0.5).latches == {"slit:P-T2": "open"}
    assert timeline.at(timeline.duration_s).latches == {"slit:P-T2": "closed"}
    assert timeline.at(0.5).span_folded is None
    named = replace(
        run,
        latches=tuple(replace(one, id="slit_pin") for one in run.latches),
        files={"rig.toml": (EXAMPLES / "rig_wing_explicit.toml").read_text()},
    )
    assert flown(named, cells).at(timeline.duration_s).latches == {"slit:P-T2": "closed"}
    lost = replace(run, latches=(*run.latches[:-1], replace(run.latches[-1], valid=False, confirmed=None)))
    assert flown(lost, cells).at(timeline.duration_s).latches == {"slit:P-T2": "unknown"}
    two = replace(run, latches=(*run.latches, replace(run.latches[0], id="slit:P-T2", time_s=run.time_s[-1])))
    assert flown(two, cells).at(timeline.duration_s).latches == {"slit:P-T2": "open"}  # one of both does not hold


def test_a_pose_in_step_has_its_time(made: Path) -> None:
    for timeline in (planned(load_plan(made / "span.plan.json")), planned(load_plan(made / "wing.plan.json"))):
        for t in np.linspace(0.0, timeline.duration_s, 23):
            pose = timeline.at(float(t))
            assert pose.span_folded is not None
            found = timeline.when(pose.fold, pose.span_folded)
            assert found is not None
            assert timeline.at(found).fold == pytest.approx(pose.fold, abs=1e-9)
            assert timeline.at(found).span_folded == pytest.approx(pose.span_folded, abs=1e-9)
    assert timeline.when(np.array([0.2, 0.2, 0.3, 0.2]), 0.0) is None


@pytest.fixture
def player(made: Path) -> Iterator[Player]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    one = Player(server, source_of(made / "span.plan.json"))
    yield one
    one._pause()
    server.stop()


def test_every_slider_follows_every_other(player: Player) -> None:
    player._by_hand(lambda: player._go_to(0.0))
    assert (player._fold_slider.value, player._span_slider.value, player._stage.value) == (0.0, 1.0, "span_unfold")
    player._by_hand(lambda: player._set_fold(0.5))
    assert (player._fold_slider.value, player._span_slider.value, player._stage.value) == (0.5, 0.0, "open")
    assert player._timeline.at(player._time_slider.value).fold == pytest.approx(0.5, abs=0.01)
    assert player._jump is not None
    assert player._jump.value.startswith("2. open")
    player._by_hand(lambda: player._set_span(0.25))
    assert (player._fold_slider.value, player._span_slider.value, player._stage.value) == (0.0, 0.25, "span_unfold")
    player._by_hand(lambda: player._set_fold(1.0))
    _put(player._moves, "c2")
    player._by_hand(lambda: player._set_fold(0.5))
    assert (player._fold_slider.value, player._stage.value) == (0.5, BY_HAND)


def test_what_plays_never_has_the_last_word_after_a_hand(player: Player, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[float] = []
    real = Timeline.at

    def slow(timeline: Timeline, time_s: float) -> Pose:
        time.sleep(0.03)  # what plays is nearly always here, between asking whether it may and showing
        return real(timeline, time_s)

    player._go_to(6.0)
    _put(player._moves, "c2")
    monkeypatch.setattr(Timeline, "at", slow)
    monkeypatch.setattr(player._viewer, "show", lambda fold, _: shown.append(float(fold[1])))
    for k in range(5):
        player._toggle()
        while len(shown) < 3:
            time.sleep(0.005)
        player._by_hand(lambda fold=0.9 + 0.01 * k: player._set_fold(fold))  # type: ignore[misc]
        time.sleep(0.1)
        assert shown[-1] == pytest.approx(0.9 + 0.01 * k)
        shown.clear()
