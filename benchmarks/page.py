"""What the operator's page does where a processor draws: `python -m benchmarks.page` from the root.

Frames: a wing of 24 cells unfolds at 1100 x 700. "drawn" counts what the browser puts on its screen, "poses" what of
the motion arrives there; meshes are uploaded once, before. Stop: from just before the button is pressed by the mouse,
the browser's remote control included, to the last cycle in which a hinge was sent another goal, from the flight log.
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
from tests.page.browser import DESKTOP, ROOT, WITHIN_MS, Command, browser, opened, press, state_is, under_control

CELLS, SECONDS, STOPS = 24, 5.0, 10

_COUNT = """seconds => new Promise(done => {
  let drawn = 0, begin = performance.now();
  const next = () => {
    drawn += 1;
    const took = performance.now() - begin;
    if (took > 1e3 * seconds) done(drawn / (1e-3 * took)); else requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
})"""


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
        heard: list[float] = []
        page.on("websocket", lambda ws: ws.on("framereceived", lambda _: heard.append(time.monotonic())))
        page.goto(page_of.address)
        page.wait_for_selector("text=Play", timeout=WITHIN_MS)
        time.sleep(4.0)
        page.click("text=Play")
        begin = time.monotonic()
        drawn = float(page.evaluate(_COUNT, SECONDS))
        poses = sum(t > begin for t in heard) / (time.monotonic() - begin)
    print(
        f"{CELLS} cells, {4 * CELLS} panels, playing: {drawn:.1f} frames/s drawn, {poses:.1f} messages/s; target 30"
    )


def stops(folder: Path) -> None:
    """Print how long a stop takes."""
    design, plan, log = folder / "wing.design.json", folder / "wing.plan.json", folder / "run.mcap"
    save_design(Design("wing", 1.26, build_from_file(ROOT / "examples" / "wing_naca2412.toml")[1]), design)
    rig = ROOT / "examples" / "rig_mock.toml"
    make_plan(design, rig, plan)
    clicked = []
    words = ("serve", plan, "--rig", rig, "--log", log, "--view", "--view-port", 0)
    with Command(*words, cwd=folder) as served, browser() as chromium:
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
    print(f"stop, from the click to the last motion command: {told}; target 100")


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
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
