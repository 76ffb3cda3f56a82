"""What the firmware takes of its chip, counted by the emulator to the cycle: `python -m benchmarks.mcu`.

Twelve hinges move, the host streams a knot and polls every 20 ms, all in lockstep: the counts are the same on
every machine and in every run.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ori_deploy.actuators.mcu.records import records
from ori_deploy.actuators.mcu.settings import HingeServo, LatchDrive, McuSettings
from ori_deploy.actuators.mcu.wiring import Hinge, Latch, McuWiring
from ori_deploy.wire.mcu import dialect
from sim_backends.microcontroller.build import firmware
from sim_backends.microcontroller.launcher import Cycles, Microcontroller, Stack, Tally
from sim_backends.microcontroller.lockstep import LockstepHost
from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec

N_HINGES, N_LATCHES = 12, 8
FRAME_CYCLES = 320_000
MOTION_S = 2.0
SWING_RAD = 0.8
FUNCTIONS = ("core_frame", "queue_positions", "hinges_output", "hinges_sense", "core_poll", "machine_setpoints")
INTERPOLATION = ("queue_positions", "hinges_output")
"""From the queue to the pulses of all hinges."""

TARGET_SHARE = 0.05

SERVO = HingeServo(
    pulse_zero_us=1500.0, pulse_us_per_rad=424.4, pulse_min_us=500.0, pulse_max_us=2500.0,
    feedback_zero_rad=-2.931, feedback_rad_per_count=0.005746, feedback_low=20, feedback_high=1000,
)  # fmt: skip


@dataclass(frozen=True)
class Load:
    """What the firmware took.

    Attributes
    ----------
    cycles
        Of functions, by name.
    latency
        Of interrupts, by vector.
    stack
        Bytes.
    """

    cycles: dict[str, Cycles]
    latency: dict[int, Tally]
    stack: Stack

    @property
    def interpolation(self) -> int:
        """Most cycles of a frame from the queue to the pulses of all hinges."""
        return sum(self.cycles[name].own.most for name in INTERPOLATION)


def wiring() -> McuWiring:
    """A board with everything on it that fits."""
    hinges = tuple(Hinge(f"h{k}", k, k, SERVO, -2.3, 2.3, 6.0, 60.0) for k in range(N_HINGES))
    latches = tuple(Latch(f"l{k}", "electromagnet", k, k, LatchDrive(), 10.0, 0.5, 0.0) for k in range(N_LATCHES))
    return McuWiring(McuSettings(port="-", supply_divider=3.0, min_supply_v=4.8), hinges, latches)


def world() -> WorldSpec:
    """What is at its pins."""
    hinges = tuple(
        HingeSpec(
            output=k, adc=k, pulse_slope_ns=424_400, feedback_zero_urad=-2_931_000, feedback_slope_nrad=5_746_000
        )
        for k in range(N_HINGES)
    )
    latches = tuple(LatchSpec("electromagnet", output=k, sensor=k) for k in range(N_LATCHES))
    return WorldSpec(hinges=hinges, latches=latches, supply_uv_per_count=1e6 * 3.0 * 5.0 / 1024)


def swing(time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Every hinge out and back, no two alike."""
    u = min(time_s / MOTION_S, 1.0)
    way = SWING_RAD * np.linspace(-1.0, 1.0, N_HINGES) ** 3
    turn = 2.0 * np.pi
    return way * (0.5 - 0.5 * np.cos(turn * u)), way * (0.5 * turn / MOTION_S) * np.sin(turn * u)


def measure() -> Load:
    """Run the motion and count."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Microcontroller(world(), Path(folder) / "tty", lockstep=True) as board,
    ):
        board.wait_ready()
        host = LockstepHost(board)
        host.configure(records(wiring()))
        host.enable(np.zeros(N_HINGES))
        board.measure(*FUNCTIONS)
        board.forget_latency()
        host.follow(swing, round(MOTION_S / 0.02) + 1)
        state = host.state()
        if state.state != dialect.ORI_HOLDING or state.fault:
            raise SystemExit(f"the motion did not end well: state {state.state}, fault {state.fault}")
        return Load(board.measured(), board.latency(), board.stack())


def size() -> tuple[int, int]:
    """Flash and static RAM, bytes."""
    said = subprocess.run(
        ["avr-size", "-A", str(firmware("atmega2560"))], capture_output=True, text=True, check=True
    ).stdout
    parts = {
        words[0]: int(words[1]) for line in said.splitlines() if len(words := line.split()) == 3 and line[0] == "."
    }
    data, rest = parts.get(".data", 0), parts.get(".bss", 0) + parts.get(".noinit", 0)
    return parts[".text"] + data, data + rest


def main() -> None:
    """Measure and print."""
    load, (flash, ram) = measure(), size()
    share = load.interpolation / FRAME_CYCLES
    worst = max(load.latency.values(), key=lambda tally: tally.most)
    print(f"ATmega2560 at 16 MHz, {N_HINGES} hinges and {N_LATCHES} latches, a knot and a poll every 20 ms; cycles:")
    for name, cycles in load.cycles.items():
        print(f"  {name:18} {cycles.own.count:6} calls, mean {cycles.own.mean:9.0f}, most {cycles.own.most:7}")
    print(
        f"  interpolation of a frame, queue to pulses: {load.interpolation} cycles, {100.0 * share:.2f} % of the "
        f"frame; target below {100.0 * TARGET_SHARE:.0f} %"
    )
    print(f"  worst interrupt latency {worst.most} cycles, {worst.most / 16.0:.1f} us")
    print(
        f"  flash {flash} of 65536 bytes wanted, static RAM {ram} of 4096 bytes wanted, "
        f"deepest stack {load.stack.used} bytes, {load.stack.free} never used"
    )


if __name__ == "__main__":
    main()
