"""What the device says is wrong, as errors in words: latched faults, and commands that it refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ori_deploy.actuators.bus import ActuatorFault, ActuatorRestarted, CommandRefused, WatchdogTripped
from ori_deploy.wire.mcu import Ack, ConfigDevice, State, dialect

WHOLE = "microcontroller"
"""Who reports what is no single hinge's or latch's."""


@dataclass(frozen=True, slots=True)
class Naming:
    """What messages about one device call things.

    Attributes
    ----------
    hinges, latches
        Their names, in the order of the configuration; those beyond are numbered.
    clear
        Command that clears a fault of this device.
    device
        Its configuration, for limits; None when it is not known.
    """

    hinges: Sequence[str] = ()
    latches: Sequence[str] = ()
    clear: str = "ori-deploy mcu clear-fault"
    device: ConfigDevice | None = None

    def hinge(self, index: int) -> str:
        """A hinge by its name."""
        return self.hinges[index] if index < len(self.hinges) else f"hinge {index}"

    def latch(self, index: int) -> str:
        """A latch by its name."""
        return self.latches[index] if index < len(self.latches) else f"latch {index}"

    def limit(self, key: str) -> str:
        """A limit as the rig calls it, with its value where that is known."""
        if self.device is None:
            return key
        value, unit = {
            "silence_s": (1e-3 * self.device.silence_ms, "s"),
            "min_supply_v": (1e-3 * self.device.supply_min_mv, "V"),
            "stall_rad": (1e-6 * self.device.stall_urad, "rad"),
            "stall_s": (1e-3 * self.device.stall_ms, "s"),
            "seat_rad": (1e-6 * self.device.seat_urad, "rad"),
        }[key]
        return f"{key} = {value:g} {unit}"


@dataclass(frozen=True, slots=True)
class _Words:
    """A fault in words; `limits` are keys of `Naming.limit`, and what is cleared says so after the remedy."""

    kind: type[ActuatorFault]
    what: str
    remedy: str
    limits: tuple[str, ...] = ()
    cleared: bool = True

    def text(self, state: State, naming: Naming) -> str:
        value = f", now {1e-3 * state.supply_mv:.2f} V" if "min_supply_v" in self.limits else ""
        limit = f"; limit: {', '.join(naming.limit(key) for key in self.limits)}" if self.limits else ""
        then = f"{', ' if self.remedy else ''}then {naming.clear}" if self.cleared else ""
        return f"{self.what}{value}{limit}; remedy: {self.remedy}{then}"


_FAULTS: Mapping[int, _Words] = MappingProxyType(
    {
        dialect.ORI_FAULT_HOST_SILENT: _Words(
            WatchdogTripped,
            "heard nothing from the host while moving, and stopped along the path",
            "check the cable and what else loads the computer",
            ("silence_s",),
        ),
        dialect.ORI_FAULT_UNDERRUN: _Words(
            WatchdogTripped,
            "ran out of goals while moving, and stopped along the path",
            "check what else loads the computer, or raise lead_s",
        ),
        dialect.ORI_FAULT_POSITION_LIMIT: _Words(
            ActuatorFault, "got a goal outside its range, and stopped", "check min_position_rad and max_position_rad"
        ),
        dialect.ORI_FAULT_VELOCITY_LIMIT: _Words(
            ActuatorFault,
            "got a goal too far from the one before, and stopped: too fast",
            "check max_velocity_rad_s",
        ),
        dialect.ORI_FAULT_ACCELERATION_LIMIT: _Words(
            ActuatorFault,
            "got a goal too far from the one before, and stopped: too much acceleration",
            "check max_acceleration_rad_s2",
        ),
        dialect.ORI_FAULT_DISCONTINUITY: _Words(
            ActuatorFault,
            "got a motion that does not begin where the hinge was told to be, and stopped",
            "report it if it comes back",
        ),
        dialect.ORI_FAULT_KNOT_TIME: _Words(
            ActuatorFault,
            "got goals out of order or too far apart in time, and stopped",
            "check what else loads the computer",
        ),
        dialect.ORI_FAULT_STALL: _Words(
            ActuatorFault,
            "did not follow, and its output went off",
            "hold the structure, free what blocks it",
            ("stall_rad", "stall_s"),
        ),
        dialect.ORI_FAULT_SUPPLY_LOW: _Words(
            ActuatorFault,
            "saw the servos' supply sag, and stopped",
            "check supply, fuse and wires",
            ("min_supply_v",),
        ),
        dialect.ORI_FAULT_ESTOP: _Words(
            ActuatorFault, "emergency stop is pressed, or its wire at D38 is open", "release it"
        ),
        dialect.ORI_FAULT_WATCHDOG_RESET: _Words(
            ActuatorRestarted,
            "hung and was restarted by its watchdog, every hinge is off",
            "hold the structure, report it",
        ),
        dialect.ORI_FAULT_BROWN_OUT: _Words(
            ActuatorRestarted,
            "restarted because its own supply sagged, every hinge is off",
            "hold the structure, check the board's supply",
        ),
        dialect.ORI_FAULT_CONFIG_CORRUPT: _Words(
            ActuatorFault,
            "both stored configurations are damaged",
            "write one with ori-deploy mcu config",
            cleared=False,
        ),
        dialect.ORI_FAULT_INTERNAL: _Words(
            ActuatorFault,
            "found itself in a state that cannot be",
            "switch it off and on, and report it",
            cleared=False,
        ),
        dialect.ORI_FAULT_HOST_BRAKE: _Words(
            ActuatorFault, "was told to stop while moving, by a host that saw a fault", "do what that command said"
        ),
        dialect.ORI_FAULT_FEEDBACK_LOST: _Words(
            ActuatorFault, "no longer says where it is", "check its feedback wire"
        ),
    }
)

NOBODY = 255
"""Index of a fault that is about no hinge."""

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


def fault_error(state: State, naming: Naming) -> ActuatorFault | None:
    """The latched fault as an error, or None."""
    if state.fault == dialect.ORI_FAULT_NONE:
        return None
    words = _FAULTS.get(state.fault)
    if words is None:
        return ActuatorFault(
            WHOLE, f"reports fault {state.fault}, which this program does not know; remedy: update it"
        )
    who = naming.hinge(state.fault_index) if state.fault in _OF_HINGES and state.fault_index != NOBODY else WHOLE
    return words.kind(who, words.text(state, naming))


def refusal(ack: Ack, what: str, who: str, naming: Naming) -> CommandRefused:
    """A refused command as an error.

    Parameters
    ----------
    ack
        The answer.
    what
        The command, and what did not happen.
    who
        The hinge, latch or record that the answer is about.
    """
    value, clear = ack.value, naming.clear
    words = {
        dialect.ORI_REFUSED_STATE: f"the microcontroller is {state_name(value)}; "
        f"remedy: wait until nothing moves, {clear}, or ori-deploy mcu config",
        dialect.ORI_REFUSED_FAULT: f"it has latched the fault {fault_name(value)}; remedy: {clear}",
        dialect.ORI_REFUSED_INDEX: "it has no such hinge, latch or record; "
        "remedy: write the rig's configuration with ori-deploy mcu config",
        dialect.ORI_REFUSED_POSITION: f"{who} is measured at {1e-6 * value:.4g} rad; "
        f"limit: {naming.limit('seat_rad')} from there; remedy: hold the structure still",
        dialect.ORI_REFUSED_RANGE: f"a value of {who} is outside its range; "
        "remedy: check that the rig and the device's configuration agree, ori-deploy mcu config",
        dialect.ORI_REFUSED_TRIPPED: f"{who} protects itself; remedy: let it recover, or {clear}",
        dialect.ORI_REFUSED_CAUSE: f"the cause of the fault {fault_name(value)} persists; "
        f"remedy: remove it, then {clear}",
        dialect.ORI_REFUSED_HASH: f"what it stored has hash {value & 0xFFFFFFFF:08x}; remedy: write it again",
        dialect.ORI_REFUSED_SENSOR: f"{who} does not say where it is; remedy: check its feedback wire",
        dialect.ORI_REFUSED_HOT: f"{naming.latch(ack.index)} is warm, and would be taken for cold; it is in "
        f"{1e-3 * value:.0f} s; remedy: wait so long",
        dialect.ORI_REFUSED_SUPPLY: f"the servos' supply is {1e-3 * value:.2f} V; "
        f"limit: {naming.limit('min_supply_v')}; remedy: switch it on, check its fuse",
    }
    return CommandRefused(f"{what}: {words.get(ack.result, f'refused with result {ack.result}')}")
