"""What the operator's page does where a processor draws: `python -m benchmarks.page` from the root.

Frames: a wing of 24 cells unfolds at 1100 x 700. "moved" counts frames that the browser drew with other poses than
the one before, found out from the matrices that its WebGL is given; "drawn" counts all that it had time for. Meshes
are uploaded once, before. In software the page asks for half as many pixels to a side: what it truly drew is told.

Stop: from just before the button is pressed by the mouse, the browser's remote control included, to the last cycle in
which a hinge was sent another goal, from the flight log; once with the simulated servos of the rig, and once with
virtual ones on a serial line that is as slow as a true one.
The load of the machine is told because everything here shares its processors.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.search import ring_layout
from ori_deploy.cli.steps import make_plan
from ori_deploy.design import build, embed
from ori_deploy.files import Design, build_from_file, save_design
from ori_deploy.profiles import Naca4
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import read_run
from sim_backends.dynamixel.from_rig import spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from tests.cli.virtual import patient_wing
from tests.page.browser import DESKTOP, ROOT, WITHIN_MS, Command, browser, opened, press, state_is, under_control

CELLS, SECONDS, STOPS = 24, 5.0, 10

_WATCH = """(() => {
  const gl = WebGL2RenderingContext.prototype, set = gl.uniformMatrix4fv;
  let now = [], before = new Set();
  gl.uniformMatrix4fv = function (place, turned, values, ...rest) {
    now.push(values[0] + 3 * values[1] + 7 * values[12] + 11 * values[13] + 13 * values[14]);
    return set.call(this, place, turned, values, ...rest);
  };
  window.countFrames = seconds => new Promise(done => {
    let drawn = 0, moved = 0;
    const begin = performance.now();
    const next = () => {
      drawn += 1;
      if (now.some(one => !before.has(one))) moved += 1;
      if (now.length) before = new Set(now);
      now = [];
      const took = 1e-3 * (performance.now() - begin);
      if (took > seconds) done([drawn / took, moved / took]); else requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
  });
})()"""

_PIXELS = "[...document.querySelectorAll('canvas')].map(c => [c.width * c.height, `${c.width} x ${c.height}`])"


def wing(cells: int) -> Design:
    """A ring of cells on a thick wing; for looking at."""
    profile = Naca4("0024", 0.5)
    layout = ring_layout(cells)
    step = 2.0 * np.pi / cells
    places = {f"O{i + 1}": profile.at_natural(0.1 + i * step) for i in range(cells)}
    places |= {f"C{i + 1}": profile.at_natural(0.1 + (i + 0.5) * step) for i in range(cells)}
    return Design("wing24", 1.0, build(embed(profile, layout, places, {"P": (0.25, 0.0)}), 0.0))


def frames(folder: Path) -> None:
    """Print how many frames there are in a second."""
    path = folder / "wing24.design.json"
    save_design(wing(CELLS), path)
    with Command("view", path, "--port", 0, cwd=folder) as page_of, browser() as chromium:
        page = chromium.new_page(viewport=DESKTOP)  # type: ignore[arg-type]
        page.add_init_script(_WATCH)
        page.goto(page_of.address)
        page.wait_for_selector("text=Play", timeout=WITHIN_MS)
        time.sleep(4.0)
        still = float(page.evaluate("countFrames(1.0)")[1])
        page.click("text=Play")
        drawn, moved = page.evaluate("countFrames", SECONDS)
        _, pixels = max(page.evaluate(_PIXELS))
    print(f"{CELLS} cells, {4 * CELLS} panels, drawn with {pixels} pixels; target 30 frames/s")
    print(f"  playing: {moved:.1f} frames/s moved, {drawn:.1f} drawn; at rest {still:.1f} moved")


def stops(folder: Path) -> None:
    """Print how long a stop takes on simulated servos, in a loop that talks to nobody."""
    design, plan = folder / "wing.design.json", folder / "wing.plan.json"
    save_design(Design("wing", 1.26, build_from_file(ROOT / "examples" / "wing_naca2412.toml")[1]), design)
    rig = ROOT / "examples" / "rig_mock.toml"
    make_plan(design, rig, plan)
    _stops(folder, "simulated servos", plan, "--rig", rig)


def servo_stops(folder: Path) -> None:
    """Print how long a stop takes on virtual servos, over their serial line."""
    folder.mkdir()
    plan = patient_wing(folder, slack_s=0.05, watchdog_s=0.8, lost=10)
    rig = folder / "rig.toml"
    with VirtualBus(spec_for_files(rig, plan, "stowed"), link=folder / "ttyDXL") as bus:
        _stops(folder, "virtual servos", plan, "--rig", rig, "--port", bus.link)


def _stops(folder: Path, which: str, *words: object) -> None:
    log, clicked = folder / "run.mcap", []
    with (
        Command("serve", *words, "--log", log, "--view", "--view-port", 0, cwd=folder) as served,
        browser() as chromium,
    ):
        page = opened(chromium, served.address)
        under_control(page)
        for k in range(STOPS):
            press(page, "Deploy" if k % 2 == 0 else "Stow")
            page.hover("#ori-stop")
            state_is(page, "moving")
            time.sleep(0.8 if k % 2 == 0 else 0.3)
            clicked.append(time.monotonic())
            page.mouse.down()
            page.mouse.up()
            state_is(page, "fault")
            time.sleep(0.3)
            press(page, "Clear fault")
            state_is(page, "armed")
    run = read_run(log)
    moved = run.time_s[1:][(np.diff(run.commanded_rad, axis=0) != 0.0).any(axis=1)]
    ends = [1e3 * (_last(moved, t) - t) for t in clicked]
    told = f"median {statistics.median(ends):.0f} ms, worst {max(ends):.0f} ms of {len(ends)}"
    print(f"stop on {which}, from the click to the last motion command: {told}; target 100")


def _last(moved: Reals, t: float) -> float:
    """The last of the cycles with a motion command that follow each other without a pause from a time on."""
    last = t
    for at in moved[moved > t]:
        if at - last > 0.1:
            break
        last = float(at)
    return last


def main() -> None:
    """Print the table."""
    print(f"page: {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        frames(Path(folder))
        stops(Path(folder))
        servo_stops(Path(folder) / "servos")
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
