"""Finding a board that a bootloader keeps from answering for as long as anybody talks to it."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from ori_deploy.actuators.bus import BusTimeout
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.startup import find_device
from ori_deploy.wire.generated import ori_deploy as d
from tests.actuators.mcu.scripted import ScriptedDevice, SteppedClock, VirtualPort
from tests.actuators.mcu.setups import config, wiring

LISTENS_S = 1.0
PATIENCE_S = 6.0
"""How long a Mega's bootloader waits for a first byte, and then for every further one."""


@dataclass
class Starting:
    """A board whose bootloader runs when its port is opened."""

    clock: SteppedClock
    device: ScriptedDevice
    port: VirtualPort
    says_boot: bool = True

    def __post_init__(self) -> None:
        self.device.dead = True
        self.opened_s = self.last_byte_s = self.clock.now()
        self.spoken_to = False
        write = self.port.write

        def heard(data: bytes) -> None:
            self.last_byte_s, self.spoken_to = self.clock.now(), True
            write(data)

        self.port.write = heard  # type: ignore[method-assign]
        self.clock.lives.append(self.live)

    def live(self) -> None:
        end = self.last_byte_s + PATIENCE_S if self.spoken_to else self.opened_s + LISTENS_S
        if self.device.dead and self.clock.now() > end:
            self.device.dead = False
            if self.says_boot:
                self.device.send(d.MAVLink_ori_event_message(0, 0, 0, d.ORI_EVENT_BOOT, 0))


def line(boots: bool, says_boot: bool = True) -> tuple[McuLine, SteppedClock, Starting | None]:
    clock = SteppedClock()
    device = ScriptedDevice(config(wiring()), clock.now)
    port = VirtualPort(device, clock)
    port.open()
    return (
        McuLine(port, clock, 0.03),  # type: ignore[arg-type]
        clock,
        Starting(clock, device, port, says_boot) if boots else None,
    )


def test_a_board_that_answers_at_once_loses_no_time() -> None:
    one, clock, _ = line(boots=False)
    began = clock.now()
    assert find_device(one, clock, 10.0).boot == 7
    assert clock.now() - began < 0.03


@pytest.mark.parametrize(("says_boot", "within_s"), [(True, PATIENCE_S + 0.3), (False, 10.3)])
def test_a_bootloader_is_left_in_peace_until_it_ends(says_boot: bool, within_s: float) -> None:
    one, clock, starting = line(boots=True, says_boot=says_boot)
    began = clock.now()
    assert find_device(one, clock, 10.0).boot == 7
    assert starting is not None
    assert PATIENCE_S < clock.now() - began < within_s


def test_who_waited_in_vain_says_for_what() -> None:
    one, clock, _ = line(boots=True)
    with pytest.raises(BusTimeout, match=r"neither at once nor after 2 s of silence, in which a bootloader ends"):
        find_device(one, clock, 2.0)
