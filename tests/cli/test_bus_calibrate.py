"""Zeros of a rig found on virtual servos: what is written, and that nothing is written when anything is wrong."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, write
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.errors import FileError
from ori_deploy.files import load_plan
from ori_deploy.motion import Plan
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from sim_backends.dynamixel.from_rig import spec_from_rig
from sim_backends.dynamixel_bus import VirtualBus
from tests.cli.virtual import Running, command, document, is_one_line

pytestmark = pytest.mark.slow  # servos and their answers take real time

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_wing_dynamixel.toml"
OFF_RAD = 0.02
"""By how much the zeros of the rig are wrong."""

RESTORED = ("operating_mode", "goal_current", "goal_pwm", "profile_velocity", "drive_mode", "bus_watchdog")
COUNT_RAD = 2.0 * np.pi / 4096


@dataclass(frozen=True)
class Wing:
    """The example wing: its plan, and the rig that is true of it."""

    plan_file: Path
    plan: Plan
    rig: ResolvedRig


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> Wing:
    folder = tmp_path_factory.mktemp("calibrate")
    design, plan_file = folder / "wing.design.json", folder / "wing.plan.json"
    assert command("design", EXAMPLES / "wing_naca2412.toml", "-o", design).exit_code == 0
    assert command("plan", design, "--rig", RIG, "-o", plan_file).exit_code == 0
    plan = load_plan(plan_file)
    return Wing(plan_file, plan, resolve_rig(load_rig(RIG), plan.cell_ids, plan.latch_points))


def wrong_rig(folder: Path, off_rad: float = OFF_RAD) -> Path:
    """The rig with zeros that are not true."""
    path = folder / "rig.toml"
    text = RIG.read_text()
    path.write_text(re.sub(r"zero_rad = (-?[\d.]+)", lambda m: f"zero_rad = {float(m[1]) + off_rad:.4f}", text))
    return path


@contextmanager
def servos(
    wing: Wing, folder: Path, *, row: int = 0, stops: bool = True, models: tuple[str, ...] = ()
) -> Iterator[VirtualBus]:
    """The wing's servos at a row of the plan, stops at both ends of the motion."""
    rig, angles = wing.rig, wing.plan.crease_angles_rad
    spec = spec_from_rig(rig, angles[0], angles[-1], start_rad=angles[row])
    ends = np.sort([rig.to_actuator(angles[0]), rig.to_actuator(angles[-1])], axis=0)
    made = [
        replace(servo, lower_stop_rad=float(low), upper_stop_rad=float(high)) if stops else servo
        for servo, low, high in zip(spec.servos, *ends, strict=True)
    ]
    made = [replace(servo, model=model) for servo, model in zip(made, models, strict=False)] + made[len(models) :]
    with VirtualBus(replace(spec, wire_timing=False, servos=tuple(made)), folder / "tty") as bus:
        yield bus


def calibrate(wing: Wing, rig: Path, bus: VirtualBus, *words: object, answer: str | None = None) -> Result:
    return command(
        "bus", "calibrate", rig, "--plan", wing.plan_file, "--port", bus.link, *words, answer=answer
    )  # fmt: skip


def untouched(rig: Path, before: str) -> bool:
    """Neither rewritten nor copied, and nothing left beside it."""
    return rig.read_text() == before and not list(rig.parent.glob("rig.toml.*")) + list(rig.parent.glob(".rig*"))


def restored(bus: VirtualBus, found: dict[int, list[int]]) -> bool:
    return found == registers(bus) and not any(servo.torque_on for servo in bus.truth().values())


def registers(bus: VirtualBus) -> dict[int, list[int]]:
    return {servo_id: [bus.register(servo_id, name) for name in RESTORED] for servo_id in bus.truth()}


MIDDLE = 300


