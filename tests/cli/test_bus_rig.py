"""Zeros go into the text of a rig: nothing else of it changes, however it is written."""

from __future__ import annotations

import resource
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig, parse_rig
from ori_deploy.bench.calibration import NotCalibrated
from ori_deploy.cli import bus_rig
from ori_deploy.cli.bus_rig import check_new, from_template, save_rig, with_zeros
from ori_deploy.errors import FileError
from ori_deploy.files import digest
from ori_deploy.motion import Plan

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_wing_dynamixel.toml"
CELLS = ("c1", "c2", "c3", "c4")
POINTS = ("slit:P-T2",)
TEMPLATE = """\
schema = "ori-deploy/rig/1"  # kept
backend = "dynamixel"
rate_hz = 100.0
[dynamixel]
port = "/dev/ttyUSB0"   # kept, too
baud = 1000000
magnets = "by_hinges"
[each_latch_point]
kind = "magnet"
[each_cell]
crease = "close_a"
gear_ratio = 2.0
max_crease_velocity_rad_s = 0.5
[each_cell.actuator]
max_velocity_rad_s = 4.0
max_acceleration_rad_s2 = 20.0
max_torque_nm = 2.0
min_position_rad = -3.0
max_position_rad = 3.0
"""


def fitted(text: str) -> ResolvedRig:
    return resolve_rig(parse_rig(tomllib.loads(text), "rig.toml"), CELLS, POINTS)


def zeros_of(text: str) -> list[float]:
    return [hinge.zero_rad for hinge in fitted(text).hinges]


@given(st.dictionaries(st.sampled_from(CELLS), st.floats(-3.0, 3.0)))
def test_only_lines_with_zeros_change_and_they_hold_the_new_ones(zeros: dict[str, float]) -> None:
    old = RIG.read_text()
    new = with_zeros(old, fitted(old), zeros)
    pairs = list(zip(old.splitlines(), new.splitlines(), strict=True))
    assert {line.split("=")[0] for line, other in pairs if line != other} <= {"zero_rad "}
    was = dict(zip(CELLS, zeros_of(old), strict=True))
    assert zeros_of(new) == pytest.approx([zeros.get(cell, was[cell]) for cell in CELLS], abs=1e-6)


def test_a_zero_that_was_left_out_comes_into_its_own_table_and_comments_stay() -> None:
    old = RIG.read_text().replace("zero_rad = 2.5\n", "").replace("zero_rad = -2.8", "zero_rad=-2.8   # by eye")
    new = with_zeros(old, fitted(old), {"c2": 2.25, "c3": -2.75})
    assert zeros_of(new) == [-3.0, 2.25, -2.75, 1.5]
    assert "zero_rad=-2.75   # by eye" in new
    lines = new.splitlines()
    at = lines.index("zero_rad = 2.25")
    assert lines[at - 1] == "max_crease_acceleration_rad_s2 = 1.2"
    assert [line for line in lines if line != "zero_rad = 2.25"] == old.replace("=-2.8 ", "=-2.75 ").splitlines()


def test_line_ends_of_another_system_stay() -> None:
    old = RIG.read_text().replace("\n", "\r\n")
    new = with_zeros(old, fitted(old), {"c1": 1.0})
    assert new == old.replace("zero_rad = -3.0", "zero_rad = 1.0")


def test_hinges_of_the_template_get_entries_and_the_others_stay_in_it() -> None:
    rig = fitted(TEMPLATE)
    assert from_template(TEMPLATE, rig) == CELLS
    new = with_zeros(TEMPLATE, rig, {"c2": 0.5, "c4": -0.5})
    assert new.startswith(TEMPLATE)
    assert zeros_of(new) == [0.0, 0.5, 0.0, -0.5]
    again = fitted(new)
    assert from_template(new, again) == ("c1", "c3")
    assert again.wiring == rig.wiring
    assert [replace(hinge, zero_rad=0.0) for hinge in again.hinges] == list(rig.hinges)
    assert with_zeros(new, again, {"c2": 0.5, "c4": -0.5}) == new


