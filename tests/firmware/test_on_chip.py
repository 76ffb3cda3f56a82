"""The image on the emulated chip: what it takes of it, and what no noise makes it do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.mcu import FRAME_CYCLES, N_HINGES, measure, size, wiring, world
from ori_deploy.actuators.mcu.records import records
from ori_deploy.wire.mcu import LatchCommand, LatchState, Poll, dialect
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.lockstep import LockstepHost
from tests.sim_backends.microcontroller.bench import need

NOISE_BYTES = 10_000_000
PART = 500_000
WIRE_S_PER_BYTE = 20e-6


def test_flash_and_ram_leave_room() -> None:
    need("atmega2560")
    flash, ram = size()
    assert flash < 64 * 1024
    assert ram < 4 * 1024


def test_magnets_are_as_hot_after_a_reset_as_before(tmp_path: Path) -> None:
    """Start-up leaves the memory alone in which the heat is kept; without power it is lost."""
    need("atmega2560")
    with Microcontroller(world(), tmp_path / "tty", lockstep=True) as board:
        board.wait_ready()
        host = LockstepHost(board)
        host.configure(records(wiring()))

        def latches() -> LatchState:
            return host.ask(lambda token: Poll(token, dialect.ORI_POLL_LATCHES), LatchState)

        host.command(lambda token: LatchCommand(token, 3, 1))
        board.run(2.0)
        left = latches().duty_left_permille[3]
        assert 790 < left < 810
        board.reset("external")
        board.run(0.3)
        warm = latches()
        assert warm.commanded == warm.tripped == 0
        assert left <= warm.duty_left_permille[3] < left + 50
        board.power(False)
        board.power(True)
        board.run(0.3)
        assert latches().duty_left_permille == [1000] * 8


@pytest.mark.slow
def test_a_frame_of_twelve_hinges_takes_less_than_a_twentieth_of_it_every_time() -> None:
    """Counts, not times: the same on every machine."""
    need("atmega2560")
    load = measure()
    assert load.interpolation < 0.05 * FRAME_CYCLES
    assert load.cycles["core_frame"].own.most < 0.15 * FRAME_CYCLES
    assert load.stack.used + size()[1] < 8192 - 2048
    # A byte at 500 kBd takes 320 cycles, and the chip holds two: an interrupt that is later loses bytes.
    assert max(tally.most for tally in load.latency.values()) < 320
    again = measure()
    assert again.cycles == load.cycles
    assert again.latency == load.latency


@pytest.mark.slow
def test_ten_million_random_bytes_move_nothing(tmp_path: Path) -> None:
    need("atmega2560")
    generator = np.random.default_rng(5)
    with Microcontroller(world(), tmp_path / "tty", lockstep=True) as board:
        board.wait_ready()
        host = LockstepHost(board)
        host.configure(records(wiring()))
        host.enable(np.zeros(N_HINGES))
        board.forget_pulses()
        before = board.truth()
        for _ in range(NOISE_BYTES // PART):
            board.feed(generator.integers(0, 256, PART, dtype=np.uint8).tobytes())
            board.run(PART * WIRE_S_PER_BYTE)
            board.tapped()
        assert not board.status().crashed
        assert board.status().resets == 0
        pulses = board.pulses()
        for output in range(N_HINGES):
            mine = pulses.of(output)
            assert len(mine.width) > 5000
            assert (mine.width == mine.width[0]).all()
        after = board.truth()
        assert after.magnets == before.magnets == 0
        state = host.state()
        assert (state.state, state.fault) == (dialect.ORI_HOLDING, dialect.ORI_FAULT_NONE)
        assert state.outputs_on == (1 << N_HINGES) - 1