@pytest.mark.parametrize(("pose", "row"), [("stowed", 0), ("deployed", -1)])
def test_a_held_pose_gives_the_zeros_and_changes_nothing_else_in_the_file(
    wing: Wing, tmp_path: Path, pose: str, row: int
) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, row=row) as bus:
        found = registers(bus)
        told = document(calibrate(wing, rig, bus, "--pose", pose, "--yes", "--json"))
        assert restored(bus, found)
    after = resolve_rig(load_rig(rig), wing.plan.cell_ids, wing.plan.latch_points)
    assert np.abs(after.zero_rad - wing.rig.zero_rad).max() <= COUNT_RAD
    assert [hinge["hinge"] for hinge in told["hinges"]] == list(wing.rig.hinge_ids)
    assert told["hinges"][0]["old_zero_rad"] == pytest.approx(wing.rig.zero_rad[0] + OFF_RAD)
    lines = list(zip(before.splitlines(), rig.read_text().splitlines(), strict=True))
    assert [old.split("=")[0] for old, new in lines if old != new] == ["zero_rad "] * 4
    assert (tmp_path / "rig.toml.bak").read_text() == before


def test_backups_are_numbered_and_never_overwritten(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    (tmp_path / "rig.toml.bak").write_text("mine")
    with servos(wing, tmp_path) as bus:
        first = document(calibrate(wing, rig, bus, "--pose", "stowed", "--yes", "--json"))["backup"]
        second = document(calibrate(wing, rig, bus, "--pose", "stowed", "--yes", "--json"))["backup"]
    assert (tmp_path / "rig.toml.bak").read_text() == "mine"
    assert [Path(name).name for name in (first, second)] == ["rig.toml.bak.1", "rig.toml.bak.2"]


@pytest.mark.parametrize(("end", "row"), [("closing", 0), ("opening", -1)])
def test_stops_give_the_zeros_and_the_servos_are_left_limp_off_the_stop_and_as_they_were(
    wing: Wing, tmp_path: Path, end: str, row: int
) -> None:
    rig = wrong_rig(tmp_path)
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        found = registers(bus)
        done = calibrate(wing, rig, bus, "--stop", end, "--speed", 150, "--yes")
        assert done.exit_code == 0, done.output
        assert restored(bus, found)
        assert (
            len(re.findall(r"; its stop [01]\.\d\d deg of the shaft (before|beyond) where the old", done.stderr)) == 4
        )
        shaft = np.array([servo.shaft_rad for servo in bus.truth().values()])
    after = resolve_rig(load_rig(rig), wing.plan.cell_ids, wing.plan.latch_points)
    assert np.abs(after.zero_rad - wing.rig.zero_rad).max() <= 3 * COUNT_RAD
    assert (np.abs(shaft - wing.rig.to_actuator(wing.plan.crease_angles_rad[row])) > 0.05).all()


def test_one_hinge_alone_is_calibrated_by_name_or_cell(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        moved = bus.truth()
        words = ("--stop", "closing", "--speed", 150, "--yes", "--json")
        told = document(calibrate(wing, rig, bus, "--hinge", "servo_4", "--hinge", "c4", *words))
        others = [bus.truth()[i].shaft_rad == moved[i].shaft_rad for i in (1, 2, 3)]
        unknown = calibrate(wing, rig, bus, "--hinge", "servo_9", *words)
    assert [hinge["cell"] for hinge in told["hinges"]] == ["c4"]
    assert all(others)
    assert unknown.exit_code == 2
    is_one_line(unknown, "servo_9", "servo_1, servo_2")
    zeros = [hinge.zero_rad for hinge in load_rig(rig).hinge]
    assert zeros[:3] == pytest.approx(wing.rig.zero_rad[:3] + OFF_RAD)
    assert zeros[3] == pytest.approx(wing.rig.zero_rad[3], abs=2 * COUNT_RAD)


def rig_with_a_model_without_current_sensor(folder: Path) -> Path:
    rig = wrong_rig(folder)
    text = rig.read_text().replace(
        'actuator = "servo_4"\nid = 4', 'actuator = "servo_4"\nid = 4\nmodel = "XL430-W250"'
    )
    rig.write_text(re.sub(r'(id = "servo_4"(?:\n.*?)*?max_torque_nm = )2\.0', r"\g<1>1.0", text))
    return rig


XL_AT_4 = ("XM430-W350", "XM430-W350", "XM430-W350", "XL430-W250")


def test_a_model_without_current_sensor_finds_its_stop_too(wing: Wing, tmp_path: Path) -> None:
    rig = rig_with_a_model_without_current_sensor(tmp_path)
    with servos(wing, tmp_path, row=MIDDLE, models=XL_AT_4) as bus:
        found = registers_without_current(bus)
        done = calibrate(
            wing, rig, bus, "--hinge", "servo_4", "--stop", "closing", "--current", 0.3, "--speed", 150, "--yes"
        )
        assert done.exit_code == 0, done.output
        assert registers_without_current(bus) == found
    assert load_rig(rig).hinge[3].zero_rad == pytest.approx(wing.rig.zero_rad[3], abs=3 * COUNT_RAD)


def test_a_model_without_current_sensor_is_pushed_with_little_voltage(wing: Wing, tmp_path: Path) -> None:
    rig = rig_with_a_model_without_current_sensor(tmp_path)
    with servos(wing, tmp_path, row=MIDDLE, models=XL_AT_4) as bus:
        start = bus.truth()[4].shaft_rad
        words = ("bus", "calibrate", rig, "--plan", wing.plan_file, "--port", bus.link, "--hinge", "c4", "--yes")
        with Running(*words, "--stop", "closing", "--speed", 5, cwd=tmp_path) as running:
            while abs(bus.truth()[4].shaft_rad - start) < 0.05:
                assert running.alive, running.end()
                time.sleep(0.02)
            assert bus.register(4, "goal_pwm") == round(0.15 * 885)
            assert running.interrupt()[0] == 130
        assert bus.register(4, "goal_pwm") == 885


def registers_without_current(bus: VirtualBus) -> list[int]:
    return [bus.register(4, name) for name in RESTORED if name != "goal_current"]


def test_a_hinge_without_a_stop_is_given_up_and_nothing_is_written(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, row=MIDDLE, stops=False) as bus:
        found = registers(bus)
        lost = calibrate(wing, rig, bus, "--hinge", "c4", "--stop", "closing", "--speed", 200, "--yes")
        assert restored(bus, found)
    assert lost.exit_code == 1
    is_one_line(lost, "servo_4", "no stop within", "limit: ", "remedy: ")
    assert untouched(rig, before)


@pytest.mark.parametrize(
    ("spoil", "says", "status"),
    [
        # Found at the first look under way, when torque is on; a servo's own error is found before.
        (lambda bus: bus.heat(4, 76.0), "too hot", 1),
        (lambda bus: bus.sag(2.0), "supply too low", 1),
        (lambda bus: bus.fail(4, 0x20), "overload", 3),
    ],
)
def test_a_servo_that_is_not_well_is_not_pushed(
    wing: Wing, tmp_path: Path, spoil: object, says: str, status: int
) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    assert callable(spoil)
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        found = registers(bus)
        spoil(bus)
        given_up = calibrate(wing, rig, bus, "--hinge", "c4", "--stop", "closing", "--yes")
        assert restored(bus, found)
    assert given_up.exit_code == status
    is_one_line(given_up, says, "remedy: ")
    assert untouched(rig, before)


def test_more_current_than_the_servo_is_set_to_is_refused(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        found = registers(bus)
        refused = calibrate(wing, rig, bus, "--hinge", "c4", "--stop", "closing", "--current", 9.0, "--yes")
        assert restored(bus, found)
        assert bus.truth()[4].moved_s < 0.0
    assert refused.exit_code == 3
    is_one_line(refused, "servo 4", "9 A", "3.21 A", "remedy: ")
    assert untouched(rig, before)


def test_a_structure_that_is_shaken_while_it_is_held_gives_no_zero(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, stops=False) as bus:
        words = ("bus", "calibrate", rig, "--plan", wing.plan_file, "--port", bus.link, "--pose", "stowed", "--yes")
        with Running(*words, cwd=tmp_path) as running:
            while running.alive:
                for by_rad in (0.05, -0.05):
                    for servo_id in (1, 2, 3, 4):
                        bus.push(servo_id, by_rad)
            status, _, err = running.end()
    assert status == 1
    assert "was not held still" in err
    assert untouched(rig, before)


def test_torque_that_is_on_is_asked_about_first(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path) as bus:
        assert command("bus", "jog", 2, "--by", 0, "--hold", "--rig", rig, "--port", bus.link).exit_code == 0
        refused = calibrate(wing, rig, bus, "--pose", "stowed", answer="n\n")
        assert refused.exit_code == 3
        assert "goes limp" in refused.stderr
        assert bus.truth()[2].torque_on
        assert untouched(rig, before)
        limp = calibrate(wing, rig, bus, "--pose", "stowed", answer="y\nn\n")
        assert limp.exit_code == 1  # no, but not before a servo went limp
        assert not bus.truth()[2].torque_on
        assert command("bus", "jog", 2, "--by", 0, "--hold", "--rig", rig, "--port", bus.link).exit_code == 0
        done = calibrate(wing, rig, bus, "--pose", "stowed", answer="y\n" + 4 * "y\n")
        assert done.exit_code == 0, done.output
        assert not bus.truth()[2].torque_on
    assert "close_a of cell c1" in done.stderr


def test_no_at_one_hinge_writes_nothing(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path) as bus:
        assert calibrate(wing, rig, bus, "--pose", "stowed", answer="y\ny\nn\n").exit_code == 3
    assert untouched(rig, before)


def test_no_after_a_hinge_was_walked_is_no_refusal_of_it_all(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    words = ("--stop", "closing", "--speed", 150, "--hinge", "c3", "--hinge", "c4")
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        assert calibrate(wing, rig, bus, *words, answer="n\n").exit_code == 3
        assert calibrate(wing, rig, bus, *words, answer="y\nn\n").exit_code == 1
    assert untouched(rig, before)


def test_a_rig_that_cannot_be_written_any_more_is_told_after_the_hinges_were_measured(
    wing: Wing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def changed(*_: object) -> None:
        raise FileError("rig.toml: changed while the hinges were calibrated", remedy="calibrate again")

    monkeypatch.setattr("ori_deploy.cli.bus_calibrate.save_rig", changed)
    with servos(wing, tmp_path) as bus:
        late = calibrate(wing, wrong_rig(tmp_path), bus, "--pose", "stowed", "--hinge", "c1", "--yes")
    assert late.exit_code == 1
    is_one_line(late, "changed while the hinges were calibrated", "remedy: ")


def test_zeros_that_leave_the_actuators_range_are_not_written(wing: Wing, tmp_path: Path) -> None:
    """Held at the wrong end, or with a horn mounted a tooth off, the motion would not fit."""
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, row=-1) as bus:
        refused = calibrate(wing, rig, bus, "--pose", "stowed", "--yes")
    assert refused.exit_code == 1
    is_one_line(refused, "nothing was written", "position range too small")
    assert untouched(rig, before)


def test_a_servo_that_does_not_answer_is_named_and_nothing_is_written(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path) as bus:
        bus.mute(3)
        refused = calibrate(wing, rig, bus, "--pose", "stowed", "--yes")
    assert refused.exit_code == 1
    is_one_line(refused, "servo_3 (id 3)")
    assert untouched(rig, before)


def test_ctrl_c_stops_the_hinge_lets_go_and_writes_nothing(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    before = rig.read_text()
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        found = registers(bus)
        start = bus.truth()[1].shaft_rad
        words = ("bus", "calibrate", rig, "--plan", wing.plan_file, "--port", bus.link)
        with Running(*words, "--stop", "closing", "--speed", 5, "--current", 0.3, "--yes", cwd=tmp_path) as running:
            deadline = time.monotonic() + 60.0
            while abs(bus.truth()[1].shaft_rad - start) < 0.05:
                assert time.monotonic() < deadline
                time.sleep(0.02)
            assert bus.register(1, "operating_mode") == 5
            assert bus.register(1, "goal_current") == round(0.3 / 2.69e-3)
            assert bus.register(1, "bus_watchdog") > 0
            status, _, err = running.interrupt()
        assert restored(bus, found)
    assert status == 130
    assert "nothing was written" in err
    assert untouched(rig, before)


def test_template_hinges_get_entries_of_their_own(wing: Wing, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    head = RIG.read_text().split("[[actuator]]")[0]
    head = re.sub(r'\[\[dynamixel.servo\]\]\nactuator = "servo_\d"\nid = \d\n\n', "", head)
    rig.write_text(
        head
        + "# one for all\n[each_cell]\ncrease = 'close_b'\ngear_ratio = 1.0\n[each_cell.actuator]\n"
        + "max_velocity_rad_s = 4.0\nmax_acceleration_rad_s2 = 20.0\nmax_torque_nm = 2.0\n"
        + "min_position_rad = -3.13\nmax_position_rad = 3.13\n"
    )
    resolved = resolve_rig(load_rig(rig), wing.plan.cell_ids, wing.plan.latch_points)
    with servos(replace(wing, rig=resolved), tmp_path, stops=False) as bus:
        bus.push(2, -0.25)
        done = calibrate(wing, rig, bus, "--hinge", "c2", "--hinge", "c3", "--pose", "stowed", "--yes")
    assert done.exit_code == 0, done.output
    assert "[each_cell]" in done.stdout
    after = resolve_rig(load_rig(rig), wing.plan.cell_ids, wing.plan.latch_points)
    assert after.wiring == resolved.wiring
    assert after.zero_rad == pytest.approx([0.0, -0.25, 0.0, 0.0], abs=COUNT_RAD)
    text = rig.read_text()
    assert text.count("[[hinge]]") == text.count("[[actuator]]") == 2
    assert "# one for all" in text


def test_servos_of_many_turns_get_the_turn_that_the_rig_means(wing: Wing, tmp_path: Path) -> None:
    """Nobody has vouched for their turns, so they say where they are but for whole ones."""
    rig = wrong_rig(tmp_path, 2.0 * np.pi + OFF_RAD)
    rig.write_text(rig.read_text().replace("max_position_rad = 3.13", "max_position_rad = 10.0"))
    with servos(wing, tmp_path, stops=False) as bus:
        done = calibrate(wing, rig, bus, "--pose", "stowed", "--yes")
    assert done.exit_code == 0, done.output
    zeros = [hinge.zero_rad for hinge in load_rig(rig).hinge]
    assert zeros == pytest.approx(wing.rig.zero_rad + 2.0 * np.pi, abs=COUNT_RAD)


def test_turns_that_a_walk_made_a_servo_forget_are_warned_of(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    rig.write_text(rig.read_text().replace("max_position_rad = 3.13", "max_position_rad = 10.0"))
    words = ("--hinge", "c4", "--stop", "closing", "--speed", 150, "--yes")
    with servos(wing, tmp_path, row=MIDDLE) as bus:
        bus.set_register(4, "operating_mode", OperatingMode.EXTENDED_POSITION)
        port = BlockingPort(str(bus.link), wing.rig.wiring.settings.baud if wing.rig.wiring else 0, slack_s=0.05)
        port.open()
        write(ServoLine(port), 4, mark_of(model_named("xm430")), MARK_ADDRESS)
        port.close()
        first, second = (calibrate(wing, rig, bus, *words) for _ in range(2))
    assert first.exit_code == second.exit_code == 0, first.output
    assert "warning: servo_4, of more than one turn, has forgotten its turns: say --stands" in first.stderr
    assert "warning" not in second.stderr


def test_bad_words_are_refused_before_the_port_is_opened(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    for words in ((), ("--pose", "stowed", "--stop", "closing"), ("--pose", "stowed", "--current", 1)):
        refused = command("bus", "calibrate", rig, "--plan", wing.plan_file, "--port", "/nowhere", *words)
        assert refused.exit_code == 2
        is_one_line(refused, "--")
    mock = command("bus", "calibrate", EXAMPLES / "rig_mock.toml", "--plan", wing.plan_file, "--pose", "stowed")
    assert mock.exit_code == 2


def test_json_is_one_document_and_progress_goes_to_the_error_stream(wing: Wing, tmp_path: Path) -> None:
    rig = wrong_rig(tmp_path)
    with servos(wing, tmp_path) as bus:
        done = calibrate(wing, rig, bus, "--pose", "stowed", "--yes", "--json", "--hinge", "c1")
    assert set(json.loads(done.stdout)) == {"rig", "backup", "new_entries", "hinges"}
    assert "found -3.00" in done.stderr