def test_entries_written_inline_stay_inline() -> None:
    hinge = '{ actuator = "a", cell = "c1", crease = "close_a", zero_rad = 0.25 }'
    limits = "max_velocity_rad_s = 4.0, max_acceleration_rad_s2 = 20.0, max_torque_nm = 2.0"
    actuator = f'{{ id = "a", {limits}, min_position_rad = -3.0, max_position_rad = 3.0 }}'
    old = f"# mine\nhinge = [ {hinge} ]\nactuator = [ {actuator} ]\n{TEMPLATE}"
    new = with_zeros(old, fitted(old), {"c1": 1.0, "c3": 2.0})
    assert zeros_of(new) == [1.0, 0.0, 2.0, 0.0]
    assert new.startswith("# mine\nhinge = [")
    assert "[[hinge]]" not in new
    assert new.endswith(TEMPLATE.split("rate_hz")[1])


def plan_of(angle: float) -> Plan:
    """A motion of every crease from 0 to an angle; all that is asked of a plan here."""
    import numpy as np

    angles = np.linspace(0.0, angle, 5)[:, None, None] * np.ones((1, len(CELLS), 4))
    return cast(Plan, SimpleNamespace(cell_ids=CELLS, latch_points=POINTS, crease_angles_rad=angles))


def test_a_new_rig_is_checked_against_the_plan() -> None:
    rig = fitted(TEMPLATE)
    check_new(with_zeros(TEMPLATE, rig, {"c1": -2.0}), rig, plan_of(1.0), {"c1": -2.0})
    text = with_zeros(TEMPLATE, rig, {"c1": 2.0})
    with pytest.raises(NotCalibrated, match=r"nothing was written.*servo_c1.*position range too small"):
        check_new(text, rig, plan_of(1.0), {"c1": 2.0})


@pytest.mark.parametrize(
    ("old", "new"), [("gear_ratio = 2.0", "gear_ratio = 1.0"), ("baud = 1000000", "baud = 57600")]
)
def test_a_text_that_says_anything_else_is_refused(old: str, new: str) -> None:
    rig = fitted(TEMPLATE)
    text = with_zeros(TEMPLATE, rig, {"c1": 0.1}).replace(old, new)
    with pytest.raises(NotCalibrated, match="nothing was written"):
        check_new(text, rig, plan_of(0.5), {"c1": 0.1})


def test_a_rig_that_changed_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(TEMPLATE)
    sha256 = load_rig(path).sha256
    path.write_text(TEMPLATE + "# changed\n")
    with pytest.raises(FileError, match="changed while"):
        save_rig(path, "new", sha256)
    assert path.read_text() == TEMPLATE + "# changed\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("wrong", [FileError("full"), KeyboardInterrupt()])
def test_a_failed_write_leaves_no_backup_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: BaseException
) -> None:
    def fail(*_: Any) -> None:
        raise wrong

    path = tmp_path / "rig.toml"
    path.write_text(TEMPLATE)
    monkeypatch.setattr(bus_rig, "write_atomically", fail)
    with pytest.raises(type(wrong)):
        save_rig(path, "new", digest(path))
    assert path.read_text() == TEMPLATE
    assert list(tmp_path.iterdir()) == [path]


@contextmanager
def nearly_full(n_bytes: int) -> Iterator[None]:
    """No file of this process gets longer than that."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_leaves_no_half_a_backup_behind(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(TEMPLATE)
    sha256 = digest(path)
    with nearly_full(len(TEMPLATE) // 2), pytest.raises(FileError, match=r"rig\.toml\.bak: .*cannot be kept"):
        save_rig(path, "new", sha256)
    assert path.read_text() == TEMPLATE
    assert list(tmp_path.iterdir()) == [path]


def test_the_old_file_is_kept_byte_for_byte(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(TEMPLATE.replace("\n", "\r\n").encode())
    old = path.read_bytes()
    kept = save_rig(path, "new\n", digest(path))
    assert kept.read_bytes() == old
    assert path.read_text() == "new\n"
