"""Find the device behind a port, and check that it is the one the rig describes."""

from __future__ import annotations

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import Info, State, dialect

KNOCK_PERIOD_S = 0.1
"""How often a device that may be starting is asked."""

LOOKS = 5
LOOK_PERIOD_S = 0.02
"""How often, and how far apart, the feedback is looked at before a hinge is called silent: right after the start
not all inputs have been converted."""


def find_device(line: McuLine, clock: Clock, boot_wait_s: float) -> Info:
    """Wait until the device answers: opening the port restarts most boards.

    Raises
    ------
    BusTimeout
        It does not answer within `boot_wait_s`.
    """
    deadline = clock.now() + boot_wait_s
    while True:
        try:
            info = line.poll(dialect.ORI_POLL_INFO).info
        except (BusTimeout, CorruptReply) as silence:
            if clock.now() >= deadline:
                raise BusTimeout(
                    f"{line.port.path}: no microcontroller answers within {boot_wait_s:g} s; "
                    "remedy: check port, baud rate and cable, and that the firmware is on it"
                ) from silence
            clock.sleep_until(clock.now() + KNOCK_PERIOD_S)
            continue
        assert info is not None
        return info


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
    names: list[str] = []
    for _ in range(LOOKS):
        state = line.poll_patiently(dialect.ORI_POLL_STATE).state
        assert state is not None
        names = [
            hinge.name
            for k, hinge in enumerate(wiring.hinges)
            if hinge.feedback is not None and not state.sensed >> k & 1
        ]
        if not names:
            return state
        clock.sleep_until(clock.now() + LOOK_PERIOD_S)
    raise BusTimeout(f"no position from {', '.join(names)}; remedy: check the servo's supply and its feedback wire")
