"""The component on a virtual clock: commands, their answers, and what keeps a structure from folding."""

from __future__ import annotations

import math

import pytest

from ori_deploy.deploy.states import State
from ori_deploy.mav.commands import FORCE
from ori_deploy.mav.words import Ask
from ori_deploy.wire.vehicle import dialect
from tests.mav.world import AUTOPILOT, GROUND, IN_AIR, ON_GROUND, US, World, command, heartbeat, world

DEPLOY, FOLD, STOP, CLEAR = (
    dialect.ORI_CMD_DEPLOY,
    dialect.ORI_CMD_FOLD,
    dialect.ORI_CMD_STOP,
    dialect.ORI_CMD_CLEAR_FAULT,
)
ACCEPTED, LATER, DENIED, FAILED, CANCELLED, IN_PROGRESS = (
    dialect.MAV_RESULT_ACCEPTED,
    dialect.MAV_RESULT_TEMPORARILY_REJECTED,
    dialect.MAV_RESULT_DENIED,
    dialect.MAV_RESULT_FAILED,
    dialect.MAV_RESULT_CANCELLED,
    dialect.MAV_RESULT_IN_PROGRESS,
)


def deployed(**settings: object) -> World:
    """A vehicle on the ground whose structure has been deployed."""
    w = world(start="deployed", **settings)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]
    w.sent.clear()
    return w


def moved(w: World, since: int) -> bool:
    """Whether any goal changed since a cycle."""
    goals = [record.commanded_rad for record in w.bench.records[since:] if math.isfinite(record.commanded_rad[0])]
    return any((goal != goals[0]).any() for goal in goals)


def test_a_deployment_is_told_from_beginning_to_end() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    acks = w.take(dialect.MAVLink_command_ack_message)
    percents = [ack.progress for ack in acks[:-1]]
    assert [ack.result for ack in acks[:-1]] == [IN_PROGRESS] * (len(acks) - 1)
    assert len(acks) > 4
    assert percents == sorted(percents)
    assert percents[-1] > 60
    assert (acks[-1].result, acks[-1].progress, acks[-1].result_param2) == (ACCEPTED, 100, 0)
    assert {(ack.target_system, ack.target_component) for ack in acks} == {(255, 190)}


def test_who_asks_how_it_is_after_the_end_is_told_of_the_end() -> None:
    w = world(telemetry_hz=20.0)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.1)
    told = [message for message, _ in w.sent]
    end = next(k for k, one in enumerate(told) if getattr(one, "result", IN_PROGRESS) == ACCEPTED)
    states = [one.state for one in told[end:] if isinstance(one, dialect.MAVLink_ori_structure_message)]
    assert states
    assert set(states) == {dialect.ORI_STRUCTURE_DEPLOYED}


def test_nothing_is_powered_before_the_first_order() -> None:
    w = world()
    w.run(1.0, landed=IN_AIR)
    assert w.state is State.READY
    w.hear(command(FOLD))  # refused, and nothing powered for it either
    w.run(0.5, landed=IN_AIR)
    assert w.state is State.READY


@pytest.mark.parametrize(
    ("armed", "landed", "reason"),
    [
        (True, ON_GROUND, dialect.ORI_REASON_ARMED),
        (False, IN_AIR, dialect.ORI_REASON_AIRBORNE),
        (False, dialect.MAV_LANDED_STATE_TAKEOFF, dialect.ORI_REASON_AIRBORNE),
        (False, dialect.MAV_LANDED_STATE_LANDING, dialect.ORI_REASON_AIRBORNE),
        (False, dialect.MAV_LANDED_STATE_UNDEFINED, dialect.ORI_REASON_LANDED_UNKNOWN),
        (False, 77, dialect.ORI_REASON_AIRBORNE),
        (None, ON_GROUND, dialect.ORI_REASON_ARMING_UNKNOWN),
        (False, None, dialect.ORI_REASON_LANDED_UNKNOWN),
        (True, IN_AIR, dialect.ORI_REASON_AIRBORNE),
    ],
)
def test_folding_is_refused_unless_on_the_ground_and_disarmed(
    armed: bool | None, landed: int | None, reason: int
) -> None:
    w = deployed()
    w.run(2.5, armed=armed, landed=landed)  # longer than a word of the autopilot counts
    begun = len(w.bench.records)
    w.answers()
    w.hear(command(FOLD))
    w.run(1.0, armed=armed, landed=landed)
    assert w.answers() == [(LATER, reason)]
    assert not moved(w, begun)
    assert w.state is State.DEPLOYED


