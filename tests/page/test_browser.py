"""The page in a real Chromium: what is drawn, what sliders and buttons do, and that its loss is no command."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from ori_deploy.files import load_design
from ori_deploy.operate.client import ask, find
from ori_deploy.operate.messages import Do, Request, Status
from ori_deploy.page.content import content_of
from ori_deploy.page.placing import Mover
from ori_deploy.page.viewer import eye_of
from tests.page.browser import (
    CHROMIUM,
    DESKTOP,
    PHONE,
    Command,
    browser,
    opened,
    page_process,
    press,
    state_is,
    under_control,
)
from tests.page.conftest import RIG, ServoWing

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
    pytest.mark.usefixtures("runtime_folder"),
]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as one:
        yield one


def pixels(page: Page) -> NDArray[np.uint8]:
    """(height, width, 3) what is on the screen."""
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))


def hue_is(seen: NDArray[np.uint8], colour: tuple[int, int, int]) -> bool:
    """Whether a pixel is a lighter or darker shade of a colour."""
    a, b = seen.astype(float), np.array(colour, dtype=float)
    a, b = a - a.min() * 0.9, b - b.min() * 0.9
    return bool(a @ b / (np.linalg.norm(a) * np.linalg.norm(b) + 1e-9) > 0.9)


def status_of(served: Command) -> Status:
    served.said("(serving)")
    told = next(iter(ask(find(pid=served.process.pid), Request(Do.STATUS)))).status
    assert told is not None
    return told


def test_panels_are_drawn_where_the_kinematics_put_them(made: Path, tmp_path: Path, chromium: Browser) -> None:
    design = load_design(made / "wing.design.json")
    content, mover = content_of(design), Mover(design)
    with Command("view", made / "wing.design.json", "--port", 0, cwd=tmp_path) as shown:
        page = opened(chromium, shown.address)
        page.wait_for_selector("text=No interference of panels")
        page.wait_for_timeout(1500)
        drawn = pixels(page)
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        page.close()
    matrices = mover.panels(np.ones(4)).matrices()
    numbers = {name: k for k, name in enumerate(mover.mechanism.layout.panel_ids)}
    found = 0
    for panel in content.panels:
        m = matrices[numbers[panel.id]]
        corners = panel.solid.vertices @ m[:3, :3].T + m[:3, 3]
        # Middles of the skin's facets, of those that look at the eye and are not hidden: upper ones.
        a, b, c = corners[panel.solid.faces].transpose(1, 0, 2)
        up = np.cross(b - a, c - a)[:, 1] / np.linalg.norm(np.cross(b - a, c - a), axis=1)
        largest = int(np.argmax(np.where(up > 0.9, np.linalg.norm(np.cross(b - a, c - a), axis=1), 0.0)))
        middle = (a[largest] + b[largest] + c[largest]) / 3.0
        if up[largest] < 0.9 or middle[1] < _top(corners, middle) - 1e-3:
            continue
        x, y = projected(middle, *eye_of(mover, content), box)  # type: ignore[arg-type]
        found += hue_is(drawn[round(y), round(x)], panel.colour)
    assert found >= 3
    canvas = drawn[int(box["y"]) + 10 :, : int(box["x"] + box["width"]) - 10]
    assert 0.03 < float((canvas.min(axis=2) < 200).mean()) < 0.6


def _top(corners: NDArray[np.float64], middle: NDArray[np.float64]) -> float:
    """Height of a panel's own top near a place: facets below it are inner faces."""
    near = np.abs(corners[:, 0] - middle[0]) < 0.02
    return float(corners[near, 1].max(initial=middle[1]))


