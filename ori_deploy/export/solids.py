"""Panels as closed bodies in the deployed pose: prisms over a cylinder's span, tapered bodies between a cone's radii.

A cone's panels end in pieces of spheres round the apex, as the design has them: stacked flat, their ends are flush.
"""

from __future__ import annotations

import numpy as np

from ori_deploy.export.kernel import Body, Triangles, closed, loft, triangulated, upright
from ori_deploy.export.rulings import PanelShape
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_OVER = 1.01
"""How far beyond the spheres a wedge reaches that they cut off."""


def panel_body(shape: PanelShape, s_low: float, s_high: float, area: float, chord_m: float) -> Body:
    """A panel's body, nothing cut from it yet; in the design's own frame, see `rulings`.

    Parameters
    ----------
    s_low, s_high
        Where it begins and ends along the span.
    area
        The cross-section's: square metres, steradians on a cone.
    chord_m
        Largest distance of the ends' facets from a cone's spheres.
    """
    if shape.on_cone:
        return _between_spheres(shape.points, s_low, s_high, area, chord_m)
    lines = shape.rulings
    return loft(lines.at(s_low), lines.at(s_high), triangulated([shape.points]))


def _between_spheres(rays: Vectors, r_low: float, r_high: float, area: float, chord_m: float) -> Body:
    """A wedge of rays, cut by two spheres of facets, and scaled about the apex to the volume of true spheres."""
    middle = rays.sum(axis=0)
    middle /= np.linalg.norm(middle)
    right, up = upright(middle)
    flat = rays / (rays @ middle)[:, None]  # on the plane a unit away
    drawn = np.column_stack([flat @ right, flat @ up])
    steepest = float((rays @ middle).min())
    wedge = loft(r_low * steepest / _OVER * flat, r_high * _OVER * flat, triangulated([drawn]))
    grid, triangles, rim = _patch(drawn, np.sqrt(4.0 * chord_m / r_high))
    sphere = middle + grid[:, :1] * right + grid[:, 1:] * up
    sphere /= np.linalg.norm(sphere, axis=1)[:, None]
    body = wedge ^ _shell(sphere, triangles, rim, r_low, r_high)
    wanted = area * (r_high**3 - r_low**3) / 3.0
    scale = float(np.cbrt(wanted / body.volume()))
    return body.scale((scale, scale, scale))


def _patch(drawn: Reals, step: float) -> tuple[Reals, Triangles, Triangles]:
    """A grid over corners on a plane: points (n, 2), triangles (m, 3), and its rim (k,), counter-clockwise."""
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    low, high = low - 0.02 * (high - low), high + 0.02 * (high - low)
    nx, ny = (max(2, int(np.ceil(x)) + 1) for x in (high - low) / step)
    x, y = np.meshgrid(np.linspace(low[0], high[0], nx), np.linspace(low[1], high[1], ny))
    number = np.arange(nx * ny).reshape(ny, nx)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.vstack([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    return np.column_stack([x.ravel(), y.ravel()]), triangles.astype(np.int64), rim.astype(np.int64)


def _shell(sphere: Vectors, triangles: Triangles, rim: Triangles, r_low: float, r_high: float) -> Body:
    """What lies between two radii under a patch of the unit sphere."""
    n, ahead = len(sphere), np.roll(rim, -1)
    if r_low == 0.0:
        points = np.vstack([r_high * sphere, np.zeros((1, 3))])
        sides = np.column_stack([np.full(len(rim), n), ahead, rim])
        return closed(points, np.vstack([triangles, sides]))
    points = np.vstack([r_high * sphere, r_low * sphere])
    sides = np.vstack([np.column_stack([rim + n, ahead + n, ahead]), np.column_stack([rim + n, ahead, rim])])
    return closed(points, np.vstack([triangles, triangles[:, ::-1] + n, sides]))
