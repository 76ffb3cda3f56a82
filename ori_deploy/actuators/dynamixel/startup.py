"""From servos as they are found to servos as the rig wants them, before torque goes on.

Registers are written only where they differ (the EEPROM wears), only while torque is off where that is
needed, and read back. Nothing moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

from ori_deploy.actuators.bus import ActuatorFault, BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine, ServoRefused
from ori_deploy.actuators.dynamixel.settings import DynamixelSettings
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, HingeServo, PinServo, Wiring
from ori_deploy.wire.dynamixel import ControlTable, OperatingMode, Register, ServoModel
from ori_deploy.wire.dynamixel.models import RPM, WATCHDOG_FIRMWARE
from ori_deploy.wire.dynamixel.registers import ACCELERATION_UNIT_RPM2, VELOCITY_UNIT_RPM

Servo = TypeVar("Servo", bound=HingeServo | PinServo)

ATTEMPTS = 3
"""Times that a register is asked for or written before its servo counts as silent."""

MARK_ADDRESS = 65
"""What the last indirect pointer is set to once somebody has vouched for a servo's turns; a restart forgets it."""

NO_SECONDARY_ID = 255

KEPT_RETURN_LEVEL = 2
"""Status Return Level (68): answer everything."""

_RPM2 = RPM / 60.0
_ONE_TURN_MODES = (OperatingMode.POSITION,)


def health_registers(table: ControlTable) -> tuple[Register, ...]:
    """What the health block shows, in order: seven bytes.

    The first is `KEPT_RETURN_LEVEL` for as long as the block is set up: a servo that restarted shows 0.
    """
    return (
        table.status_return_level,
        table.torque_enable,
        table.hardware_error_status,
        table.bus_watchdog,
        table.present_input_voltage,
        table.present_temperature,
    )


def pin_registers(table: ControlTable) -> tuple[Register, ...]:
    """What a lock pin's block shows, in order: eight bytes, the first as in `health_registers`."""
    return (
        table.status_return_level,
        table.torque_enable,
        table.hardware_error_status,
        table.bus_watchdog,
        table.present_position,
    )


def by_block_address(servos: Sequence[HingeServo | PinServo]) -> dict[int, list[int]]:
    """Ids by where their indirect block begins: families and firmwares differ."""
    groups: dict[int, list[int]] = {}
    for servo in servos:
        groups.setdefault(servo.model.table.indirect.first_data, []).append(servo.id)
    return groups


def find_servos(line: ServoLine, wiring: Wiring) -> dict[int, Pong]:
    """Ping every servo of a rig, and check that it is what the rig says.

    Raises
    ------
    BusTimeout
        Some do not answer; the message names them all.
    CommandRefused
        A servo is of another model, or its firmware lacks what the rig asks for.
    """
    pongs = {servo.id: pong for servo in wiring.servos if (pong := _patient_ping(line, servo.id)) is not None}
    missing = [f"{name_of(servo)} (id {servo.id})" for servo in wiring.servos if servo.id not in pongs]
    if missing:
        raise BusTimeout(
            f"no answer from {', '.join(missing)} on {line.port.path} at {line.port.getBaudRate()} baud; "
            "remedy: check power, wiring, id and baud rate; ori-deploy bus scan shows who is there"
        )
    for servo in wiring.servos:
        _check_kind(servo, pongs[servo.id], wiring.settings)
    return pongs


def fast_read_known(pongs: Sequence[Pong]) -> bool:
    """Whether every servo's firmware answers a fast sync read."""
    return all(pong.model is not None and pong.firmware >= pong.model.fast_sync_read_firmware for pong in pongs)


