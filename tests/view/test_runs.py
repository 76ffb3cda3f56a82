"""What a run's curves, events and verdict say."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.deploy.result import Fault, FaultKind, Outcome
from ori_deploy.deploy.states import Event, State, Transition
from ori_deploy.telemetry.read import Run
from ori_deploy.telemetry.summary import summarise
from ori_deploy.view import draw_tracking, to_svg
from ori_deploy.view.events import latch_events, run_events
from ori_deploy.view.facts import key_facts, provenance_facts, run_facts
from ori_deploy.view.verdict import verdict
from tests.deploy.synthetic import synthetic_plan
from tests.view.test_figures import gids


def repeated(run: Run, times: int) -> Run:
    """A log that is `times` as long."""
    n = len(run.time_s)
    arrays: dict[str, Any] = {
        name: np.concatenate([value] * times)
        for name, value in vars(run).items()
        if isinstance(value, np.ndarray) and len(value) == n and name != "time_s"
    }
    return replace(
        run, **arrays, time_s=np.arange(n * times) / 100.0, state=run.state * times, stage=run.stage * times
    )


def test_tracking_shows_every_driven_crease_commanded_measured_and_its_error(good_run: Run) -> None:
    figure = draw_tracking(good_run, synthetic_plan())
    for what in ("commanded", "measured", "error"):
        assert gids(figure, f"{what}-") == [f"{what}-{i}" for i in range(4)]
    assert gids(figure, "spread-limit")
    assert not gids(draw_tracking(good_run), "spread-limit")
    notes = [t.get_text() for axes in figure.axes for t in axes.texts]
    assert any("confirmed" in t for t in notes)
    worst = summarise(good_run).worst_tracking
    assert worst is not None
    assert f"{np.degrees(worst.error_rad):.2f}° {worst.hinge_id}" in notes


def test_tracking_marks_the_fault(faulted_run: Run) -> None:
    figure = draw_tracking(faulted_run)
    assert "fault: path_tolerance" in [t.get_text() for t in figure.axes[1].texts]
    legends = [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    assert "fault" in legends
    assert "deployed" not in legends


def test_a_long_log_keeps_its_peaks_and_stays_small(good_run: Run) -> None:
    long = repeated(good_run, 30)
    long.position_rad[4321, 1] += 2.0
    figure = draw_tracking(long)
    (line,) = [x for x in figure.axes[2].lines if x.get_gid() == "error-1"]
    peak = np.degrees(np.nanmax(np.abs(long.tracking_error_rad[:, 1])))
    assert np.nanmax(np.abs(line.get_ydata())) == pytest.approx(peak)
    assert len(to_svg(figure)) < 1_500_000


def test_a_log_in_which_no_hinge_ever_answered_can_be_drawn(good_run: Run) -> None:
    silent = replace(
        good_run,
        position_rad=np.full_like(good_run.position_rad, np.nan),
        fold=np.full_like(good_run.fold, np.nan),
    )
    ET.fromstring(to_svg(draw_tracking(silent, synthetic_plan())))


def test_a_log_of_one_cycle_can_be_drawn(good_run: Run) -> None:
    n = len(good_run.time_s)
    first: dict[str, Any] = {
        name: value[:1]
        for name, value in vars(good_run).items()
        if (isinstance(value, np.ndarray) and len(value) == n) or name in ("state", "stage")
    }
    ET.fromstring(to_svg(draw_tracking(replace(good_run, **first, latches=()))))


def test_long_and_odd_names_are_cut_short_and_not_taken_for_formulas(good_run: Run) -> None:
    odd = replace(good_run, info={**good_run.info, "hinge_ids": ["$\\frac{", "</svg><script>", "x" * 300, "]]>"]})
    text = to_svg(draw_tracking(odd))
    ET.fromstring(text)
    assert "<script>" not in text


def reading(time_s: float, engaged: bool, confirmed: bool | None, valid: bool = True) -> LatchReading:
    return LatchReading("pin", engaged, confirmed, valid, time_s)


def test_latch_events_are_changes_and_lost_readings_are_none(good_run: Run) -> None:
    start = float(good_run.time_s[0])
    readings = (
        reading(start, False, False),
        reading(start + 1.0, True, False),
        reading(start + 1.1, True, None, valid=False),
        reading(start + 1.2, True, True),
        reading(start + 1.3, True, True),
        reading(start + 1.4, True, None, valid=False),
        reading(start + 2.0, True, False),
        reading(start + 3.0, False, False),
    )
    events = latch_events(replace(good_run, latches=readings))
    assert [(round(e.time_s, 3), e.what) for e in events] == [
        (1.0, "latch engaged"),
        (1.2, "latch confirmed"),
        (2.0, "latch not confirmed"),
        (3.0, "latch released"),
    ]
    already = latch_events(replace(good_run, latches=(reading(start, True, True),)))
    assert already == []


def test_events_are_in_order_and_confirmations_precede_deployed(good_run: Run) -> None:
    events = run_events(good_run)
    assert [e.time_s for e in events] == sorted(e.time_s for e in events)
    deployed = next(i for i, e in enumerate(events) if e.what == "state" and e.thing == "deployed")
    confirmed = [i for i, e in enumerate(events) if e.is_confirmation]
    assert len(confirmed) == len(good_run.info["latch_ids"])
    assert max(confirmed) < deployed


def test_verdict_on_a_deployment() -> None:
    assert verdict(None, None).tone == "neutral"
    assert "not carried out" in verdict(synthetic_plan(), None).headline


def test_verdict_on_a_run_that_deployed(good_run: Run) -> None:
    found = verdict(None, good_run)
    assert found.tone == "good"
    assert found.headline == "Deployed with every latch confirmed"
    assert found.reasons == ()


def test_verdict_on_a_fault_names_it(faulted_run: Run) -> None:
    found = verdict(None, faulted_run)
    assert found.tone == "bad"
    assert found.headline.startswith("Not deployed: stopped off its path (path_tolerance, ")
    assert any("path_tolerance" in reason for reason in found.reasons)


@pytest.mark.parametrize("outcome", [o for o in Outcome if o is not Outcome.SUCCEEDED])
@pytest.mark.parametrize("state", list(State))
@pytest.mark.parametrize(
    ("command", "headline"), [("deploy", "Not deployed:"), ("stow", "Not stowed:"), ("recover", "Not in step:")]
)
def test_nothing_is_called_done_that_did_not_succeed(
    good_run: Run, outcome: Outcome, state: State, command: str, headline: str
) -> None:
    result = replace(good_run.results[0], command=command, outcome=outcome, state=state)
    found = verdict(None, replace(good_run, results=(result,)))
    assert found.tone == "bad"
    assert found.headline.startswith(headline)


def recovered(run: Run) -> Run:
    """As a log of `recover` that brought the cells back in step."""
    ends = Transition(float(run.time_s[-1]), State.MOVING, Event.RECOVERED, State.ARMED)
    result = replace(run.results[0], command="recover", state=State.ARMED)
    return replace(run, results=(result,), state=(*run.state[:-1], "armed"), transitions=(ends,))


def test_verdict_on_cells_that_were_brought_back_in_step(good_run: Run) -> None:
    found = verdict(None, recovered(good_run))
    assert (found.tone, found.headline, found.reasons) == ("good", "Cells back in step", ())


@pytest.mark.parametrize("state", [s for s in State if s is not State.DEPLOYED])
def test_success_in_another_state_than_deployed_is_not_believed(good_run: Run, state: State) -> None:
    result = replace(good_run.results[0], state=state)
    found = verdict(None, replace(good_run, results=(result,)))
    assert found.headline.startswith("Not deployed:")
    assert found.tone == "bad"


def test_a_fault_after_deployment_and_a_log_cut_off_are_bad_news(good_run: Run) -> None:
    after = replace(good_run, state=(*good_run.state[:-1], "fault"))
    assert verdict(None, after).tone == "bad"
    assert verdict(None, after).headline.endswith("then a fault")
    cut = verdict(None, replace(good_run, complete=False, results=()))
    assert cut.tone == "bad"
    assert not cut.headline.startswith("Deployed")
    fold = good_run.fold[-1]
    where = f"{fold.min():.3f}"
    assert any("cut off" in reason and f"at fold {where}" in reason for reason in cut.reasons)
    assert f"at fold {where}" in cut.headline


def test_a_session_in_which_nothing_was_ordered_is_no_bad_news(good_run: Run) -> None:
    idle = replace(good_run, results=(), transitions=(), state=("ready",) * len(good_run.state))
    assert verdict(None, idle).tone == "neutral"
    assert verdict(None, idle).headline.startswith("Nothing was carried out: the log ends in state ready")
    for bad in (
        replace(idle, state=(*idle.state[:-1], "moving")),
        replace(idle, transitions=good_run.transitions),
        replace(idle, complete=False),
    ):
        assert verdict(None, bad).tone == "bad"


def test_a_damaged_log_is_no_good_news_and_not_called_cut_off(good_run: Run) -> None:
    found = verdict(None, replace(good_run, complete=False, unread="2 of its parts are damaged"))
    assert found.tone == "bad"
    assert any("2 of its parts are damaged" in reason for reason in found.reasons)
    assert not any("cut off" in reason for reason in found.reasons)


def test_of_a_cell_that_fell_silent_it_is_told_where_and_when_it_was_measured_last(good_run: Run) -> None:
    def ends(*silent_from: tuple[int, int]) -> str:
        """Cells, and the rows from which on they say nothing; the others end at fold 0.5."""
        fold = np.tile(np.linspace(0.0, 0.5, n)[:, None], 4)
        for cell, row in silent_from:
            fold[row:, cell] = np.nan
        return verdict(None, replace(good_run, fold=fold, results=())).headline.removeprefix(
            "No result recorded: the log ends in state deployed at fold "
        )

    n = len(good_run.time_s)
    at = [f"{time_s:.2f} s" for time_s in good_run.time_s - good_run.time_s[0]]
    low = f"{0.5 * 99 / (n - 1):.3f}"
    assert ends() == "0.500"
    assert ends((1, 100)) == f"{low} to 0.500 (c2 not since {at[99]})"
    assert ends((1, 100), (3, 100), (0, 0)) == f"{low} to 0.500 (c1 never; c2, c4 not since {at[99]})"
    assert ends(*((cell, 100) for cell in range(4))) == f"{low} (no cell since {at[99]})"
    assert ends((0, n - 1), (1, n - 2)).endswith(f"(c1 not since {at[-2]}; c2 not since {at[-3]})")


def gone_on(run: Run, *steps: tuple[Event, State], kind: FaultKind | None = None) -> Run:
    """As a log that went on after the last result, a cycle per step, with a fault where a step leads into one."""
    time_s, state = float(run.time_s[-1]), State(run.state[-1])
    transitions, faults = list(run.transitions), list(run.faults)
    for event, target in steps:
        time_s += 0.01
        transitions.append(Transition(time_s, state, event, target))
        if target is State.FAULT and kind is not None:
            faults.append(Fault(kind, "c1", "", "", time_s))
        state = target
    return replace(run, state=(*run.state[:-1], str(state)), transitions=tuple(transitions), faults=tuple(faults))


TRIPPED, CLEARED = (Event.FAULT, State.FAULT), (Event.CLEAR_FAULT, State.ARMED)


@pytest.mark.parametrize("result_of", [lambda run: run, recovered], ids=["deployed", "recovered"])
@pytest.mark.parametrize(
    "steps",
    [
        (TRIPPED, CLEARED),
        (TRIPPED, (Event.CLEAR_FAULT, State.READY)),
        (TRIPPED, (Event.CLEAR_FAULT, State.DISCONNECTED)),
        (TRIPPED, CLEARED, (Event.DISARM, State.READY)),
    ],
)
def test_a_fault_after_the_last_result_is_told_though_it_was_cleared(
    good_run: Run, result_of: Callable[[Run], Run], steps: tuple[tuple[Event, State], ...]
) -> None:
    run = result_of(good_run)
    found = verdict(None, gone_on(run, *steps, kind=FaultKind.LATCH_LOST))
    assert found.tone == "bad"
    assert f"; then fault latch_lost, cleared; the log ends in state {steps[-1][1]} at fold " in found.headline
    without_name = verdict(None, gone_on(run, *steps))
    assert (without_name.tone, "; then a fault, cleared" in without_name.headline) == ("bad", True)


def test_a_latched_fault_after_the_last_result_is_named(good_run: Run) -> None:
    found = verdict(None, gone_on(good_run, TRIPPED, kind=FaultKind.LATCH_LOST))
    assert (found.tone, found.headline.endswith("; then fault latch_lost")) == ("bad", True)
    left = verdict(
        None, gone_on(good_run, TRIPPED, (Event.DISCONNECT, State.DISCONNECTED), kind=FaultKind.LATCH_LOST)
    )
    assert (left.tone, "cleared" in left.headline) == ("bad", False)


def test_a_fault_before_the_last_result_does_not_spoil_it(good_run: Run) -> None:
    early = Fault(FaultKind.BUS_CLOSED, "bus", "", "", float(good_run.time_s[0]))
    found = verdict(None, replace(good_run, faults=(early,)))
    assert (found.tone, found.headline) == ("good", "Deployed with every latch confirmed")


@pytest.mark.parametrize("time_s", [np.nan, np.inf])
def test_a_fault_that_may_have_come_after_the_last_result_counts(good_run: Run, time_s: float) -> None:
    when = Fault(FaultKind.LATCH_LOST, "c1", "", "", time_s)
    assert verdict(None, replace(good_run, faults=(when,))).tone == "bad"
    lost = replace(good_run, transitions=())
    assert verdict(None, lost).tone == "good"
    assert verdict(None, replace(lost, faults=(replace(when, time_s=float(good_run.time_s[0])),))).tone == "bad"


LET_GO = (Event.DISARM, State.READY)


@pytest.mark.parametrize(
    ("steps", "tone"),
    [
        ((), "good"),
        ((LET_GO,), "good"),
        ((LET_GO, (Event.DISCONNECT, State.DISCONNECTED)), "good"),
        (((Event.DISCONNECT, State.DISCONNECTED), (Event.CONNECT, State.READY)), "good"),
        ((LET_GO, (Event.ARM, State.ARMED)), "neutral"),
        (((Event.STOW, State.LATCHING), (Event.RELEASED, State.MOVING)), "bad"),
        (((Event.STOW, State.LATCHING), (Event.STOP, State.STOPPING), (Event.AT_REST, State.ARMED), LET_GO), "bad"),
    ],
)
def test_what_follows_the_last_result_is_good_news_only_if_nothing_moved(
    good_run: Run, steps: tuple[tuple[Event, State], ...], tone: str
) -> None:
    found = verdict(None, gone_on(good_run, *steps))
    assert found.tone == tone
    assert ("the log ends in state" in found.headline) == (tone != "good")


def test_the_legend_is_in_the_order_of_the_cells_line_by_line(good_run: Run) -> None:
    """Matplotlib fills columns; eyes read lines."""
    figure = draw_tracking(good_run)
    figure.draw_without_rendering()
    places = [(text.get_window_extent(), text.get_text()) for text in figure.legends[0].get_texts()]
    by_lines = [text for _, text in sorted(places, key=lambda one: (-round(one[0].y0 / 10.0), one[0].x0))]
    names = [f"{hinge} " for hinge in good_run.info["hinge_ids"]]
    assert by_lines[0] == "commanded"
    assert all(text.startswith(name) for text, name in zip(by_lines[1:], names, strict=True))


def test_a_seed_is_told_of_simulated_servos_only(good_run: Run) -> None:
    for seed, told in ((1, True), (None, False)):
        facts, _ = provenance_facts("", "", None, replace(good_run, info={**good_run.info, "seed": seed}), "0")
        assert any(fact.name == "seed" for fact in facts) == told


def told(run: Run, name: str) -> tuple[str, str]:
    """Value and note of a line of the run's table."""
    return next((fact.value, fact.note) for fact in run_facts(run) if fact.name == name)


