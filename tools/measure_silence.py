"""How long after `kill -9` of a deploying host the board's outputs come to rest: `measure_silence.py 10`, emulated.

With the example rig and its default silence. A run that the machine was too busy for is made again: one in which
goals ran out before, or in which the emulation did not keep up.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from sim_backends.microcontroller.from_rig import world_for_files
from sim_backends.microcontroller.launcher import Microcontroller

ROOT = Path(__file__).parents[1]
RIG = ROOT / "examples" / "rig_wing_mcu.toml"
PROGRAM = [sys.executable, "-u", "-m", "ori_deploy.cli"]
LATE_S = 0.005


def run(folder: Path, *words: str | Path) -> str:
    """A command of the program, to its end."""
    done = subprocess.run([*PROGRAM, *map(str, words)], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


def kill_once(folder: Path) -> float | None:
    """Time from the kill to the last change of a pulse, in s; None when the machine was too busy."""
    port = ("--port", folder / "ttyMCU")
    with Microcontroller(world_for_files(RIG, folder / "plan.json", "stowed"), folder / "ttyMCU") as board:
        board.wait_ready()
        run(folder, "mcu", "config", RIG, "--plan", "plan.json", *port)
        words = [*PROGRAM, "deploy", "plan.json", "--rig", str(RIG), "--port", str(port[1])]
        with subprocess.Popen(
            words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        ) as host:
            assert host.stdout is not None
            next((line for line in host.stdout if "-> moving" in line), None)
            time.sleep(random.uniform(1.5, 4.5))
            killed_s = 1e-6 * board.truth().time_us
            os.kill(host.pid, signal.SIGKILL)
        time.sleep(1.0)
        pulses = board.pulses()
        changes = [pulses.of(k).time_s[1:][np.diff(pulses.of(k).width) != 0][-1] for k in range(4)]
        silent = "host silent" in run(folder, "mcu", "info", *port)
        if not silent or board.lost_s() > LATE_S:
            return None
        return float(max(changes)) - killed_s


def main() -> None:
    """Least, median and largest of so many runs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(folder, "design", ROOT / "examples" / "wing_naca2412.toml", "-o", "design.json")
        run(folder, "plan", "design.json", "--rig", RIG, "-o", "plan.json")
        found: list[float] = []
        while len(found) < int(sys.argv[1]):
            took_s = kill_once(folder)
            print("too busy, once more" if took_s is None else f"{1e3 * took_s:.0f} ms", flush=True)
            found += [] if took_s is None else [took_s]
    least, median, most = 1e3 * np.quantile(found, [0.0, 0.5, 1.0])
    print(f"{len(found)} runs: {least:.0f}, {median:.0f}, {most:.0f} ms")


if __name__ == "__main__":
    main()
