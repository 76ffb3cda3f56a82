"""Write the controller's diagram and table into docs/safety.md: `python tools/write_state_diagram.py`."""

from __future__ import annotations

from pathlib import Path

from ori_deploy.deploy import diagram

PAGE = Path(__file__).parents[1] / "docs" / "safety.md"
BEGIN, END = "<!-- generated: tools/write_state_diagram.py -->\n", "<!-- end of what is generated -->\n"


def generated() -> str:
    """What belongs between the marks."""
    return f"\n```mermaid\n{diagram.mermaid()}\n```\n\n{diagram.table()}\n\n"


def written(page: str) -> str:
    """The page with what belongs between the marks."""
    head, rest = page.split(BEGIN)
    _, tail = rest.split(END)
    return head + BEGIN + generated() + END + tail


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
