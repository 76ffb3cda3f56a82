"""The firmware: its own tests, what it may not do by its sources, and what it takes of the microcontroller."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from ori_deploy.wire.generated import ori_deploy as dialect

FIRMWARE = Path(__file__).parents[2] / "firmware"
CORE = FIRMWARE / "core"

FLASH_LIMIT = 64 * 1024
RAM_LIMIT = 4 * 1024
"""Bytes: a quarter of the ATmega2560's flash, and half of its RAM, so that the stack has the other half."""

OWN_HEADERS = {path.name for path in CORE.glob("*.h")}
LIBRARY = {"stdbool.h", "stddef.h", "stdint.h", "string.h"}
GENERATED = {"ori_deploy/version.h", "ori_deploy/mavlink.h", "mavlink_types.h"}


def make(target: str, limit_s: float, *settings: str) -> subprocess.CompletedProcess[str]:
    words = ["make", "-C", str(FIRMWARE), target, *settings]
    return subprocess.run(words, capture_output=True, text=True, timeout=limit_s)


def needs(program: str, package: str) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is missing: apt-get install {package}")


def code(path: Path) -> str:
    """A source without comments and texts."""
    return re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', " ", path.read_text(), flags=re.DOTALL)


def sources() -> list[Path]:
    return sorted([*CORE.glob("*.c"), *CORE.glob("*.h")])


@pytest.mark.slow
def test_unit_tests_and_a_short_fuzz_run_pass() -> None:
    needs("gcc", "gcc make")
    done = make("test", 600)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"\b\d{3} tests, 0 failed", done.stdout)


@pytest.mark.slow
def test_nine_of_ten_mutants_are_killed() -> None:
    """Of every fifth; `make campaign` runs all."""
    needs("gcc", "gcc make")
    done = make("mutate", 1800, "MUTANTS_EVERY=5")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_compilers_have_nothing_to_say() -> None:
    needs("gcc", "gcc make")
    needs("clang", "clang")
    done = make("lint", 600)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_it_fits_the_microcontroller() -> None:
    needs("avr-gcc", "gcc-avr binutils-avr avr-libc")
    done = make("size", 600)
    assert done.returncode == 0, done.stdout + done.stderr
    sizes = re.search(r"flash (\d+) of \d+ bytes, static RAM (\d+) of \d+ bytes", done.stdout)
    assert sizes, done.stdout
    assert int(sizes[1]) < FLASH_LIMIT
    assert int(sizes[2]) < RAM_LIMIT


@pytest.mark.parametrize("path", sources(), ids=lambda path: path.name)
def test_the_core_knows_its_port_by_one_header(path: Path) -> None:
    included = re.findall(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', path.read_text(), flags=re.MULTILINE)
    assert set(included) <= OWN_HEADERS | LIBRARY | GENERATED


@pytest.mark.parametrize("path", sources(), ids=lambda path: path.name)
def test_the_core_touches_no_hardware_and_no_heap_and_has_no_fractions(path: Path) -> None:
    text = code(path)
    assert not re.search(r"\b(?:float|double|_Complex)\b", text)
    assert not re.search(r"\b\d+\.\d*(?:[eE][-+]?\d+)?[fFlL]?\b|\b\d+[eE][-+]?\d+", text)
    assert not re.search(r"\b(?:malloc|calloc|realloc|free|alloca)\s*\(", text)
    assert not re.search(r"\b(?:volatile|__attribute__|ISR|PROGMEM|_BV|__AVR\w*|__linux__|__unix__)\b", text)
    # Assembler without an instruction hides a value from the optimiser, and does nothing else.
    written = re.findall(r"\basm\b|\b__asm__\b[^;]*", path.read_text())
    assert all(re.match(r'__asm__\s*\(\s*""\s*:', one) for one in written)


@pytest.mark.parametrize("path", sorted(CORE.glob("*.c")), ids=lambda path: path.name)
def test_loops_and_numbers_are_of_known_size(path: Path) -> None:
    """No recursion is asked for here, but plain int, long and the like differ between the port and a host."""
    assert not re.search(r"\b(?:unsigned|long|short|int)\b", code(path))


@pytest.mark.parametrize("name", ["timesync", "statustext"])
def test_messages_of_the_common_dialect_are_those_of_the_common_dialect(name: str) -> None:
    ours, theirs = (getattr(of, f"MAVLink_{name}_message") for of in (dialect, common))
    assert ours.id == theirs.id
    assert ours.crc_extra == theirs.crc_extra
    assert ours.unpacker.size == theirs.unpacker.size
    assert ours.ordered_fieldnames == theirs.ordered_fieldnames
    assert ours.fieldtypes == theirs.fieldtypes


def test_severities_are_those_of_the_common_dialect() -> None:
    def named(of: object) -> dict[str, int]:
        entries = of.enums["MAV_SEVERITY"]  # type: ignore[attr-defined]
        return {entry.name: value for value, entry in entries.items()}

    assert named(dialect) == named(common)
