"""A layout from a planar graph: vertices with coordinates and a list of edges, checked.

The drawing is straight: every edge a segment between its vertices. Its inner faces become the cells, its
bipartition the closing and opening vertices, its outer face the outline.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import LayoutError
from ori_deploy.layout.layout import (
    AllowableRule,
    Layout,
    Role,
    Vertex,
    make_layout,
    opening_vertices_on_outline,
)
from ori_deploy.layout.slit_choices import slit_choices

TOUCH = 1e-9
"""Points nearer than this to an edge lie on it, in sizes of the drawing: well above rounding, well below any pen."""

Edge = tuple[int, int]
Points = NDArray[np.complex128]


def layout_of_graph(
    places: Mapping[str, complex],
    edges: Iterable[tuple[str, str]],
    *,
    roles: Mapping[str, Role] | None = None,
    slits: Iterable[tuple[str, str]] | None = None,
    allowable: AllowableRule = opening_vertices_on_outline,
) -> Layout:
    """Check a planar graph and make it a layout.

    Parameters
    ----------
    places
        Point of the plane of every vertex, by id. In any unit: only how the edges run counts.
    edges
        Pairs of ids.
    roles
        Of the vertices whose role is known. The graph has two colourings: the one that agrees with these
        is taken; left open, the one that `allowable` lets pass; if it lets both pass, the one with the
        first vertex closing.
    slits
        Pairs of ids, one per inner vertex. Left out: the first choice with which the structure folds
        flat; where there is none, the first choice at all.
    allowable
        Rule that says which layouts fold flat.

    Returns
    -------
    Layout
        Vertices in the order given, cells by their first vertex in that order.

    Raises
    ------
    LayoutError
        Unknown or repeated ids; vertices that coincide; edges that cross or touch; parts that do not
        hang together; a face that is no quadrilateral; too few cells round an inner vertex; no colouring
        that is allowable; slits that do not fit. Names the vertices.
    """
    ids = list(places)
    pairs = _edges(ids, edges)
    z = np.array([complex(places[v]) for v in ids], dtype=np.complex128)
    _check_places(ids, z)
    z = z - z[0]
    _check_crossings(ids, z, pairs)
    _check_connected(ids, pairs)
    faces, outline = _faces(ids, z, pairs)
    inner = [i not in set(outline) for i in range(len(ids))]
    _check_inner(ids, pairs, inner)
    vertices = _coloured(ids, pairs, inner, faces, dict(roles or {}), allowable)
    cells = _cells(vertices, faces)
    bare = Layout(vertices, tuple(cells), ())
    if slits is None:
        chosen = next(slit_choices(bare), None) or next(slit_choices(bare, foldable=False))
        slits = [(ids[a], ids[b]) for a, b in chosen]
    named = [(ids[a], ids[c], ids[b], ids[d]) for a, c, b, d in cells]
    return make_layout(vertices, named, slits, allowable=allowable)


def _edges(ids: Sequence[str], edges: Iterable[tuple[str, str]]) -> list[Edge]:
    index = {v: i for i, v in enumerate(ids)}
    pairs: list[Edge] = []
    seen: set[frozenset[int]] = set()
    for edge in edges:
        name = "-".join(edge)
        unknown = next((v for v in edge if v not in index), None)
        if len(edge) != 2 or unknown is not None or edge[0] == edge[1]:
            raise LayoutError(
                f"edge {name}: does not join two known vertices",
                value=unknown,
                limit="two different ids of [[vertex]]",
                remedy="add the vertex or mend the id",
            )
        pair = (index[edge[0]], index[edge[1]])
        if frozenset(pair) in seen:
            raise LayoutError(f"edge {name}: given twice", limit="every edge once", remedy="remove one")
        seen.add(frozenset(pair))
        pairs.append(pair)
    if not pairs:
        raise LayoutError("graph: no edges", limit="at least four", remedy="list edges")
    return pairs


def _check_places(ids: Sequence[str], z: Points) -> None:
    bad = np.flatnonzero(~np.isfinite(z))
    if bad.size:
        raise LayoutError(
            f"vertex {ids[bad[0]]}: no place", value=z[bad[0]], limit="finite numbers", remedy="mend it"
        )
    for i in range(1, len(ids)):
        near = np.flatnonzero(np.abs(z[:i] - z[i]) <= TOUCH * _size(z))
        if near.size:
            raise LayoutError(
                f"vertices {ids[near[0]]} and {ids[i]}: in the same place",
                value=f"({z[i].real:g}, {z[i].imag:g})",
                limit="distinct places",
                remedy="move one, or make them one vertex",
            )


def _size(z: Points) -> float:
    return float(np.hypot(np.ptp(z.real), np.ptp(z.imag)))


def _check_crossings(ids: Sequence[str], z: Points, pairs: Sequence[Edge]) -> None:
    """No vertex lies on an edge it does not end, then no two edges cross."""
    ends = np.array(pairs, dtype=np.intp)
    tail, head = z[ends[:, 0]], z[ends[:, 1]]
    along = head - tail
    touch = TOUCH * _size(z)
    for i, name in enumerate(ids):
        part = np.clip(((z[i] - tail) * np.conj(along)).real / np.abs(along) ** 2, 0.0, 1.0)
        on = (np.abs(tail + part * along - z[i]) <= touch) & (ends != i).all(axis=1)
        if on.any():
            a, b = ends[np.flatnonzero(on)[0]]
            raise LayoutError(
                f"vertex {name}: lies on edge {ids[a]}-{ids[b]}",
                limit="edges touch at their ends only",
                remedy=f"move it, or split the edge into {ids[a]}-{name} and {name}-{ids[b]}",
            )
    unit = along / np.abs(along)
    for i in range(len(pairs) - 1):
        rest = slice(i + 1, None)
        # Signed distances of either edge's ends from the line of the other.
        here = ((np.stack([tail[rest], head[rest]]) - tail[i]) * np.conj(unit[i])).imag
        there = ((np.stack([tail[i] - tail[rest], head[i] - tail[rest]])) * np.conj(unit[rest])).imag
        across = (here.prod(axis=0) < 0.0) & (there.prod(axis=0) < 0.0)
        across &= (np.abs(here) > touch).all(axis=0) & (np.abs(there) > touch).all(axis=0)
        if across.any():
            (a, b), (c, d) = pairs[i], pairs[i + 1 + int(np.flatnonzero(across)[0])]
            raise LayoutError(
                f"edges {ids[a]}-{ids[b]} and {ids[c]}-{ids[d]}: cross",
                limit="a planar graph, drawn straight",
                remedy="move a vertex, or put one where they cross",
            )


def _neighbours(n: int, pairs: Iterable[Edge]) -> list[list[int]]:
    beside: list[list[int]] = [[] for _ in range(n)]
    for a, b in pairs:
        beside[a].append(b)
        beside[b].append(a)
    return beside


def _check_connected(ids: Sequence[str], pairs: Sequence[Edge]) -> None:
    colour = _colours(_neighbours(len(ids), pairs))
    loose = [v for v, c in zip(ids, colour, strict=True) if c is None]
    if loose:
        raise LayoutError(
            f"graph: {', '.join(loose[:8])}{', …' if len(loose) > 8 else ''} not joined to {ids[0]}",
            limit="one connected graph",
            remedy="add the edges that are missing, or remove the vertices",
        )


def _colours(beside: Sequence[Sequence[int]]) -> list[int | None]:
    """Steps from the first vertex, even or odd; None where none lead to."""
    colour: list[int | None] = [None] * len(beside)
    colour[0] = 0
    reached = [0]
    for i in reached:
        for j in beside[i]:
            if colour[j] is None:
                colour[j] = 1 - (colour[i] or 0)
                reached.append(j)
    return colour


def _faces(ids: Sequence[str], z: Points, pairs: Sequence[Edge]) -> tuple[list[tuple[int, ...]], tuple[int, ...]]:
    """Inner faces, counter-clockwise, and the outer face's walk."""
    beside = _neighbours(len(ids), pairs)
    turn_right: dict[Edge, int] = {}
    for v, others in enumerate(beside):
        by_angle = sorted(others, key=lambda w: float(np.angle(z[w] - z[v])))
        turn_right |= {(v, w): by_angle[k - 1] for k, w in enumerate(by_angle)}
    walks: list[tuple[int, ...]] = []
    unseen = dict.fromkeys([*pairs, *((b, a) for a, b in pairs)])
    while unseen:
        start = tail, head = next(iter(unseen))
        walk: list[int] = []
        while not walk or (tail, head) != start:
            walk.append(tail)
            del unseen[tail, head]
            tail, head = head, turn_right[head, tail]
        walks.append(tuple(walk))
    area = [float((np.conj(z[list(w)]) * np.roll(z[list(w)], -1)).imag.sum()) for w in walks]
    outer = walks.pop(int(np.argmin(area)))
    if not walks:
        raise LayoutError(
            "graph: encloses nothing", value=f"{len(pairs)} edges", limit="at least one face", remedy="add edges"
        )
    _check_faces(ids, walks, outer)
    return walks, outer


