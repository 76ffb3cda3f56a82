"""The how-to pages' code does what they say."""

from __future__ import annotations

import inspect
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.wire.dynamixel import MODELS, models
from tools.doc_blocks import blocks

ROOT = Path(__file__).parents[2]
HOW_TO = ROOT / "docs" / "how-to"
PORT_H = (ROOT / "firmware" / "core" / "port.h").read_text()


def run_python(page: str, given: dict[str, Any] | None = None) -> dict[str, Any]:
    """A page's Python, block after block in one module; the names that it leaves."""
    names: dict[str, Any] = dict(given or {})
    for number, text in enumerate(blocks(HOW_TO / page, "python"), 1):
        exec(compile(text, f"{page}, block {number}", "exec", dont_inherit=True), names)
    return names


def test_the_new_profile_is_right_builds_and_deploys() -> None:
    egg = run_python("new-profile.md")["egg"]
    assert egg.is_convex


def test_the_new_servo_is_not_there_yet_and_its_line_makes_a_model() -> None:
    model = run_python("new-servo-model.md", vars(models))["model"]
    assert model.name not in {known.name for known in MODELS}
    assert model.number not in {known.number for known in MODELS}


def test_the_new_backend_has_every_method_that_a_bus_leaves_open() -> None:
    names = run_python("new-backend.md")
    assert not names["IdealBus"].__abstractmethods__
    left_open = {name for name, of in inspect.getmembers(ActuatorBus) if getattr(of, "__isabstractmethod__", False)}
    assert left_open <= vars(names["IdealBus"]).keys()
    assert len(left_open) == 9
    assert "nine small methods" in (HOW_TO / "new-backend.md").read_text()


def test_the_skeleton_of_a_port_has_all_of_port_h(tmp_path: Path) -> None:
    (skeleton,) = blocks(HOW_TO / "new-microcontroller.md", "c")
    wanted = set(re.findall(r"\b(port_\w+)\([^)]*\);", PORT_H))
    assert wanted == set(re.findall(r"\b(port_\w+)\([^)]*\) \{", skeleton))
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    source = tmp_path / "main.c"
    source.write_text(skeleton)
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{ROOT / 'firmware' / 'core'}"]
    done = subprocess.run(["gcc", *flags, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", sorted(HOW_TO.glob("*.md")), ids=lambda page: page.stem)
def test_what_a_page_sends_readers_to_is_there(page: Path) -> None:
    text = page.read_text()
    for name in re.findall(r"`((?:ori_deploy|tests|sim_backends|firmware|examples)/[\w/.]+)`", text):
        assert (ROOT / name).exists(), name
    said: dict[str, Callable[[], str]] = {
        "`VertexSpec.parameter`": lambda: (ROOT / "ori_deploy/files/spec.py").read_text(),
        "`_FAMILIES`": lambda: (ROOT / "ori_deploy/profiles/__init__.py").read_text(),
        "`PlaneProfileSpec`": lambda: (ROOT / "ori_deploy/files/profile_spec.py").read_text(),
        "`Backend`": lambda: (ROOT / "ori_deploy/actuators/rig.py").read_text(),
        "`MODELS`": lambda: (ROOT / "ori_deploy/wire/dynamixel/models.py").read_text(),
    }
    for words, source in said.items():
        if words in text:
            assert words.strip("`").split(".")[-1] in source()
