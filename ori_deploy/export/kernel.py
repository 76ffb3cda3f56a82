"""Closed bodies and what can be cut from them: manifold3d in double precision, and trimesh for files.

Both belong to the extra `export` and are imported when needed. Lengths in metres.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import InputError
from ori_deploy.export.rulings import Rulings
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

Body: TypeAlias = Any
"""A manifold3d.Manifold."""
Triangles = NDArray[np.int64]

ROUND_SIDES = 48
"""Corners of a round hole."""
_MOST_PAIRS = 1_000_000
"""Lines times triangles that are looked at together."""
_EDGE = 1e-7
"""Part of a triangle by which a line may miss it: rather in both neighbours than in none."""


def need(module: str, extra: str) -> Any:
    """A module of an extra.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as why:
        raise InputError(
            f"export: {module} is not installed",
            value=str(why),
            limit=f"the extra `{extra}`",
            remedy=f"pip install -e '.[{extra}]'",
        ) from why


def closed(points: Vectors, triangles: Triangles) -> Body:
    """A body from a closed surface, triangles counter-clockwise seen from outside."""
    m = need("manifold3d", "export")
    body = m.Manifold(m.Mesh64(np.ascontiguousarray(points, dtype=float), triangles.astype(np.uint64)))
    if body.status() != m.Error.NoError:
        raise InputError("export: not a closed surface", value=str(body.status()), remedy="tell the project")
    return body


def surface(body: Body) -> tuple[Vectors, Triangles]:
    """(n, 3) points and (m, 3) triangles of a body."""
    mesh = body.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3].copy(), np.asarray(mesh.tri_verts).astype(np.int64)


def triangulated(loops: list[Reals]) -> Triangles:
    """(m, 3) triangles over polygons (n, 2): outer ones counter-clockwise, holes clockwise; numbered in a row."""
    m = need("manifold3d", "export")
    return np.asarray(m.triangulate([np.ascontiguousarray(loop) for loop in loops], 0.0, False), dtype=np.int64)


def loft(low: Vectors, high: Vectors, caps: Triangles, starts: tuple[int, ...] = (0,)) -> Body:
    """A body between two polygons of as many corners, each joined to the other's by a plane.

    Parameters
    ----------
    low, high
        (n, 3), counter-clockwise seen from above, several loops in a row; `low` may be one and the same point.
    caps
        (m, 3) triangles over them, counter-clockwise.
    starts
        Where each loop begins.
    """
    n = len(high)
    apex = bool(np.ptp(low, axis=0).max() <= 0.0)
    ahead = np.arange(n) + 1
    for start, stop in zip(starts, (*starts[1:], n), strict=True):
        ahead[stop - 1] = start
    at = np.arange(n)
    if apex:
        points = np.vstack([high, low[:1]])
        sides = np.column_stack([np.full(n, n), ahead, at])
        return closed(points, np.vstack([caps, sides]))
    points = np.vstack([high, low])
    sides = np.vstack([np.column_stack([at + n, ahead + n, ahead]), np.column_stack([at + n, ahead, at])])
    return closed(points, np.vstack([caps, caps[:, ::-1] + n, sides]))


