"""What a bus is made of: specifications, their JSON, the command's words, and rigs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.errors import InputError
from ori_deploy.motion.plan import Plan
from ori_deploy.wire.dynamixel import BAUD_CODES, MODELS
from sim_backends.dynamixel.bus import Bus
from sim_backends.dynamixel.from_rig import Start, spec_for_files, spec_from_rig
from sim_backends.dynamixel.spec import BusSpec, PinSpec, ServoSpec
from sim_backends.dynamixel_bus import make_spec, parse_servos
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.sim_backends.dynamixel.test_packets import fixed

EXAMPLES = Path(__file__).parents[3] / "examples"
ANGLES = st.floats(-100.0, 100.0)
POSITIVE = st.floats(0.001, 10.0)
HALF_COUNT = 1.001 * np.pi / 4096


# -- specifications ----------------------------------------------------------------------------------

SERVOS = st.builds(
    ServoSpec,
    id=st.integers(0, 252),
    model=st.sampled_from([model.name for model in MODELS] + ["xm430"]),
    firmware=st.integers(0, 255),
    baud=st.none() | st.sampled_from(list(BAUD_CODES)),
    start_rad=ANGLES,
    load_nm=POSITIVE,
    time_constant_s=POSITIVE,
    backlash_rad=POSITIVE,
    lower_stop_rad=st.none() | ANGLES,
    upper_stop_rad=st.none() | ANGLES,
)


@st.composite
def buses(draw: st.DrawFn) -> BusSpec:
    servos = draw(st.lists(SERVOS, min_size=1, max_size=5))
    ids = st.sampled_from([servo.id for servo in servos])
    pins = []
    for _ in range(draw(st.integers(0, 2))):
        hinges = draw(st.lists(ids, max_size=3))
        each = st.lists(ANGLES, min_size=len(hinges), max_size=len(hinges)).map(tuple)
        engaged = draw(ANGLES)
        pins.append(PinSpec(draw(ids), engaged, engaged + draw(POSITIVE), tuple(hinges), draw(each), draw(each)))
    return BusSpec(
        servos=tuple(servos),
        baud=draw(st.sampled_from(list(BAUD_CODES))),
        wire_timing=draw(st.booleans()),
        turnaround_s=draw(POSITIVE),
        usb_latency_s=draw(POSITIVE),
        followers_answer=draw(st.booleans()),
        pins=tuple(pins),
        supply_v=draw(st.none() | POSITIVE),
        supply_ohm=draw(POSITIVE),
        ambient_c=draw(ANGLES),
    )


@fixed
@given(buses())
def test_a_specification_survives_json(spec: BusSpec) -> None:
    assert BusSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec


@pytest.mark.parametrize(
    "make",
    [
        lambda: ServoSpec(id=253),
        lambda: ServoSpec(id=-1),
        lambda: ServoSpec(id=1, model="ax12"),
        lambda: ServoSpec(id=1, firmware=256),
        lambda: ServoSpec(id=1, time_constant_s=0.0),
        lambda: ServoSpec(id=1, backlash_rad=-0.1),
        lambda: BusSpec(servos=()),
        lambda: BusSpec(servos=(ServoSpec(id=1),), baud=9601),
        lambda: BusSpec(servos=(ServoSpec(id=1, baud=1),)),
        lambda: PinSpec(1, 0.5, 0.5, (), (), ()),
        lambda: PinSpec(1, 0.5, 0.0, (2,), (), ()),
        lambda: BusSpec(servos=(ServoSpec(id=1),), pins=(PinSpec(1, 0.5, 0.0, (2,), (0.0,), (0.1,)),)),
    ],
)
def test_what_cannot_be_is_refused(make: Any) -> None:
    with pytest.raises(InputError):
        make()


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("1:xm430", [1]),
        ("1-4:xm430", [1, 2, 3, 4]),
        ("7,1-2,9:xl330", [7, 1, 2, 9]),
        ("0-252:xm430", list(range(253))),
    ],
)
def test_servos_are_read_as_numbers_and_ranges(text: str, ids: list[int]) -> None:
    servos = parse_servos(text, firmware=40)
    assert [servo.id for servo in servos] == ids
    assert {(servo.model, servo.firmware) for servo in servos} == {(text.split(":")[1], 40)}


@pytest.mark.parametrize(
    "text", ["", "xm430", ":xm430", "1-:xm430", "a:xm430", "4-1:xm430", "1-2-3:xm430", "1:", "1:ax12", "300:xm430",
             "1-999999999999:xm430", "-1:xm430", "1,:xm430"]
)  # fmt: skip
def test_servos_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_servos(text)


@pytest.mark.parametrize(("servos", "rig", "spec"), [((), None, None), (("1:xm430",), Path("rig.toml"), None)])
def test_exactly_one_description_is_asked_for(servos: tuple[str, ...], rig: Path | None, spec: Path | None) -> None:
    with pytest.raises(InputError):
        make_spec(servos, rig, None, spec, "stowed", None, 48)


def test_a_rate_goes_with_any_description(tmp_path: Path) -> None:
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(BusSpec(servos=(ServoSpec(id=1),), baud=57_600).to_json()))
    assert make_spec((), None, None, path, "stowed", None, 48).baud == 57_600
    assert make_spec((), None, None, path, "stowed", 2_000_000, 48).baud == 2_000_000
    assert make_spec(("1:xm430",), None, None, None, "stowed", None, 48).baud == 1_000_000
    with pytest.raises(InputError):
        make_spec(("1:xm430",), None, None, None, "stowed", 0, 48)


# -- rigs --------------------------------------------------------------------------------------------

LOCK = {"id": "lock", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.2}
STOW = {"id": "stow", "secures": "stow", "kind": "lock_pin", "travel_s": 0.2}
PINS = [
    {"latch": "lock", "id": 20, "model": "XL330-M288", "engaged_rad": 1.0, "released_rad": -0.5},
    {"latch": "stow", "id": 30, "model": "XL430-W250", "engaged_rad": -1.0, "released_rad": 0.5},
]


@pytest.fixture
def rigged() -> tuple[ResolvedRig, Plan]:
    plan = synthetic_plan(3)
    rig = synthetic_rig(
        plan,
        backend="dynamixel",
        each_cell={"zero_rad": 2.6, "gear_ratio": 4.0, "actuator": {
            "max_velocity_rad_s": 4.0, "max_torque_nm": 0.2, "min_position_rad": -3.1, "max_position_rad": 3.1,
            "max_acceleration_rad_s2": 60.0,
        }},
        latch=[LOCK, STOW],
        dynamixel={"port": "/dev/null", "baud": 4_000_000, "magnets": "by_hinges", "servo": PINS},
    )  # fmt: skip
    return rig, plan


@pytest.mark.parametrize("start", ["stowed", "deployed"])
def test_servos_stand_where_the_structure_does_with_that_ends_pins_home(
    start: Start, rigged: tuple[ResolvedRig, Plan]
) -> None:
    rig, plan = rigged
    ends = {"stowed": plan.crease_angles_rad[0], "deployed": plan.crease_angles_rad[-1]}
    spec = spec_from_rig(rig, ends["stowed"], ends["deployed"], start=start)
    assert rig.wiring is not None
    by_id = {servo.id: servo for servo in spec.servos}
    assert spec.baud == 4_000_000
    assert sorted(by_id) == sorted([one.id for one in rig.wiring.hinges] + [20, 30])
    np.testing.assert_allclose([by_id[one.id].start_rad for one in rig.wiring.hinges], rig.to_actuator(ends[start]))
    assert by_id[20].start_rad == pytest.approx(1.0 if start == "deployed" else -0.5, abs=HALF_COUNT)
    assert by_id[30].start_rad == pytest.approx(-1.0 if start == "stowed" else 0.5, abs=HALF_COUNT)
    assert [by_id[k].model for k in (20, 30)] == ["XL330-M288", "XL430-W250"]
    closed = {20: "deployed", 30: "stowed"}
    for pin in spec.pins:
        expected = dict(
            zip((one.id for one in rig.wiring.hinges), rig.to_actuator(ends[closed[pin.servo_id]]), strict=True)
        )
        assert pin.hinge_ids
        for hinge, angle, reach in zip(pin.hinge_ids, pin.closed_rad, pin.range_rad, strict=True):
            assert angle == pytest.approx(expected[hinge])
            assert 0.0 < reach < np.inf


def test_from_given_angles_no_pin_is_home(rigged: tuple[ResolvedRig, Plan]) -> None:
    rig, plan = rigged
    angles = plan.crease_angles_rad
    middle = angles[len(angles) // 2]
    spec = spec_from_rig(rig, angles[0], angles[-1], start_rad=middle)
    by_id = {servo.id: servo for servo in spec.servos}
    assert [by_id[k].start_rad for k in (20, 30)] == pytest.approx([-0.5, 0.5], abs=HALF_COUNT)
    assert rig.wiring is not None
    np.testing.assert_allclose([by_id[one.id].start_rad for one in rig.wiring.hinges], rig.to_actuator(middle))


@pytest.mark.parametrize("start", ["stowed", "deployed"])
def test_nothing_stirs_on_a_bus_that_a_rig_describes_until_it_is_told_to(
    start: Start, rigged: tuple[ResolvedRig, Plan]
) -> None:
    rig, plan = rigged
    spec = spec_from_rig(rig, plan.crease_angles_rad[0], plan.crease_angles_rad[-1], start=start)
    bus = Bus(spec, 0.0)
    before = bus.motors.shaft_rad.copy()
    bus.motors.torque_on[:] = True
    bus.advance(0.5)
    np.testing.assert_allclose(bus.motors.shaft_rad, before, atol=HALF_COUNT)
    assert all(servo.error_byte == 0 for servo in bus.servos)


def test_a_rig_without_dynamixel_servos_is_refused() -> None:
    plan = synthetic_plan(2)
    with pytest.raises(InputError, match="Dynamixel"):
        spec_from_rig(synthetic_rig(plan), plan.crease_angles_rad[0], plan.crease_angles_rad[-1])


def test_a_rig_file_alone_gives_its_named_servos_without_structure() -> None:
    spec = spec_for_files(EXAMPLES / "rig_wing_dynamixel.toml", None, "stowed")
    assert [servo.id for servo in spec.servos] == [1, 2, 3, 4]
    assert spec.pins == ()
    assert spec == replace(spec, baud=1_000_000)


def test_a_template_needs_a_plan(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text((EXAMPLES / "rig_mock.toml").read_text())
    with pytest.raises(InputError, match="which cells"):
        spec_for_files(path, None, "stowed")
