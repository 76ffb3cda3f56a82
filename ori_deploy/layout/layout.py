"""Layouts: which cells meet where, without any length.

A layout is a planar graph whose inner faces are quadrilaterals, the cells. Its vertices are
2-coloured closing and opening. Every cell is listed counter-clockwise as (closing a, opening c,
closing b, opening d) and has four panels, one per edge, in the same order: a-c, c-b, b-d, d-a.
Panel `4 * cell + k` is the k-th panel of a cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import LayoutError

Role = Literal["closing", "opening"]
EDGE_NAMES = ("ac", "cb", "bd", "da")
"""Names of a cell's four panels."""


@dataclass(frozen=True)
class Vertex:
    """A vertex of the layout: its id, role, and whether it lies inside or on the outline."""

    id: str
    role: Role
    inner: bool


@dataclass(frozen=True)
class Layout:
    """An allowable layout with its slits chosen. Make one with `make_layout`, which checks it.

    Attributes
    ----------
    vertices
        All vertices.
    cells
        Four vertex indices per cell: closing a, opening c, closing b, opening d, counter-clockwise.
    slits
        (inner closing vertex, opening vertex) index pairs, one per inner vertex: the inner edge
        there that is not bonded.
    cell_ids
        "c1", "c2", … in the order of `cells`.
    """

    vertices: tuple[Vertex, ...]
    cells: tuple[tuple[int, int, int, int], ...]
    slits: tuple[tuple[int, int], ...]

    @property
    def cell_ids(self) -> tuple[str, ...]:
        return tuple(f"c{i + 1}" for i in range(len(self.cells)))

    @property
    def n_cells(self) -> int:
        return len(self.cells)

    @property
    def n_panels(self) -> int:
        return 4 * len(self.cells)

    @cached_property
    def panel_ids(self) -> tuple[str, ...]:
        """ "c1.ac", "c1.cb", … : the cell and the edge."""
        return tuple(f"{cell}.{edge}" for cell in self.cell_ids for edge in EDGE_NAMES)

    @cached_property
    def corners(self) -> NDArray[np.intp]:
        """(n_cells, 4) vertex indices of `cells`."""
        return np.array(self.cells, dtype=np.intp)

    @cached_property
    def neighbour(self) -> NDArray[np.intp]:
        """(n_panels,) the panel on the other side of the same inner edge, -1 on the outline."""
        tail = self.corners.reshape(-1)
        head = np.roll(self.corners, -1, axis=1).reshape(-1)
        at = {(int(t), int(h)): p for p, (t, h) in enumerate(zip(tail, head, strict=True))}
        return np.array([at.get((int(h), int(t)), -1) for t, h in zip(tail, head, strict=True)], dtype=np.intp)

    @cached_property
    def is_slit(self) -> NDArray[np.bool_]:
        """(n_panels,) whether the panel lies on a slit."""
        tail = self.corners.reshape(-1)
        head = np.roll(self.corners, -1, axis=1).reshape(-1)
        pairs = {frozenset(s) for s in self.slits}
        return np.array([frozenset((int(t), int(h))) in pairs for t, h in zip(tail, head, strict=True)])

    @cached_property
    def bonded_to(self) -> NDArray[np.intp]:
        """(n_panels,) the panel this one is fixed to, -1 on the outline and at slits."""
        return np.where(self.is_slit, -1, self.neighbour)

    @cached_property
    def outline(self) -> tuple[int, ...]:
        """Outline vertices counter-clockwise, from the smallest index."""
        follow = outline_successors(self.cells)
        start = min(follow)
        loop = [start]
        while (after := follow[loop[-1]]) != start:
            loop.append(after)
        return tuple(loop)

    @cached_property
    def folding_order(self) -> tuple[tuple[int, int, int], ...]:
        """(cell, its panel that is already placed, the bonded panel that places it, or -1) from cell 0 outwards."""
        order = [(0, 0, -1)]
        placed = {0}
        for cell, _, _ in order:
            for panel in range(4 * cell, 4 * cell + 4):
                other = int(self.bonded_to[panel])
                if other >= 0 and other // 4 not in placed:
                    placed.add(other // 4)
                    order.append((other // 4, other, panel))
        return tuple(order)

    @cached_property
    def bodies(self) -> NDArray[np.intp]:
        """(n_panels,) number of the rigid body a panel belongs to: bonded panels are one."""
        own = np.arange(self.n_panels)
        return np.where((self.bonded_to >= 0) & (self.bonded_to < own), self.bonded_to, own)

    @cached_property
    def overfull_vertices(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Opening vertices at which more than two cells are bonded in a row, with those cells.

        Such a structure deploys but cannot fold flat: every cell of the row opens there to 180 degrees, so
        the first and the third would lie in the same place. A slit in the row parts it.
        """
        found = []
        for i, v in enumerate(self.vertices):
            if v.role != "opening":
                continue
            arrives = [int(p) for p in np.flatnonzero(np.roll(self.corners, -1, axis=1).reshape(-1) == i)]
            # The panel that arrives at the vertex is followed, in its cell, by the one that leaves it.
            leaves = {p: p + 1 if p % 4 < 3 else p - 3 for p in arrives}
            for first in (p for p in arrives if self.bonded_to[leaves[p]] < 0):
                row = [first]
                while (other := int(self.bonded_to[row[-1]])) >= 0:
                    row.append(next(p for p, q in leaves.items() if q == other))
                if len(row) > 2:
                    found.append((v.id, tuple(self.cell_ids[p // 4] for p in row)))
        return tuple(found)

    @cached_property
    def latch_points(self) -> tuple[str, ...]:
        """What secures the deployed state: every slit, and every cell that touches no inner vertex."""
        slits = [f"slit:{self.vertices[a].id}-{self.vertices[b].id}" for a, b in self.slits]
        inner = np.array([v.inner for v in self.vertices])
        alone = ~inner[self.corners].any(axis=1)
        return (*slits, *(f"cell:{self.cell_ids[i]}" for i in np.flatnonzero(alone)))


def opening_vertices_on_outline(
    vertices: tuple[Vertex, ...], cells: tuple[tuple[int, int, int, int], ...]
) -> str | None:
    """The allowable rule: every opening vertex lies on the outline. None, or what breaks it.

    Cells round an inner vertex that all close there stack; three or more that open there would
    need over 360 degrees. A named predicate so that another rule can take its place.
    """
    del cells
    for v in vertices:
        if v.role == "opening" and v.inner:
            return f"opening vertex {v.id} is inside"
    return None


AllowableRule = Callable[[tuple[Vertex, ...], tuple[tuple[int, int, int, int], ...]], str | None]


def outline_successors(cells: Iterable[tuple[int, int, int, int]]) -> dict[int, int]:
    """The vertex that follows each outline vertex counter-clockwise: edges that only one cell has."""
    directed = [(q[k], q[(k + 1) % 4]) for q in cells for k in range(4)]
    present = set(directed)
    return {t: h for t, h in directed if (h, t) not in present}


def make_layout(
    vertices: Iterable[Vertex],
    cells: Iterable[tuple[str, str, str, str]],
    slits: Iterable[tuple[str, str]],
    *,
    allowable: AllowableRule = opening_vertices_on_outline,
) -> Layout:
    """Check a layout and make it.

    Parameters
    ----------
    vertices
        With distinct ids.
    cells
        Vertex ids (closing, opening, closing, opening), counter-clockwise.
    slits
        Vertex id pairs, one per inner vertex, in either order.
    allowable
        Rule that says which layouts fold flat.

    Raises
    ------
    LayoutError
        Unknown or repeated ids, wrong colouring, not a quadrangulation, not allowable, or slits that
        leave a cell loose or stuck.
    """
    vertices = tuple(vertices)
    index = {v.id: i for i, v in enumerate(vertices)}
    if len(index) < len(vertices):
        twice = next(v.id for i, v in enumerate(vertices) if index[v.id] != i)
        raise LayoutError(f"vertex {twice}: id given twice", limit="distinct ids", remedy="rename one")
    cell_list = list(cells)
    if not cell_list:
        raise LayoutError("layout: no cells", limit="at least one cell", remedy="list cells")
    corners = tuple(_cell_corners(f"c{i + 1}", cell, index, vertices) for i, cell in enumerate(cell_list))
    _check_edges(corners, vertices)
    _check_fans(corners, vertices)
    broken = allowable(vertices, corners)
    if broken:
        raise LayoutError(
            f"layout: {broken}",
            limit="every opening vertex lies on the outline (the layout must fold flat)",
            remedy="swap closing and opening, or move the vertex to the outline",
        )
    pairs = _slit_pairs(slits, index, vertices, corners)
    layout = Layout(vertices, corners, pairs)
    _check_bonds(layout)
    return layout


def _cell_corners(
    name: str, cell: tuple[str, ...], index: dict[str, int], vertices: tuple[Vertex, ...]
) -> tuple[int, int, int, int]:
    listed = "[" + ", ".join(cell) + "]"
    if len(cell) != 4:
        raise LayoutError(
            f"cell {name}: not a quadrilateral",
            value=f"{len(cell)} vertices {listed}",
            limit="4 vertices",
            remedy="split or join cells until each has four corners",
        )
    for v in cell:
        if v not in index:
            raise LayoutError(
                f"cell {name}: unknown vertex",
                value=v,
                limit="ids of [[vertex]]",
                remedy="add the vertex or mend the id",
            )
    if len(set(cell)) < 4:
        raise LayoutError(
            f"cell {name}: a vertex twice", value=listed, limit="4 distinct vertices", remedy="mend the list"
        )
    roles = [vertices[index[v]].role for v in cell]
    if roles != ["closing", "opening", "closing", "opening"]:
        raise LayoutError(
            f"cell {name}: wrong colouring",
            value=", ".join(f"{v} {r}" for v, r in zip(cell, roles, strict=True)),
            limit="closing, opening, closing, opening, counter-clockwise",
            remedy="start the list at a closing vertex, or mend a role",
        )
    a, c, b, d = (index[v] for v in cell)
    return a, c, b, d


def _check_edges(cells: tuple[tuple[int, int, int, int], ...], vertices: tuple[Vertex, ...]) -> None:
    seen: dict[tuple[int, int], int] = {}
    for i, cell in enumerate(cells):
        for k in range(4):
            edge = (cell[k], cell[(k + 1) % 4])
            if edge in seen:
                t, h = (vertices[v].id for v in edge)
                raise LayoutError(
                    f"cells c{seen[edge] + 1} and c{i + 1}: both lie on the left of edge {t}-{h}",
                    limit="two cells share an edge from opposite sides",
                    remedy="list the vertices of every cell counter-clockwise",
                )
            seen[edge] = i
    used = {v for cell in cells for v in cell}
    for i, v in enumerate(vertices):
        if i not in used:
            raise LayoutError(
                f"vertex {v.id}: in no cell",
                limit="every vertex is a corner of a cell",
                remedy="list the cell it is a corner of, or remove it",
            )


def _check_fans(cells: tuple[tuple[int, int, int, int], ...], vertices: tuple[Vertex, ...]) -> None:
    """Cells round each vertex must form one fan: closed inside, open on the outline; and one outline in all."""
    follow: dict[int, dict[int, int]] = {i: {} for i in range(len(vertices))}
    for cell in cells:
        for k in range(4):
            follow[cell[k]][cell[(k + 1) % 4]] = cell[k - 1]
    for i, fan in enumerate(follow.values()):
        v = vertices[i]
        starts = [x for x in fan if x not in fan.values()]
        if len(starts) != (0 if v.inner else 1):
            raise LayoutError(
                f"vertex {v.id}: the cells round it do not fit",
                value=f"{len(starts)} gaps between its {len(fan)} cells",
                limit="none round an inner vertex, exactly one at the outline",
                remedy="set inner = true or false rightly, or list the cells that are missing",
            )
        here = starts[0] if starts else next(iter(fan))
        first, count = here, 0
        while here in fan:
            here, count = fan[here], count + 1
            if here == first:
                break
        if count < len(fan):
            raise LayoutError(
                f"vertex {v.id}: cells meet only at this point",
                limit="neighbours share edges",
                remedy="bridge the gap",
            )
        if v.inner and len(fan) < 3:
            raise LayoutError(
                f"vertex {v.id}: too few cells round an inner vertex",
                value=len(fan),
                limit="at least 3",
                remedy="with two cells one angle is 180 degrees or more: move the vertex to the outline",
            )
    edges = outline_successors(cells)
    n_vertices, n_edges = len(vertices), (4 * len(cells) + len(edges)) // 2
    if not edges or n_vertices - n_edges + len(cells) != 1:
        raise LayoutError(
            "layout: not one disk",
            value=f"{n_vertices} vertices, {n_edges} edges, {len(cells)} cells",
            limit="vertices - edges + cells = 1",
            remedy="connect the parts, fill the holes",
        )


def _slit_pairs(
    slits: Iterable[tuple[str, str]],
    index: dict[str, int],
    vertices: tuple[Vertex, ...],
    cells: tuple[tuple[int, int, int, int], ...],
) -> tuple[tuple[int, int], ...]:
    edges = {frozenset((q[k], q[(k + 1) % 4])) for q in cells for k in range(4)}
    pairs: list[tuple[int, int]] = []
    for slit in slits:
        name = "-".join(slit)
        if len(slit) != 2 or any(v not in index for v in slit):
            raise LayoutError(
                f"slit {name}: not two known vertices",
                limit="[inner vertex, opening vertex]",
                remedy="mend the ids",
            )
        a, b = sorted((index[v] for v in slit), key=lambda i: not vertices[i].inner)
        if not vertices[a].inner:
            raise LayoutError(
                f"slit {name}: touches no inner vertex",
                limit="slits start at an inner vertex",
                remedy="leave it out",
            )
        if frozenset((a, b)) not in edges:
            raise LayoutError(
                f"slit {name}: not an edge of the layout",
                limit="an inner edge",
                remedy="name an edge of a cell",
            )
        pairs.append((a, b))
    for i, v in enumerate(vertices):
        at = [p for p in pairs if p[0] == i]
        if v.inner and len(at) != 1:
            raise LayoutError(
                f"vertex {v.id}: {len(at)} slits at this inner vertex",
                limit="exactly one",
                remedy="leave exactly one inner edge at it unbonded: list it in slits",
            )
    return tuple(pairs)


def _check_bonds(layout: Layout) -> None:
    if len(layout.folding_order) < layout.n_cells:
        placed = {cell for cell, _, _ in layout.folding_order}
        loose = [c for i, c in enumerate(layout.cell_ids) if i not in placed]
        raise LayoutError(
            f"layout: cells {', '.join(loose)} are not bonded to the rest",
            limit="bonded cells form one tree",
            remedy="choose other slits",
        )


def ring(n_cells: int) -> tuple[tuple[Vertex, ...], tuple[tuple[str, str, str, str], ...]]:
    """Vertices and cells round one inner vertex: "P", opening "O1"…, closing "C1"… counter-clockwise.

    Cell i is (P, O_i, C_i, O_i+1); C_i lies between O_i and O_i+1.

    Raises
    ------
    LayoutError
        Fewer than 3 cells.
    """
    if n_cells < 3:
        raise LayoutError(
            "layout.ring.cells: too few cells round an inner vertex",
            value=n_cells,
            limit="at least 3",
            remedy="use 3 or more",
        )
    number = range(1, n_cells + 1)
    vertices = (
        Vertex("P", "closing", True),
        *(Vertex(f"O{i}", "opening", False) for i in number),
        *(Vertex(f"C{i}", "closing", False) for i in number),
    )
    return vertices, tuple(("P", f"O{i}", f"C{i}", f"O{i % n_cells + 1}") for i in number)