def slab(row: Rulings, depth: float, lift: float, s_low: float, s_high: float) -> Body:
    """What lies under a row of facets, from `lift` above to `depth` below, between two places along its lines."""
    s = max(abs(s_low), abs(s_high))
    under, over = row.offset(-depth, s), row.offset(lift, s).reversed()
    n = len(row)
    # Under runs along the row, over back: counter-clockwise only the other way about.
    low, high = (np.vstack([over.at(x)[::-1], under.at(x)[::-1]]) for x in (s_low, s_high))
    k = np.arange(n - 1)
    quads = np.column_stack([k, k + 1, 2 * n - 2 - k, 2 * n - 1 - k])
    return loft(low, high, np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def punch(loops: list[Reals], origin: Vectors, right: Vectors, up: Vectors, depth: float, lift: float) -> Body:
    """Polygons drawn on a plane, from `lift` before it to `depth` behind it.

    Parameters
    ----------
    loops
        Outer ones counter-clockwise seen from before the plane, holes clockwise.
    origin, right, up
        The drawing's frame in space; `right x up` points towards the one who looks at it.
    """
    flat = np.concatenate(loops)
    starts = tuple(int(i) for i in np.cumsum([0, *(len(loop) for loop in loops[:-1])]))
    towards = np.cross(right, up)
    drawn = origin + flat[:, :1] * right + flat[:, 1:] * up
    return loft(drawn - depth * towards, drawn + lift * towards, triangulated(loops), starts)


def swept(first: Body, second: Body) -> Body:
    """The smallest convex body round two: what a convex one sweeps on a short way from the one place to the other."""
    return need("manifold3d", "export").Manifold.batch_hull([first, second])


def joined(bodies: list[Body]) -> Body:
    """All of several bodies as one."""
    m = need("manifold3d", "export")
    return m.Manifold.batch_boolean(bodies, m.OpType.Add)


def circle(radius: float) -> Reals:
    """(n, 2) a polygon of the circle's area."""
    angle = 2.0 * np.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    equal = radius * np.sqrt(2.0 * np.pi / (ROUND_SIDES * np.sin(2.0 * np.pi / ROUND_SIDES)))
    return np.asarray(equal * np.column_stack([np.cos(angle), np.sin(angle)]))


def around(radius: float) -> Reals:
    """(n, 2) a polygon round the circle: what turns in it touches none of its sides."""
    angle = 2.0 * np.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    return np.asarray(radius / np.cos(np.pi / ROUND_SIDES) * np.column_stack([np.cos(angle), np.sin(angle)]))


def upright(axis: Vectors) -> tuple[Vectors, Vectors]:
    """Two unit vectors at right angles to a unit vector and each other, right-handed with it."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    right = np.cross(other, axis)
    right /= np.linalg.norm(right)
    return right, np.cross(axis, right)


def depths(points: Vectors, triangles: Triangles, origins: Vectors, direction: Vectors) -> Reals:
    """(n,) how far it is from places on a surface through the body to the other side; see `exits`."""
    return exits(points, triangles, origins, direction)[0]


def exits(
    points: Vectors, triangles: Triangles, origins: Vectors, direction: Vectors
) -> tuple[Reals, NDArray[np.int64]]:
    """Where straight lines from places on a surface leave the body again.

    Parameters
    ----------
    direction
        (3,) or (n, 3) unit vectors into the body.

    Returns
    -------
    (n,) distances, 0 where there is no body, and (n,) the triangle that is left through, or -1.
    """
    ways = np.broadcast_to(np.asarray(direction, dtype=float), origins.shape)
    rows = max(1, _MOST_PAIRS // len(triangles))
    found = [
        _exits(points, triangles, origins[k : k + rows], ways[k : k + rows]) for k in range(0, len(origins), rows)
    ]
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _exits(points: Vectors, triangles: Triangles, origins: Vectors, ways: Vectors) -> tuple[Reals, NDArray[np.int64]]:
    """`exits` of not too many lines: every line against every triangle.

    With r from a triangle's corner a to the line's origin, d the line and e1, e2, n the triangle's sides and their
    product: -r·n / d·n along it the line crosses the plane, at -e2·(r x d) / d·n of e1 and e1·(r x d) / d·n of e2.
    """
    middle = points.mean(axis=0)
    near = origins - middle
    a, b, c = (points[triangles[:, k]] - middle for k in range(3))
    first, second = b - a, c - a
    normal = np.cross(first, second)
    moment = np.cross(near, ways)
    through = ways @ normal.T
    over = np.where(through != 0.0, through, np.inf)
    u = -(moment @ second.T - ways @ np.cross(second, a).T) / over
    v = (moment @ first.T - ways @ np.cross(first, a).T) / over
    far = (np.einsum("mi,mi->m", a, normal) - near @ normal.T) / over
    least = 1e-7 * float(np.ptp(points, axis=0).max())
    hit = (through != 0.0) & (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE) & (far > least)
    at = np.argmin(np.where(hit, far, np.inf), axis=1)
    line = np.arange(len(origins))
    # The first triangle crossed has to be left, along its normal: one that is entered means there was no body.
    left = hit[line, at] & (through[line, at] > 0.0)
    return np.where(left, far[line, at], 0.0), np.where(left, at, -1)
