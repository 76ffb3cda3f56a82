"""Whether a profile is star-shaped, and from where."""

from __future__ import annotations

import numpy as np

from ori_deploy.profiles.profile import Profile


def star_centre(profile: Profile) -> complex | None:
    """The place that sees all of the outline and keeps furthest from the tangents that bound such places.

    Every tangent of the outline, sampled, has to have the place on its left: a linear programme.

    Returns
    -------
    None where no place sees all of the outline: the profile is not star-shaped.
    """
    from scipy.optimize import linprog  # loaded by those who need it only: it takes 0.2 s

    at = np.concatenate([profile.table_s, profile.corners])
    point = np.concatenate([profile.point(at)] * 2)
    normal = 1j * np.concatenate(profile.tangents(at))
    normal /= np.abs(normal)
    # normal . (x - point) >= room, as large a room as there is
    bounded = np.stack([-normal.real, -normal.imag, np.ones(len(normal))], axis=1)
    found = linprog(
        [0.0, 0.0, -1.0],
        A_ub=bounded,
        b_ub=-(np.conj(normal) * point).real,
        bounds=[(None, None), (None, None), (None, None)],
    )
    if found.status != 0 or found.x[2] <= 1e-6 * profile.size:
        return None
    return complex(found.x[0], found.x[1])
