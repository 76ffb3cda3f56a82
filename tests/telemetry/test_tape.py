"""The tape gives back exactly what went over the boundary."""

from __future__ import annotations

import contextlib
import inspect
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ori_deploy.actuators import bus as buses
from ori_deploy.actuators.bus import ActuatorBus, HealthReadings, HingeReadings, LatchReading
from ori_deploy.telemetry.boundary import BoundaryBus
from ori_deploy.telemetry.tape import (
    BROKEN_TAPE,
    PIECE,
    Entry,
    Tape,
    entries,
    plain,
    plain_error,
    rich,
    rich_error,
)
from ori_deploy.telemetry.taped import TapedBus

numbers = st.floats(width=64)  # NaN and infinities among them
texts = st.text(max_size=20)


def only(tape: Tape) -> Entry:
    (entry,) = entries(tape.take()[PIECE.size :])
    return entry


def identical(a: Any, b: Any) -> None:
    np.testing.assert_array_equal(a, b, strict=True)


@st.composite
def hinge_readings(draw: st.DrawFn) -> HingeReadings:
    n = draw(st.integers(1, 5))
    floats, bools = arrays(np.float64, n, elements=numbers), arrays(np.bool_, n)
    return HingeReadings(draw(floats), draw(floats), draw(floats), draw(bools), draw(bools), draw(floats))


@st.composite
def health_readings(draw: st.DrawFn) -> HealthReadings:
    n = draw(st.integers(1, 5))
    floats, bools = arrays(np.float64, n, elements=numbers), arrays(np.bool_, n)
    return HealthReadings(
        draw(floats), draw(floats), draw(arrays(np.uint8, n)), draw(bools), draw(bools), draw(floats)
    )


latches = st.builds(
    LatchReading, texts, st.booleans(), st.none() | st.booleans(), st.booleans(), numbers, st.none() | texts
)


@given(hinge_readings())
def test_hinge_readings_come_back_to_the_last_bit(readings: HingeReadings) -> None:
    tape = Tape()
    tape.read_hinges(readings)
    back = only(tape).value
    for name in HingeReadings.__dataclass_fields__:
        identical(getattr(back, name), getattr(readings, name))


@given(health_readings())
def test_health_comes_back_to_the_last_bit(readings: HealthReadings) -> None:
    tape = Tape()
    tape.read_health(readings)
    back = only(tape).value
    for name in HealthReadings.__dataclass_fields__:
        identical(getattr(back, name), getattr(readings, name))


@given(hinge_readings(), st.booleans())
def test_goals_come_back(readings: HingeReadings, moving: bool) -> None:
    tape = Tape()
    velocity = readings.velocity_rad_s if moving else None
    tape.command_hinges(readings.position_rad, velocity)
    position, back = only(tape).arguments
    identical(position, readings.position_rad)
    assert back is None if velocity is None else (identical(back, velocity) is None)


@given(numbers, numbers)
def test_times_come_back(a: float, b: float) -> None:
    tape = Tape()
    tape.now(a)
    tape.slept(b)
    tape.due(a, b)
    now, slept, due = entries(tape.take()[PIECE.size :])
    identical([now.value, *slept.arguments, *due.arguments, due.value], [a, b, a, b])


@given(st.lists(latches, max_size=4).map(tuple))
def test_latches_come_back(readings: tuple[LatchReading, ...]) -> None:
    tape = Tape()
    tape.read_latches(readings)
    assert repr(only(tape).value) == repr(readings)  # NaN is not equal to itself


@given(health_readings() | st.lists(latches, max_size=4).map(tuple) | numbers | texts | st.none() | st.booleans())
def test_other_values_come_back(value: Any) -> None:
    tape = Tape()
    tape.called("read", (value, "x"), value)
    entry = only(tape)
    for back in (entry.value, entry.arguments[0]):
        if isinstance(value, HealthReadings):
            for name in HealthReadings.__dataclass_fields__:
                identical(getattr(back, name), getattr(value, name))
        else:
            assert repr(back) == repr(value)  # NaN is not equal to itself


@pytest.mark.parametrize(
    "error",
    [
        *(
            kind("servo_1", "hot, nan") if issubclass(kind, buses.ActuatorFault) else kind("what happened")
            for kind in vars(buses).values()
            if isinstance(kind, type) and issubclass(kind, buses.BusError)
        ),
        KeyboardInterrupt(),
        OSError(5, "Input/output error"),
        ZeroDivisionError("nothing"),
    ],
)
def test_an_exception_comes_back_as_the_controller_sees_it(error: BaseException) -> None:
    tape = Tape()
    tape.raised("read_hinges", (), error)
    told = only(tape).error
    assert told is not None
    back = rich_error(told)
    assert type(back).__name__ == type(error).__name__
    assert str(back) == str(error)
    if isinstance(error, buses.BusError):
        assert type(back) is type(error)
        assert getattr(back, "actuator_id", None) == getattr(error, "actuator_id", None)


def test_a_backends_own_error_comes_back_as_the_kind_that_it_is() -> None:
    class Odd(buses.LatchTripped):
        pass

    back = rich_error(plain_error(Odd("latch_1", "too hot")))
    assert type(back) is buses.LatchTripped
    assert str(back) == "latch_1: too hot"


def test_what_has_no_form_is_named_and_ends_nothing() -> None:
    tape = Tape()
    tape.begun("deploy", (object(),), {"x": {1}})
    with pytest.raises(ValueError, match="object has no form"):
        only(tape)
    assert plain(np.float64(2.0)) == 2.0
    assert rich({"array": [1], "dtype": "|u1"}).dtype == np.uint8
    with pytest.raises(ValueError, match="array of"):
        rich({"array": [1], "dtype": "|O"})


@given(st.binary(max_size=200))
def test_bytes_that_are_no_tape_are_refused(data: bytes) -> None:
    with contextlib.suppress(BROKEN_TAPE):
        list(entries(data))


def test_every_cut_of_a_piece_is_refused_or_an_entry_less() -> None:
    tape = Tape()
    tape.now(1.0)
    tape.read_hinges(HingeReadings.none(3))
    tape.called("engage", ("latch",), None)
    tape.begun("deploy", (), {"span_unfolded": True})
    data = tape.take()[PIECE.size :]
    whole = len(list(entries(data)))
    for cut in range(len(data)):
        try:
            found = len(list(entries(data[:cut])))
        except BROKEN_TAPE:
            continue
        assert found < whole


def test_pieces_are_numbered() -> None:
    tape = Tape()
    assert [struct.unpack("<Q", tape.take())[0] for _ in range(3)] == [0, 1, 2]


def public(kind: type) -> dict[str, Any]:
    return {
        name: inspect.getattr_static(kind, name)
        for name in dir(kind)
        if not name.startswith("_") and (callable(getattr(kind, name)) or isinstance(getattr(kind, name), property))
    }


@pytest.mark.parametrize("kind", [BoundaryBus, TapedBus])
def test_no_call_of_a_bus_goes_past_the_tape(kind: type) -> None:
    """Whoever gives a bus a new method has to say here how it is taken down."""
    for name, found in public(ActuatorBus).items():
        assert public(kind)[name] is not found, f"{kind.__name__} does not pass on {name}"
