"""The control table of the X series: where everything is, how wide, and what it may hold.

Source: ROBOTIS e-manual, section "Control Table" of each model. A model that lacks a register has None in
its place; one that keeps it elsewhere has a table of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from types import MappingProxyType

EEPROM_END = 64
"""Registers below keep their value without power, and can be written only while torque is off."""

COUNTS_PER_TURN = 4096
CENTRE_COUNT = 2048
"""Position count that is 0 rad here: the middle of the first turn."""

VELOCITY_UNIT_RPM = 0.229
ACCELERATION_UNIT_RPM2 = 214.577
WATCHDOG_UNIT_S = 0.02
WATCHDOG_TRIPPED = -1
RETURN_DELAY_UNIT_S = 2e-6
VOLTAGE_UNIT_V = 0.1
LOAD_UNIT = 1e-3
"""Present Load: thousandths of the stall torque."""

BAUD_CODES: Mapping[int, int] = MappingProxyType(
    {9_600: 0, 57_600: 1, 115_200: 2, 1_000_000: 3, 2_000_000: 4, 3_000_000: 5, 4_000_000: 6, 4_500_000: 7}
)
"""Baud rates and the values of the register that stand for them."""


class OperatingMode(IntEnum):
    """What the goal registers mean."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a control table.

    Attributes
    ----------
    name
        As the e-manual has it, in lower case with underscores.
    address, size
        First byte, and 1, 2 or 4 bytes, little-endian.
    default
        After a factory reset (EEPROM) or a restart (RAM); 0 where the manual leaves it open.
    minimum, maximum
        Of what may be written; None where the register is read-only, or another register bounds it.
    signed
        Two's complement.
    writable
        Whether it can be written at all.
    """

    name: str
    address: int
    size: int
    default: int = 0
    minimum: int | None = None
    maximum: int | None = None
    signed: bool = False
    writable: bool = True

    @property
    def end(self) -> int:
        """First address after it."""
        return self.address + self.size

    @property
    def eeprom(self) -> bool:
        """Whether it keeps its value without power."""
        return self.address < EEPROM_END

    def encode(self, value: int) -> bytes:
        """Little-endian bytes. Raises `OverflowError` when the value does not fit."""
        return value.to_bytes(self.size, "little", signed=self.signed)

    def decode(self, data: bytes) -> int:
        """Value of exactly `size` bytes. Raises `ValueError` for any other number of them."""
        if len(data) != self.size:
            raise ValueError(f"{self.name} has {self.size} bytes, not {len(data)}")
        return int.from_bytes(data, "little", signed=self.signed)


@dataclass(frozen=True, slots=True)
class IndirectBlock:
    """Registers that can be pointed anywhere, so that scattered registers are read as one block.

    Attributes
    ----------
    first_address, first_data, count
        Of the pointers, of the bytes that they show, and how many there are.
    last
        Farthest address that they can point at.
    first
        Number that the manual gives the first of them; numbers run on from block to block.
    """

    first_address: int
    first_data: int
    count: int
    last: int
    first: int = 1

    def pointer(self, k: int) -> Register:
        """Register that holds the address which byte k of the block shows."""
        name, address = f"indirect_address_{self.first + k}", self.first_address + 2 * k
        return Register(name, address, 2, self.first_data + k, EEPROM_END, self.last)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlTable:
    """Registers of one family of models. What a family lacks is None.

    `startup_configuration` and `backup_ready` are there from firmware 45 on, 46 in the 330 family; before, a servo
    refuses to read them.
    """

    model_number: Register
    model_information: Register
    firmware_version: Register
    id: Register
    baud_rate: Register
    return_delay_time: Register
    drive_mode: Register
    operating_mode: Register
    secondary_id: Register
    protocol_type: Register
    homing_offset: Register
    moving_threshold: Register
    temperature_limit: Register
    max_voltage_limit: Register
    min_voltage_limit: Register
    pwm_limit: Register
    current_limit: Register | None
    velocity_limit: Register
    max_position_limit: Register
    min_position_limit: Register
    external_port_mode_1: Register | None
    external_port_mode_2: Register | None
    external_port_mode_3: Register | None
    startup_configuration: Register
    pwm_slope: Register | None
    shutdown: Register
    torque_enable: Register
    led: Register
    status_return_level: Register
    registered_instruction: Register
    hardware_error_status: Register
    velocity_i_gain: Register
    velocity_p_gain: Register
    position_d_gain: Register
    position_i_gain: Register
    position_p_gain: Register
    feedforward_2nd_gain: Register
    feedforward_1st_gain: Register
    bus_watchdog: Register
    goal_pwm: Register
    goal_current: Register | None
    goal_velocity: Register
    profile_acceleration: Register
    profile_velocity: Register
    goal_position: Register
    realtime_tick: Register
    moving: Register
    moving_status: Register
    present_pwm: Register
    present_current: Register | None
    present_load: Register | None
    present_velocity: Register
    present_position: Register
    velocity_trajectory: Register
    position_trajectory: Register
    present_input_voltage: Register
    present_temperature: Register
    backup_ready: Register
    external_port_data_1: Register | None
    external_port_data_2: Register | None
    external_port_data_3: Register | None
    indirect: IndirectBlock
    more_indirect: IndirectBlock | None

    def __iter__(self) -> Iterator[Register]:
        """Every register there is, indirect pointers left out, by address."""
        return iter(sorted(self._present(), key=lambda register: register.address))

    def _present(self) -> Iterator[Register]:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Register):
                yield value

    def named(self, name: str) -> Register:
        """Register by name. Raises `KeyError` when the family has none of that name."""
        for register in self:
            if register.name == name:
                return register
        raise KeyError(name)

    @property
    def effort(self) -> Register:
        """Present current, or present load where there is no current sensor; both at address 126."""
        register = self.present_current or self.present_load
        if register is None:
            raise ValueError("a control table has present_current or present_load")
        return register
