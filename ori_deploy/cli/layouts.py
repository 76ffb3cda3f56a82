"""`ori-deploy layouts`: which layouts there are, and whether a graph is one."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import click

from ori_deploy.errors import InputError
from ori_deploy.files import DrawnLayout, load_graph, write_atomically
from ori_deploy.layout import (
    Layout,
    PlaneTree,
    count_by_inner,
    folds_flat_with_some_slits,
    layout_of,
    layouts,
    opening_vertices_on_outline,
    slit_choices,
)

MOST_CELLS = 14
"""About 140 million layouts: half an hour to count, and sixfold with every cell more."""
_DRAWINGS = (".svg", ".png")
_PATH = click.Path(path_type=Path, dir_okay=False)


@click.command(name="layouts", epilog="\b\nExample:\n  ori-deploy layouts --cells 5 --inner 1 --draw layouts.svg")
@click.option("--cells", type=int, metavar="K", help=f"Every layout of K cells; up to {MOST_CELLS}.")
@click.option("--inner", type=int, metavar="N", help="Only those with N inner vertices.")
@click.option("--mirror-apart", is_flag=True, help="Count mirror images apart instead of once.")
@click.option("--foldable", is_flag=True, help="Only those that some choice of slits lets fold flat.")
@click.option("--graph", type=_PATH, help="Instead: check a planar graph (TOML or JSON) and make it a layout.")
@click.option("--count", is_flag=True, help="Only how many there are.")
@click.option("--json", "as_json", is_flag=True, help="For programs.")
@click.option("--draw", type=_PATH, help="Contact sheet to write (.svg or .png).")
def layouts_command(
    cells: int | None,
    inner: int | None,
    mirror_apart: bool,
    foldable: bool,
    graph: Path | None,
    count: bool,
    as_json: bool,
    draw: Path | None,
) -> None:
    """List the layouts of K cells: code, inner vertices, symmetry, slits.

    A code has the number of cells at each closing vertex, along a walk round the outline, with a star
    where the outline passes; 14141414 is four cells round an inner vertex. The symmetry is the number
    of rotations and reflections that map the layout to itself. Slit choices are counted up to symmetry.
    """
    _check_words(cells, inner, mirror_apart, graph, count, draw)
    rule = folds_flat_with_some_slits if foldable else opening_vertices_on_outline
    if graph is not None:
        drawn = load_graph(graph, allowable=rule)
        _print_all(iter([_of_graph(drawn)]), as_json=as_json)
        if not as_json:
            _print_for_specification(drawn.layout)
        if draw is not None:
            _draw_graph(drawn, graph.stem, draw)
    elif cells is not None and count:
        by_inner = count_by_inner(cells, inner=inner, mirror_apart=mirror_apart, allowable=rule)
        _print_count(cells, by_inner, as_json=as_json)
    elif cells is not None:
        trees = layouts(cells, inner=inner, mirror_apart=mirror_apart, allowable=rule)
        _print_all((_of_tree(tree, mirror_apart) for tree in trees), as_json=as_json)
    if draw is not None and cells is not None:
        which = f"{f', {inner} inner' if inner is not None else ''}{', mirror images apart' if mirror_apart else ''}"
        which += ", those that fold flat" if foldable else ""
        _draw_layouts(
            lambda: layouts(cells, inner=inner, mirror_apart=mirror_apart, allowable=rule), cells, which, draw
        )
    if draw is not None:
        click.echo(f"written {draw}", err=as_json)


def _check_words(
    cells: int | None, inner: int | None, mirror_apart: bool, graph: Path | None, count: bool, draw: Path | None
) -> None:
    if (cells is None) == (graph is None):
        raise InputError(
            "layouts: give either --cells or --graph",
            value="both" if graph else "neither",
            remedy="--cells 4 lists all layouts of 4 cells, --graph FILE checks one",
        )
    if graph is not None and (inner is not None or count or mirror_apart):
        raise InputError(
            "--graph: checks one layout", limit="no --inner, --count, --mirror-apart", remedy="leave them out"
        )
    if cells is not None and cells > MOST_CELLS:
        raise InputError(
            "--cells: too many to go through",
            value=cells,
            limit=f"{MOST_CELLS}: about 140 million layouts, half an hour; sixfold with every cell more",
            remedy="ask for fewer cells",
        )
    if draw is not None and draw.suffix.lower() not in _DRAWINGS:
        raise InputError("--draw: not a drawing", value=draw, limit=".svg or .png", remedy="choose another name")


def _print_count(cells: int, by_inner: dict[int, int], *, as_json: bool) -> None:
    total = sum(by_inner.values())
    if as_json:
        click.echo(json.dumps({"cells": cells, "total": total, "by_inner": {str(n): c for n, c in by_inner.items()}}))
        return
    click.echo(_how_many(total, cells))
    for n, c in by_inner.items():
        click.echo(f"{c:>12} with {n} inner")


def _how_many(total: int, cells: int) -> str:
    return f"{total} layout{'s' * (total != 1)} of {cells} cell{'s' * (cells != 1)}"


def _of_tree(tree: PlaneTree, mirror_apart: bool) -> dict[str, Any]:
    return _told(tree, tree, mirror_apart)


def _of_graph(drawn: DrawnLayout) -> dict[str, Any]:
    tree, _ = PlaneTree.of(drawn.layout)
    return _told(tree.canonical(), drawn.layout, mirror_apart=False)


def _told(tree: PlaneTree, layout: PlaneTree | Layout, mirror_apart: bool) -> dict[str, Any]:
    """What there is to say of a layout, its vertices named as `layout` does."""
    ids = [v.id for v in layout.vertices]
    foldable = slit_choices(layout, mirror_apart=mirror_apart)
    told = {
        "code": tree.code,
        "inner": tree.n_inner,
        "vertices": [{"id": v.id, "role": v.role, "inner": v.inner} for v in layout.vertices],
        "cells": [[ids[v] for v in cell] for cell in layout.cells],
        "slits": [[[ids[a], ids[b]] for a, b in choice] for choice in foldable],
        "slit_choices": sum(1 for _ in slit_choices(layout, foldable=False, mirror_apart=mirror_apart)),
        "symmetry_order": len(tree.symmetries()),
        "rotations": len(tree.symmetries(mirror_apart=True)),
    }
    if isinstance(layout, Layout):
        told["outline"] = [ids[v] for v in layout.outline]
        told["given_slits"] = [[ids[a], ids[b]] for a, b in layout.slits]
    return told


def _print_all(found: Iterator[dict[str, Any]], *, as_json: bool) -> None:
    """One at a time: there may be more than memory holds."""
    if as_json:
        between = "["
        for told in found:
            click.echo(between + json.dumps(told), nl=False)
            between = ",\n"
        click.echo("]" if between != "[" else "[]")
        return
    first = next(found, None)
    if first is None:
        click.echo("no layouts")
        return
    for told in chain([first], found):
        slits = f"{len(told['slits'])} of {told['slit_choices']} slit choices" if told["inner"] else "no slits"
        flat = "folds flat" if told["slits"] else "cannot fold flat"
        click.echo(
            f"{told['code']:<24} {told['inner']} inner   symmetry {told['symmetry_order']:<2}   {flat}, {slits}"
        )


def _print_for_specification(layout: Layout) -> None:
    """The layout as the tables of a specification have it."""
    ids = [v.id for v in layout.vertices]
    for name, lists in (("cells", layout.cells), ("slits", layout.slits)):
        click.echo(f"{name} = {json.dumps([[ids[v] for v in entry] for entry in lists])}")


def _draw_layouts(find: Callable[[], Iterator[PlaneTree]], cells: int, which: str, path: Path) -> None:
    from ori_deploy.view.contact_sheet import MOST_DRAWN, Entry

    shown = sorted(islice(find(), MOST_DRAWN), key=lambda tree: tree.n_inner)
    total = sum(1 for _ in find())
    title = _how_many(total, cells) + which
    _write_sheet(
        [Entry(made, _caption(tree, made)) for tree in shown for made in [layout_of(tree)]], title, total, path
    )


def _draw_graph(drawn: DrawnLayout, name: str, path: Path) -> None:
    import numpy as np

    from ori_deploy.view.contact_sheet import Entry

    tree, _ = PlaneTree.of(drawn.layout)
    entry = Entry(drawn.layout, _caption(tree.canonical(), drawn.layout), np.array(drawn.places))
    _write_sheet([entry], name, 1, path)


def _caption(tree: PlaneTree, layout: Layout) -> str:
    if not layout.overfull_vertices:
        return tree.code
    never = next(slit_choices(tree), None) is None
    return f"{tree.code}\n{'cannot fold flat' if never else 'cannot fold flat with this slit'}"


def _write_sheet(entries: list[Any], title: str, total: int, path: Path) -> None:
    from ori_deploy.view import to_png, to_svg
    from ori_deploy.view.contact_sheet import draw_contact_sheet

    figure = draw_contact_sheet(entries, title=title, total=total)
    write_atomically(path, to_png(figure) if path.suffix.lower() == ".png" else to_svg(figure))
