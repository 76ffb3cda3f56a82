"""Print check: thinnest wall, steepest overhang and whether it fits the bed, for every part as it is laid out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ori_deploy.design import ConeStructure
from ori_deploy.export.kernel import exits
from ori_deploy.export.parts import Part, Parts
from ori_deploy.export.parts_spec import PrintSpec
from ori_deploy.export.plates import Placed, lay_out, overhangs
from ori_deploy.motion.spanwise import MOST_SEGMENTS
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

Check = Literal["wall", "overhang", "bed"]

_SPREAD, _PLANES = 100, 200
"""Places all over a part's surface, and planes of it, at which its walls are measured."""
_OPPOSITE = -float(np.cos(np.radians(10.0)))
"""Cosine between two faces' normals below which what is between them is a wall, and not a corner."""


@dataclass(frozen=True)
class Finding:
    """What a check found of one part.

    Attributes
    ----------
    part, check
        Which.
    ok
        Whether it keeps the limit.
    value, limit, remedy
        In words; `value` and `limit` with units.
    at
        (3,) where, in the design's coordinates, metres; None where it is the whole part.
    """

    part: str
    check: Check
    ok: bool
    value: str
    limit: str
    remedy: str
    at: Vectors | None

    def __str__(self) -> str:
        told = f"{self.part}: {self.check} {'ok' if self.ok else 'wrong'}; found {self.value}; limit: {self.limit}"
        return told if self.ok else f"{told}; remedy: {self.remedy}"


def print_check(parts: Parts) -> tuple[Finding, ...]:
    """Three findings per part, in the parts' order: wall, overhang, bed."""
    placed = {item.part.id: item for item in lay_out(parts)}
    spec, segments = parts.spec.print, parts.design.span_segments
    on_cone = isinstance(parts.design.structure, ConeStructure)
    found: list[Finding] = []
    for part in parts.parts:
        found += [_wall(part, spec), _overhang(placed[part.id], spec), _bed(placed[part.id], spec, segments, on_cone)]
    return tuple(found)


def walls(part: Part) -> tuple[Vectors, Reals]:
    """How thick a part is, measured straight through from places on its surface.

    From places spread evenly, from one in every large plane, and from the floor of every pocket: a cone's spheres
    are thousands of planes. What lies between faces that are not nearly parallel is a corner, and no wall; under a
    floor it is one.

    Returns
    -------
    (n, 3) places, and (n,) thicknesses, metres.
    """
    normal, area = part.faces
    rng = np.random.default_rng(1)
    spread = rng.choice(len(area), size=_SPREAD, p=area / area.sum())
    largest = np.argsort(-area, kind="stable")
    height = np.einsum("mi,mi->m", normal, part.points[part.triangles[:, 0]] - part.points[0])
    plane = np.column_stack([normal.round(6), height.round(6)])[largest]
    _, first = np.unique(plane, axis=0, return_index=True)
    single = largest[np.sort(first)][:_PLANES]
    chosen = np.concatenate([spread, single])
    share = rng.dirichlet(np.ones(3), size=_SPREAD)
    share = np.vstack([share, np.full((len(single), 3), 1.0 / 3.0)])
    at = np.einsum("nk,nki->ni", share, part.points[part.triangles[chosen]])
    thick, through = exits(part.points, part.triangles, at, -normal[chosen])
    facing = np.einsum("ni,ni->n", normal[chosen], normal[through])
    kept = (through >= 0) & (facing < _OPPOSITE)
    floor, under = _under_floors(part)
    return np.vstack([at[kept], floor]), np.concatenate([thick[kept], under])


def _under_floors(part: Part) -> tuple[Vectors, Reals]:
    """(n, 3) places on floors of pockets, and (n,) what is left there; none where another pocket took it."""
    floor = np.vstack([np.zeros((0, 3)), *(pocket.floor for pocket in part.pockets)])
    into = np.vstack([np.zeros((0, 3)), *(np.tile(p.into, (len(p.floor), 1)) for p in part.pockets)])
    if not len(floor):
        return floor, np.zeros(0)
    thick, through = exits(part.points, part.triangles, floor, into)
    there = through >= 0
    return floor[there], thick[there]


def _wall(part: Part, spec: PrintSpec) -> Finding:
    at, thick = walls(part)
    if not len(thick):
        return Finding(part.id, "wall", True, "no wall", f"{spec.wall_mm:g} mm", "", None)
    k = int(np.argmin(thick))
    thin = 1e3 * float(thick[k])
    share = float((1e3 * thick < spec.wall_mm).mean())
    value = f"{thin:.2f} mm" + (f", {100.0 * share:.0f} % of the walls below the limit" if share > 0.0 else "")
    remedy = "a larger wall_m in the specification, a finer nozzle, or expect a ragged edge there"
    return Finding(part.id, "wall", thin >= spec.wall_mm, value, f"{spec.wall_mm:g} mm", remedy, at[k])


def _overhang(item: Placed, spec: PrintSpec) -> Finding:
    part = item.part
    angle = overhangs(part, item.matrix[:3, :3])
    worst = int(np.argmax(angle))
    over = angle > spec.overhang_deg
    area = 1e6 * float(part.faces[1][over].sum())
    value = f"{max(0.0, float(angle[worst])):.0f}° from upright" + (f", {area:.0f} mm²" if over.any() else "")
    at = part.points[part.triangles[worst]].mean(axis=0) if over.any() else None
    return Finding(part.id, "overhang", not over.any(), value, f"{spec.overhang_deg:g}°", "supports there", at)


def _bed(item: Placed, spec: PrintSpec, segments: int, on_cone: bool) -> Finding:
    size, bed = 1e3 * item.size_m, np.array(spec.bed_mm)
    needed = segments * int(np.ceil(float(size[0] / bed[:2].max())))
    helps = not on_cone and segments < needed <= MOST_SEGMENTS
    remedy = f"span_segments = {needed} in the specification" if helps else "a larger bed, or a smaller design"
    shown, limit = (" x ".join(f"{x:.0f}" for x in box) + " mm" for box in (size, bed))
    return Finding(item.part.id, "bed", item.fits, shown, limit, remedy, None)


def check_text(findings: tuple[Finding, ...]) -> str:
    """What is wrong, a line each, and a count of what is right."""
    wrong = [str(finding) for finding in findings if not finding.ok]
    return "\n".join([*wrong, f"print check: {len(findings) - len(wrong)} of {len(findings)} ok"]) + "\n"
