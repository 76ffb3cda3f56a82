"""Which inner edge at each inner vertex is left unbonded: all choices, up to the layout's symmetries.

The bonds that remain always join all cells into one tree: the inner edges round an inner vertex are the
only cycle of neighbours there, an inner edge has one inner vertex at most, and one of each cycle is left
out. What a choice decides is whether the structure folds flat: at an opening vertex every bonded cell of a
row opens to 180 degrees, so a row of three would have the first and the third in the same place.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ori_deploy.layout.layout import Layout, Vertex, make_layout
from ori_deploy.layout.plane_tree import Cells, PlaneTree

Slits = tuple[tuple[int, int], ...]
"""(inner closing vertex, opening vertex) index pairs, by inner vertex: as `Layout.slits`."""


def slit_choices(
    layout: Layout | PlaneTree,
    *,
    foldable: bool = True,
    up_to_symmetry: bool = True,
    mirror_apart: bool = False,
) -> Iterator[Slits]:
    """All choices of one slit per inner vertex; the cells stay bonded into one tree with each.

    Parameters
    ----------
    layout
        The slits of a `Layout` are not looked at.
    foldable
        Only choices with which the structure folds flat, that is with `Layout.overfull_vertices` empty.
        A layout may have none: then it deploys with any slits, and folds flat with none.
    up_to_symmetry
        Of choices that a symmetry of the layout exchanges, only one.
    mirror_apart
        Whether reflections are no symmetries here.

    Yields
    ------
    Slits
        Vertex indices, in the order of the inner vertices. One empty choice where nothing is inside.

    Raises
    ------
    LayoutError
        A `Layout` with an opening vertex inside, as another allowable rule may let pass.
    """
    if isinstance(layout, Layout):
        tree, place = PlaneTree.of(layout)
    else:
        tree, place = layout, tuple(range(len(layout.vertices)))
    group = tree.symmetries(mirror_apart=mirror_apart)[1:] if up_to_symmetry else ()
    for choice in _choices(tree, foldable):
        if all(choice <= tuple(sorted((g.images[a], g.images[b]) for a, b in choice)) for g in group):
            yield tuple(sorted((place[a], place[b]) for a, b in choice))


def _choices(tree: PlaneTree, foldable: bool) -> Iterator[Slits]:
    """Depth first over the inner vertices, in the order of the tree's vertices."""
    edges: list[list[tuple[int, int]]] = [[] for _ in range(tree.n_inner)]
    for edge in tree.inner_edges:
        if edge[0] < tree.n_inner:
            edges[edge[0]].append(edge)
    # Of two inner edges that are next to each other at an opening vertex one has to be a slit.
    pairs = _neighbours(tree) if foldable else []
    if any(min(a, b)[0] >= tree.n_inner for a, b in pairs):
        return
    due: list[list[tuple[tuple[int, int], tuple[int, int]]]] = [[] for _ in range(tree.n_inner)]
    for a, b in pairs:
        last = max(edge[0] for edge in (a, b) if edge[0] < tree.n_inner)
        due[last].append((a, b))

    def extend(chosen: Slits) -> Iterator[Slits]:
        at = len(chosen)
        if at == tree.n_inner:
            yield chosen
            return
        for edge in sorted(edges[at]):
            longer = (*chosen, edge)
            if all(a in longer or b in longer for a, b in due[at]):
                yield from extend(longer)

    yield from extend(())


def _neighbours(tree: PlaneTree) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Pairs of inner edges with one cell between them at their opening vertex."""
    edges = iter(tree.inner_edges)
    round_outline = [None if letter & 1 else next(edges) for letter in tree.word]
    after = [*round_outline[1:], round_outline[0]]
    return [(a, b) for a, b in zip(round_outline, after, strict=True) if a is not None and b is not None]


def layout_of(tree: PlaneTree, slits: Iterable[tuple[str, str]] | None = None) -> Layout:
    """A layout with slits.

    Parameters
    ----------
    slits
        By vertex ids. Left out: the first choice with which the structure folds flat; where there is none,
        the first choice at all, and `Layout.overfull_vertices` says why it does not.

    Raises
    ------
    LayoutError
        Slits that are not one per inner vertex.
    """
    if slits is None:
        fallback = slit_choices(tree, foldable=False)
        chosen = next(slit_choices(tree), None) or next(fallback)
        slits = [(tree.vertices[a].id, tree.vertices[b].id) for a, b in chosen]
    return make_layout(tree.vertices, tree.cell_names, slits)


def folds_flat_with_some_slits(vertices: tuple[Vertex, ...], cells: Cells) -> str | None:
    """An allowable rule stricter than the usual one: some choice of slits lets the structure fold flat."""
    tree, place = PlaneTree.of(Layout(vertices, cells, ()))
    if next(_choices(tree, foldable=True), None) is not None:
        return None
    rows = [vertices[place[a[1]]].id for a, _ in _neighbours(tree)]
    return f"no choice of slits parts the rows of three cells and more at {', '.join(dict.fromkeys(rows))}"
