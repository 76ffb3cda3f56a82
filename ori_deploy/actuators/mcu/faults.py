"""What the device says is wrong, as errors in words: latched faults, and commands that it refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from ori_deploy.actuators.bus import ActuatorFault, ActuatorRestarted, CommandRefused, WatchdogTripped
from ori_deploy.wire.mcu import Ack, State, dialect

WHOLE = "microcontroller"
"""Who reports what is no single hinge's or latch's."""

CLEAR = "then clear the fault and arm"

_FAULTS: Mapping[int, tuple[type[ActuatorFault], str]] = MappingProxyType(
    {
        dialect.ORI_FAULT_HOST_SILENT: (
            WatchdogTripped,
            "heard nothing for too long and stopped the hinges along their path; "
            f"remedy: check the cable and what else loads the computer, {CLEAR}",
        ),
        dialect.ORI_FAULT_UNDERRUN: (
            WatchdogTripped,
            "ran out of goals while moving and stopped the hinges along their path; "
            f"remedy: check what else loads the computer, {CLEAR}",
        ),
        dialect.ORI_FAULT_POSITION_LIMIT: (
            ActuatorFault,
            f"got a goal outside its range and stopped; remedy: check the rig's range, {CLEAR}",
        ),
        dialect.ORI_FAULT_VELOCITY_LIMIT: (
            ActuatorFault,
            "got a goal too far from the one before and stopped: too fast; "
            f"remedy: check max_velocity_rad_s, {CLEAR}",
        ),
        dialect.ORI_FAULT_ACCELERATION_LIMIT: (
            ActuatorFault,
            "got a goal too far from the one before and stopped: too much acceleration; "
            f"remedy: check max_acceleration_rad_s2, {CLEAR}",
        ),
        dialect.ORI_FAULT_DISCONTINUITY: (
            ActuatorFault,
            "got a motion that does not begin where the hinge was told to be, and stopped; "
            "remedy: clear the fault and arm",
        ),
        dialect.ORI_FAULT_KNOT_TIME: (
            ActuatorFault,
            "got goals out of order or too far apart in time, and stopped; "
            f"remedy: check what else loads the computer, {CLEAR}",
        ),
        dialect.ORI_FAULT_STALL: (
            ActuatorFault,
            f"did not follow, and its output went off; remedy: free what holds it, {CLEAR}",
        ),
        dialect.ORI_FAULT_SUPPLY_LOW: (
            ActuatorFault,
            f"saw the servos' supply below min_supply_v, and stopped; remedy: check supply and wires, {CLEAR}",
        ),
        dialect.ORI_FAULT_ESTOP: (
            ActuatorFault,
            f"its emergency stop is pressed, or its wire is broken; remedy: release it, {CLEAR}",
        ),
        dialect.ORI_FAULT_WATCHDOG_RESET: (
            ActuatorRestarted,
            f"hung and was restarted by its watchdog, every hinge is off; remedy: report it, {CLEAR}",
        ),
        dialect.ORI_FAULT_BROWN_OUT: (
            ActuatorRestarted,
            f"its own supply sagged and it restarted, every hinge is off; remedy: check its supply, {CLEAR}",
        ),
        dialect.ORI_FAULT_CONFIG_CORRUPT: (
            ActuatorFault,
            "both its stored configurations are damaged; remedy: write one with ori-deploy mcu config",
        ),
        dialect.ORI_FAULT_INTERNAL: (
            ActuatorFault,
            "found itself in a state that cannot be; remedy: switch it off and on, and report it",
        ),
        dialect.ORI_FAULT_HOST_BRAKE: (
            ActuatorFault,
            "was told to stop while moving; remedy: clear the fault and arm",
        ),
        dialect.ORI_FAULT_FEEDBACK_LOST: (
            ActuatorFault,
            f"no longer says where it is; remedy: check its feedback wire, {CLEAR}",
        ),
    }
)

_OF_HINGES = frozenset(
    {
        dialect.ORI_FAULT_POSITION_LIMIT,
        dialect.ORI_FAULT_VELOCITY_LIMIT,
        dialect.ORI_FAULT_ACCELERATION_LIMIT,
        dialect.ORI_FAULT_DISCONTINUITY,
        dialect.ORI_FAULT_STALL,
        dialect.ORI_FAULT_FEEDBACK_LOST,
    }
)


def enum_name(enum: str, value: int) -> str:
    """Name of a value without what all its siblings begin with, or the number."""
    entry = dialect.enums[enum].get(value)
    if entry is None:
        return f"number {value}"
    return entry.name.removeprefix("ORI_").removeprefix("FAULT_").removeprefix("REFUSED_").lower().replace("_", " ")


def fault_name(fault: int) -> str:
    """A fault's name, such as "host silent"."""
    return enum_name("ORI_FAULT", fault)


def state_name(state: int) -> str:
    """A state's name, such as "holding"."""
    return enum_name("ORI_STATE_OF", state)


def fault_error(state: State, hinges: Sequence[str]) -> ActuatorFault | None:
    """The latched fault as an error, or None."""
    if state.fault == dialect.ORI_FAULT_NONE:
        return None
    kind, words = _FAULTS.get(
        state.fault,
        (ActuatorFault, f"reports fault {state.fault}, which this program does not know; remedy: update it"),
    )
    who = WHOLE
    if state.fault in _OF_HINGES and state.fault_index < len(hinges):
        who = hinges[state.fault_index]
    return kind(who, words)


def refusal(ack: Ack, what: str, names: Sequence[str]) -> CommandRefused:
    """A refused command as an error.

    Parameters
    ----------
    ack
        The answer.
    what
        The command, and what did not happen.
    names
        Of the hinges or latches that its index counts.
    """
    who = names[ack.index] if ack.index < len(names) else f"number {ack.index}"
    words = {
        dialect.ORI_REFUSED_STATE: f"the microcontroller is {state_name(ack.value)}; "
        "remedy: wait until nothing moves, clear its fault, or write its configuration",
        dialect.ORI_REFUSED_FAULT: f"it has latched the fault {fault_name(ack.value)}; remedy: clear the fault",
        dialect.ORI_REFUSED_INDEX: "it has no such hinge, latch or record; "
        "remedy: write the rig's configuration with ori-deploy mcu config",
        dialect.ORI_REFUSED_POSITION: f"{who} is measured at {1e-6 * ack.value:.4g} rad; limit: seat_rad from there; "
        "remedy: hold the structure still",
        dialect.ORI_REFUSED_RANGE: f"a value of {who} is outside its range; "
        "remedy: check that the rig and the device's configuration agree, ori-deploy mcu config",
        dialect.ORI_REFUSED_TRIPPED: f"{who} protects itself; remedy: let it recover, or clear the fault",
        dialect.ORI_REFUSED_CAUSE: f"the cause of the fault {fault_name(ack.value)} persists; remedy: remove it",
        dialect.ORI_REFUSED_HASH: f"what it stored has hash {ack.value & 0xFFFFFFFF:08x}; remedy: write it again",
        dialect.ORI_REFUSED_SENSOR: f"{who} does not say where it is; remedy: check its feedback wire",
        dialect.ORI_REFUSED_HOT: f"latch {ack.index} is warm, and would be taken for cold; it is in "
        f"{1e-3 * ack.value:.0f} s; remedy: wait so long",
        dialect.ORI_REFUSED_SUPPLY: f"the servos' supply is {1e-3 * ack.value:.2f} V; limit: min_supply_v; "
        "remedy: switch it on",
    }
    return CommandRefused(f"{what}: {words.get(ack.result, f'refused with result {ack.result}')}")
