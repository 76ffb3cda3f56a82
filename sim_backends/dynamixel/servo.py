"""One servo's control table: what may be read and written when, and what that does to its motor.

Source: e-manual, control tables of the X series, and Protocol 2.0, table "Error".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import floor, inf, pi
from struct import pack_into

from ori_deploy.wire.dynamixel import BAUD_CODES, OperatingMode, Register, model_named
from ori_deploy.wire.dynamixel.models import RPM, WATCHDOG_FIRMWARE
from ori_deploy.wire.dynamixel.registers import (
    ACCELERATION_UNIT_RPM2,
    CENTRE_COUNT,
    COUNTS_PER_TURN,
    LOAD_UNIT,
    VELOCITY_UNIT_RPM,
    VOLTAGE_UNIT_V,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT_S,
    IndirectBlock,
)
from sim_backends.dynamixel.motors import OVERLOAD_AFTER_S, Motors
from sim_backends.dynamixel.spec import ServoSpec

RESULT_FAIL, INSTRUCTION, CRC, DATA_RANGE, DATA_LENGTH, DATA_LIMIT, ACCESS = range(1, 8)
ALERT = 0x80

INPUT_VOLTAGE, OVERHEATING, OVERLOAD = 0x01, 0x04, 0x20
"""Bits of Hardware Error Status (70) and Shutdown (63)."""

RAD_PER_COUNT = 2.0 * pi / COUNTS_PER_TURN
FARTHEST_COUNT = 1_048_575
"""Goals of extended position: 256 turns either way."""

BOOT_S = 0.25
_MULTI_TURN = (OperatingMode.EXTENDED_POSITION, OperatingMode.CURRENT_BASED_POSITION)
_FORGETTING = (OperatingMode.POSITION, OperatingMode.EXTENDED_POSITION)
"""Modes whose choice puts the position back into one turn."""

IN_POSITION, PROFILE_ONGOING, NOT_FOLLOWING, RECTANGLE, TRAPEZOID = 0x01, 0x02, 0x08, 0x10, 0x30
"""Bits of Moving Status (123)."""

IN_POSITION_RAD, NOT_FOLLOWING_RAD = 0.01, 0.1


class Refusal(Exception):
    """An instruction that a servo answers with an error.

    Attributes
    ----------
    code
        Of the protocol.
    """

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class Servo:
    """Control table and behaviour of one servo.

    Parameters
    ----------
    spec, baud
        As it is switched on, and the rate of the bus.
    motors, k
        Where its motor is simulated.

    Attributes
    ----------
    k
        Row of its motor.
    silent_until
        It restarts, and hears nothing before.
    """

    def __init__(self, spec: ServoSpec, baud: int, motors: Motors, k: int) -> None:
        self.spec = spec
        self.model = model_named(spec.model).at_firmware(spec.firmware)
        self.table = self.model.table
        self._motors, self.k = motors, k
        self._end = max(block.first_data + block.count for block in self._blocks())
        self._memory = bytearray(self._end)
        self._registers = [register for register in self.table if register.size]
        pointers = [block.pointer(i) for block in self._blocks() for i in range(block.count)]
        self._pointers = [replace(pointer, maximum=self._end - 1) for pointer in pointers]
        self._by_byte = {a: r for r in (*self._registers, *self._pointers) for a in range(r.address, r.end)}
        self._data = {a: Register("indirect_data", a, 1, 0, 0, 255) for a in self._data_addresses()}
        self._goal_addresses = frozenset(register.address for register in self._goals())
        self._turns = 0
        self._registered: tuple[int, bytes] | None = None
        self._heard_s = 0.0
        self.silent_until = -inf
        self.factory_reset(keep_id=False, keep_baud=False)
        self.put(self.table.id, spec.id)
        self.put(self.table.baud_rate, BAUD_CODES[spec.baud or baud])

    # -- registers -----------------------------------------------------------------------------------

    @property
    def id(self) -> int:
        """Id that it answers to."""
        return self.get(self.table.id)

    @property
    def baud_code(self) -> int:
        """Rate that it listens at, as its register has it."""
        return self.get(self.table.baud_rate)

    @property
    def mode(self) -> OperatingMode:
        """Operating mode."""
        return OperatingMode(self.get(self.table.operating_mode))

    @property
    def error_byte(self) -> int:
        """Alert bit of its status packets."""
        return ALERT if self.get(self.table.hardware_error_status) else 0

    @property
    def return_delay_s(self) -> float:
        """What it waits before it answers."""
        return 2e-6 * self.get(self.table.return_delay_time)

    def get(self, register: Register) -> int:
        """Value as it stands in memory."""
        at = register.address
        return int.from_bytes(self._memory[at : at + register.size], "little", signed=register.signed)

    def named(self, name: str) -> int:
        """Value by the register's name, up to date. Raises `KeyError` for a name that there is not."""
        self._measure_all()
        return self.get(self.table.named(name))

    def put(self, register: Register, value: int) -> None:
        """Set a value past all rules."""
        self._memory[register.address : register.end] = register.encode(value)

    def read(self, address: int, size: int) -> bytes:
        """Bytes as a host reads them; gaps between registers read as 0.

        Raises
        ------
        Refusal
            Beyond the end of the table.
        """
        if size == 0 or address + size > self._end:
            raise Refusal(ACCESS)
        if self.table.effort.address <= address and address + size <= self.table.velocity_trajectory.address:
            self._measure()  # what is read in every cycle has to be quick
            return bytes(self._memory[address : address + size])
        self._measure_all()
        return bytes(self._memory[self._target(a)] for a in range(address, address + size))

    def write(self, address: int, data: bytes) -> None:
        """Write as a host does: all of it or nothing.

        Raises
        ------
        Refusal
            With the protocol's error.
        """
        for register, value in self.check(address, data):
            self._apply(register, value)

    def check(self, address: int, data: bytes) -> list[tuple[Register, int]]:
        """What a write would change. Raises as `write`."""
        changes = self._changes(address, data)
        for register, value in changes:
            self._check(register, value)
        return changes

    def register_write(self, address: int, data: bytes) -> None:
        """Keep a write for a later `action`. Raises as `write`."""
        self.check(address, data)
        self._registered = (address, data)
        self.put(self.table.registered_instruction, 1)

    def action(self) -> None:
        """Do what was registered. Raises as `write`, and when nothing was."""
        if self._registered is None:
            raise Refusal(INSTRUCTION)
        address, data = self._registered
        self._registered = None
        self.put(self.table.registered_instruction, 0)
        self.write(address, data)

    def _changes(self, address: int, data: bytes) -> list[tuple[Register, int]]:
        """What is written to which register, indirect addresses followed; whole registers only."""
        if not data or address + len(data) > self._end:
            raise Refusal(ACCESS)
        whole = self._by_byte.get(address)
        if whole is not None and (whole.address, whole.size) == (address, len(data)):
            return [(whole, whole.decode(data))]
        written = {self._target(address + k): byte for k, byte in enumerate(data)}
        changes: dict[Register, int] = {}
        for at in written:
            register = self._by_byte.get(at) or self._data.get(at)
            if register is None:
                raise Refusal(ACCESS)
            span = range(register.address, register.end)
            if not all(a in written for a in span):
                raise Refusal(DATA_LENGTH)
            changes[register] = register.decode(bytes(written[a] for a in span))
        return list(changes.items())

    def _check(self, register: Register, value: int) -> None:
        if not register.writable:
            raise Refusal(ACCESS)
        if register.eeprom and self.get(self.table.torque_enable):
            raise Refusal(ACCESS)
        if register.minimum is not None and value < register.minimum:
            raise Refusal(DATA_RANGE)
        if register.maximum is not None and value > register.maximum:
            raise Refusal(DATA_RANGE)
        table = self.table
        if register is table.operating_mode and value not in self.model.modes:
            raise Refusal(DATA_RANGE)
        tripped = self.get(table.bus_watchdog) == WATCHDOG_TRIPPED
        if tripped and (register.address in self._goal_addresses or (register is table.bus_watchdog and value)):
            raise Refusal(DATA_RANGE)
        shut_down = self.get(table.hardware_error_status) & self.get(table.shutdown)
        if register is table.torque_enable and value and shut_down:
            raise Refusal(RESULT_FAIL)
        self._check_limits(register, value)

    def _check_limits(self, register: Register, value: int) -> None:
        table = self.table
        if register is table.goal_position:
            if self.get(table.operating_mode) in _MULTI_TURN:
                if abs(value) > FARTHEST_COUNT:
                    raise Refusal(DATA_RANGE)
            elif not self.get(table.min_position_limit) <= value <= self.get(table.max_position_limit):
                raise Refusal(DATA_LIMIT)
            return
        for goal, limit in (
            (table.goal_pwm, table.pwm_limit),
            (table.goal_current, table.current_limit),
            (table.goal_velocity, table.velocity_limit),
        ):
            if goal is not None and limit is not None and register is goal and abs(value) > self.get(limit):
                raise Refusal(DATA_LIMIT)

    def _apply(self, register: Register, value: int) -> None:
        table, motors, k = self.table, self._motors, self.k
        if register is table.torque_enable and value and not motors.torque_on[k]:
            self._take_hold()
        changes = value != self.get(register)
        self.put(register, value)
        if register is table.goal_position:
            motors.goal_rad[k] = self.rad_of(value)
            return
        if register is table.operating_mode:
            self._change_mode(forget=changes and self.mode in _FORGETTING)
        elif register is table.bus_watchdog:
            # The manual does not say what becomes of the old goal; the worst that can be: it counts again.
            self._motors.frozen[self.k] = False
        elif register is table.homing_offset:
            self.put(table.goal_position, self.count)
        self._drive()

    def _take_hold(self) -> None:
        """Torque goes on: from where it stands it will go to whatever goal there is."""
        self._motors.hold(self.k)
        if self.mode is OperatingMode.POSITION:
            self._forget_turns()
        if self.spec.goal_follows_on_torque:
            self.put(self.table.goal_position, self.count)

    def _change_mode(self, *, forget: bool) -> None:
        if forget:
            self._forget_turns()
        table = self.table
        gains = range(table.velocity_i_gain.address, table.feedforward_1st_gain.end)
        for register in table:
            if register.address in gains or register in (table.profile_velocity, table.profile_acceleration):
                self.put(register, register.default)
        self._reset_goals()

    def _reset_goals(self) -> None:
        table = self.table
        self.put(table.goal_position, self.count)
        self.put(table.goal_velocity, 0)
        self.put(table.goal_pwm, self.get(table.pwm_limit))
        if table.goal_current is not None and table.current_limit is not None:
            self.put(table.goal_current, self.get(table.current_limit))

    # -- motor ---------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Present position."""
        return self._count_of(float(self._motors.shaft_rad[self.k]))

    def _count_of(self, rad: float) -> int:
        raw = round(rad / RAD_PER_COUNT)
        return raw + CENTRE_COUNT - COUNTS_PER_TURN * self._turns + self.get(self.table.homing_offset)

    def rad_of(self, count: int) -> float:
        """Shaft angle that a position count means."""
        offset = self.get(self.table.homing_offset)
        return (count - offset - CENTRE_COUNT + COUNTS_PER_TURN * self._turns) * RAD_PER_COUNT

    def _drive(self) -> None:
        """Tell the motor what the registers say."""
        table, motors, k = self.table, self._motors, self.k
        motors.torque_on[k] = bool(self.get(table.torque_enable))
        motors.goal_rad[k] = self.rad_of(self.get(table.goal_position))
        velocity, acceleration = self.get(table.profile_velocity), self.get(table.profile_acceleration)
        motors.profile_rad_s[k] = velocity * VELOCITY_UNIT_RPM * RPM if velocity else inf
        motors.profile_rad_s2[k] = acceleration * ACCELERATION_UNIT_RPM2 * RPM / 60.0 if acceleration else inf
        motors.duty[k] = self._duty()
        motors.limit_nm[k] = motors.stall_nm[k] * min(motors.duty[k], self._current_part())

    def _current_part(self) -> float:
        """Part of the stall torque that the current limits leave."""
        table, part = self.table, 1.0
        if self.model.current_unit_a is not None and table.current_limit is not None:
            units = self.get(table.current_limit)
            if self.mode is OperatingMode.CURRENT_BASED_POSITION and table.goal_current is not None:
                units = min(units, abs(self.get(table.goal_current)))
            part = units * self.model.current_unit_a / self.model.stall_current_a
        return min(1.0, part)

    def _duty(self) -> float:
        """Part of the supply that the motor may have: less makes it weaker, and slower."""
        table = self.table
        pwm = self.get(table.pwm_limit)
        if self.mode not in (OperatingMode.CURRENT, OperatingMode.VELOCITY):
            pwm = min(pwm, abs(self.get(table.goal_pwm)))
        return min(1.0, pwm / (table.pwm_limit.maximum or 1))

    def _measure(self) -> None:
        """Bring effort, velocity and position up to date: 126 to 135."""
        motors, k = self._motors, self.k
        sense = -1 if motors.goal_rad[k] < motors.shaft_rad[k] else 1
        if self.model.current_unit_a is not None:
            effort = round(float(motors.current_a[k]) / self.model.current_unit_a)
        else:
            effort = round(float(motors.torque_nm[k] / motors.stall_nm[k]) / LOAD_UNIT)
        units = round(float(motors.velocity_rad_s[k]) / (VELOCITY_UNIT_RPM * RPM))
        seen = self.count + round(motors.noise(k))
        pack_into("<hii", self._memory, self.table.effort.address, sense * min(32767, effort), units, seen)

    def _measure_all(self) -> None:
        self._measure()
        self._measure_motion()
        self._measure_supply()

    def _under_way(self) -> bool:
        motors, k = self._motors, self.k
        return bool(motors.torque_on[k] and not motors.frozen[k] and motors.trajectory(k)[0] != motors.goal_rad[k])

    def _moves(self) -> bool:
        """What Moving (122) says: a profile goes on, or the shaft turns faster than the threshold."""
        units = abs(float(self._motors.velocity_rad_s[self.k])) / (VELOCITY_UNIT_RPM * RPM)
        return self._under_way() or units > self.get(self.table.moving_threshold)

    def _measure_motion(self) -> None:
        """Bring clock, motion, output and trajectory up to date: 120 to 125, and 136 to 143."""
        table, motors, k = self.table, self._motors, self.k
        way, speed = motors.trajectory(k)
        state = PROFILE_ONGOING if self._under_way() else 0
        if self.get(table.profile_velocity):
            state |= TRAPEZOID if self.get(table.profile_acceleration) else RECTANGLE
        if abs(motors.goal_rad[k] - motors.shaft_rad[k]) < IN_POSITION_RAD:
            state |= IN_POSITION
        if motors.torque_on[k] and abs(way - motors.shaft_rad[k]) > NOT_FOLLOWING_RAD:
            state |= NOT_FOLLOWING
        pwm = round((table.pwm_limit.maximum or 0) * float(motors.torque_nm[k] / motors.stall_nm[k]))
        tick = int(1e3 * motors.now) % 32768
        pack_into("<HBBh", self._memory, table.realtime_tick.address, tick, self._moves(), state, pwm)
        units = round(speed / (VELOCITY_UNIT_RPM * RPM))
        pack_into("<ii", self._memory, table.velocity_trajectory.address, units, self._count_of(way))

    def _measure_supply(self) -> None:
        """Bring voltage and temperature up to date: 144 to 146."""
        volts = round(float(self._motors.supply_v[self.k]) / VOLTAGE_UNIT_V)
        degrees = min(255, max(0, round(float(self._motors.temperature_c[self.k]))))
        pack_into("<HB", self._memory, self.table.present_input_voltage.address, volts, degrees)

    def watch_itself(self) -> None:
        """After the motors were stepped: what it finds wrong with itself, and what it does then."""
        table, motors, k = self.table, self._motors, self.k
        errors = self.get(table.hardware_error_status)
        volts = float(motors.supply_v[k]) / VOLTAGE_UNIT_V
        if not self.get(table.min_voltage_limit) <= round(volts) <= self.get(table.max_voltage_limit):
            errors |= INPUT_VOLTAGE
        if motors.temperature_c[k] > self.get(table.temperature_limit):
            errors |= OVERHEATING
        if motors.strained_s[k] > OVERLOAD_AFTER_S:
            errors |= OVERLOAD
        if errors != self.get(table.hardware_error_status):
            self.fail(errors)

    def fail(self, errors: int) -> None:
        """Report errors, and let go where the shutdown mask says so."""
        table = self.table
        self.put(table.hardware_error_status, errors)
        if errors & self.get(table.shutdown):
            self.put(table.torque_enable, 0)
            self._drive()

    # -- watchdog ------------------------------------------------------------------------------------

    def heard(self, now: float) -> None:
        """An instruction packet came."""
        self._heard_s = now

    def trip_time(self) -> float:
        """When its watchdog will trip if nothing comes; inf without torque, and when it is off or has tripped."""
        units = self.get(self.table.bus_watchdog)
        if units <= 0 or not self.get(self.table.torque_enable) or self.spec.firmware < WATCHDOG_FIRMWARE:
            return inf
        return self._heard_s + units * WATCHDOG_UNIT_S

    def trip(self) -> None:
        """Stop where it is."""
        self.put(self.table.bus_watchdog, WATCHDOG_TRIPPED)
        if self.spec.trip_clears_profile:
            self.put(self.table.profile_velocity, 0)
            self.put(self.table.profile_acceleration, 0)
            self._drive()
        self._motors.frozen[self.k] = True
        self._motors.hold(self.k)

    # -- restarts ------------------------------------------------------------------------------------

    def reboot(self, now: float) -> None:
        """Restart: RAM as new, torque off, turns forgotten, silent for a while."""
        for register in (*self._registers, *self._pointers, *self._data.values()):
            if not register.eeprom:
                self.put(register, register.default)
        self._restart()
        self.silent_until = now + BOOT_S

    def factory_reset(self, *, keep_id: bool, keep_baud: bool) -> None:
        """Everything as it left the factory."""
        kept = [(self.table.id, self.id)] if keep_id else []
        if keep_baud:
            kept.append((self.table.baud_rate, self.get(self.table.baud_rate)))
        for register in (*self._registers, *self._pointers, *self._data.values()):
            self.put(register, register.default)
        for register, value in kept:
            self.put(register, value)
        self.put(self.table.firmware_version, self.spec.firmware)
        self._restart()

    def clear_turns(self) -> None:
        """Count from the first turn again. Refused while it moves."""
        if self._moves():
            raise Refusal(RESULT_FAIL)
        self._forget_turns()
        self.put(self.table.goal_position, self.count)
        self._drive()

    def _restart(self) -> None:
        self._registered = None
        self._motors.frozen[self.k] = False
        self._motors.strained_s[self.k] = 0.0
        self._forget_turns()
        self._reset_goals()
        self._drive()

    def _forget_turns(self) -> None:
        raw = round(float(self._motors.shaft_rad[self.k]) / RAD_PER_COUNT) + CENTRE_COUNT
        self._turns = floor(raw / COUNTS_PER_TURN)

    # -- indirect addresses --------------------------------------------------------------------------

    def _blocks(self) -> tuple[IndirectBlock, ...]:
        more = self.table.more_indirect
        return (self.table.indirect,) if more is None else (self.table.indirect, more)

    def _data_addresses(self) -> Iterator[int]:
        return (block.first_data + k for block in self._blocks() for k in range(block.count))

    def _target(self, address: int) -> int:
        """Where a byte really is: indirect data shows what its pointer points at."""
        for block in self._blocks():
            k = address - block.first_data
            if 0 <= k < block.count:
                pointed = self.get(block.pointer(k))
                return pointed if pointed < self._end else address
        return address

    def _goals(self) -> tuple[Register, ...]:
        table = self.table
        goals = (table.goal_pwm, table.goal_current, table.goal_velocity, table.goal_position)
        return tuple(register for register in goals if register is not None)
