"""A layout laid onto a profile: where its vertices are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.star import star_centre
from ori_deploy.tolerance import TOLERANCE


@dataclass(frozen=True)
class Embedding:
    """A layout on a profile. Make one with `embed`, which checks it.

    Attributes
    ----------
    profile, layout
        What is embedded on what.
    s
        (n_vertices,) parameter of each outline vertex; NaN for inner ones.
    z
        (n_vertices,) places as complex numbers, metres.
    """

    profile: Profile
    layout: Layout
    s: Reals
    z: Points

    @cached_property
    def curved(self) -> NDArray[np.bool_]:
        """(n_cells, 4) whether the cell's panel lies on the outline."""
        return (self.layout.neighbour < 0).reshape(-1, 4)


def embed(
    profile: Profile, layout: Layout, outline: Mapping[str, float], inner: Mapping[str, tuple[float, float]]
) -> Embedding:
    """Place a layout's vertices.

    Parameters
    ----------
    profile, layout
        Shape and layout.
    outline
        Parameter `s` of every outline vertex, by id.
    inner
        (x, y) of every inner vertex, metres, by id.

    Raises
    ------
    LayoutError
        A vertex without a place or outside, outline vertices out of order, inner edges that cross
        the outline or each other.
    """
    s = np.full(len(layout.vertices), np.nan)
    z = np.empty(len(layout.vertices), dtype=complex)
    for i, v in enumerate(layout.vertices):
        where = inner.get(v.id) if v.inner else outline.get(v.id)
        if where is None:
            kind = "inner" if v.inner else "outline"
            raise LayoutError(
                f"vertex {v.id}: no place given",
                limit=f"an {kind} vertex needs one",
                remedy="add its position",
            )
        if not np.isfinite(where).all():
            raise LayoutError(f"vertex {v.id}: position is not a finite number", value=where, remedy="give a number")
        if v.inner:
            z[i] = complex(*where)  # type: ignore[misc]
        else:
            s[i] = float(where) % profile.period  # type: ignore[arg-type]
    on_outline = np.isfinite(s)
    z[on_outline] = profile.point(s[on_outline])
    embedding = Embedding(profile, layout, s, z)
    _check_inside(embedding)
    _check_order(embedding)
    _check_edges(embedding)
    return embedding


def _check_inside(e: Embedding) -> None:
    inner = np.flatnonzero(np.isnan(e.s))
    outside = inner[~e.profile.contains(e.z[inner])]
    if len(outside):
        v = int(outside[0])
        x, y = e.z[v].real, e.z[v].imag
        raise LayoutError(
            f"vertex {e.layout.vertices[v].id}: outside the profile",
            value=f"({x:.6g}, {y:.6g}) m",
            limit="inside the outline",
            remedy="move it inside, or make it an outline vertex (arc, angle_rad, x_chord)",
        )


def _check_order(e: Embedding) -> None:
    loop = np.array(e.layout.outline)
    ahead = np.diff(e.s[loop], append=e.s[loop[0]]) % e.profile.period
    lengths = e.profile.arc_length(e.s[loop] + ahead) - e.profile.arc_length(e.s[loop])
    close = np.flatnonzero(lengths < TOLERANCE.vertex_gap * e.profile.perimeter)
    names = [e.layout.vertices[v].id for v in loop]
    if len(close):
        k = int(close[0])
        raise LayoutError(
            f"vertices {names[k]} and {names[(k + 1) % len(names)]}: at the same place on the outline",
            value=f"{float(lengths[k]):.3g} m apart along it",
            limit=f"at least {TOLERANCE.vertex_gap * e.profile.perimeter:.3g} m",
            remedy="move one",
        )
    if not np.isclose(ahead.sum(), e.profile.period, rtol=1e-6):
        by_place = sorted(names, key=lambda n: float(e.s[loop[names.index(n)]]))
        raise LayoutError(
            "layout: outline vertices are not in the order the cells say",
            value=f"on the outline {' '.join(by_place)}",
            limit=f"round the cells {' '.join(names)}, counter-clockwise",
            remedy="move the vertices, or list the cells' vertices counter-clockwise",
        )


def _inner_edges(e: Embedding) -> NDArray[np.intp]:
    """(n, 2) vertex indices (closing, opening) of every inner edge, each once."""
    layout = e.layout
    own = np.flatnonzero((layout.neighbour >= 0) & (np.arange(layout.n_panels) < layout.neighbour))
    cell, k = own // 4, own % 4
    pair = np.stack([layout.corners[cell, k], layout.corners[cell, (k + 1) % 4]], axis=1)
    return np.where((k % 2 == 0)[:, None], pair, pair[:, ::-1])