def _check_faces(ids: Sequence[str], faces: Sequence[tuple[int, ...]], outline: tuple[int, ...]) -> None:
    for face in faces:
        if len(face) != 4:
            raise LayoutError(
                f"face {'-'.join(ids[v] for v in face)}: not a quadrilateral",
                value=f"{len(face)} edges round it",
                limit="4",
                remedy="add or remove edges until every inner face has four",
            )
    twice = next((v for v in outline if outline.count(v) > 1), None)
    if twice is not None:
        raise LayoutError(
            f"vertex {ids[twice]}: the outline passes it {outline.count(twice)} times",
            limit="one simple outline round all cells",
            remedy="remove edges that no cell has; bridge cells that meet only at this point",
        )


def _check_inner(ids: Sequence[str], pairs: Sequence[Edge], inner: Sequence[bool]) -> None:
    for v, others in enumerate(_neighbours(len(ids), pairs)):
        if inner[v] and len(others) < 3:
            raise LayoutError(
                f"vertex {ids[v]}: too few cells round an inner vertex",
                value=len(others),
                limit="at least 3",
                remedy="with two cells one angle is 180 degrees or more: add an edge, or move the vertex outside",
            )


def _coloured(
    ids: Sequence[str],
    pairs: Sequence[Edge],
    inner: Sequence[bool],
    faces: Sequence[tuple[int, ...]],
    roles: dict[str, Role],
    allowable: AllowableRule,
) -> tuple[Vertex, ...]:
    """Every face has four edges, so the graph has exactly two colourings; the first that fits is taken."""
    colour = _colours(_neighbours(len(ids), pairs))
    refused: list[str] = []
    for closing in (0, 1):
        vertices = tuple(
            Vertex(v, "closing" if c == closing else "opening", i) for v, c, i in zip(ids, colour, inner, strict=True)
        )
        first = next(v.id for v in vertices if v.role == "closing")
        wrong = next((v for v in vertices if roles.get(v.id, v.role) != v.role), None)
        if wrong is not None:
            refused.append(f"with {first} closing {wrong.id} is {wrong.role}, not {roles[wrong.id]}")
            continue
        broken = allowable(vertices, _cells(vertices, faces))
        if broken is None:
            return vertices
        refused.append(f"with {first} closing {broken}")
    raise LayoutError(
        f"graph: {'; '.join(refused)}",
        limit="neighbours differ, closing and opening; inner vertices are closing (the layout must fold flat)",
        remedy="move the vertex to the outline, split the cell beside it, or leave roles out",
    )


def _cells(vertices: Sequence[Vertex], faces: Iterable[tuple[int, ...]]) -> tuple[tuple[int, int, int, int], ...]:
    """Faces from their first closing vertex, in the order of the vertices."""
    cells = []
    for face in faces:
        k = min((v, k) for k, v in enumerate(face) if vertices[v].role == "closing")[1]
        a, c, b, d = face[k:] + face[:k]
        cells.append((a, c, b, d))
    return tuple(sorted(cells))