def test_a_tracking_error_that_was_never_measured_is_not_one_of_0(good_run: Run) -> None:
    name = "worst tracking error"
    position_rad = good_run.position_rad.copy()
    position_rad[:, 2] = np.nan
    value, note = told(replace(good_run, position_rad=position_rad), name)
    assert value.endswith("°")
    assert note.endswith("; not read: servo_c3")
    assert "not read" not in told(good_run, name)[1]
    silent = replace(good_run, position_rad=np.full_like(position_rad, np.nan))
    assert told(silent, name) == ("not read", "")
    assert [(fact.value, fact.note) for fact in key_facts(None, None, silent) if fact.name == name] == [
        ("not read", "")
    ]


def test_a_log_that_tells_nothing_of_the_time_of_cycles_says_so(good_run: Run) -> None:
    n = len(good_run.time_s)
    timing = {f"{part}_s": np.full(n, 1e-3) for part in ("read", "decide", "send", "record")}
    timing["read_s"][1:] = np.nan
    result = replace(good_run.results[0], duration_s=np.nan)
    lateness_s = np.full(n, 2e-3)
    lateness_s[0] = np.nan
    some = replace(good_run, timing=timing, lateness_s=lateness_s, results=(result,))
    assert told(some, "overruns")[1] == "worst lateness 2.00 ms"
    assert told(some, "work of a cycle") == (
        "4.00 ms at most",
        "medians in ms: read 1.00, decide 1.00, send 1.00, record 1.00",
    )
    timing["read_s"][0] = np.nan
    none = replace(some, lateness_s=np.full(n, np.nan))
    assert told(none, "overruns")[1] == "worst lateness not told"
    assert told(none, "work of a cycle")[0] == "not told"
    assert "read not told, decide 1.00" in told(none, "work of a cycle")[1]
    assert told(none, "deploy")[0] == "succeeded, how long not told"
    assert not any("nan" in fact.value + fact.note for fact in (*run_facts(none), *key_facts(None, None, none)))