def _check_edges(e: Embedding) -> None:
    """Inner edges leave outline vertices inwards and cross neither the outline nor each other."""
    edges = _inner_edges(e)
    if len(edges) == 0:
        return
    p, q = e.z[edges[:, 0]], e.z[edges[:, 1]]
    # Shortened at outline ends: there the directions decide, see Tolerance.edge_end.
    shrink = TOLERANCE.edge_end * e.profile.size * (q - p) / np.abs(q - p)
    on_outline = np.isfinite(e.s[edges])
    p0, q0 = p + np.where(on_outline[:, 0], shrink, 0.0), q - np.where(on_outline[:, 1], shrink, 0.0)
    a = e.profile.table_f
    crossing = np.argwhere(_cross(p0[:, None], q0[:, None], a[None], np.roll(a, -1)[None]))
    if len(crossing):
        _refuse_edge(e, edges[crossing[0][0]], "crosses the outline")
    edge, end = np.nonzero(on_outline)
    vertex, other = edges[edge, end], edges[edge, 1 - end]
    leaving = np.flatnonzero(~_point_inwards(e, e.s[vertex], e.z[other] - e.z[vertex]))
    if len(leaving):
        _refuse_edge(e, edges[edge[leaving[0]]], "leaves the profile at its end")
    i, j = np.triu_indices(len(edges), 1)
    apart = ~(edges[i][:, :, None] == edges[j][:, None, :]).any(axis=(1, 2))
    i, j = i[apart], j[apart]
    hit = np.flatnonzero(_cross(p[i], q[i], p[j], q[j]))
    if len(hit):
        names = [e.layout.vertices[v].id for v in edges[j[hit[0]]]]
        _refuse_edge(e, edges[i[hit[0]]], f"crosses edge {names[0]}-{names[1]}")


def _point_inwards(e: Embedding, s: Reals, direction: Points) -> NDArray[np.bool_]:
    """Whether each direction lies between the outline's two tangents at `s`, on the inner side."""
    before, after = e.profile.tangents(s)
    inner_angle = np.pi - np.angle(after / before)
    turn = np.angle(direction / after) % (2.0 * np.pi)
    return np.asarray((turn > 0.0) & (turn < inner_angle))


def _cross(p: Points, q: Points, a: Points, b: Points) -> NDArray[np.bool_]:
    def side(u: Points, v: Points, w: Points) -> Reals:
        return np.asarray((np.conj(v - u) * (w - u)).imag)

    return np.asarray((side(p, q, a) * side(p, q, b) < 0.0) & (side(a, b, p) * side(a, b, q) < 0.0))


def _refuse_edge(e: Embedding, edge: NDArray[np.intp], what: str) -> None:
    inner = np.flatnonzero(np.isnan(e.s))
    if len(inner) == 1 and inner[0] in edge and "edge" not in what:
        _refuse_hidden(e, edge, what)
    a, b = (e.layout.vertices[v].id for v in edge)
    raise LayoutError(
        f"edge {a}-{b}: {what}",
        limit="inner edges are straight, inside the profile, and meet only at vertices",
        remedy=f"move {a} or {b}",
    )


def _refuse_hidden(e: Embedding, edge: NDArray[np.intp], what: str) -> None:
    """The only inner vertex does not see all of the outline: says from where all of it can be seen."""
    a, b = (e.layout.vertices[v] for v in edge)
    name, other = (a.id, b.id) if a.inner else (b.id, a.id)
    z = e.z[edge[0] if a.inner else edge[1]]
    centre = star_centre(e.profile)
    step = 1e-4 * e.profile.size  # as fine as a person would place it; adding 0 makes no zero negative

    def told(x: float) -> str:
        return f"{round(x / step) * step + 0.0:.6g}"

    raise LayoutError(
        f"profile: not star-shaped from inner vertex {name}",
        value=f"({z.real:.6g}, {z.imag:.6g}) m: edge {a.id}-{b.id} {what}",
        limit="the only inner vertex sees all of the outline",
        remedy=f"place {name} at ({told(centre.real)}, {told(centre.imag)}) m, or move {other}"
        if centre is not None
        else f"no place sees all of this outline: move {other}, or use a layout with more inner vertices",
    )