def configure(line: ServoLine, servo: HingeServo | PinServo, settings: DynamixelSettings, travel_s: float) -> None:
    """Bring one servo to the rig's settings.

    Parameters
    ----------
    travel_s
        A lock pin's time from end to end.

    Raises
    ------
    CommandRefused
        Torque is on and a register that it locks differs; or a register does not keep what was written.
    """
    torque = read(line, servo.id, servo.model.table.torque_enable)
    _refuse_torque_at_startup(line, servo)
    clear_trip(line, servo)
    for register, value in _wanted(servo, settings, travel_s):
        found = read(line, servo.id, register)
        if found == value:
            continue
        if torque and register.eeprom:
            raise CommandRefused(
                f"{name_of(servo)} (id {servo.id}): torque is on and {register.name} is {found}, not {value}; "
                "remedy: ori-deploy bus torque-off, with the structure held by hand"
            )
        if register in (servo.model.table.operating_mode, servo.model.table.drive_mode):
            mark = mark_of(servo.model)  # a change of either may forget the turns that somebody vouched for
            write(line, servo.id, mark, mark.default)
        write(line, servo.id, register, value)
        kept = read(line, servo.id, register)
        if kept != value:
            raise CommandRefused(
                f"{name_of(servo)} (id {servo.id}): {register.name} reads {kept} after {value} was written; "
                "remedy: restart it (ori-deploy bus reset-error), or replace it"
            )


def unwell(servo: HingeServo, what: str) -> ActuatorFault:
    """An error of a servo's own, which only its restart clears."""
    return ActuatorFault(servo.name, f"{what}; remedy: remove its cause, then ori-deploy bus reset-error {servo.id}")


def clear_trip(line: ServoLine, servo: HingeServo | PinServo) -> None:
    """Turn a servo's watchdog off. One that had tripped stays where it is.

    It takes no goal before its watchdog is cleared, so the place where it stands becomes its goal at once.
    """
    table = servo.model.table
    tripped = read(line, servo.id, table.bus_watchdog) < 0
    if not tripped:
        write(line, servo.id, table.bus_watchdog, 0)
        return
    stands = read(line, servo.id, table.present_position)
    if servo.mode in _ONE_TURN_MODES:  # a shaft may stand a little beyond the limits of goals
        low, high = (read(line, servo.id, r) for r in (table.min_position_limit, table.max_position_limit))
        stands = min(max(stands, low), high)
    write(line, servo.id, table.bus_watchdog, 0)
    write(line, servo.id, table.goal_position, stands)


def _refuse_torque_at_startup(line: ServoLine, servo: HingeServo | PinServo) -> None:
    """A servo that holds a goal of its own as soon as it has power is nobody's to move."""
    try:
        found = read(line, servo.id, servo.model.table.startup_configuration)
    except ServoRefused:
        return  # firmware that does not have the register does not have the function
    if found:
        raise CommandRefused(
            f"{name_of(servo)} (id {servo.id}): startup_configuration is {found}: it may take torque or restore "
            "goals when it is switched on; limit: 0; remedy: write 0 to address 60 with DYNAMIXEL Wizard"
        )


def restarted(line: ServoLine, servos: Sequence[Servo]) -> tuple[Servo, ...]:
    """Servos whose settings in RAM are gone: they restarted since `configure`."""
    return tuple(
        servo
        for servo in servos
        if read(line, servo.id, servo.model.table.indirect.pointer(0))
        != servo.model.table.status_return_level.address
    )


def mark_of(model: ServoModel) -> Register:
    """The register that remembers, until a restart, that somebody vouched for the turns."""
    return model.table.indirect.pointer(model.table.indirect.count - 1)


def read(line: ServoLine, servo_id: int, register: Register) -> int:
    """Read a register, patiently. Raises as `ServoLine.read`."""
    for _ in range(ATTEMPTS - 1):
        try:
            return line.read(servo_id, register)
        except (BusTimeout, CorruptReply):
            continue
    return line.read(servo_id, register)


def write(line: ServoLine, servo_id: int, register: Register, value: int) -> None:
    """Write a register, patiently: writing a value twice does no harm. Raises as `ServoLine.write`."""
    for _ in range(ATTEMPTS - 1):
        try:
            return line.write(servo_id, register, value)
        except (BusTimeout, CorruptReply):
            continue
    return line.write(servo_id, register, value)


def name_of(servo: HingeServo | PinServo) -> str:
    """Actuator or latch."""
    return servo.name if isinstance(servo, HingeServo) else servo.latch


