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
            remedy=f"pip install 'ori-deploy[{extra}]'",
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


def circle(radius: float) -> Reals:
    """(n, 2) a polygon of the circle's area."""
    angle = 2.0 * np.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    equal = radius * np.sqrt(2.0 * np.pi / (ROUND_SIDES * np.sin(2.0 * np.pi / ROUND_SIDES)))
    return np.asarray(equal * np.column_stack([np.cos(angle), np.sin(angle)]))


def upright(axis: Vectors) -> tuple[Vectors, Vectors]:
    """Two unit vectors at right angles to a unit vector and each other, right-handed with it."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    right = np.cross(other, axis)
    right /= np.linalg.norm(right)
    return right, np.cross(axis, right)


def depths(points: Vectors, triangles: Triangles, origins: Vectors, direction: Vectors) -> Reals:
    """(n,) how far it is from places on a surface through the body to the other side; 0 where there is no body.

    Parameters
    ----------
    direction
        (3,) or (n, 3) unit vectors into the body.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    ways = np.broadcast_to(direction, origins.shape)
    out = np.zeros(len(origins))
    scale = float(np.ptp(points, axis=0).max())
    for i, (o, d) in enumerate(zip(origins, ways, strict=True)):
        p = np.cross(d, c - a)
        det = np.einsum("ij,ij->i", p, b - a)
        t = o - a
        q = np.cross(t, b - a)
        crossed = det != 0.0
        over = np.where(crossed, det, 1.0)
        u, v, far = (x / over for x in (np.einsum("ij,ij->i", t, p), q @ d, np.einsum("ij,ij->i", q, c - a)))
        # A triangle that is left behind, not entered, has its normal along the way: det > 0 is an entry.
        hit = crossed & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (far > 1e-7 * scale)
        if hit.any():
            first = int(np.argmin(np.where(hit, far, np.inf)))
            out[i] = far[first] if det[first] < 0.0 else 0.0
    return out