def test_folding_is_accepted_on_the_ground() -> None:
    w = deployed()
    w.hear(command(FOLD))
    w.until(lambda: w.state is State.STOWED)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]


def test_another_vehicles_autopilot_does_not_count() -> None:
    w = deployed()
    w.run(2.5, armed=None, landed=None)
    w.hear(dialect.MAVLink_extended_sys_state_message(0, ON_GROUND), (2, 1))
    w.hear(heartbeat(), (2, 1))
    w.hear(dialect.MAVLink_extended_sys_state_message(0, ON_GROUND), (1, 191))
    w.hear(command(FOLD))
    w.run(0.3, armed=None, landed=None)
    assert w.answers() == [(LATER, dialect.ORI_REASON_LANDED_UNKNOWN)]


@pytest.mark.parametrize("change", [{"armed": True}, {"landed": IN_AIR}, {"armed": None}, {"landed": None}])
def test_a_fold_is_held_when_the_vehicle_arms_takes_off_or_falls_silent(change: dict[str, object]) -> None:
    w = deployed()
    w.hear(dialect.MAVLink_param_set_message(*US, b"ORI_SPEED", 0.3, dialect.MAV_PARAM_TYPE_REAL32))
    w.hear(command(FOLD))
    w.until(lambda: w.state is State.MOVING)
    w.run(0.3)
    w.run(3.0, **change)
    assert w.state is State.HOLD
    assert w.record.rate == 0.0
    assert w.answers() == [(FAILED, dialect.ORI_REASON_VEHICLE_CHANGED)]
    where = w.record.commanded_fold
    w.run(1.0)  # all is well again: nothing goes on by itself
    assert w.record.commanded_fold == where
    w.hear(command(FOLD))
    w.until(lambda: w.state is State.STOWED)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]


def test_an_operator_at_another_terminal_is_interlocked_too() -> None:
    from ori_deploy.operate.messages import Code, Do, Request

    w = deployed()
    w.run(0.5, landed=IN_AIR)
    answer = w.desk.answer(Request(Do.STOW), "a terminal")
    assert (answer.took, answer.code) == (False, Code.AIRBORNE)
    w.run(0.5)
    assert w.desk.answer(Request(Do.STOW), "a terminal").took
    w.until(lambda: w.state is State.MOVING)
    w.run(0.5, armed=True)
    assert w.state is State.HOLD
    answer = w.desk.answer(Request(Do.RESUME), "a terminal")
    assert (answer.took, answer.code) == (False, Code.ARMED)


def test_force_needs_leave_and_is_told() -> None:
    w = deployed()
    w.hear(command(FOLD, p2=FORCE))
    w.run(0.5, landed=IN_AIR)
    assert w.answers() == [(DENIED, dialect.ORI_REASON_FORCE_NOT_ALLOWED)]
    w = deployed(force_allowed=True)
    w.run(4.0)
    w.texts()
    w.run(0.5, landed=IN_AIR)
    w.hear(command(FOLD, p2=FORCE))
    w.until(lambda: w.state is State.STOWED, landed=IN_AIR)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]
    assert any("FORCES fold" in text for text in w.texts())


@pytest.mark.parametrize(("p1", "p2"), [(1.0, 0.0), (0.0, 1.0), (0.0, math.inf), (-0.5, FORCE), (0.0, 21195.0)])
def test_a_parameter_that_means_nothing_is_denied(p1: float, p2: float) -> None:
    w = world(force_allowed=True)
    w.run(0.1)
    w.hear(command(DEPLOY, p1, p2))
    w.run(0.5)
    assert w.answers() == [(DENIED, dialect.ORI_REASON_PARAMETER)]
    assert w.state is State.READY


@pytest.mark.parametrize(("number", "ends"), [(1.0, State.DEPLOYED), (2.0, State.STOWED)])
def test_the_alias_for_stock_stations(number: float, ends: State) -> None:
    w = world(start="stowed" if number == 1.0 else "deployed")
    w.run(0.1)
    w.hear(command(dialect.MAV_CMD_USER_1, number, math.nan))
    w.until(lambda: w.state is ends)
    w.run(0.2)
    acks = w.take(dialect.MAVLink_command_ack_message)
    assert {ack.command for ack in acks} == {dialect.MAV_CMD_USER_1}
    assert acks[-1].result == ACCEPTED


