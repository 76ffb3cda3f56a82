"""Control tables against the e-manual's pages, transcribed by hand, and against another client's own tables."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
import rustypot
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.wire.dynamixel import (
    BAUD_CODES,
    MODELS,
    MODELS_BY_NUMBER,
    ControlTable,
    OperatingMode,
    Register,
    ServoModel,
    model_named,
)
from ori_deploy.wire.dynamixel.models import RPM, X330_MORE_INDIRECT_FIRMWARE
from ori_deploy.wire.dynamixel.registers import COUNTS_PER_TURN

LATER_X330 = "XL330 from firmware 53"
"""Rows of the CSV that take the place of the older firmware's."""

NOT_OF_THE_ROW = {
    (12, "max"): 255,  # 253 to 255 mean that there is no secondary id, says the text; the default is one of them
    (98, "min"): 0,  # turns the watchdog off, says the text
}
"""(address, column) where the row alone says less than the text below it does, and what we have."""

BEFORE_FIRMWARE_45 = {"XL330-M077", "XM430-W350", "XH540-W270", "XH540-W150"}
"""Pages whose row of the drive mode lacks bit 3, which the text and the pages of their siblings have.

Bit 1 is the 540 family's alone, by the text.
"""

NOT_ON_THE_PAGE = {"XM430-W350": {60, 147}, "XH540-W150": {60, 147}}
"""Registers of firmware 45, by which those two pages are too old; on the pages of all siblings."""

NO_LOAD_RPM_AND_STALL = {
    "XL330-M077": (5.0, 0.215, 1.47, 383),
    "XL330-M288": (5.0, 0.52, 1.47, 103),
    "XL430-W250": (11.1, 1.4, 1.3, 57),
    "XC430-W150": (12.0, 1.6, 1.4, 106),
    "XC430-W240": (12.0, 1.9, 1.4, 70),
    "XM430-W350": (12.0, 4.1, 2.3, 46),
    "XM430-W210": (12.0, 3.0, 2.3, 77),
    "XH540-W270": (12.0, 9.9, 4.9, 39),
    "XH540-W150": (12.0, 7.1, 4.9, 70),
    "XH540-V270": (24.0, 9.2, 2.4, 34),
    "XH540-V150": (24.0, 6.4, 2.4, 60),
}
"""V, N m, A and rev/min of the sections "Specifications", at the recommended voltage."""

OTHER_CLIENT: dict[str, type[rustypot.Xl330PyController] | type[rustypot.Xl430PyController]] = {
    "XL330-M077": rustypot.Xl330PyController,
    "XL330-M288": rustypot.Xl330PyController,
    "XL430-W250": rustypot.Xl430PyController,
    "XC430-W150": rustypot.Xl430PyController,
    "XM430-W350": rustypot.Xl430PyController,
    "XH540-W150": rustypot.Xl430PyController,
}

every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


@dataclass(frozen=True)
class Row:
    """One of a page's table."""

    address: int
    size: int
    name: str
    access: str
    default: int | None
    min: int | None
    max: int | None


def rows(model: str) -> dict[int, Row]:
    """By address."""
    with (Path(__file__).parent / "emanual_tables.csv").open(encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if row.pop("model") == model]
    return {row.address: row for row in map(_row, found)}


def _row(texts: dict[str, str]) -> Row:
    number = {key: int(texts[key]) if texts[key] else None for key in ("default", "min", "max")}
    name = texts["name"].lower().replace("(shadow)", "").replace(" ", "_")
    return Row(int(texts["address"]), int(texts["size"]), name, texts["access"], **number)


def registers(table: ControlTable) -> dict[int, Register]:
    """All, pointers and the data that they show included, by address."""
    return {register.address: register for register in (*table, *_indirect(table))}


def _indirect(table: ControlTable) -> Iterator[Register]:
    for block in filter(None, (table.indirect, table.more_indirect)):
        for k in range(block.count):
            yield block.pointer(k)
            yield Register(f"indirect_data_{block.first + k}", block.first_data + k, 1, 0, 0, 255)


def same(model: ServoModel, row: Row, ours: Register) -> None:
    found = (ours.address, ours.size, ours.name, "RW" if ours.writable else "R")
    assert found == (row.address, row.size, row.name, row.access)
    for text, value in (("default", ours.default), ("min", ours.minimum), ("max", ours.maximum)):
        stated = getattr(row, text)
        if stated is None:
            continue
        assert ours.decode(ours.encode(stated)) == stated  # it has the width and the sign for that
        if text == "default" or ours.writable:
            assert value == NOT_OF_THE_ROW.get((row.address, text), stated), (model.name, ours.name, text)


@every_model
def test_the_table_is_the_manual_s(model: ServoModel) -> None:
    page, ours = rows(model.name), registers(model.table)
    if model.name in BEFORE_FIRMWARE_45:
        assert page[10].max == 5
        page[10] = Row(10, 1, "drive_mode", "RW", 0, 0, 15 if "540" in model.name else 13)
    for address, row in page.items():
        same(model, row, ours[address])
    not_there = {a for a, register in ours.items() if "indirect" not in register.name} - page.keys()
    assert not_there == NOT_ON_THE_PAGE.get(model.name, set())


