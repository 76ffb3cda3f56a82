"""A real Chromium without a window, and the page of a running controller in it."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
"""As root and without a graphics card; WebGL is then drawn by the processor."""

DESKTOP, PHONE = {"width": 1100, "height": 700}, {"width": 390, "height": 844}
WITHIN_MS = 40_000.0
ROOT = Path(__file__).parents[2]


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser of its own."""
    assert CHROMIUM is not None
    with sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        try:
            yield chromium
        finally:
            chromium.close()


def opened(chromium: Browser, address: str, size: dict[str, int] = DESKTOP) -> Page:
    """The page, connected, without viser's word about slow drawing."""
    page = chromium.new_page(viewport=size)  # type: ignore[arg-type]
    page.set_default_timeout(WITHIN_MS)
    page.goto(address)
    page.wait_for_selector("canvas")
    page.add_style_tag(content=".mantine-Notification-root { display: none !important; }")
    return page


class Command:
    """A command of `ori-deploy` that serves a page, in a process of its own; for `with`.

    Attributes
    ----------
    address
        Of its page.
    """

    def __init__(self, *words: object, cwd: Path) -> None:
        line = [sys.executable, "-m", "ori_deploy.cli", *(str(word) for word in words)]
        self.told = (cwd / "told.txt").open("w+")
        self.process = subprocess.Popen(line, cwd=cwd, stdout=self.told, stderr=subprocess.STDOUT, text=True)
        self.address = ""

    def __enter__(self) -> Command:
        self.address = self.said(r"page: (http\S+)")
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(20.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.told.close()

    @property
    def output(self) -> str:
        """All it has said so far."""
        return Path(self.told.name).read_text()

    def said(self, pattern: str) -> str:
        """Wait until it has said something; the pattern's group."""
        for _ in range(1200):
            found = re.search(pattern, self.output)
            if found is not None:
                return found.group(1)
            if self.process.poll() is not None:
                break
            try:
                self.process.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        raise AssertionError(f"never said {pattern!r}: {self.output}")


def page_process(served: Command) -> int:
    """The process of a command's page, by its id."""
    pid = served.process.pid
    children = Path(f"/proc/{pid}/task").glob("*/children")
    for child in " ".join(file.read_text() for file in children).split():
        if b"ori_deploy.page" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    raise AssertionError("no page")


def state_is(page: Page, *states: str) -> str:
    """Wait until the bar tells one of these states; all that it tells."""
    page.wait_for_function(
        "states => states.some(s => document.getElementById('ori-state').textContent.startsWith(s))", arg=list(states)
    )
    return page.inner_text("#ori-state")


def press(page: Page, name: str) -> None:
    """Press a button of the bar as soon as it can be pressed."""
    page.locator("#ori button", has_text=name).click()


def under_control(page: Page) -> None:
    """Take control and arm."""
    state_is(page, "ready", "armed")
    press(page, "Take control")
    page.wait_for_selector("#ori >> text=Give control")
    press(page, "Arm")
    state_is(page, "armed")
