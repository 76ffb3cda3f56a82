"""What the bar says of a controller, and what is shown while a reading is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.deploy.states import State
from ori_deploy.deploy.step_room import USABLE
from ori_deploy.motion import Collision
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.messages import Answer, Do, LatchStatus, Request, Status
from ori_deploy.page.judging import Verdict
from ori_deploy.page.line import LineLost
from ori_deploy.page.telling import ENDED, SILENT, WAITING, Seen, Watch, alarms_of, folds_of, latch_states, lost, news
from tests.deploy.synthetic import bench, synthetic_plan
from tests.operate.served import SESSION
from tests.page.conftest import EXAMPLES

STATUS = Status(
    pid=1, plan="p", rig="r", log=None, ports=(), uptime_s=1.0, state=State.MOVING, stage="open", command="deploy",
    at_rest=False, fold=0.5, rate=1.0, progress_percent=50.0, remaining_s=2.0, fault=None, worst_tracking_rad=0.0,
    worst_tracking_hinge=None, lost_replies=0, overruns=0, cycles=10, latches=(), folds=(0.5, 0.51),
)  # fmt: skip
FINE = Verdict((), 1.5e-3, ("c1.ac", "c2.bd"))


def seen(*fold: float) -> Seen:
    return Seen(np.array(fold), measured=True)


def test_progress_clearance_and_orders_are_told() -> None:
    told = news(Answer(True, State.MOVING), STATUS, FINE, synthetic_plan(), seen(0.5, 0.51))
    assert told["state"] == "moving"
    assert told["facts"][:4] == [
        "measured 50.0 to 51.0 % open",
        "commanded 50.0 %",
        "2.0 s left",
        "clearance 1.50 mm",
    ]
    assert not told["takes_orders"]
    assert told["alarms"] == []


def test_faults_interference_and_cells_out_of_step_are_alarms() -> None:
    plan = synthetic_plan()
    deep = Verdict((Collision(("c1.ac", "c2.bd"), (0.5, 0.5), 2e-3),), 0.0, ("c1.ac", "c2.bd"))
    told = alarms_of(replace(STATUS, fault="hot"), deep, plan, seen(0.0, 0.9))
    assert told[0] == "Fault: hot"
    assert "2.00 mm" in told[1]
    assert "out of step" in told[2]


@pytest.mark.parametrize("lead", [0.15, 0.55, 0.78, 0.97])
def test_out_of_step_is_judged_as_the_controller_does_between_rows_and_while_seating(lead: float) -> None:
    """Reproduced: told "0.300 is safe" between rows of 0.5 and 0.1, and nothing at all beyond the seating fold."""
    plan = synthetic_plan()
    steps = replace(
        plan.step_tolerance,
        lead=np.array([0.1, 0.4, 0.7, 0.8, 1.0]),
        spread=np.array([1.0, 0.5, 0.1, 0.05, 0.0]),
        seating_fold=0.75,
    )
    plan = replace(plan, step_tolerance=steps)
    allowed = USABLE * steps.allowed(lead)
    assert alarms_of(STATUS, FINE, plan, seen(lead - allowed + 1e-3, lead)) == []
    told = alarms_of(STATUS, FINE, plan, seen(lead - allowed - 1e-3, lead))
    assert told == [f"Cells are out of step by {allowed + 1e-3:.3f}; {allowed:.3f} is allowed"]


def test_a_missing_reading_keeps_its_place_and_an_old_controller_tells_what_it_commands() -> None:
    before = np.array([0.2, 0.3])
    assert folds_of(replace(STATUS, folds=(None, 1.002)), before).tolist() == [0.2, 1.0]
    assert folds_of(replace(STATUS, folds=()), before).tolist() == [0.5, 0.5]
    assert folds_of(replace(STATUS, folds=(), fold=None), before).tolist() == [0.2, 0.3]


def test_a_reading_that_is_missing_for_a_while_is_an_alarm_and_no_place() -> None:
    """Reproduced: all readings None and 900 lost replies were "50.0 % open, out of step 0.000 · at rest"."""
    watch, plan = Watch(("c1", "c2")), synthetic_plan()
    gone = replace(STATUS, folds=(0.5, None), state=State.HOLD, at_rest=True, lost_replies=900)
    watch.note(STATUS)
    assert watch.note(gone).measured  # a reply is lost now and then
    for _ in range(2):
        known = watch.note(gone)
    told = news(Answer(True, State.HOLD, at_rest=True), gone, FINE, plan, known)
    assert told["alarms"] == ["No reading from c2"]
    assert not told["at_rest"]
    assert told["fold"] is None
    assert told["facts"] == ["commanded 50.0 %", "900 replies lost"]
    assert watch.note(STATUS).missing == ()


@pytest.mark.parametrize("before", ["nothing", "a lost link", "a new link", "a silence"])
def test_what_was_not_read_since_the_link_came_up_is_not_measured(before: str) -> None:
    """Reproduced: "measured 0.0 to 0.0 % open · at rest" of cells that were never read, and after a lost link 100."""
    watch, plan = Watch(("c1", "c2")), synthetic_plan()
    if before != "nothing":
        assert watch.note(replace(STATUS, folds=(1.0, 1.0))).measured
    if before == "a lost link":
        watch.note(replace(STATUS, state=State.DISCONNECTED, folds=(), fold=None))
    if before == "a new link":
        watch.note(replace(STATUS, state=State.READY, folds=(), fold=None))
    if before == "a silence":
        watch.forget()
    for folds, missing in (((None, None), "c1, c2"), ((1.0, None), "c2")):
        status = replace(
            STATUS, state=State.READY, at_rest=True, fold=None, folds=folds, stage=None, remaining_s=None
        )
        told = news(Answer(True, State.READY, at_rest=True), status, FINE, plan, watch.note(status))
        assert told["alarms"] == [f"No reading from {missing}"]  # and not that they are out of step
        assert told["facts"] == []
        assert told["fold"] is None
        assert not told["at_rest"]
    assert watch.note(STATUS).measured
    assert watch.note(replace(STATUS, folds=(0.5, None))).measured  # now one that is lost is one that was there


def test_latches_are_not_counted_from_readings_that_are_lost() -> None:
    """Reproduced: "latches 1/1" beside "No reading from c1, c2"."""
    watch = Watch(("c1", "c2"))
    status = replace(STATUS, folds=(None, None), latches=(LatchStatus("pin", True, True, "slit:P-T2"),))
    told = news(Answer(True, State.FAULT), status, FINE, synthetic_plan(), watch.note(status))
    assert told["facts"] == ["commanded 50.0 %", "2.0 s left"]


def test_without_a_link_there_are_no_facts() -> None:
    watch, plan = Watch(("c1", "c2")), synthetic_plan()
    watch.note(STATUS)
    cut = replace(STATUS, state=State.DISCONNECTED, at_rest=True, folds=(), fold=None)
    told = news(Answer(True, State.DISCONNECTED, at_rest=True), cut, FINE, plan, watch.note(cut))
    assert told["facts"] == []
    assert not told["at_rest"]
    assert told["alarms"] == ["No link to the actuators: nothing is measured."]


def test_what_is_lost_or_late_is_told_while_it_grows() -> None:
    watch = Watch(("c1", "c2"))
    assert watch.note(replace(STATUS, lost_replies=7, overruns=3)).growing == ()
    assert watch.note(replace(STATUS, lost_replies=8, overruns=3)).growing == ("8 replies lost",)
    assert watch.note(replace(STATUS, lost_replies=8, overruns=3, uptime_s=60.0)).growing == ()


def test_why_it_is_paused_is_told() -> None:
    told = alarms_of(replace(STATUS, concern="over_temperature: servo_c2"), FINE, synthetic_plan(), seen(0.5, 0.5))
    assert told == ["Paused, and a fault if it lasts: over_temperature: servo_c2"]


def test_silence_is_told_apart_from_an_end_and_both_from_nobody_yet() -> None:
    silent = lost(LineLost("no answer"), was_there=True)
    assert silent["link"] == SILENT
    assert "may be moving" in silent["alarms"][0]
    assert lost(LineLost("no answer"), was_there=False)["link"] == SILENT
    assert lost(LineLost("nobody", shut=True), was_there=False) == {"link": WAITING, "alarms": []}
    deaf = lost(LineLost("nobody", shut=True), was_there=True)
    assert deaf["link"] == SILENT
    assert "takes no commands any more: it may be moving" in deaf["alarms"][0]
    assert lost(LineLost("gone", ended=True, shut=True), was_there=False)["link"] == ENDED
    gone = lost(LineLost("gone", ended=True), was_there=True)
    assert gone["link"] == ENDED
    assert "did not say how" in gone["alarms"][0]


def test_a_clean_end_is_told_with_how_it_ended_and_is_no_alarm() -> None:
    """Reproduced: every `deploy --view` that succeeded ended in red, without its outcome."""

    def ended(last: Answer) -> dict[str, object]:
        return lost(LineLost("gone", ended=True, last=last), was_there=True)

    assert ended(Answer(True, State.DEPLOYED, at_rest=True)) == {"link": "ended: deployed", "alarms": []}
    assert ended(Answer(True, State.FAULT, at_rest=True, fault="hot"))["alarms"] == ["Fault: hot"]
    assert "before it was at rest" in str(ended(Answer(True, State.MOVING))["alarms"])


# -- latches -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rig_mock", "rig_wing_explicit"])
def test_latches_are_told_by_the_point_they_are_on(name: str) -> None:
    """Reproduced: the page looked for "latch_slit:P-T2" or "slit_pin" among "slit:P-T2", and no ball turned green."""
    rig, b = load_rig(EXAMPLES / f"{name}.toml"), bench()
    cells, points = ("c1", "c2", "c3", "c4"), ("slit:P-T2",)
    resolved = resolve_rig(rig, cells, points)
    desk = Desk(b.controller, SESSION, b.plan, resolved, b.bus, 0.0)
    b.controller.deploy()
    record = b.step_until_fold(0.5)
    read = b.bus.read_latches()[0]
    ids = resolved.latch_ids
    desk(replace(record, latches=tuple(replace(read, id=one, confirmed=True) for one in ids)))
    status = desk.answer(Request(Do.STATUS), "a page").status
    assert status is not None
    assert latch_states(status)["slit:P-T2"] == "closed"
    assert status.secured == (len(resolved.latches), len(resolved.latches))


def test_a_point_is_closed_when_all_of_its_latches_are_and_stow_locks_do_not_count() -> None:
    def point(*confirmed: bool | None) -> str:
        latches = tuple(LatchStatus(f"l{k}", True, one, "slit:P-T2") for k, one in enumerate(confirmed))
        return latch_states(replace(STATUS, latches=latches))["slit:P-T2"]

    assert [point(True, True), point(True, False), point(True, None)] == ["closed", "open", "unknown"]
    lock = LatchStatus("lock", False, False, "stow")
    told = news(
        Answer(True, State.DEPLOYED),
        replace(STATUS, latches=(LatchStatus("pin", True, True, "slit:P-T2"), lock)),
        FINE,
        synthetic_plan(),
        seen(1.0, 1.0),
    )
    assert told["facts"][-1] == "latches 1/1"
