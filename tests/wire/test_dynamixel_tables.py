"""Control tables against the e-manual's pages, transcribed by hand, and against another client's own tables."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path

import pytest
import rustypot
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.wire.dynamixel import MODELS, MODELS_BY_NUMBER, OperatingMode, Register, ServoModel, model_named

TRANSCRIBED = ("XL330-M288", "XL430-W250", "XC430-W150", "XH540-W150")
"""Pages that the CSV holds; `*` stands for all four."""

OTHER_NAMES = {
    "current_limit": "torque_limit",
    "velocity_limit": "moving_speed",
    "present_load": "present_current",
}
"""What the other client may call otherwise, at the same place."""

NOT_DRIVEN = {
    "startup_configuration": {"XH540-W150"},  # in its later firmware only, as on the other pages
}


def rows() -> list[dict[str, str]]:
    with (Path(__file__).parent / "emanual_tables.csv").open() as file:
        return list(csv.DictReader(file))


def of(model: str) -> list[dict[str, str]]:
    return [row for row in rows() if row["models"] == "*" or model in row["models"].split()]


def registers(model: ServoModel) -> dict[str, Register]:
    """All of them, the first and last pointer of every indirect block included."""
    table = model.table
    found = {register.name: register for register in table}
    offset = 0
    for block in filter(None, (table.indirect, table.more_indirect)):
        for k in (0, block.count - 1):
            found[f"indirect_address_{offset + k + 1}"] = block.pointer(k)
        offset += block.count
    return found


@pytest.mark.parametrize("name", TRANSCRIBED)
def test_tables_are_those_of_the_manual(name: str) -> None:
    ours = registers(model_named(name))
    for row in of(name):
        register = ours.pop(row["name"])
        found = (register.address, register.size, "RW" if register.writable else "R")
        assert found == (int(row["address"]), int(row["size"]), row["access"]), row["name"]
        for key, value in (("default", register.default), ("min", register.minimum), ("max", register.maximum)):
            if row[key]:
                assert value == int(row[key]), (row["name"], key)
    left = {register for register in ours if name not in NOT_DRIVEN.get(register, set())}
    assert not left


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_registers_do_not_overlap_and_the_blocks_that_are_read_together_are_one(model: ServoModel) -> None:
    table = model.table
    ordered = list(table)
    assert all(one.end <= other.address for one, other in pairwise(ordered))
    assert (table.effort.address, table.effort.end) == (126, 128) == (126, table.present_velocity.address)
    assert (table.present_velocity.end, table.present_position.end) == (132, 136)
    assert (table.present_input_voltage.address, table.present_temperature.end) == (144, 147)
    assert (model.current_unit_a is None) == (table.present_current is None) == (table.current_limit is None)
    assert (OperatingMode.CURRENT_BASED_POSITION in model.modes) == (table.goal_current is not None)
    assert len(model.bauds) == (table.baud_rate.maximum or 0) + 1


@pytest.mark.parametrize(
    ("name", "controller"), [("XL330-M288", rustypot.Xl330PyController), ("XL430-W250", rustypot.Xl430PyController)]
)
def test_another_client_s_tables_agree(name: str, controller: type[rustypot.Xl330PyController]) -> None:
    theirs = {register.addr: register for register in controller.registers()}
    model = model_named(name)
    shared = [register for register in model.table if register.address in theirs]
    assert len(shared) > 30
    for register in shared:
        other = theirs[register.address]
        assert other.size == register.size
        assert other.name in (register.name, OTHER_NAMES.get(register.name))
    assert model.number in controller.models().values()
    for short, number in controller.models().items():
        known = MODELS_BY_NUMBER.get(number)
        assert known is None or known.name.replace("-", "") == short


@given(value=st.integers(-(2**31), 2**31 - 1))
def test_values_come_back_as_they_were_written(value: int) -> None:
    for register in model_named("xm430").table:
        bits = 8 * register.size - register.signed
        low = -(1 << bits) if register.signed else 0
        if low <= value < 1 << bits:
            data = register.encode(value)
            assert len(data) == register.size
            assert register.decode(data) == value
        else:
            with pytest.raises(OverflowError):
                register.encode(value)


def test_bytes_of_another_number_are_no_value() -> None:
    position = model_named("xm430").table.present_position
    for size in (0, 3, 5):
        with pytest.raises(ValueError, match="present_position has 4 bytes"):
            position.decode(bytes(size))


def test_models_are_found_by_name_in_any_case_by_family_and_by_number() -> None:
    assert model_named("xm430-w210").name == "XM430-W210"
    assert model_named("XH540").key == "xh540"
    assert MODELS_BY_NUMBER[1060] is model_named("XL430")
    assert len(MODELS_BY_NUMBER) == len(MODELS)
    with pytest.raises(KeyError):
        model_named("MX-28")