def test_arguments_nested_too_deeply_to_parse_are_told_as_they_are(good_run: Run) -> None:
    command = {"time_s": good_run.time_s[0], "command": "arm", "outcome": "refused", "detail": "no"}
    for arguments in ("[" * 100_000, "{"):
        (event,) = (
            e
            for e in run_events(replace(good_run, commands=({**command, "arguments": arguments},)))
            if e.kind == "command"
        )
        assert event.detail == f"refused {arguments}: no"


def test_deploying_and_stowing_are_both_told(good_run: Run) -> None:
    deployed = good_run.results[0]
    stowed = replace(deployed, command="stow", state=State.STOWED)
    failed = replace(deployed, command="stow", state=State.HOLD, outcome=Outcome.HELD)
    ends = Transition(float(good_run.time_s[-1]), State.LATCHING, Event.STOWAGE_SECURED, State.STOWED)
    to_stowed = (*good_run.transitions, ends)
    in_stowed = replace(good_run, state=(*good_run.state[:-1], "stowed"), transitions=to_stowed)
    both = verdict(None, replace(in_stowed, results=(deployed, stowed)))
    assert (both.tone, both.headline) == ("good", "Deployed with every latch confirmed, then stowed")
    half = verdict(None, replace(good_run, results=(deployed, failed)))
    assert half.tone == "bad"
    assert "then not stowed" in half.headline
