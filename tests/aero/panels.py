"""A second way to a section's pressures: straight panels with vortices that grow linearly along them, no viscosity.

After Kuethe and Chow, Foundations of Aerodynamics, sec. 5.10. It shares nothing with the package.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


def solved(points: NDArray[np.complex128], alpha_rad: float) -> tuple[NDArray[np.complex128], Reals, float]:
    """Middles of the panels, C_p there, and C_l.

    Parameters
    ----------
    points
        (n + 1,) outline in chords from the trailing edge over the lower side to the nose and back above: clockwise.
    """
    z = points
    middle, side = 0.5 * (z[1:] + z[:-1]), np.diff(z)
    length, theta = np.abs(side), np.angle(side)
    n = len(side)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    own = i == j
    away = (middle[i] - z[j]) * np.exp(-1j * theta[j])
    a = -(away.real)
    b = np.abs(away) ** 2
    turn = theta[i] - theta[j]
    c, d = np.sin(turn), np.cos(turn)
    e = -away.imag
    f = np.log(1.0 + length[j] * (length[j] + 2.0 * a) / b)
    g = np.arctan2(e * length[j], b + a * length[j])
    dx, dy = (middle[i] - z[j]).real, (middle[i] - z[j]).imag
    p = dx * np.sin(theta[i] - 2.0 * theta[j]) + dy * np.cos(theta[i] - 2.0 * theta[j])
    q = dx * np.cos(theta[i] - 2.0 * theta[j]) - dy * np.sin(theta[i] - 2.0 * theta[j])
    cn2 = d + 0.5 * q * f / length[j] - (a * c + d * e) * g / length[j]
    cn1 = 0.5 * d * f + c * g - cn2
    ct2 = c + 0.5 * p * f / length[j] + (a * d - c * e) * g / length[j]
    ct1 = 0.5 * c * f - d * g - ct2
    cn1[own], cn2[own], ct1[own], ct2[own] = -1.0, 1.0, 0.5 * np.pi, 0.5 * np.pi
    normal, along = np.zeros((n + 1, n + 1)), np.zeros((n, n + 1))
    normal[:n, :n], along[:, :n] = cn1, ct1
    normal[:n, 1:] += cn2
    along[:, 1:] += ct2
    normal[n, 0] = normal[n, n] = 1.0  # Kutta
    gamma = np.linalg.solve(normal, np.append(np.sin(theta - alpha_rad), 0.0))
    speed = np.cos(theta - alpha_rad) + along @ gamma
    cp = 1.0 - speed**2
    force = -1j * (cp * side).sum()  # clockwise: outwards is to the left
    return middle, cp, float((np.conj(1j * np.exp(1j * alpha_rad)) * force).real)
