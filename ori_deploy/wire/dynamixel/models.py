"""X-series models: control tables, and what each can do at its nominal voltage.

Source: ROBOTIS e-manual, sections "Specifications" and "Control Table" of each model, and "Protocol 2.0" for
what each firmware answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi
from types import MappingProxyType

from ori_deploy.wire.dynamixel.registers import (
    BAUD_CODES,
    ControlTable,
    IndirectBlock,
    OperatingMode,
    Register,
)

RPM = 2.0 * pi / 60.0

WATCHDOG_FIRMWARE = 38
"""First firmware of the X series with a bus watchdog."""

FAST_SYNC_READ_FIRMWARE = 45
"""First firmware of the 430 and 540 families that answers fast sync read; `ServoModel` has each model's own."""

X330_FAST_SYNC_READ_FIRMWARE = 46
X330_MORE_INDIRECT_FIRMWARE = 53
"""First firmware of the 330 family with 28 indirect addresses; the 20 before it show their data elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoModel:
    """One model.

    Attributes
    ----------
    name, number
        As printed on it, and as it answers to a ping.
    table
        Its registers. `at_firmware` has those of a firmware that keeps some elsewhere.
    modes
        Operating modes that it has.
    bauds
        Rates it can be set to.
    current_unit_a
        Of the current registers; None where it measures load instead.
    nominal_v
        At which the following hold.
    stall_torque_nm, stall_current_a, no_load_rad_s
        As the data sheet states them.
    fast_sync_read_firmware
        First that answers fast sync read.
    later
        First firmware with another table, and that table; None where there is none.
    """

    name: str
    number: int
    table: ControlTable
    modes: frozenset[OperatingMode]
    bauds: tuple[int, ...]
    current_unit_a: float | None
    nominal_v: float
    stall_torque_nm: float
    stall_current_a: float
    no_load_rad_s: float
    fast_sync_read_firmware: int = FAST_SYNC_READ_FIRMWARE
    later: tuple[int, ControlTable] | None = None

    def at_firmware(self, firmware: int) -> ServoModel:
        """The same model with the table that this firmware has. For a model of `MODELS`."""
        if self.later is None or firmware < self.later[0]:
            return self
        return replace(self, table=self.later[1])

    @property
    def key(self) -> str:
        """Name in lower case without the suffix, as in "xm430"."""
        return self.name.split("-")[0].lower()


def _read_only(name: str, address: int, size: int, *, default: int = 0, signed: bool = False) -> Register:
    return Register(name, address, size, default, signed=signed, writable=False)


def _table(
    number: int,
    *,
    current_limit: tuple[int, int] | None,
    velocity_limit: tuple[int, int],
    temperature_limit: int,
    voltage_limits: tuple[int, int, int, int],
    shutdown: int,
    velocity_gains: tuple[int, int],
    position_gains: tuple[int, int, int],
    drive_mode_max: int,
    moving_threshold: int = 10,
    external_ports: bool = False,
    x330: bool = False,
) -> ControlTable:
    """A table; pairs are (default, maximum), voltages (smallest, largest, default low, default high)."""
    current = current_limit is not None
    v_low, v_high, v_default_low, v_default_high = voltage_limits
    i_velocity, p_velocity = velocity_gains
    d_position, i_position, p_position = position_gains
    max_baud, protocols = (6, (2, 22)) if x330 else (7, (1, 2))
    return ControlTable(
        model_number=_read_only("model_number", 0, 2, default=number),
        model_information=_read_only("model_information", 2, 4),
        firmware_version=_read_only("firmware_version", 6, 1),
        id=Register("id", 7, 1, 1, 0, 252),
        baud_rate=Register("baud_rate", 8, 1, 1, 0, max_baud),
        return_delay_time=Register("return_delay_time", 9, 1, 250, 0, 254),
        drive_mode=Register("drive_mode", 10, 1, 0, 0, drive_mode_max),
        operating_mode=Register("operating_mode", 11, 1, 3, 0, 16),
        secondary_id=Register("secondary_id", 12, 1, 255, 0, 255),
        protocol_type=Register("protocol_type", 13, 1, 2, *protocols),
        homing_offset=Register("homing_offset", 20, 4, 0, -1_044_479, 1_044_479, signed=True),
        moving_threshold=Register("moving_threshold", 24, 4, moving_threshold, 0, 1023),
        temperature_limit=Register("temperature_limit", 31, 1, temperature_limit, 0, 100),
        max_voltage_limit=Register("max_voltage_limit", 32, 2, v_default_high, v_low, v_high),
        min_voltage_limit=Register("min_voltage_limit", 34, 2, v_default_low, v_low, v_high),
        pwm_limit=Register("pwm_limit", 36, 2, 885, 0, 885),
        current_limit=Register("current_limit", 38, 2, current_limit[0], 0, current_limit[1])
        if current_limit
        else None,
        velocity_limit=Register("velocity_limit", 44, 4, velocity_limit[0], 0, velocity_limit[1]),
        max_position_limit=Register("max_position_limit", 48, 4, 4095, 0, 4095),
        min_position_limit=Register("min_position_limit", 52, 4, 0, 0, 4095),
        external_port_mode_1=Register("external_port_mode_1", 56, 1, 3, 0, 3) if external_ports else None,
        external_port_mode_2=Register("external_port_mode_2", 57, 1, 3, 0, 3) if external_ports else None,
        external_port_mode_3=Register("external_port_mode_3", 58, 1, 3, 0, 3) if external_ports else None,
        startup_configuration=Register("startup_configuration", 60, 1, 0, 0, 3),
        pwm_slope=Register("pwm_slope", 62, 1, 140, 1, 255) if x330 else None,
        shutdown=Register("shutdown", 63, 1, shutdown, 0, 255),
        torque_enable=Register("torque_enable", 64, 1, 0, 0, 1),
        led=Register("led", 65, 1, 0, 0, 1),
        status_return_level=Register("status_return_level", 68, 1, 2, 0, 2),
        registered_instruction=_read_only("registered_instruction", 69, 1),
        hardware_error_status=_read_only("hardware_error_status", 70, 1),
        velocity_i_gain=Register("velocity_i_gain", 76, 2, i_velocity, 0, 16383),
        velocity_p_gain=Register("velocity_p_gain", 78, 2, p_velocity, 0, 16383),
        position_d_gain=Register("position_d_gain", 80, 2, d_position, 0, 16383),
        position_i_gain=Register("position_i_gain", 82, 2, i_position, 0, 16383),
        position_p_gain=Register("position_p_gain", 84, 2, p_position, 0, 16383),
        feedforward_2nd_gain=Register("feedforward_2nd_gain", 88, 2, 0, 0, 16383),
        feedforward_1st_gain=Register("feedforward_1st_gain", 90, 2, 0, 0, 16383),
        bus_watchdog=Register("bus_watchdog", 98, 1, 0, 0, 127, signed=True),
        goal_pwm=Register("goal_pwm", 100, 2, signed=True),
        goal_current=Register("goal_current", 102, 2, signed=True) if current else None,
        goal_velocity=Register("goal_velocity", 104, 4, signed=True),
        profile_acceleration=Register("profile_acceleration", 108, 4, 0, 0, 32767),
        profile_velocity=Register("profile_velocity", 112, 4, 0, 0, 32767),
        goal_position=Register("goal_position", 116, 4, signed=True),
        realtime_tick=_read_only("realtime_tick", 120, 2),
        moving=_read_only("moving", 122, 1),
        moving_status=_read_only("moving_status", 123, 1),
        present_pwm=_read_only("present_pwm", 124, 2, signed=True),
        present_current=_read_only("present_current", 126, 2, signed=True) if current else None,
        present_load=None if current else _read_only("present_load", 126, 2, signed=True),
        present_velocity=_read_only("present_velocity", 128, 4, signed=True),
        present_position=_read_only("present_position", 132, 4, signed=True),
        velocity_trajectory=_read_only("velocity_trajectory", 136, 4, signed=True),
        position_trajectory=_read_only("position_trajectory", 140, 4, signed=True),
        present_input_voltage=_read_only("present_input_voltage", 144, 2),
        present_temperature=_read_only("present_temperature", 146, 1),
        backup_ready=_read_only("backup_ready", 147, 1),
        external_port_data_1=Register("external_port_data_1", 152, 2) if external_ports else None,
        external_port_data_2=Register("external_port_data_2", 154, 2) if external_ports else None,
        external_port_data_3=Register("external_port_data_3", 156, 2) if external_ports else None,
        indirect=_INDIRECT_X330 if x330 else _INDIRECT,
        more_indirect=None if x330 else _MORE_INDIRECT,
    )


_INDIRECT = IndirectBlock(168, 224, 28, 661)
_MORE_INDIRECT = IndirectBlock(578, 634, 28, 661, first=29)
_INDIRECT_X330 = IndirectBlock(168, 208, 20, 227)
_LATER_INDIRECT_X330 = IndirectBlock(168, 224, 28, 251)

_ALL_MODES = frozenset(OperatingMode)
_NO_CURRENT = _ALL_MODES - {OperatingMode.CURRENT, OperatingMode.CURRENT_BASED_POSITION}
_BAUDS = tuple(BAUD_CODES)
_BAUDS_XL330 = _BAUDS[:-1]


def _xl330(
    name: str,
    number: int,
    velocity: int,
    velocity_gains: tuple[int, int],
    position_gains: tuple[int, int, int],
    torque: float,
    current: float,
    rpm: float,
) -> ServoModel:
    table = _table(
        number,
        current_limit=(1750, 1750),
        velocity_limit=(velocity, 2047),
        temperature_limit=70,
        voltage_limits=(31, 70, 35, 70),
        shutdown=53,
        velocity_gains=velocity_gains,
        position_gains=position_gains,
        drive_mode_max=13,
        x330=True,
    )
    return ServoModel(
        name=name,
        number=number,
        table=table,
        modes=_ALL_MODES,
        bauds=_BAUDS_XL330,
        current_unit_a=1e-3,
        nominal_v=5.0,
        stall_torque_nm=torque,
        stall_current_a=current,
        no_load_rad_s=rpm * RPM,
        fast_sync_read_firmware=X330_FAST_SYNC_READ_FIRMWARE,
        later=(X330_MORE_INDIRECT_FIRMWARE, replace(table, indirect=_LATER_INDIRECT_X330)),
    )


def _x430_without_current(
    name: str,
    number: int,
    velocity: int,
    temperature: int,
    voltages: tuple[int, int, int, int],
    nominal_v: float,
    velocity_gains: tuple[int, int],
    position_gains: tuple[int, int, int],
    torque: float,
    current: float,
    rpm: float,
    *,
    moving_threshold: int = 10,
) -> ServoModel:
    table = _table(
        number,
        current_limit=None,
        velocity_limit=(velocity, 1023),
        temperature_limit=temperature,
        voltage_limits=voltages,
        shutdown=52,
        velocity_gains=velocity_gains,
        position_gains=position_gains,
        drive_mode_max=13,
        moving_threshold=moving_threshold,
    )
    return ServoModel(
        name=name,
        number=number,
        table=table,
        modes=_NO_CURRENT,
        bauds=_BAUDS,
        current_unit_a=None,
        nominal_v=nominal_v,
        stall_torque_nm=torque,
        stall_current_a=current,
        no_load_rad_s=rpm * RPM,
    )


def _with_current(
    name: str,
    number: int,
    current_limit: int,
    velocity: int,
    voltages: tuple[int, int, int, int],
    nominal_v: float,
    torque: float,
    current: float,
    rpm: float,
    *,
    x540: bool = False,
) -> ServoModel:
    table = _table(
        number,
        current_limit=(current_limit, current_limit),
        velocity_limit=(velocity, 1023),
        temperature_limit=80,
        voltage_limits=voltages,
        shutdown=52,
        velocity_gains=(1920, 100),
        position_gains=(0, 0, 800),
        drive_mode_max=15 if x540 else 13,  # bit 1, follower of another servo, needs the 540's sync cable
        external_ports=x540,
    )
    return ServoModel(
        name=name,
        number=number,
        table=table,
        modes=_ALL_MODES,
        bauds=_BAUDS,
        current_unit_a=2.69e-3,
        nominal_v=nominal_v,
        stall_torque_nm=torque,
        stall_current_a=current,
        no_load_rad_s=rpm * RPM,
    )


_V12 = ((95, 160, 95, 160), 12.0)
_V24 = ((110, 300, 110, 300), 24.0)
_XL430 = ((60, 140, 60, 140), 11.1, (1000, 100), (4000, 0, 640))  # voltages, velocity and position gains
_XC430 = ((60, 160, 60, 160), 12.0, (1920, 100))

MODELS: tuple[ServoModel, ...] = (
    _xl330("XL330-M077", 1190, 1620, (400, 40), (0, 400, 400), 0.215, 1.47, 383.0),
    _xl330("XL330-M288", 1200, 445, (1600, 180), (0, 0, 400), 0.52, 1.47, 103.0),
    _x430_without_current("XL430-W250", 1060, 265, 72, *_XL430, 1.4, 1.3, 57.0),
    _x430_without_current("XC430-W150", 1070, 460, 80, *_XC430, (0, 0, 460), 1.6, 1.4, 106.0, moving_threshold=20),
    _x430_without_current("XC430-W240", 1080, 306, 80, *_XC430, (0, 0, 700), 1.9, 1.4, 70.0),
    _with_current("XM430-W350", 1020, 1193, 200, *_V12, 4.1, 2.3, 46.0),
    _with_current("XM430-W210", 1030, 1193, 330, *_V12, 3.0, 2.3, 77.0),
    _with_current("XH540-W270", 1100, 2047, 167, *_V12, 9.9, 4.9, 39.0, x540=True),
    _with_current("XH540-W150", 1110, 2047, 300, *_V12, 7.1, 4.9, 70.0, x540=True),
    _with_current("XH540-V270", 1140, 1188, 128, *_V24, 9.2, 2.4, 34.0, x540=True),
    _with_current("XH540-V150", 1150, 1188, 230, *_V24, 6.4, 2.4, 60.0, x540=True),
)
"""Every model that this package drives."""

MODELS_BY_NUMBER: Mapping[int, ServoModel] = MappingProxyType({model.number: model for model in MODELS})


def model_named(name: str) -> ServoModel:
    """A model by its name in any case; a family such as "xm430" means its first model.

    Raises
    ------
    KeyError
        There is none.
    """
    wanted = name.lower()
    for model in MODELS:
        if model.name.lower() == wanted:
            return model
    for model in MODELS:
        if model.key == wanted:
            return model
    raise KeyError(name)
