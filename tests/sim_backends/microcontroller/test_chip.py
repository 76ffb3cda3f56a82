"""The port to the ATmega2560, on the emulated chip: exact pulses, clean edges, every pin, every reset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import serial

from sim_backends.microcontroller.build import firmware
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec
from tests.sim_backends.microcontroller.bench import CORES, FRAME, need, probe

POWER, EXTERNAL, BROWN_OUT, WATCHDOG = range(4)
CYCLES_PER_TICK = 8


def test_pulses_are_exact_to_the_cycle(tmp_path: Path) -> None:
    # 2001 and 2257 differ in the high byte alone, 2257 and 2258 in the low one.
    steps = (1, 999, 2001, 2257, 2258, 3000, 5000, 2000, 19999, 20000)
    with probe(tmp_path / "tty") as chip:
        for ticks in steps:
            for output in range(12):
                chip.tell("P", output, ticks + output if ticks < 19999 else ticks)
            chip.board.run(0.02)
        chip.board.run(0.04)
        pulses = chip.board.pulses()
    assert pulses.hz == 16_000_000
    for output in range(12):
        mine = pulses.of(output)
        wanted = [ticks + output if ticks < 19999 else ticks for ticks in steps]
        widths = mine.width // CYCLES_PER_TICK
        assert (mine.width % CYCLES_PER_TICK == 0).all()
        assert list(dict.fromkeys(widths.tolist())) == wanted
        assert (np.diff(mine.rise) == FRAME).all()
    frames = pulses.rise[pulses.output == 0]
    for output in range(1, 12):  # the chip starts them in one cycle; the emulation knows no common prescaler
        assert np.abs(pulses.rise[pulses.output == output] - frames).max() <= 64


def test_a_pulse_changes_with_the_next_frame_whenever_it_is_given(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.tell("P", 3, 3000)
        chip.board.run_cycles(2 * FRAME)
        start = int(chip.board.pulses().of(3).rise[-1])
        for i, after in enumerate(range(2000, FRAME - 8000, 21_000)):  # before, in and after the pulse of 24,000
            frame = start + (2 * i + 2) * FRAME
            chip.board.run_cycles(frame + after - chip.board.status().cycle)
            chip.board.forget_pulses()
            chip.tell("P", 3, 2000 + 100 * i)
            chip.board.run_cycles(2 * FRAME - after - 4000)
            mine = chip.board.pulses().of(3)
            before = 3000 if i == 0 else 2000 + 100 * (i - 1)
            by_frame = {int(rise - frame): int(width) for rise, width in zip(mine.rise, mine.width, strict=True)}
            assert by_frame[FRAME] == CYCLES_PER_TICK * (2000 + 100 * i)
            assert by_frame.get(0, CYCLES_PER_TICK * before) == CYCLES_PER_TICK * before


@pytest.mark.parametrize("output", [1, 6])
def test_turning_on_and_off_leaves_whole_pulses_only(tmp_path: Path, output: int) -> None:
    step = 67_000  # does not divide the frame: every phase of it is met, most of all in the pulse
    with probe(tmp_path / "tty") as chip:
        for i in range(80):
            chip.tell("P", output, 0 if i % 2 else 3000)
            chip.board.run_cycles(step * (1 + i % 5))
        chip.tell("P", output, 0)
        chip.board.run_cycles(3 * FRAME)
        pulses = chip.board.pulses()
        chip.board.forget_pulses()
        chip.board.run_cycles(3 * FRAME)
        assert len(chip.board.pulses().output) == 0
    assert len(pulses.output) > 5
    assert set(pulses.output.tolist()) == {output}
    assert set(pulses.width.tolist()) == {3000 * CYCLES_PER_TICK}
    assert (np.diff(pulses.rise) % FRAME == 0).all()


def test_turning_on_and_off_around_the_end_of_a_frame_is_as_clean(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.tell("P", 0, 3000)
        chip.board.run_cycles(2 * FRAME)
        phase = int(chip.board.pulses().rise[-1])
        for i, before in enumerate(range(0, 2800, 9)):  # of the frame's end, the five bytes' 1,600 cycles among them
            chip.tell("P", 0, 3000 * (i % 2))
            chip.board.run_cycles(2 * FRAME - before - (chip.board.status().cycle - phase) % FRAME)
            chip.tell("P", 0, 0 if i % 2 else 3000)
            chip.board.run_cycles(FRAME)
        pulses = chip.board.pulses()
    assert len(pulses.width) > 300
    assert set(pulses.width.tolist()) == {3000 * CYCLES_PER_TICK}
    assert (np.diff(pulses.rise) % FRAME == 0).all()


def test_off_takes_effect_with_the_next_frame(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.tell("P", 0, 3000)
        chip.board.run_cycles(2 * FRAME)
        last = int(chip.board.pulses().of(0).rise[-1])
        chip.board.run_cycles(last + 2 * FRAME + 5000 - chip.board.status().cycle)  # in the pulse
        chip.tell("P", 0, 0)
        chip.board.run_cycles(3 * FRAME)
        assert chip.board.pulses().of(0).rise[-1] == last + 2 * FRAME


def test_nothing_moves_before_it_is_told(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.board.run(0.2)
        assert len(chip.board.pulses().output) == 0
        assert chip.board.truth().magnets == 0


def test_time_goes_on_evenly_and_frames_begin_with_the_pulses(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.tell("P", 0, 2000)
        chip.board.run(0.04)
        times = []
        for _ in range(60):
            cycle = chip.board.status().cycle
            times.append((cycle, chip.ask("T")))
        offsets = np.array([micros - cycle / 16 for cycle, micros in times])
        assert np.ptp(offsets) < 120.0  # of a poll
        assert (np.diff([micros for _, micros in times]) > 0).all()
        frame = chip.ask("F")
        chip.board.run_cycles(FRAME)
        rises = chip.board.pulses().of(0).rise / 16 - FRAME / 16  # the first frame is frame 0
        assert frame % 20_000 == 0
        assert np.abs((rises - rises[0]) % 20_000).max() < 1.0


def test_every_analogue_input_has_its_place(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        for i in range(16):
            chip.board.adc(i, 17 + 60 * i)
        chip.board.run(0.005)
        assert [chip.ask("A", i) for i in range(16)] == [17 + 60 * i for i in range(16)]


def test_supply_thermistor_and_pots_read_as_they_are_wired(tmp_path: Path) -> None:
    pot = HingeSpec(output=0, adc=5, start_rad=0.25)
    world = WorldSpec(hinges=(pot,), supply_v=7.4, supply_uv_per_count=9766.0, thermistor_count=300)
    with probe(tmp_path / "tty", world) as chip:
        assert chip.ask("A", 12) == round(7.4e6 / 9766.0)
        assert chip.ask("A", 13) == 300
        position = (-1_800_000 + chip.ask("A", 5) * 3519.062) * 1e-6
        assert position == pytest.approx(0.25, abs=0.0018)
        chip.board.open_wire(0)
        chip.board.run(0.005)
        assert chip.ask("A", 5) == 0
        chip.board.short_wire(0)
        chip.board.run(0.005)
        assert chip.ask("A", 5) == 1023
        chip.board.wire(0, "good")
        chip.board.supply(5.0)
        chip.board.run(0.005)
        assert chip.ask("A", 5) not in (0, 1023)
        assert chip.ask("A", 12) == 512


def test_sensors_magnets_and_emergency_stop(tmp_path: Path) -> None:
    magnets = tuple(LatchSpec("electromagnet", output=i, sensor=7 - i, sensor_high=i == 2) for i in range(8))
    with probe(tmp_path / "tty", WorldSpec(latches=magnets)) as chip:
        assert chip.ask("S") == 0xFF & ~(1 << 5)
        chip.ask("M", 1, 1)
        chip.ask("M", 2, 1)
        chip.board.run(0.002)
        assert chip.board.truth().magnets == 0b110
        assert chip.ask("S") == 0xFF & ~(1 << 6)
        chip.ask("M", 1, 0)
        chip.board.estop()
        chip.board.run(0.002)
        assert chip.ask("S") == 0x1FF
        chip.board.sensor(0, "low")
        assert chip.ask("S") == 0x1FE


def test_every_reset_says_why(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        assert chip.ask("R") == POWER
        chip.board.reset("external")
        chip.board.run(0.03)
        assert chip.ask("R") == EXTERNAL
        chip.board.reset("brown_out")
        chip.board.run(0.03)
        assert chip.ask("R") == BROWN_OUT
        for interrupts in (False, True):
            chip.board.hang(interrupts)
            chip.board.run(0.2)
            assert chip.board.status().resets == 2 + interrupts
            chip.board.run(0.1)
            assert chip.board.status().resets == 3 + interrupts
            assert chip.ask("R") == WATCHDOG
        chip.board.power_cycle()
        chip.board.run(0.03)
        assert chip.ask("R") == POWER
        chip.board.run(0.6)
        assert chip.board.status().resets == 5  # the watchdog is kicked


def test_pulses_go_on_while_the_program_hangs_and_end_with_the_reset(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.tell("P", 4, 3000)
        chip.tell("M", 3, 1)
        chip.board.run(0.05)
        chip.board.forget_pulses()
        chip.board.hang()
        chip.board.run(0.2)
        assert len(chip.board.pulses().output) in (9, 10, 11)
        assert chip.board.truth().magnets == 8
        chip.board.run(0.1)
        assert chip.board.truth().magnets == 0
        chip.board.forget_pulses()
        chip.board.run(0.1)
        assert len(chip.board.pulses().output) == 0


def test_eeprom_outlives_the_process_and_takes_its_time(tmp_path: Path) -> None:
    with probe(tmp_path / "tty", eeprom=tmp_path / "eeprom") as chip:
        assert chip.ask("G", 0, 300) == 0xFF
        chip.tell("W", 77, 300)
        chip.tell("W", 78, 4095)
        chip.board.tapped()
        chip.board.run(0.002)
        assert len(chip.board.tapped()) == 9  # the second has to wait for the first
        chip.board.run(0.005)
        assert chip.ask("G", 0, 300) == 77
        chip.board.power_cycle()
        chip.board.run(0.03)
        assert chip.ask("G", 0, 4095) == 78
        chip.board.kill()
    with probe(tmp_path / "tty", eeprom=tmp_path / "eeprom") as chip:
        assert chip.ask("G", 0, 300) == 77
        chip.board.put_eeprom(300, b"\x05")
        assert chip.board.eeprom(299, 3) == b"\xff\x05\xff"
        assert chip.ask("G", 0, 300) == 5


def test_cycles_latency_and_stack_are_counted(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.board.measure("core_frame", "port_servo")
        chip.board.run(0.1)
        frame = chip.board.measured()["core_frame"]
        assert frame.all.count == 5
        assert 10 < frame.own.least <= frame.own.most < 100
        assert chip.board.measured()["port_servo"].all.count == 0
        chip.ask("P", 0, 2000)
        assert chip.board.measured()["port_servo"].all.count == 1
        assert 0 <= chip.board.latency()[20].most < 160  # 10 us; timer 1's overflow
        stack = chip.board.stack()
        assert 20 < stack.used < 300
        assert stack.free > 6000


def test_echo_is_lossless_at_full_rate(tmp_path: Path) -> None:
    need("atmega2560")
    sent = np.random.default_rng(0).bytes(16_000)
    with Microcontroller(WorldSpec(), tmp_path / "tty", program=firmware("atmega2560", CORES / "echo")) as board:
        board.wait_ready()
        with serial.Serial(str(board.link), 500_000, timeout=5.0) as port:
            began = board.truth().time_us  # the board's own time: on the wall it may catch up
            port.write(sent)
            assert port.read(len(sent)) == sent
            took = 1e-6 * (board.truth().time_us - began)
        assert took > len(sent) / 50_000  # no faster than the wire
        assert board.status().overruns == 0


def test_the_same_inputs_give_the_same_cycles(tmp_path: Path) -> None:
    records = []
    for _ in range(2):
        with probe(
            tmp_path / "tty", WorldSpec(hinges=(HingeSpec(output=0, adc=0, noise_counts=2.0),), seed=7)
        ) as chip:
            chip.tell("P", 0, 3300)
            counts = [chip.ask("A", 0) for _ in range(20)]
            chip.board.run(0.05)
            records.append((counts, chip.board.pulses().rise.tolist(), chip.board.truth(), chip.board.status()))
    assert records[0] == records[1]
    assert len(set(records[0][0])) > 2
