"""Closed-form four-bar kinematics of a cone's cell: four links that all turn about the apex.

Links are arcs of great circles on the unit sphere; everything else is told as in `fourbar`. The cosine
rule over the diagonal c'd', written with half angles, gives the link angle at v3 just as in the plane, sines
of links in place of links:

    sin²(θ_b / 2) = sin²(ε_b / 2) + (sin l1 sin l4 / sin l2 sin l3) (sin² x − sin²(ε_a / 2))

and Napier's analogies take the place of the law of tangents: in the triangle v1 c' d' the angles A at c'
and B at d' satisfy

    tan((A + B) / 2) = cos((l4 − l1) / 2) / cos((l4 + l1) / 2) cot x
    tan((A − B) / 2) = sin((l4 − l1) / 2) / sin((l4 + l1) / 2) cot x

so that angles add up to more than 2 pi by the quadrilateral's area. For the same reason a link leans
against the face's normal at its opening crease by less than at its closing crease: by κ, with
tan κ = cos l tan(lean), in the right triangle of link, inner face and wall offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ori_deploy.motion.fourbar import FourBars
from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class SphericalFourBars(FourBars):
    """The four-bars of all cells of a cone.

    Attributes
    ----------
    link
        (n_cells, 4) arcs l1 to l4, radians; l1 + l4 and l2 + l3 below pi.
    lean
        (n_cells, 4) angle at each face's closing crease between face and link: at v1 (c side), at v3
        (c side), at v3 (d side), at v1 (d side).
    deployed
        (n_cells, 4) inner angles about the creases when deployed.
    """

    @cached_property
    def _constants(self) -> tuple[Reals, ...]:
        l1, l2, l3, l4 = self.link.T
        sine = np.sin(self.link).T
        flat_a = self.lean[:, 0] + self.lean[:, 3]
        flat_b = self.lean[:, 1] + self.lean[:, 2]
        skew_a, skew_b = self._skews
        kappa = np.arctan2(np.cos(self.link) * np.sin(self.lean), np.cos(self.lean))
        columns = (
            0.5 * self.deployed[:, 2],
            0.5 * flat_a,
            np.sin(0.5 * flat_a) ** 2,
            np.sin(0.5 * flat_b) ** 2,
            sine[0] * sine[3] / (sine[1] * sine[2]),
            0.5 * flat_b,
            np.sin(0.5 * skew_a),
            np.sin(0.5 * (l1 + l4)),
            np.cos(0.5 * skew_a),
            np.cos(0.5 * (l1 + l4)),
            np.sin(0.5 * skew_b),
            np.sin(0.5 * (l2 + l3)),
            np.cos(0.5 * skew_b),
            np.cos(0.5 * (l2 + l3)),
            kappa[:, 0] + kappa[:, 1],
            kappa[:, 2] + kappa[:, 3],
        )
        return tuple(c[:, None] for c in columns)

    def _solve(self, fold: Reals, out: Reals) -> None:
        half_a, lean_a, sin2_a, sin2_b, ratio, lean_b, *napier, lean_c, lean_d = self._constants
        sin_ka, sin_pa, cos_ka, cos_pa, sin_kb, sin_pb, cos_kb, cos_pb = napier
        half = half_a * fold
        x = half + lean_a
        sin_x, cos_x = np.sin(x), np.cos(x)
        sin2_y = sin2_b + ratio * np.maximum(sin_x * sin_x - sin2_a, 0.0)
        sin_y = np.sqrt(np.minimum(sin2_y, 1.0))
        cos_y = np.sqrt(np.maximum(1.0 - sin2_y, 0.0))
        mean = np.arctan2(cos_ka * cos_x, cos_pa * sin_x) + np.arctan2(cos_kb * cos_y, cos_pb * sin_y)
        # The two arcs of the other analogy are added as complex numbers, one arctangent for both.
        re_a, im_a = sin_pa * sin_x, sin_ka * cos_x
        re_b, im_b = sin_pb * sin_y, sin_kb * cos_y
        swing = np.arctan2(im_a * re_b + re_a * im_b, re_a * re_b - im_a * im_b)
        out[0] = mean + swing + lean_c
        out[1] = mean - swing + lean_d
        out[2] = 2.0 * half
        np.multiply(np.arcsin(sin_y) - lean_b, 2.0, out=out[3])
        np.maximum(out[3], 0.0, out=out[3])