def test_the_alias_to_all_components_is_somebody_elses() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(dialect.MAV_CMD_USER_1, 1.0, to=(1, 0)))
    w.run(0.5)
    assert w.answers() == []
    assert w.state is State.READY


@pytest.mark.parametrize("to", [(0, 140), (2, 140), (0, 0), (1, 141)])
def test_what_is_meant_for_others_does_nothing(to: tuple[int, int]) -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY, to=to))
    w.run(0.5)
    assert w.answers() == []
    assert w.state is State.READY


def test_command_int_is_the_same() -> None:
    w = world()
    w.run(0.1)
    w.hear(dialect.MAVLink_command_int_message(1, 140, 0, DEPLOY, 0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]


def test_only_listed_systems_command() -> None:
    w = world(commanders=(7,))
    w.run(0.1)
    for asked in (command(DEPLOY), command(STOP), command(CLEAR)):
        w.hear(asked)
    w.run(0.5)
    assert w.answers() == [(DENIED, dialect.ORI_REASON_NOT_LISTED)] * 3
    assert w.state is State.READY
    w.hear(command(DEPLOY), (7, 1))
    w.until(lambda: w.state is State.DEPLOYED)


def test_a_repeated_command_is_one_command() -> None:
    w = world()
    w.run(0.1)
    for confirmation in (0, 0, 1, 2):
        w.hear(command(DEPLOY, confirmation=confirmation))
    w.run(0.5)
    w.hear(command(DEPLOY, confirmation=3))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    asked = [word for word in w.words if isinstance(word, Ask)]
    assert len(asked) == 1
    assert w.answers() == [(ACCEPTED, 0)]
    w.hear(command(DEPLOY, confirmation=4))  # who did not hear the end
    assert w.answers() == [(ACCEPTED, 0)]
    w.hear(command(DEPLOY))  # or gives it again
    w.run(0.5)
    assert w.answers() == [(ACCEPTED, 0)]
    assert len([word for word in w.words if isinstance(word, Ask)]) == 1


def test_an_old_answer_is_not_given_to_a_new_command() -> None:
    w = deployed()
    w.hear(command(FOLD))
    w.until(lambda: w.state is State.STOWED)
    w.run(0.2)
    w.answers()
    w.hear(command(DEPLOY, confirmation=1))  # its first sending was lost
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    assert w.answers() == [(ACCEPTED, 0)]


def test_two_stations_want_the_same_and_both_are_answered() -> None:
    w = world(commanders=(255, 254))
    w.run(0.1)
    w.hear(command(DEPLOY), (255, 190), "one")
    w.run(0.3)
    w.hear(command(DEPLOY), (254, 190), "other")
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(0.2)
    acks = [(m, peer) for m, peer in w.sent if isinstance(m, dialect.MAVLink_command_ack_message)]
    ends = {(m.target_system, peer) for m, peer in acks if m.result == ACCEPTED}
    assert ends == {(255, "one"), (254, "other")}


def test_the_opposite_has_to_wait() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.run(0.5)
    w.hear(command(FOLD))
    w.run(0.1)
    assert w.answers() == [(LATER, dialect.ORI_REASON_BUSY)]
    assert w.desk.command == "deploy"


def test_stop_ends_the_other_command_and_is_accepted_at_rest() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.2)
    w.answers()
    w.hear(command(STOP))
    w.until(lambda: w.state is State.ARMED)
    w.run(0.3)
    acks = [one for one in w.take(dialect.MAVLink_command_ack_message) if one.result != IN_PROGRESS]
    assert {(one.command, one.result) for one in acks} == {(DEPLOY, CANCELLED), (STOP, ACCEPTED)}
    assert w.record.rate == 0.0
    w.hear(command(STOP))
    w.run(0.1)
    assert w.answers() == [(ACCEPTED, dialect.ORI_REASON_NOTHING_TO_DO)]


def test_a_cancelled_command_says_so() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    for _ in range(3):
        w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))
    w.until(lambda: w.state is State.ARMED)
    w.run(0.3)
    assert w.answers() == [(CANCELLED, dialect.ORI_REASON_STOPPED)]
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))  # who did not hear it
    assert w.answers() == [(CANCELLED, dialect.ORI_REASON_STOPPED)]


def test_a_fault_on_the_way_to_rest_is_not_hidden_behind_a_cancel() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.2)
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))
    w.cycle()
    w.bench.controller.emergency_stop("a test")
    w.run(1.0)
    assert w.answers() == [(FAILED, dialect.ORI_REASON_FAULT)]


