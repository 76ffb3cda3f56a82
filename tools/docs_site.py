"""What MkDocs does besides turning pages into HTML: a hook, named in mkdocs.yml.

Pages link to files of the repository as its readers would; on the site those files are served as they are,
under source/. Formulas become MathML here, so that no script is needed to read one. The API reference has a page for
every room, found where the rooms are.
"""

from __future__ import annotations

import os
import re
from html import unescape
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
ROOMS = sorted(p.parent.name for p in (ROOT / "ori_deploy").glob("*/__init__.py"))
_OUTSIDE = re.compile(r"\]\(((?:\.\./)+)([\w./-]+)\)")
_WORKER = "https://unpkg.com/iframe-worker/shim"
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_config(config: Any) -> Any:
    """Leave out pages that are not there, add the API reference, and Mermaid if it was fetched."""
    config.nav = [entry for given in config.nav if (entry := _present(given)) is not None]
    config.nav.append({"API": ["api/index.md", *(f"api/{room}.md" for room in ROOMS)]})
    if (DOCS / "generated" / "mermaid.min.js").exists():
        config.extra_javascript.append("generated/mermaid.min.js")
    return config


def _present(entry: Any) -> Any:
    if isinstance(entry, str):
        return entry if (DOCS / entry).exists() else None
    ((title, inside),) = entry.items()
    if isinstance(inside, str):
        return entry if (DOCS / inside).exists() else None
    return {title: [page for given in inside if (page := _present(given)) is not None]}


def on_files(files: Files, config: Any) -> Files:
    """Add the API reference and the repository's files that pages link to."""
    files.append(File.generated(config, "api/index.md", content=_api_index()))
    for room in ROOMS:
        page = f"# {room}\n\n::: ori_deploy.{room}\n"
        files.append(File.generated(config, f"api/{room}.md", content=page))
    for path in sorted(_linked_files()):
        name = f"source/{path.relative_to(ROOT)}"
        if path.is_dir():
            listing = "\n".join(f"- [{f.name}]({f.name})" for f in sorted(path.iterdir()) if f.is_file())
            files.append(File.generated(config, f"{name}/index.md", content=f"# {path.name}\n\n{listing}\n"))
        inside = [f for f in sorted(path.iterdir()) if f.is_file()] if path.is_dir() else [path]
        for file in inside:
            served = f"source/{file.relative_to(ROOT)}"
            files.append(File.generated(config, served, abs_src_path=str(file)))
    if "ORI_DOCS_WITHOUT_PICTURES" in os.environ:  # tests of the site do not wait for them
        for page in DOCS.rglob("*.md"):
            for name in re.findall(r"\]\((?:\.\./)*(generated/[\w.-]+)\)", page.read_text()):
                if files.get_file_from_path(name) is None:
                    files.append(File.generated(config, name, content=b""))
    return files


def _api_index() -> str:
    lines = [f"- [{room}]({room}.md): {_first_line(room)}" for room in ROOMS]
    return "# API\n\nWhat the rooms of the house hold, from their docstrings.\n\n" + "\n".join(lines) + "\n"


def _first_line(room: str) -> str:
    text = (ROOT / "ori_deploy" / room / "__init__.py").read_text()
    found = re.search(r'"""(.*?)(?:\n|""")', text)
    return "" if found is None else found.group(1)


def outside_links(page: Path) -> list[tuple[str, Path]]:
    """Links of a page that leave docs/: as written, and the file or folder they are meant for."""
    found = _OUTSIDE.findall(page.read_text())
    every = [(ups + rest, (page.parent / (ups + rest)).resolve()) for ups, rest in found]
    return [(link, path) for link, path in every if not path.is_relative_to(DOCS)]


def _linked_files() -> set[Path]:
    pages = [p for p in DOCS.rglob("*.md") if "generated" not in p.parts]
    return {path for page in pages for _, path in outside_links(page) if path.exists()}


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point links into the repository to where its files are served."""
    del config, files
    here = DOCS / page.file.src_uri
    for link, path in outside_links(here) if here.exists() else ():
        served = f"source/{path.relative_to(ROOT)}" + ("/index.md" if path.is_dir() else "")
        target = os.path.relpath(served, Path(page.file.src_uri).parent)
        markdown = markdown.replace(f"]({link})", f"]({target})")
    return markdown


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Take the search's worker from here, where it was fetched."""
    del config
    if not (DOCS / "generated" / "iframe-worker.js").exists():
        return output
    ups = "../" * page.file.dest_uri.count("/")
    return output.replace(_WORKER, f"{ups}generated/iframe-worker.js")


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Set formulas."""
    del page, config, files
    return _FORMULA.sub(_set, html)


def _set(found: re.Match[str]) -> str:
    tag, formula = found.groups()
    display = "block" if tag == "div" else "inline"
    return f'<{tag} class="arithmatex">{convert(unescape(formula), display=display)}</{tag}>'
