"""Links of all pages lead somewhere: files that are there, headings that are there. Nothing asks the net."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ori_deploy.cli.commands import ENTRIES
from tools.make_doc_pictures import KEPT, NAMES

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(p for p in DOCS.rglob("*.md") if "generated" not in p.parts)]
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```.*?^```$|`[^`\n]+`", re.DOTALL | re.MULTILINE)
_COMING = {"operator-page.md"}
"""Pages that the table of contents has a place for, and that may not be there."""


def links(page: Path) -> list[str]:
    """Targets of a page's links, code left out."""
    every = _LINK.findall(_CODE.sub("", page.read_text()))
    return [target for target in every if not re.match(r"[a-z]+:", target)]


def anchors(page: Path) -> set[str]:
    """Ids that headings get: as the site's `toc` makes them, and as repository browsers do."""
    found: set[str] = set()
    for heading in re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.S | re.M), re.M):
        plain = re.sub(r"[^\w\s-]", "", heading).strip().lower()
        found |= {re.sub(r"[-\s]+", "-", plain), plain.replace(" ", "-")}
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for link in links(page):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if target.parent == DOCS / "generated":
            assert target.name in NAMES, f"{link}: nothing makes this picture"
        elif target.relative_to(ROOT) != Path("docs/api/index.md"):  # written by the site's build
            assert target.exists(), link
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), link


def test_every_picture_that_is_made_is_shown() -> None:
    shown = {Path(link).name for page in PAGES for link in links(page)}
    assert shown >= NAMES


def test_the_commands_page_has_the_programs_commands() -> None:
    told = set(re.findall(r"ori-deploy ([a-z]+)", (DOCS / "commands.md").read_text()))
    also = set(re.findall(r"so are ([a-z, -]+)\.", (DOCS / "commands.md").read_text())[0].split(", "))
    recover = {"recover"}  # told in the same line
    assert told <= ENTRIES.keys()
    assert ENTRIES.keys() - told - also - recover <= {"view"}  # has a page of its own


def test_the_moving_picture_is_small_enough_to_be_kept() -> None:
    data = KEPT.read_bytes()
    assert data[:6] == b"GIF89a"
    assert 50_000 < len(data) < 1_500_000


def test_the_table_of_contents_has_every_page() -> None:
    _, nav = (ROOT / "mkdocs.yml").read_text().split("\nnav:\n")
    named = set(re.findall(r"[\w/-]+\.md", nav))
    here = {str(page.relative_to(DOCS)) for page in PAGES if page.is_relative_to(DOCS)}
    assert here <= named
    assert named - here <= _COMING