@pytest.mark.parametrize("name", ["XL330-M077", "XL330-M288"])
def test_firmware_53_of_the_330_family_has_its_indirect_data_elsewhere(name: str) -> None:
    model = model_named(name)
    before, after = (model.at_firmware(X330_MORE_INDIRECT_FIRMWARE + k) for k in (-1, 0))
    assert before is model
    assert after.at_firmware(X330_MORE_INDIRECT_FIRMWARE) == after
    page = rows(LATER_X330)
    for address, row in page.items():
        same(after, row, registers(after.table)[address])
    assert max(page) == max(registers(after.table))
    assert max(rows(name)) == max(registers(before.table))
    assert list(before.table) == list(after.table)


def test_other_families_have_one_table_whatever_their_firmware() -> None:
    for model in MODELS:
        if "330" not in model.name:
            assert model.at_firmware(255) is model


@every_model
def test_specifications_are_the_manual_s(model: ServoModel) -> None:
    volts, torque, current, rpm = NO_LOAD_RPM_AND_STALL[model.name]
    assert (model.nominal_v, model.stall_torque_nm, model.stall_current_a) == (volts, torque, current)
    assert model.no_load_rad_s == pytest.approx(rpm * RPM)
    assert model.number == rows(model.name)[0].default
    # Units: "Current Limit(38)" of the pages of all models that have it.
    senses_current = 38 in rows(model.name)
    assert model.current_unit_a == (None if not senses_current else 1e-3 if "330" in model.name else 2.69e-3)
    # "Fast Sync Read" of the manual's Protocol 2.0: X430 and X540 from 45, X330 from 46.
    assert model.fast_sync_read_firmware == (46 if "330" in model.name else 45)


@pytest.mark.parametrize("firmware", [40, 99])
@every_model
def test_registers_do_not_overlap_and_the_blocks_that_are_read_together_are_one(
    model: ServoModel, firmware: int
) -> None:
    table = model.at_firmware(firmware).table
    everything = registers(table)
    assert len(everything) == len([*table, *_indirect(table)])
    assert len({register.name for register in everything.values()}) == len(everything)
    ordered = [everything[address] for address in sorted(everything)]
    assert all(one.end <= other.address for one, other in pairwise(ordered))
    assert (table.effort.address, table.effort.end) == (126, table.present_velocity.address)
    assert (table.present_velocity.end, table.present_position.end) == (table.present_position.address, 136)
    assert (table.present_input_voltage.address, table.present_input_voltage.end) == (144, 146)
    assert (table.present_temperature.address, table.present_temperature.end) == (146, 147)
    assert (model.current_unit_a is None) == (table.present_current is None) == (table.current_limit is None)
    assert (OperatingMode.CURRENT in model.modes) == (table.goal_current is not None)
    assert (OperatingMode.CURRENT_BASED_POSITION in model.modes) == (table.goal_current is not None)
    assert [BAUD_CODES[baud] for baud in model.bauds] == list(range((table.baud_rate.maximum or 0) + 1))


@pytest.mark.parametrize("name", OTHER_CLIENT)
def test_another_client_s_tables_agree(name: str) -> None:
    theirs, model = OTHER_CLIENT[name].definition(), model_named(name)
    assert theirs.models[name.replace("-", "")] == model.number
    assert theirs.resolution == COUNTS_PER_TURN
    assert theirs.baudrates.items() <= BAUD_CODES.items()
    assert {mode.lower(): value for mode, value in OperatingMode.__members__.items()} == theirs.operating_modes
    # That client knows the 330 family's newer indirect addresses alone.
    table = model.at_firmware(X330_MORE_INDIRECT_FIRMWARE).table
    ours = {register.name: register for register in table}
    for k in range(6):
        ours[f"indirect_address_{k + 1}"] = table.indirect.pointer(k)
        ours[f"indirect_data_{k + 1}"] = Register("indirect_data", table.indirect.first_data + k, 1, 0, 0, 255)
    # What only some models have, and loads by another name.
    lacking = {"present_load", "pwm_slope"} | {register for register in ours if "external_port" in register}
    shared = [register for register in ours if theirs.register(register) is not None]
    assert ours.keys() - set(shared) <= lacking
    for register in shared:
        other = theirs.register(register)
        assert other is not None
        assert (other.addr, other.size) == (ours[register].address, ours[register].size), register
        # Position limits are 0 to 4095, alike in both encodings.
        if "position_limit" not in register and other.encoding == "twos_complement":
            assert ours[register].signed, register


@given(data=st.data())
@every_model
def test_values_come_back_as_they_were_written(model: ServoModel, data: st.DataObject) -> None:
    register = data.draw(st.sampled_from(list(registers(model.table).values())))
    value = data.draw(st.integers(-(2**33), 2**33))
    bits = 8 * register.size - register.signed
    low = -(1 << bits) if register.signed else 0
    if low <= value < 1 << bits:
        written = register.encode(value)
        assert len(written) == register.size
        assert register.decode(written) == value
    else:
        with pytest.raises(OverflowError):
            register.encode(value)
    raw = data.draw(st.binary(min_size=register.size, max_size=register.size))
    assert register.encode(register.decode(raw)) == raw


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


def test_registers_are_found_by_name() -> None:
    table = model_named("xl430").table
    assert table.named("goal_position") is table.goal_position
    with pytest.raises(KeyError):
        table.named("goal_current")