def test_a_cancel_that_the_loop_could_not_carry_out_is_passed_on_again() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))
    w.to_loop.clear()  # it never gets there
    w.run(0.3)
    assert w.state is State.MOVING
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))
    w.until(lambda: w.state is State.ARMED)
    w.run(0.3)
    assert w.answers() == [(CANCELLED, dialect.ORI_REASON_STOPPED)]


def test_a_stranger_cancels_nothing() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY), (99, 190))
    w.until(lambda: w.state is State.DEPLOYED)


def test_a_fault_fails_the_command_and_is_cleared_by_one() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.bench.controller.emergency_stop("a test")
    w.run(2.2)
    assert w.answers() == [(FAILED, dialect.ORI_REASON_FAULT)]
    beats = w.take(dialect.MAVLink_heartbeat_message)
    assert beats[-1].system_status == dialect.MAV_STATE_CRITICAL
    w.hear(command(DEPLOY))
    w.run(0.3)
    assert w.answers() == [(FAILED, dialect.ORI_REASON_FAULT)]
    w.hear(command(CLEAR))
    w.run(0.3)
    assert w.answers() == [(ACCEPTED, 0)]
    assert w.state is State.ARMED
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)


@pytest.mark.parametrize(
    ("rule", "armed", "landed", "may"),
    [
        ("always", True, IN_AIR, True),
        ("always", None, None, True),
        ("disarmed", False, None, True),
        ("disarmed", True, ON_GROUND, False),
        ("disarmed", None, ON_GROUND, False),
        ("on-ground", True, ON_GROUND, True),
        ("on-ground", False, IN_AIR, False),
        ("on-ground-and-disarmed", True, ON_GROUND, False),
        ("on-ground-and-disarmed", False, ON_GROUND, True),
    ],
)
def test_rules_for_deploying(rule: str, armed: bool | None, landed: int | None, may: bool) -> None:
    w = world(deploy_when=rule)
    w.run(1.0, armed=armed, landed=landed)
    w.hear(command(DEPLOY))
    w.run(0.5, armed=armed, landed=landed)
    assert (w.state is not State.READY) is may
    assert (w.answers() == []) is may


@pytest.mark.parametrize("policy", ["hold", "finish"])
def test_a_lost_station_holds_or_does_not(policy: str) -> None:
    w = world(link_loss=policy, link_timeout_s=2.0)
    w.hear(dialect.MAVLink_param_set_message(*US, b"ORI_SPEED", 0.3, dialect.MAV_PARAM_TYPE_REAL32))
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.run(12.0, ground=False)
    assert w.state is (State.HOLD if policy == "hold" else State.DEPLOYED)
    w.hear(heartbeat())
    w.run(0.5)
    expected = (FAILED, dialect.ORI_REASON_LINK_LOST) if policy == "hold" else (ACCEPTED, 0)
    assert w.answers() == [expected]
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)


def test_heartbeats_come_from_the_loop_and_stop_with_it() -> None:
    w = world()
    w.run(5.0)
    beats = w.take(dialect.MAVLink_heartbeat_message)
    assert len(beats) in (5, 6)
    assert {(beat.type, beat.custom_mode) for beat in beats} == {
        (dialect.MAV_TYPE_SERVO, dialect.ORI_STRUCTURE_READY)
    }
    w.loop_hangs = True
    w.run(1.5)
    w.sent.clear()
    w.run(5.0)
    w.take(dialect.MAVLink_command_long_message)
    assert w.sent == []
    w.hear(command(DEPLOY))
    assert w.answers() == [(LATER, dialect.ORI_REASON_LOOP_SILENT)]
    w.loop_hangs = False
    w.run(0.1)
    assert w.state is State.READY  # what was asked of a silent loop is not done later
    assert w.take(dialect.MAVLink_heartbeat_message)


def test_an_order_that_waited_too_long_is_not_carried_out() -> None:
    w = world()
    w.run(0.1)
    w.loop_hangs = True
    w.hear(command(DEPLOY))
    w.run(2.5)
    assert w.answers() == [(FAILED, dialect.ORI_REASON_LOOP_SILENT)]
    w.loop_hangs = False
    w.run(2.0)
    assert w.state is State.READY
    assert w.answers() == []


