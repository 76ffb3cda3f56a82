"""Find the device behind a port, and check that it is the one the rig describes."""

from __future__ import annotations

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import Info, State, dialect

FIRST_ASKS = 3
"""Times that a device is asked at once: an answer may be lost, and all of it reaches a bootloader as one burst."""

LAST_ASKS = 4

LOOKS = 5
LOOK_PERIOD_S = 0.02
"""How often, and how far apart, the feedback is looked at before a hinge is called silent: right after the start
not all inputs have been converted."""


def find_device(line: McuLine, clock: Clock, boot_wait_s: float) -> Info:
    """Ask the device who it is, and wait in silence when it does not answer.

    Opening the port restarts most boards, and a bootloader stays awake for as long as anybody talks to it: a
    Mega's goes on for 5 to 8 s after the last byte. The firmware says by itself that it has started.

    Raises
    ------
    BusTimeout
        It does not answer at once, nor after `boot_wait_s` of silence.
    """
    if (info := _ask(line, FIRST_ASKS)) is not None:
        return info
    deadline = clock.now() + boot_wait_s
    while clock.now() < deadline:
        if line.listen(deadline - clock.now()) and (info := _ask(line, FIRST_ASKS)) is not None:
            return info
    if (info := _ask(line, LAST_ASKS)) is not None:
        return info
    raise BusTimeout(
        f"{line.port.path}: no microcontroller answers, neither at once nor after {boot_wait_s:g} s of silence, "
        "in which a bootloader ends; remedy: check port and cable, and that the firmware is on it"
    )


def _ask(line: McuLine, attempts: int) -> Info | None:
    try:
        return line.poll_patiently(dialect.ORI_POLL_INFO, attempts).info
    except (BusTimeout, CorruptReply):
        return None


FIRMWARE = (1, 1)
"""Major and minor version of the firmware whose faults and answers this program knows."""


def check_firmware(info: Info, port: str) -> None:
    """Check that device and host speak of the same things.

    Raises
    ------
    CommandRefused
        Its firmware has another major version than `FIRMWARE`, or an older minor one.
    """
    major, minor = info.firmware >> 24 & 0xFF, info.firmware >> 16 & 0xFF
    if major != FIRMWARE[0] or minor < FIRMWARE[1]:
        raise CommandRefused(
            f"{port}: the firmware does not go with this program; found version {major}.{minor}; "
            f"limit: {FIRMWARE[0]}.{FIRMWARE[1]} or a later {FIRMWARE[0]}.x; "
            "remedy: flash the one that came with it, ori-deploy mcu flash, or update this program"
        )


def check_config(info: Info, wanted: int, port: str) -> None:
    """Check that the device has the rig's configuration.

    Raises
    ------
    CommandRefused
        It has another one, or none.
    """
    if info.config_hash != wanted:
        found = f"{info.config_hash:08x}" if info.config_hash else "none"
        raise CommandRefused(
            f"{port}: the microcontroller's configuration is not the rig's; found hash {found}; "
            f"limit: {wanted:08x}; remedy: ori-deploy mcu config writes it"
        )


def check_feedback(line: McuLine, wiring: McuWiring, clock: Clock) -> State:
    """Check that every hinge with a feedback wire says where it is, and return the state in which it does.

    Raises
    ------
    BusTimeout
        Naming those that do not.
    """
    for look in range(LOOKS):
        if look:
            clock.sleep_until(clock.now() + LOOK_PERIOD_S)
        state = line.poll_patiently(dialect.ORI_POLL_STATE).state
        assert state is not None
        lost = {
            hinge.name: f"{'open wire' if state.silent >> k & 1 else 'reads what cannot be'} at A{hinge.feedback}"
            for k, hinge in enumerate(wiring.hinges)
            if hinge.feedback is not None and not state.sensed >> k & 1
        }
        if not lost:
            return state
    assert state is not None
    supply_v, lowest_v = 1e-3 * state.supply_mv, wiring.settings.min_supply_v
    if supply_v < lowest_v:
        raise BusTimeout(
            f"no position from {', '.join(lost)}: the servos' supply is {supply_v:.2f} V; "
            f"limit: min_supply_v = {lowest_v:g} V; remedy: switch it on, check its fuse"
        )
    raise BusTimeout(
        f"no position from {', '.join(f'{name} ({what})' for name, what in lost.items())}; "
        "remedy: check the servo's supply and its feedback wire"
    )
