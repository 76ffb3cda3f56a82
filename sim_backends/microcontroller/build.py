"""Compiles the firmware and the emulation, where that has not been done since their sources changed."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Literal

from ori_deploy.errors import OriDeployError

Port = Literal["host", "atmega2560"]

HERE = Path(__file__).resolve().parent
FIRMWARE = HERE.parent.parent / "firmware"
EMULATION_FLAGS = ("-std=c11", "-D_GNU_SOURCE", "-O2", "-g", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off")


class BuildError(OriDeployError):
    """The firmware or the emulation cannot be compiled."""


def missing_tools(port: Port) -> tuple[str, ...]:
    """Debian's names of the packages that are missing to build and run a port."""
    wanted = {"gcc": shutil.which("gcc"), "make": shutil.which("make"), "libc6-dev": _header("pty.h")}
    if port == "atmega2560":
        wanted["gcc-avr"] = shutil.which("avr-gcc")
        wanted["avr-libc"] = _first("/usr/lib/avr/include/avr/io.h", "/usr/avr/include/avr/io.h")
        wanted["libsimavr-dev"] = _header("simavr/sim_avr.h")
        wanted["libelf-dev"] = _header("gelf.h")
    return tuple(package for package, found in wanted.items() if not found)


def _header(name: str) -> str | None:
    return _first(f"/usr/include/{name}", f"/usr/local/include/{name}")


def _first(*names: str) -> str | None:
    return next((name for name in names if Path(name).exists()), None)


def require_tools(port: Port) -> None:
    """See that a port can be built.

    Raises
    ------
    BuildError
        Packages are missing.
    """
    missing = missing_tools(port)
    if missing:
        raise BuildError(
            f"the port {port} cannot be built; missing: {', '.join(missing)}; "
            f"remedy: apt-get install --no-install-recommends {' '.join(missing)}"
        )
    if not FIRMWARE.is_dir():
        raise BuildError(
            f"{FIRMWARE}: the firmware's sources are not there; remedy: use a checkout of the repository"
        )


def firmware(port: Port, core: Path | None = None) -> Path:
    """The firmware of a port, up to date: an ELF for the chip, or a program for Linux.

    Parameters
    ----------
    port
        Which.
    core
        Folder of another core to put on the port; None for the firmware's own.
    """
    require_tools(port)
    name = {"host": "ori_host", "atmega2560": "ori_atmega2560.elf"}[port]
    folder = _cache() if core is None else _cache() / f"core-{_digest(core)}"
    with _locked(folder):
        _run(
            "make", "-s", "-C", str(FIRMWARE), "-f", f"port_{port}/rules.mk", f"BUILD={folder}",
            f"PYTHON={sys.executable}", *([] if core is None else [f"CORE={core.resolve()}"]), str(folder / name),
        )  # fmt: skip
    return folder / name


def emulator() -> Path:
    """The program that emulates the ATmega2560, up to date."""
    require_tools("atmega2560")
    sources = sorted(str(path) for path in HERE.glob("*.c"))
    made = _cache() / f"ori_avr-{_digest(HERE)}"
    with _locked(_cache()):
        if not made.exists():
            fresh = made.with_name(f".{made.name}.{os.getpid()}")
            libraries = ("-lsimavr", "-lelf", "-lutil", "-lm")
            _run("gcc", *EMULATION_FLAGS, "-o", str(fresh), *sources, *libraries)
            for old in made.parent.glob("ori_avr-*"):
                old.unlink()
            fresh.replace(made)
    return made


def _cache() -> Path:
    """Beside the sources, or where one may write."""
    folder = FIRMWARE / "build"
    try:
        folder.mkdir(exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    folder = Path(tempfile.gettempdir()) / f"ori-firmware-{os.getuid()}-{sha256(str(HERE).encode()).hexdigest()[:12]}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise BuildError(f"{folder}: belongs to somebody else; remedy: remove it")
    return folder


def _digest(folder: Path) -> str:
    """Of the C sources in a folder."""
    made = sha256()
    for path in sorted((*folder.glob("*.c"), *folder.glob("*.h"))):
        made.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return made.hexdigest()[:16]


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """One process at a time."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(f"{command[0]} failed:\n{done.stderr.strip() or done.stdout.strip()}")
