"""Anybody may say anything at any time: a structure folds only on the ground and disarmed."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from ori_deploy.deploy.states import State
from ori_deploy.operate.messages import Do, Request
from ori_deploy.wire.vehicle import dialect
from tests.mav.world import IN_AIR, ON_GROUND, US, World, command, heartbeat, world

DEPLOY, FOLD, STOP, CLEAR = (
    dialect.ORI_CMD_DEPLOY,
    dialect.ORI_CMD_FOLD,
    dialect.ORI_CMD_STOP,
    dialect.ORI_CMD_CLEAR_FAULT,
)
FRESH_S = 2.0
TO_REST_S = 0.7
"""Longer than any ramp of the plan, with the cycle in which something is noticed."""


class Flight(RuleBasedStateMachine):
    """The oracle is a memory of what the autopilot said, kept here, and the goals that went to the servos."""

    @initialize(folding=st.sampled_from([True, True, False]), loss=st.sampled_from(["hold", "finish"]))
    def begin(self, folding: bool, loss: str) -> None:
        self.w: World = world(start="deployed" if folding else "stowed", link_loss=loss, link_timeout_s=3.0)
        self.w.hear(dialect.MAVLink_param_set_message(*US, b"ORI_SPEED", 0.25, dialect.MAV_PARAM_TYPE_REAL32))
        self.landed: tuple[int | None, float] = (None, -math.inf)
        self.armed: tuple[bool | None, float] = (None, -math.inf)
        self.bad_since: float | None = None
        self.ordered = False
        self.time_passes(0.1)
        if folding:
            self.folds_on_the_ground()

    # -- what happens ------------------------------------------------------------------------------------

    @rule(landed=st.sampled_from([ON_GROUND, ON_GROUND, IN_AIR, dialect.MAV_LANDED_STATE_UNDEFINED]))
    def says_whether_it_landed(self, landed: int) -> None:
        self.w.autopilot(armed=None, landed=landed)
        self.landed = landed, self.w.now

    @rule(armed=st.sampled_from([False, False, True]))
    def says_whether_it_is_armed(self, armed: bool) -> None:
        self.w.autopilot(armed=armed, landed=None)
        self.armed = armed, self.w.now

    @rule(which=st.sampled_from([DEPLOY, DEPLOY, FOLD, FOLD, STOP, CLEAR]), again=st.integers(0, 1))
    def a_station_commands(self, which: int, again: int) -> None:
        self.ordered = True
        self.w.hear(command(which, confirmation=again))

    @rule()
    def folds_on_the_ground(self) -> None:
        """All that it takes, at once: by chance it comes together too rarely."""
        self.says_whether_it_landed(ON_GROUND)
        self.says_whether_it_is_armed(False)
        self.a_station_lives()
        self.a_station_commands(FOLD, 0)
        self.time_passes(0.8)

    @rule(which=st.sampled_from([DEPLOY, FOLD]))
    def a_station_takes_back(self, which: int) -> None:
        self.w.hear(dialect.MAVLink_command_cancel_message(1, 140, which))

    @rule()
    def a_station_lives(self) -> None:
        self.w.hear(heartbeat())

    @rule(do=st.sampled_from([Do.DEPLOY, Do.STOW, Do.PAUSE, Do.RESUME, Do.RESUME, Do.STOP, Do.ESTOP, Do.CLEAR_FAULT]))
    def somebody_at_a_terminal(self, do: Do) -> None:
        self.ordered |= do in (Do.DEPLOY, Do.STOW)
        self.w.desk.answer(Request(do), "a terminal")

    @rule(seconds=st.sampled_from([0.02, 0.2, 1.0, 3.0]))
    def time_passes(self, seconds: float) -> None:
        for _ in range(round(100 * seconds)):
            self.w.cycle()
            self.look()

    # -- what has to be so -------------------------------------------------------------------------------

    def may_fold(self) -> bool:
        now = self.w.now
        landed, landed_s = self.landed
        armed, armed_s = self.armed
        return landed == ON_GROUND and now - landed_s <= FRESH_S and armed is False and now - armed_s <= FRESH_S

    def look(self) -> None:
        records = self.w.bench.records
        self.bad_since = None if self.may_fold() else (self.bad_since or self.w.now)
        if len(records) < 2:
            return
        before, last = records[-2], records[-1]
        folding = last.commanded_fold < before.commanded_fold - 1e-9
        long_bad = self.bad_since is not None and self.w.now - self.bad_since > TO_REST_S
        assert not (folding and long_bad), f"folds although it may not: {last.state}, {self.landed}, {self.armed}"
        if not self.ordered:
            assert not math.isfinite(last.commanded_fold) or last.commanded_fold == before.commanded_fold

    @invariant()
    def deployed_means_every_latch(self) -> None:
        if hasattr(self, "w") and self.w.state is State.DEPLOYED:
            assert all(latch.confirmed for latch in self.w.desk.status().latches)

    @invariant()
    def progress_never_claims_the_end(self) -> None:
        if not hasattr(self, "w"):
            return
        for ack in self.w.take(dialect.MAVLink_command_ack_message):
            if ack.result == dialect.MAV_RESULT_IN_PROGRESS:
                assert ack.progress <= 99 or ack.progress == 255
            if ack.result == dialect.MAV_RESULT_ACCEPTED and ack.command == DEPLOY:
                assert self.deployed_lately()

    def deployed_lately(self) -> bool:
        return any(record.state is State.DEPLOYED for record in self.w.bench.records[-400:])

    def teardown(self) -> None:
        """In the end everybody has been answered."""
        if hasattr(self, "w"):
            self.w.run(12.0)
            assert self.w.component._commands.motion is None or self.w.state is State.HOLD
            self.w.bench.controller.close()


def _settings(examples: int) -> settings:
    return settings(max_examples=examples, stateful_step_count=12, suppress_health_check=list(HealthCheck))


class TestFlight(Flight.TestCase):  # type: ignore[misc]
    settings = _settings(8)


@pytest.mark.slow
class TestManyFlights(Flight.TestCase):  # type: ignore[misc]
    settings = _settings(30)