def projected(
    place: NDArray[np.float64], eye: NDArray[np.float64], target: NDArray[np.float64], box: dict[str, float]
) -> tuple[float, float]:
    """Where a place is on the screen: viser's camera sees 75 degrees from top to bottom."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    seen = place - eye
    scale = 0.5 * box["height"] / np.tan(np.radians(37.5)) / float(seen @ ahead)
    x, y = scale * float(seen @ right), scale * float(seen @ up)
    return box["x"] + 0.5 * box["width"] + x, box["y"] + 0.5 * box["height"] - y


def test_sliders_move_all_cells_or_one_and_what_collides_turns_red(
    made: Path, tmp_path: Path, chromium: Browser
) -> None:
    with Command("view", made / "wing.plan.json", "--port", 0, cwd=tmp_path) as shown:
        page = opened(chromium, shown.address)
        page.wait_for_selector("text=No interference of panels")
        page.wait_for_timeout(800)
        before = pixels(page)
        fold = page.get_by_role("slider").nth(1)
        fold.focus()
        page.keyboard.press("Home")
        page.wait_for_selector("text=lie against each other")
        page.wait_for_function("document.querySelector('[role=slider]').getAttribute('aria-valuenow') < 0.02")  # time
        page.wait_for_timeout(800)
        assert (np.abs(pixels(page)[:, :700].astype(int) - before[:, :700]) > 40).any(axis=2).mean() > 0.02
        page.keyboard.press("End")
        page.locator('input:not([type=hidden])[value="all cells"]').first.click()
        page.get_by_role("option", name="c2").click()
        fold.focus()
        page.keyboard.press("Home")
        page.wait_for_selector("text=reach into each other")
        page.wait_for_timeout(800)
        red = pixels(page)[80:, :700].astype(int)
        assert ((red[..., 0] > 150) & (red[..., 1] < 60) & (red[..., 2] < 70)).sum() > 500
        assert re.search(r"c1\.\w+\s+c2\.\w+\s+\d+\.\d\d mm", page.inner_text("body"))
        page.close()


def test_a_flight_is_played_again(made: Path, tmp_path: Path, chromium: Browser) -> None:
    with Command("view", made / "run.mcap", "--port", 0, cwd=tmp_path) as shown:
        page = opened(chromium, shown.address)
        page.click("text=Play")
        page.wait_for_function("[...document.querySelectorAll('input')].some(i => i.value === 'open')")
        page.wait_for_selector("text=latch open")
        assert page.inner_text("body").count("slit:P-T2") == 1
        page.click("text=Plots")
        page.wait_for_selector("text=temperature")
        assert page.locator(".uplot canvas").count() == 3
        page.close()


def test_deployed_watched_and_stopped_from_the_keyboard(
    servo_wing: ServoWing, tmp_path: Path, chromium: Browser
) -> None:
    stowed = servo_wing.shafts()
    with Command(*servo_wing.serving, cwd=tmp_path) as served:
        page, other = opened(chromium, served.address), opened(chromium, served.address, PHONE)
        state_is(page, "ready")
        for one, size in ((page, DESKTOP), (other, PHONE)):
            box = one.locator("#ori-stop").bounding_box()
            assert box is not None
            assert box["width"] >= 120
            assert box["height"] >= 50
            assert box["x"] + box["width"] <= size["width"]
        assert page.locator("#ori button", has_text="Arm").is_disabled()  # looking gives no control
        under_control(page)
        assert servo_wing.shafts() == pytest.approx(stowed, abs=1e-3)  # armed is not moved
        other.wait_for_function("document.getElementById('ori-control').title === 'Somebody else commands'")
        assert other.locator("#ori button", has_text="Deploy").is_disabled()
        press(page, "Deploy")
        state_is(other, "moving")
        press(page, "Pause")
        assert "hold" in state_is(page, "hold")
        press(page, "Resume")
        state_is(page, "moving")
        while servo_wing.shafts() == pytest.approx(stowed, abs=0.1):
            page.wait_for_timeout(50.0)
        other.keyboard.press("Space")  # everybody may stop
        state_is(page, "fault")
        assert "emergency_stop" in page.inner_text("#ori-alarm")
        assert (status_of(served).fold or 0.0) < 1.0
        rest = servo_wing.shafts()
        page.wait_for_timeout(500.0)
        assert servo_wing.shafts() == pytest.approx(rest, abs=2e-3)
        other.wait_for_selector("#ori >> text=Take control")
        press(other, "Take control")
        other.wait_for_selector("#ori >> text=Give control")
        press(other, "Clear fault")
        state_is(other, "armed")
        page.close()
        other.close()


def deploying(chromium: Browser, served: Command) -> Page:
    """A page that has begun a deployment."""
    page = opened(chromium, served.address)
    under_control(page)
    press(page, "Deploy")
    state_is(page, "moving")
    return page


def test_its_loss_stops_no_motion_and_starts_none_and_it_connects_again(
    servo_wing: ServoWing, tmp_path: Path, chromium: Browser
) -> None:
    with Command(*servo_wing.serving, cwd=tmp_path) as served:
        page = deploying(chromium, served)
        page.context.set_offline(True)
        page.close()
        assert status_of(served).state == "moving"
        again = opened(chromium, served.address)
        assert state_is(again, "moving", "deployed")
        served.said(r"(succeeded)")
        state_is(again, "deployed")
        assert again.inner_text("#ori-control") == "Take control"  # who left gave it back
        press(again, "Take control")
        again.wait_for_selector("#ori >> text=Give control")
        deployed = servo_wing.shafts()
        again.evaluate("window.__ori.close()")
        again.wait_for_selector("#ori >> text=not connected")
        again.wait_for_selector("#ori >> text=Give control")
        assert status_of(served).state == "deployed"
        assert servo_wing.shafts() == pytest.approx(deployed, abs=2e-3)
        again.close()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_page_that_dies_or_hangs_stops_no_motion_and_starts_none(
    servo_wing: ServoWing, tmp_path: Path, chromium: Browser, how: signal.Signals
) -> None:
    with Command(*servo_wing.serving, cwd=tmp_path) as served:
        page = deploying(chromium, served)
        process = page_process(served)
        os.kill(process, how)
        try:
            assert status_of(served).state == "moving"
            served.said(r"(succeeded)")
            deployed = servo_wing.shafts()
            assert status_of(served).state == "deployed"
            page.wait_for_function("document.getElementById('ori-alarm').offsetHeight > 0")
            assert servo_wing.shafts() == pytest.approx(deployed, abs=2e-3)
            assert status_of(served).state == "deployed"
        finally:
            page.close()
            if how == signal.SIGSTOP:
                os.kill(process, signal.SIGKILL)


def test_without_the_token_there_is_nothing(made: Path, tmp_path: Path) -> None:
    with Command("view", made / "wing.design.json", "--port", 0, cwd=tmp_path) as shown:
        base = shown.address.rsplit("/", 1)[0]
        for address in (base, f"{base}/", f"{base}/guess"):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(address)
        socket = shown.address.replace("http", "ws")
        for wrong in (base.replace("http", "ws"), f"{base.replace('http', 'ws')}/guess/operate"):
            with pytest.raises(InvalidStatus):
                connect(wrong)
        with pytest.raises(InvalidStatus):
            connect(socket, origin="http://evil.example")  # type: ignore[arg-type]
        with urllib.request.urlopen(shown.address) as answer:
            assert b"root" in answer.read()
            assert answer.headers["Referrer-Policy"] == "no-referrer"


def test_a_message_that_is_none_of_ours_changes_nothing(made: Path, tmp_path: Path) -> None:
    words = ("serve", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*words, cwd=tmp_path) as served, connect(served.address.replace("http", "ws") + "/operate") as link:
        for words_ in ("", "[]", '{"do": "arm"}', '{"do": "deploy"}', b"\x00", '{"do": ["stop"]}'):
            link.send(words_)
        answers = []
        while len(answers) < 2:
            told = json.loads(link.recv(20.0))
            answers += [told["answer"]] if "answer" in told else []
        assert [one["took"] for one in answers] == [False, False]
        assert "control" in answers[0]["why"]
        assert status_of(served).state == "ready"
