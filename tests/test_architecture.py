"""The house stays as drawn: rooms import only rooms to their left."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMMON = {"errors", "tolerance", "clock", "realtime", "spelling"}
ALLOWED: dict[str, set[str]] = {
    "profiles": set(),
    "layout": set(),
    "design": {"profiles", "layout"},
    "motion": {"profiles", "layout", "design"},
    "loads": {"profiles", "layout", "design", "motion"},
    "search": {"profiles", "layout", "design", "motion"},
    "aero": {"profiles", "design", "motion", "loads"},
    "files": {"profiles", "layout", "design", "motion", "loads", "search", "aero"},
    "figures": {"profiles", "layout", "design", "motion", "search", "files"},
    "export": {"profiles", "layout", "design", "motion", "loads", "files"},
    "wire": set(),
    "actuators": {"wire", "runtime_dir"},
    "bench": {"actuators", "wire"},
    "deploy": {"motion", "actuators"},
    "operate": {"motion", "actuators", "deploy", "runtime_dir"},
    "telemetry": {"motion", "actuators", "deploy"},
    "mav": {"motion", "actuators", "deploy", "operate", "wire", "files", "telemetry", "runtime_dir"},
    "sweep": {"profiles", "layout", "design", "motion", "files", "search"},
    "page": {
        "profiles",
        "layout",
        "design",
        "motion",
        "actuators",
        "deploy",
        "operate",
        "telemetry",
        "files",
        "view",
        "runtime_dir",
    },
    "view": {
        "profiles",
        "layout",
        "design",
        "motion",
        "telemetry",
        "deploy",
        "actuators",
        "files",
        "figures",
        "aero",
    },
}
"""What each room may import, besides what all may. The command line knows them all."""
NO_IO = ("profiles", "layout", "design", "motion", "loads")
GEOMETRY_MAY_IMPORT = {"numpy", "scipy", "shapely", "toppra"}


def modules(room: str) -> list[Path]:
    return sorted((ROOT / "ori_deploy" / room).rglob("*.py"))


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


def test_every_room_is_on_the_plan() -> None:
    rooms = {p.name for p in (ROOT / "ori_deploy").iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert rooms == {*ALLOWED, "cli"}


@pytest.mark.parametrize("room", ALLOWED)
def test_rooms_import_only_what_the_plan_allows(room: str) -> None:
    for path in modules(room):
        for name in imports(path):
            parts = name.split(".")
            if parts[0] == "sim_backends":
                pytest.fail(f"{path} imports {name}")
            if parts[0] == "ori_deploy" and len(parts) > 1:
                assert parts[1] in ALLOWED[room] | COMMON | {room}, f"{path} imports {name}"


def test_simulators_know_nothing_of_the_controller() -> None:
    geometry = {"profiles", "layout", "design", "motion", "loads"}
    for path in (ROOT / "sim_backends").rglob("*.py"):
        is_plant = path.name == "plant.py" or "physics" in path.parts
        allowed = {"actuators", "wire", "files", *COMMON} | (geometry if is_plant else set())
        for name in imports(path):
            if name.startswith("ori_deploy."):
                assert name.split(".")[1] in allowed, f"{path} imports {name}"


@pytest.mark.parametrize("room", NO_IO)
def test_geometry_does_no_io_and_reads_no_clock(room: str) -> None:
    standard = {
        "abc",
        "collections",
        "dataclasses",
        "functools",
        "itertools",
        "re",
        "typing",
        "__future__",
        "logging",
    }
    for path in modules(room):
        for name in imports(path):
            top = name.split(".")[0]
            assert top in standard | GEOMETRY_MAY_IMPORT | {"ori_deploy"}, f"{path} imports {name}"
        assert not re.search(r"\b(open|print)\(", path.read_text()), path


def test_files_are_one_idea_long() -> None:
    ours = [
        p for top in ("ori_deploy", "sim_backends") for p in (ROOT / top).rglob("*.py") if "generated" not in p.parts
    ]
    assert not [p for p in ours if len(p.read_text().splitlines()) > 500]
