"""docs/safety.md: every promise has its test, every test is there, the diagram is the table's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ori_deploy.deploy.states import RULES, Event, State
from tools.write_state_diagram import PAGE, written

ROOT = Path(__file__).parents[1]
ROWS = [
    tuple(cell.strip() for cell in line.split("|")[1:-1])
    for line in PAGE.read_text().splitlines()
    if line.startswith("| SAFE-")
]
NAMES = {
    name
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(r"^(?:def |)(test_\w+|TestCampaign)\b", path.read_text(), re.MULTILINE)
}


def test_there_are_promises_numbered_in_order() -> None:
    assert len(ROWS) > 30
    assert [row[0] for row in ROWS] == [f"SAFE-{k:02d}" for k in range(1, len(ROWS) + 1)]
    assert all(len(row) == 4 for row in ROWS)
    assert PAGE.read_text().count("| SAFE-") == len(ROWS)  # none is written in a way that is not checked


@pytest.mark.parametrize(("name", "promise", "limit", "test"), ROWS, ids=[row[0] for row in ROWS])
def test_every_promise_has_a_test_that_exists(name: str, promise: str, limit: str, test: str) -> None:
    assert promise, name
    assert test in NAMES, f"{name} ({limit}): no such test"


def test_no_two_promises_share_a_test() -> None:
    tests = [row[3] for row in ROWS]
    assert len(set(tests)) == len(tests)


def test_the_diagram_is_that_of_the_table() -> None:
    page = PAGE.read_text()
    assert written(page) == page, "run python tools/write_state_diagram.py"
    for state in State:
        assert str(state) in page
    for event in Event:
        assert str(event) in page
    assert len({event for _, event in RULES}) == len(Event)