def test_arming_is_authorised_only_when_deployed_and_locked() -> None:
    w = world()
    w.run(0.1)
    ask = command(dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST, 1.0)
    w.hear(ask, AUTOPILOT, "autopilot")
    assert w.answers() == [(DENIED, dialect.MAV_ARM_AUTH_DENIED_REASON_GENERIC)]
    w.run(0.5)
    assert "ori: arming refused: not deployed and locked" in w.texts()
    w.run(10.0)
    w.hear(ask, GROUND, "station")  # answered, but it arms nothing: no alarm on every screen
    assert w.answers() == [(DENIED, dialect.MAV_ARM_AUTH_DENIED_REASON_GENERIC)]
    w.run(0.5)
    assert "ori: arming refused: not deployed and locked" not in w.texts()
    health = w.take(dialect.MAVLink_sys_status_message)[-1]
    assert not health.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK
    assert health.onboard_control_sensors_enabled & dialect.MAV_SYS_STATUS_PREARM_CHECK
    w = deployed()
    w.run(1.2)
    w.hear(ask, AUTOPILOT, "autopilot")
    leave = w.take(dialect.MAVLink_command_ack_message)[-1]
    assert (leave.result, leave.progress, leave.result_param2) == (ACCEPTED, 10, 10)  # seconds, wherever looked for
    health = w.take(dialect.MAVLink_sys_status_message)[-1]
    assert health.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK


def test_an_autopilot_that_does_not_say_whether_it_landed_is_asked() -> None:
    w = world()
    w.run(6.0, landed=None)
    asked = w.take(dialect.MAVLink_command_long_message)
    assert [one.command for one in asked] == [dialect.MAV_CMD_SET_MESSAGE_INTERVAL] * 2
    assert asked[0].param1 == dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    w.run(6.0)
    assert len(w.take(dialect.MAVLink_command_long_message)) <= 1
    w.run(6.0)
    assert w.take(dialect.MAVLink_command_long_message) == []


def test_transitions_are_told_once_and_not_too_many() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)
    w.run(10.0)
    texts = w.texts()
    assert texts.count("ori: deployed and locked") == 1
    assert len(texts) <= 4
    w.run(0.1, landed=IN_AIR)
    for _ in range(100):  # each is refused, and would be told
        w.hear(command(FOLD))
        w.run(0.1, landed=IN_AIR)
    told = w.texts()
    assert 0 < len(told) <= 10 + 5
    assert max(len(text) for text in told) <= 50


def test_telemetry_says_how_the_structure_is() -> None:
    w = deployed()
    w.run(0.5)
    structure = w.take(dialect.MAVLink_ori_structure_message)[-1]
    assert structure.state == dialect.ORI_STRUCTURE_DEPLOYED
    assert structure.flags & dialect.ORI_STRUCTURE_LOCKED
    assert structure.flags & dialect.ORI_STRUCTURE_MAY_FOLD
    assert (structure.creases, structure.latches, structure.latches_confirmed) == (4, 2, 2)
    assert structure.fold_lowest == pytest.approx(1.0, abs=0.01)
    creases = w.take(dialect.MAVLink_ori_creases_message)[-1]
    assert (creases.count, creases.total, creases.first) == (4, 4, 0)
    driven = w.bench.rig.to_crease(w.record.readings.position_rad)
    assert creases.angle[:4] == pytest.approx(driven.tolist(), abs=0.01)
    assert all(math.isnan(angle) for angle in creases.angle[4:])
    latches = w.take(dialect.MAVLink_ori_latches_message)[-1]
    assert (latches.confirmed, latches.sensed, latches.total) == (0b11, 0b11, 2)
    names = {one.name for one in w.take(dialect.MAVLink_named_value_float_message)}
    assert {"ori_fold", "ori_state"} <= {n.decode() if isinstance(n, bytes) else n for n in names}


def test_requests_for_messages() -> None:
    w = deployed()
    for number in (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, dialect.MAVLINK_MSG_ID_ORI_CREASES):
        w.hear(command(dialect.MAV_CMD_REQUEST_MESSAGE, float(number)))
    assert w.answers() == [(ACCEPTED, 0)] * 2
    assert w.take(dialect.MAVLink_autopilot_version_message)
    w.hear(command(dialect.MAV_CMD_REQUEST_MESSAGE, 33.0))
    w.hear(command(dialect.MAV_CMD_NAV_TAKEOFF))
    assert w.answers() == [(dialect.MAV_RESULT_UNSUPPORTED, 0)] * 2
