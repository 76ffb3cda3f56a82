"""Knots on their grid, and on their way through a line that loses messages."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.mcu.grid import Grid, Knot
from ori_deploy.actuators.mcu.records import device_acceleration, device_velocity
from ori_deploy.actuators.mcu.stream import NUMBERS, Stream
from ori_deploy.wire.mcu import Setpoints
from tests.actuators.mcu.setups import wiring

PERIOD, LEAD, MIN_LEAD = 0.02, 0.3, 0.25


def knot(i: int) -> Knot:
    return Knot(1.0 + 0.02 * i, np.array([0.001 * i, -0.5]), np.array([0.05, 0.0]))


class Receiver:
    """Takes knots as the device does: in order, once, as long as there is room."""

    def __init__(self, first: int, room: int) -> None:
        self.contiguous, self.room = first, room
        self.taken: list[tuple[int, int]] = []

    def hear(self, message: Setpoints) -> None:
        for j in range(message.count):
            if (message.first + j) % NUMBERS == self.contiguous and self.room > 0:
                self.taken.append((self.contiguous, message.time_us[j]))
                self.contiguous = (self.contiguous + 1) % NUMBERS
                self.room -= 1


@settings(max_examples=100)
@given(
    first=st.sampled_from([0, 5, NUMBERS - 7]),
    lost=st.lists(st.booleans(), max_size=120),
    silent=st.lists(st.booleans(), max_size=40),
    full=st.lists(st.booleans(), max_size=40),
    beginning=st.booleans(),
)
def test_knots_arrive_once_and_in_order_whatever_is_lost(
    first: int, lost: list[bool], silent: list[bool], full: list[bool], beginning: bool
) -> None:
    stream, receiver = Stream(3, first), Receiver(first, 0)
    losses, silences, fulls = iter(lost), iter(silent), iter(full)

    def send(messages: tuple[Setpoints, ...]) -> None:
        for message in messages:
            if not next(losses, False):
                receiver.hear(message)

    made = 0
    for _ in range(40):
        receiver.room = 0 if next(fulls, False) else 20
        if not next(silences, False):
            stream.acknowledge(receiver.contiguous)
            send(stream.again())
        count = 2 if beginning and made == 0 else 1
        send(stream.append([knot(made + i) for i in range(count)]))
        made += count
    receiver.room = 100
    for _ in range(130):
        stream.acknowledge(receiver.contiguous)
        send(stream.again())
    stream.acknowledge(receiver.contiguous)
    assert stream.unacknowledged == 0
    assert receiver.taken == [((first + i) % NUMBERS, round(1e6 * knot(i).time_s)) for i in range(made)]


def test_one_lost_message_loses_nothing() -> None:
    stream, receiver = Stream(1), Receiver(0, 100)
    for i in range(10):
        for message in stream.append([knot(i)]):
            if i != 4:
                receiver.hear(message)
    assert receiver.contiguous == 10


def test_numbers_that_were_never_sent_acknowledge_nothing() -> None:
    stream = Stream(1)
    stream.append([knot(0)])
    for contiguous in (2, 100, NUMBERS - 1):
        stream.acknowledge(contiguous)
        assert stream.unacknowledged == 1
    stream.acknowledge(1)
    assert stream.unacknowledged == 0
    assert stream.oldest_due_s == np.inf
    assert stream.again() == ()


def test_messages_in_the_units_of_the_wire() -> None:
    (message,) = Stream(7).append([Knot(4294.967297, np.array([0.1234567, -1.0]), np.array([0.0504, -2.0]))])
    assert message.time_us == [1, 0]
    assert message.position_urad == [123457, -1_000_000] + [0] * 22
    assert message.velocity_mrad_s == [50, -2000] + [0] * 22
    assert (message.first, message.count, message.stream) == (0, 1, 7)


# -- the grid ----------------------------------------------------------------------------------------


def grid() -> Grid:
    made = Grid(wiring(2).hinges, PERIOD, LEAD, MIN_LEAD)
    made.stand(np.zeros(2))
    return made


def path(t: float) -> tuple[np.ndarray, np.ndarray]:
    """From rest to rest, within 2 s."""
    u = min(max(t / 2.0, 0.0), 1.0)
    s, v = u**3 * (10 - 15 * u + 6 * u**2), 15 * u**2 * (1 - u) ** 2
    return s * np.array([1.0, -0.7]), v * np.array([1.0, -0.7])


@settings(max_examples=60)
@given(
    rate=st.floats(0.995, 1.005),
    late=st.lists(st.floats(0.0, 0.012), min_size=110, max_size=110),
    stalls=st.lists(st.tuples(st.integers(0, 100), st.floats(0.0, 0.04)), max_size=3),
    caught_up=st.booleans(),
    off=st.floats(-0.01, 0.01),
    resting=st.integers(0, 30),
)
def test_knots_of_a_motion_are_evenly_spaced_and_ahead(
    rate: float, late: list[float], stalls: list[tuple[int, float]], caught_up: bool, off: float, resting: int
) -> None:
    made, knots, ahead = grid(), [], []
    for i in range(resting):  # the motion begins with a step off what was held, on the grid
        made.next(rate * (50.0 + (i - resting) * PERIOD), rate, np.zeros(2), np.zeros(2))
    knots += [made.last] if resting else []
    commanded: list[np.ndarray] = [np.zeros(2)] if resting else []
    origin = behind = 50.0
    first_s = 0.04 * caught_up  # the queue is begun late, and then caught up with
    for i in range(110):
        stall = first_s * (i == 0) + sum(duration for cycle, duration in stalls if cycle == i)
        behind = max(behind, origin + i * PERIOD) + late[i] + stall  # then cycles follow each other at once
        origin += 0.0 if caught_up else stall
        now = rate * (behind if caught_up else origin + i * PERIOD + late[i])
        behind -= late[i]
        position, velocity = path(i * PERIOD)
        assert made.has_room(now, rate, velocity) or not velocity.any()
        if not made.has_room(now, rate, velocity):
            continue
        fresh = made.next(now, rate, position + off, velocity)
        knots += fresh
        commanded += [np.zeros(2)] * (len(fresh) - 1) + [velocity]
        ahead.append((fresh[-1].time_s - now) / rate)
    spacing = np.diff([k.time_s for k in knots]) / (rate * PERIOD)
    at_rest = [k.at_rest for k in knots[:-1]]
    moving = np.array([not rest for rest in at_rest])
    assert (spacing > 0.0).all()
    assert (spacing[moving] > 0.997).all()
    assert (spacing[moving] < 1.0101).all()
    assert min(ahead) >= LEAD - 0.012 - first_s - sum(duration for _, duration in stalls) - 2e-3
    assert max(ahead) <= LEAD + 6.5 * PERIOD
    speeds = np.array([k.velocity_rad_s for k in knots])[1:]  # as fast on the device's clock as the spacing says
    np.testing.assert_allclose(speeds[moving] * rate * spacing[moving, None], np.array(commanded)[1:][moving])
    velocity, acceleration = device_velocity(3.0), device_acceleration(20.0)
    for a, b in pairwise(knots):
        assert_within(a, b, velocity, acceleration)


def assert_within(a: Knot, b: Knot, velocity: float, acceleration: float) -> None:
    """A segment sampled, not computed with the formulas of the grid."""
    duration = b.time_s - a.time_s
    u = np.linspace(0.0, 1.0, 41)[:, None]
    way = b.position_rad - a.position_rad
    v = (
        6 * u * (1 - u) * way / duration
        + (1 - u) * (1 - 3 * u) * a.velocity_rad_s
        + u * (3 * u - 2) * b.velocity_rad_s
    )
    assert np.abs(v).max() <= velocity + 1e-9
    assert np.abs(np.diff(v, axis=0)).max() * 40 / duration <= acceleration + 1e-9


@given(
    goals=st.lists(st.tuples(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)), min_size=1, max_size=6),
    pause=st.lists(st.floats(0.0, 2.0), min_size=6, max_size=6),
)
def test_lone_goals_keep_the_actuators_limits(goals: list[tuple[float, float]], pause: list[float]) -> None:
    made, now = grid(), 10.0
    for goal, wait in zip(goals, pause, strict=False):
        now += wait
        while not made.has_room(now, 1.0, np.zeros(2)):
            now += PERIOD
        before = made.last
        knots = made.next(now, 1.0, 0.5 * np.array(goal), np.zeros(2))
        chain = ([before] if np.isfinite(before.time_s) else []) + list(knots)
        assert knots[0].time_s >= now + 0.15 - 1e-9
        assert knots[-1].time_s >= now + MIN_LEAD - 1e-9
        for a, b in pairwise(chain):
            assert b.time_s - a.time_s >= 1e-3
            if not np.array_equal(a.position_rad, b.position_rad):
                assert b.time_s - a.time_s <= 1.1
                assert_within(a, b, device_velocity(3.0), device_acceleration(20.0))


def test_a_motion_begins_with_where_it_rests() -> None:
    made = grid()
    hold, goal = made.next(5.0, 1.0, np.array([1e-4, 0.0]), np.array([0.01, 0.0]))
    assert hold.at_rest
    np.testing.assert_array_equal(hold.position_rad, [0.0, 0.0])
    assert hold.time_s == pytest.approx(5.0 + LEAD - PERIOD)
    assert goal.time_s == pytest.approx(5.0 + LEAD)
    (then,) = made.next(5.02, 1.0, np.array([3e-4, 0.0]), np.array([0.01, 0.0]))
    assert then.time_s == pytest.approx(5.0 + LEAD + PERIOD)


def test_a_step_ends_when_it_is_due_and_the_queue_gets_its_length_back() -> None:
    made = grid()
    hold, goal = made.next(5.0, 1.0, np.array([0.05, 0.0]), np.zeros(2))
    assert goal.time_s == pytest.approx(5.0 + LEAD)
    assert goal.time_s - hold.time_s > 0.1
    (step,) = made.next(5.02, 1.0, np.array([0.5, 0.0]), np.zeros(2))
    assert step.time_s > 5.02 + LEAD + 0.1
    now = 5.02
    while not made.has_room(now, 1.0, np.zeros(2)):
        now += PERIOD
    for _ in range(4):
        made.next(now, 1.0, np.array([0.5, 0.0]), np.zeros(2))
        now += PERIOD
    assert made.last.time_s == pytest.approx(now - PERIOD + LEAD)


def test_a_moving_queue_is_never_begun_anew() -> None:
    made = grid()
    made.next(5.0, 1.0, np.array([1e-4, 0.0]), np.array([0.01, 0.0]))
    (late,) = made.next(5.28, 1.0, np.array([3e-4, 0.0]), np.array([0.01, 0.0]))
    assert late.time_s == pytest.approx(5.0 + LEAD + PERIOD, rel=2e-5)


def test_a_goal_that_is_too_far_names_its_hinge() -> None:
    made = Grid(wiring(2, each_hinge=None, hinge=_far()).hinges, PERIOD, LEAD, MIN_LEAD)
    made.stand(np.array([-2.0, 0.0]))
    made._velocity[:] = 1.0
    with pytest.raises(CommandRefused, match="goal of a is 4 rad"):
        made.next(5.0, 1.0, np.array([2.0, 0.0]), np.zeros(2))


def _far() -> list[dict[str, object]]:
    from tests.actuators.mcu.setups import SERVO

    return [{"actuator": name, "output": k, "open_loop": True, **SERVO} for k, name in enumerate("ab")]
