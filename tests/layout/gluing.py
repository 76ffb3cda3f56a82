"""A slow enumerator of its own: glue quadrilaterals to a disk, tell disks apart flag by flag.

Every disk of quadrilaterals can be built by gluing one at a time so that it stays a disk in between
(disks are shellable). A new one covers one, two or three edges of the outline in a row. Two cover the
vertex between them, which has to be closing and to have three cells then; three would cover an opening
vertex. Disks are lists of cells, corners counter-clockwise from a closing vertex, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

Corners = tuple[int, int, int, int]
Disk = tuple[Corners, ...]
Code = tuple[tuple[tuple[int, int], ...], ...]


def edges(cell: Corners) -> list[tuple[int, int]]:
    return [(cell[k], cell[(k + 1) % 4]) for k in range(4)]


def outline(disk: Sequence[Corners]) -> list[int]:
    directed = {e for cell in disk for e in edges(cell)}
    follow = {a: b for a, b in directed if (b, a) not in directed}
    loop = [min(follow)]
    while follow[loop[-1]] != loop[0]:
        loop.append(follow[loop[-1]])
    assert len(loop) == len(follow)
    return loop


def n_inner(disk: Sequence[Corners]) -> int:
    return len({v for cell in disk for v in cell}) - len(outline(disk))


def glued(disk: Disk) -> Iterator[Disk]:
    """All disks with one cell more."""
    loop = outline(disk)
    closing = {v for cell in disk for v in cell[::2]}
    new = max(v for cell in disk for v in cell) + 1
    for i, q in enumerate(loop):
        p, r = loop[i - 1], loop[(i + 1) % len(loop)]
        fresh = (r, q, new, new + 1)
        yield (*disk, fresh if r in closing else (*fresh[1:], fresh[0]))
        if q in closing and sum(q in cell for cell in disk) >= 2:
            yield (*disk, (q, p, new, r))


def codes(disk: Disk, *, mirror_apart: bool) -> list[Code]:
    """One per flag: a cell, one of its closing corners, a sense. Equal disks have equal codes, flag by flag."""
    views: list[list[Corners]] = [list(disk)]
    if not mirror_apart:
        views.append([(a, d, b, c) for a, c, b, d in disk])
    return [_code(view, start, turn) for view in views for start in range(len(view)) for turn in (0, 2)]


def _code(cells: list[Corners], start: int, turn: int) -> Code:
    """Walk over neighbouring cells; write down for every side which cell is there, and by which of its sides."""
    side_of = {e: (i, k) for i, cell in enumerate(cells) for k, e in enumerate(edges(cell))}
    number, first = {start: 0}, {start: turn}
    order, told = [start], []
    for i in order:
        row = []
        for step in range(4):
            a, b = edges(cells[i])[(first[i] + step) % 4]
            if (b, a) not in side_of:
                row.append((-1, -1))
                continue
            j, k = side_of[b, a]
            if j not in number:
                number[j], first[j] = len(order), k
                order.append(j)
            row.append((number[j], (k - first[j]) % 4))
        told.append(tuple(row))
    return tuple(told)


def classes(n_cells: int, *, mirror_apart: bool) -> dict[Code, Disk]:
    """One disk per class, by its code."""
    found: dict[Code, Disk] = {}
    if n_cells == 1:
        one: Disk = ((0, 1, 2, 3),)
        return {min(codes(one, mirror_apart=mirror_apart)): one}
    for parent in classes(n_cells - 1, mirror_apart=mirror_apart).values():
        for child in glued(parent):
            found.setdefault(min(codes(child, mirror_apart=mirror_apart)), child)
    return found