def velocity_units(rad_s: float) -> int:
    """A speed in the registers' unit, rounded up and at least 1: 0 would mean no limit."""
    return max(1, int(rad_s / (VELOCITY_UNIT_RPM * RPM) + 0.999))


def _patient_ping(line: ServoLine, servo_id: int) -> Pong | None:
    for _ in range(ATTEMPTS):
        found = line.ping_all((servo_id,))
        if found:
            return found[0]
    return None


def _check_kind(servo: HingeServo | PinServo, pong: Pong, settings: DynamixelSettings) -> None:
    name = f"{name_of(servo)} (id {servo.id})"
    if pong.model_number != servo.model.number:
        found = pong.model.name if pong.model else f"model number {pong.model_number}"
        raise CommandRefused(
            f"{name} is an {found}, not an {servo.model.name}; remedy: correct model in the rig, or the wiring"
        )
    if settings.watchdog_s and pong.firmware < WATCHDOG_FIRMWARE:
        raise CommandRefused(
            f"{name} has firmware {pong.firmware}, which has no bus watchdog; limit: {WATCHDOG_FIRMWARE} or newer; "
            "remedy: update it with DYNAMIXEL Wizard, or set watchdog_s = 0 and stay within reach of the switch"
        )


def _wanted(
    servo: HingeServo | PinServo, settings: DynamixelSettings, travel_s: float
) -> Iterator[tuple[Register, int]]:
    """Registers and what they have to hold, in an order in which they can be written."""
    table = servo.model.table
    yield table.status_return_level, KEPT_RETURN_LEVEL
    yield table.return_delay_time, 0
    yield table.drive_mode, 0  # not reversed, velocity-based profile, no torque by a goal
    yield table.secondary_id, NO_SECONDARY_ID
    yield table.operating_mode, servo.mode
    if isinstance(servo, HingeServo):
        if servo.mode in _ONE_TURN_MODES:
            yield table.min_position_limit, servo.min_count
            yield table.max_position_limit, servo.max_count
        yield from _profile(table, settings)
        if servo.mode is OperatingMode.CURRENT_BASED_POSITION and settings.current_limit_a is not None:
            yield from current_limit(servo.model, settings.current_limit_a)
    else:
        way = abs(servo.engaged_count - servo.released_count) * RAD_PER_COUNT
        yield table.profile_acceleration, 0
        yield table.profile_velocity, velocity_units(way / travel_s)
        if servo.mode is OperatingMode.CURRENT_BASED_POSITION:
            yield from current_limit(servo.model, PIN_CURRENT * servo.model.stall_current_a)
        else:
            low, high = sorted((servo.engaged_count, servo.released_count))
            yield table.min_position_limit, low
            yield table.max_position_limit, high
    shown = health_registers(table) if isinstance(servo, HingeServo) else pin_registers(table)
    addresses = (address for register in shown for address in range(register.address, register.end))
    for k, address in enumerate(addresses):
        yield table.indirect.pointer(k), address


PIN_CURRENT = 0.25
"""Part of the stall current that a lock pin's servo uses: it may have to push against a closed hole."""


def _profile(table: ControlTable, settings: DynamixelSettings) -> Iterator[tuple[Register, int]]:
    acceleration, velocity = settings.profile_acceleration_rad_s2, settings.profile_velocity_rad_s
    unit = ACCELERATION_UNIT_RPM2 * _RPM2
    yield table.profile_acceleration, 0 if acceleration is None else max(1, round(acceleration / unit))
    yield table.profile_velocity, 0 if velocity is None else velocity_units(velocity)


def current_limit(model: ServoModel, limit_a: float) -> Iterator[tuple[Register, int]]:
    """Registers that bound a servo's current, and their values; the goal, which is what counts, last."""
    table = model.table
    if table.current_limit is None or table.goal_current is None or model.current_unit_a is None:
        raise ValueError(f"an {model.name} has no current registers")  # the wiring refused such a mode
    units = min(max(1, round(limit_a / model.current_unit_a)), table.current_limit.maximum or 0)
    # The limit bounds the goal, so it goes first.
    yield table.current_limit, units
    yield table.goal_current, units
