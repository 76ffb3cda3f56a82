"""Random operators and random faults against the controller; its promises hold after every single step."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from ori_deploy.actuators.bus import BusError
from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import CycleRecord, StartRefused
from ori_deploy.deploy.states import RULES, Event, IllegalCommand, State
from tests.deploy.synthetic import Bench, bench, synthetic_plan

PLAN = synthetic_plan(4, duration_s=1.6, curvature=0.2)
LATCHES = [
    {"id": "pin", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.1, "timeout_s": 0.4},
    {"id": "coil", "secures": "cell:c1", "kind": "electromagnet", "max_on_s": 30.0, "duty_cycle": 0.5},
    {"id": "lock", "secures": "stow", "kind": "lock_pin", "travel_s": 0.1, "timeout_s": 0.4},
]
MAY_HAVE_RATE = {State.MOVING, State.HOLD, State.STOPPING, State.FAULT}
MUST_SLOW_DOWN = {State.HOLD, State.STOPPING, State.FAULT}
hinges = st.sampled_from([f"servo_c{i + 1}" for i in range(4)])
commands = st.sampled_from(
    [
        "connect",
        "disconnect",
        "arm",
        "disarm",
        "deploy",
        "stow",
        "hold",
        "resume",
        "stop",
        "clear_fault",
        "emergency_stop",
    ]
)


class Campaign(RuleBasedStateMachine):
    """One structure, one controller, many hands."""

    @initialize(start=st.sampled_from(["stowed", "deployed"]), fold=st.none() | st.floats(0.0, 1.0))
    def set_up(self, start: str, fold: float | None) -> None:
        self.b: Bench = bench(PLAN, start=start, start_fold=fold, latch=LATCHES, controller={"settle_timeout_s": 0.4})
        rate = np.abs(self.b.rig.driven(PLAN.crease_rates_rad_s)).max()
        self.largest_step = max(rate, self.b.rig.controller.align_velocity_rad_s) * 4.0 / 100.0 * 1.001
        self.localiser = Localiser(PathTable.build(PLAN, self.b.rig))
        self.checked = self.slowing = 0

    # -- operators

    @rule(command=commands)
    def command(self, command: str) -> None:
        state = self.b.controller.state
        goal = self.b.bus._servos.goal_rad.copy()
        shaft = self.b.bus.true_shaft_rad
        allowed = (state, Event(command)) in RULES
        try:
            getattr(self.b.controller, command)()
            done = True
        except IllegalCommand:
            turns = command in ("deploy", "stow") or self.b.controller.concern is not None
            assert not allowed or self.b.controller.under_way or turns
            done = False
        except (StartRefused, BusError):
            done = False
        assert allowed or not done
        assert done or self.b.controller.state is state
        # No command moves anything by itself: a goal changes only to where its shaft stands.
        new_goal = self.b.bus._servos.goal_rad
        assert (np.isclose(new_goal, goal) | (np.abs(new_goal - shaft) < 0.02)).all()

    @rule(count=st.sampled_from([1, 2, 5, 20, 60, 150]))
    def let_it_run(self, count: int) -> None:
        if self.b.controller.state is not State.DISCONNECTED:
            self.b.steps(count)

    @rule()
    def bring_to_work(self) -> None:
        """The way out of any trouble, or random commands would hardly ever get anything to move."""
        for hinge in self.b.rig.hinge_ids:
            self.b.bus.unmute(hinge)
            self.b.bus.free(hinge)
        self.b.bus.sag(0.0)
        self.b.bus.replug()
        controller = self.b.controller
        for state, command in (
            (State.FAULT, "clear_fault"),
            (State.DISCONNECTED, "connect"),
            (State.FAULT, "clear_fault"),
            (State.READY, "arm"),
            (State.HOLD, "resume"),
        ):
            if controller.state is state:
                if controller.under_way:
                    self.b.step_to_rest()
                self.command(command)

    # -- faults

    @rule(hinge=hinges, count=st.integers(1, 4))
    def drop(self, hinge: str, count: int) -> None:
        self.b.bus.drop_replies(hinge, count)

    @rule(hinge=hinges)
    def mute(self, hinge: str) -> None:
        self.b.bus.mute(hinge)

    @rule(hinge=hinges)
    def jam(self, hinge: str) -> None:
        self.b.bus.jam(hinge)

    @rule(hinge=hinges)
    def reboot(self, hinge: str) -> None:
        self.b.bus.reboot(hinge)

    @rule(hinge=hinges)
    def overload(self, hinge: str) -> None:
        self.b.bus.overload(hinge)

    @rule(volts=st.sampled_from([0.0, 1.0, 3.0]))
    def sag(self, volts: float) -> None:
        self.b.bus.sag(volts)

    @rule()
    def unplug(self) -> None:
        self.b.bus.unplug()

    @rule(latch=st.sampled_from(["pin", "coil", "lock"]))
    def blind(self, latch: str) -> None:
        self.b.bus.latch_blind(latch)

    @rule(count=st.integers(1, 30))
    def drop_latches(self, count: int) -> None:
        self.b.bus.drop_latch_replies(count)

    @rule(delay_s=st.sampled_from([0.005, 0.02, 0.1]))
    def delay(self, delay_s: float) -> None:
        self.b.bus.delay_reads(1, delay_s)

    # -- promises

    @invariant()
    def every_cycle_keeps_the_promises(self) -> None:
        records = self.b.records
        for i in range(max(self.checked, 1), len(records)):
            before, record = records[i - 1], records[i]
            self.check_rate(before, record)
            self.check_goals(before, record)
            self.check_endings(record)
        self.checked = len(records)

    @invariant()
    def what_the_state_says_is_true(self) -> None:
        state = self.b.controller.state
        if state is State.FAULT:
            assert self.b.controller.fault is not None
        if state is State.DEPLOYED:
            assert self.b.bus.truly_closed("pin")
            assert self.b.bus.truly_closed("coil") or self._coil_has_just_let_go()

    def check_rate(self, before: CycleRecord, record: CycleRecord) -> None:
        """Rates only where motion belongs, bounded in size and slope, and only falling once told to stop."""
        assert abs(record.rate) <= 1.0
        if record.state not in MAY_HAVE_RATE:
            assert record.rate == 0.0
        # To zero at once only at an end of the path, where the plan rests, or when the link is gone; else a fault
        # may take two cycles from full rate, and nothing but a fault more than the gentle slope gives in one.
        steepest = 0.501 if record.state is State.FAULT else 0.0534
        assert abs(record.rate - before.rate) <= steepest or record.rate == 0.0
        if record.state in MUST_SLOW_DOWN and before.state in MUST_SLOW_DOWN:
            self.slowing += 1
            if self.slowing > 7:  # a slope that still pointed up has turned round
                assert abs(record.rate) <= abs(before.rate)
        else:
            self.slowing = 0

    def check_goals(self, before: CycleRecord, record: CycleRecord) -> None:
        """No jump, no motion without a rate, and cells in step while slowing down."""
        reseeded = {t.event for t in record.transitions} & {"arm", "disarm", "clear_fault", "disconnect"}
        if reseeded or np.isnan(before.commanded_rad).any():
            return
        moved = np.abs(record.commanded_rad - before.commanded_rad).max()
        assert moved <= self.largest_step
        if before.rate == 0.0 and record.state is not State.MOVING:
            assert moved <= 1e-12
        if record.stage in ("open", "close") and record.state in MUST_SLOW_DOWN:
            apart = np.ptp(self.localiser.folds(record.commanded_rad))
            assert apart <= np.ptp(self.localiser.folds(before.commanded_rad)) + 1e-9

    def check_endings(self, record: CycleRecord) -> None:
        reached = {t.target for t in record.transitions}
        if State.DEPLOYED in reached:
            assert record.latches is not None
            assert all(r.confirmed for r in record.latches if r.id in ("pin", "coil"))
        if State.STOWED in reached:
            assert (np.abs(record.folds) < 0.03).all()

    def _coil_has_just_let_go(self) -> bool:
        """Between two looks at the latches, and three of them, before it is a fault."""
        recent = [record for record in self.b.records[-21:] if record.latches is not None]
        return any(not r.confirmed for record in recent for r in record.latches or () if r.id == "coil")


Campaign.TestCase.settings = settings(
    max_examples=40,
    stateful_step_count=30,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
TestCampaign = Campaign.TestCase
