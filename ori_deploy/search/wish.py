"""What a structure is wished to be: what to maximise, bounds, and pins by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout
from ori_deploy.profiles import Cone, Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.search.measures import Unknowns
from ori_deploy.search.nearest import nearest_parameter

_ON_OUTLINE = 1e-6
"""Distance from the outline, over the size, up to which a place counts as one on it: figures are written rounded."""

_OWN_IMAGE = 1e-6
"""Distance of an outline, over the size, from its mirror image up to which it is its own."""

Objective = Literal["eta", "box_ratio", "wall"]
Axis = Literal["x", "y"]


@dataclass(frozen=True)
class Equation:
    """Scalar equations that vertex places have to satisfy; lengths over the profile's size.

    Attributes
    ----------
    name
        The pin it comes from, for people.
    value
        How far it is from holding; 0 where it holds.
    slope
        (count,) its derivatives.
    """

    name: str
    value: float
    slope: Reals


class UnmetPinError(LayoutError):
    """Pins that cannot be made to hold from one start; others may lead further.

    Attributes
    ----------
    off_m
        How far the worst of them stays from holding.
    """

    off_m: float = 0.0


@dataclass(frozen=True)
class Fixed:
    """A vertex that stays where it is at the start, or at a place (metres) of its own: of an outline one on it."""

    vertex: str
    place: complex | None = None

    @property
    def name(self) -> str:
        return f"fixed {self.vertex}"


@dataclass(frozen=True)
class OnLine:
    """Vertices on one straight line through `through` (metres) along `direction`."""

    vertices: tuple[str, ...]
    through: complex
    direction: complex

    @property
    def name(self) -> str:
        return f"line {'-'.join(self.vertices)}"


@dataclass(frozen=True)
class Spar:
    """A straight vertical chain of inner edges from skin to skin, or one inner edge.

    Attributes
    ----------
    vertices
        Its vertices in order, ends on the outline.
    x_m
        Where it stands; free where None.
    """

    vertices: tuple[str, ...]
    x_m: float | None = None

    @property
    def name(self) -> str:
        return f"spar {'-'.join(self.vertices)}"


@dataclass(frozen=True)
class Symmetric:
    """The structure is its own mirror image about a line parallel to the x or y axis.

    Attributes
    ----------
    axis
        "x": mirrored up and down; "y": left and right.
    pairs
        Vertices and their mirror images; a vertex on the axis is its own.
    at_m
        Where the axis crosses the other one.
    """

    axis: Axis
    pairs: tuple[tuple[str, str], ...]
    at_m: float = 0.0

    @property
    def name(self) -> str:
        return f"symmetric about {self.axis}"

    @classmethod
    def of(cls, start: Embedding, axis: Axis, at_m: float = 0.0) -> Symmetric:
        """The symmetry nearest to an embedding: every vertex with the one nearest to its mirror image.

        Raises
        ------
        LayoutError
            The layout there is not its own mirror image, not even roughly, or the profile is not.
        """
        probe = cls(axis, (), at_m)
        mirrored = np.conj(start.z) + 2j * at_m if axis == "x" else 2.0 * at_m - np.conj(start.z)
        away = np.abs(mirrored[:, None] - start.z[None])
        unlike = np.array([[(u.role, u.inner) != (v.role, v.inner) for v in start.layout.vertices]
                           for u in start.layout.vertices])  # fmt: skip
        image = np.where(unlike, np.inf, away).argmin(axis=1)
        ids = [v.id for v in start.layout.vertices]
        cells = {frozenset(cell) for cell in start.layout.cells}
        lone = [ids[i] for i in range(len(ids)) if image[image[i]] != i]
        lost = [start.layout.cell_ids[k] for k, cell in enumerate(start.layout.cells)
                if frozenset(int(image[i]) for i in cell) not in cells]  # fmt: skip
        outline = start.profile.table_f
        flipped = np.array([probe.mirrored(complex(z)) for z in outline[:: max(1, len(outline) // 64)]])
        nearest = start.profile.point([nearest_parameter(start.profile, complex(z)) for z in flipped])
        off = float(np.abs(nearest - flipped).max())
        if lone or lost or off > _OWN_IMAGE * start.profile.size:
            what = (
                f"the profile, {off:.3g} m off"
                if off > _OWN_IMAGE * start.profile.size
                else f"vertex {lone[0]} has no image"
                if lone
                else f"cell {lost[0]} has no image"
            )
            raise LayoutError(
                f"symmetric about {axis}: the start is not its own mirror image", value=what,
                limit="every vertex and cell has one, nearly; the profile exactly",
                remedy="lay the cells out symmetrically, mend symmetric_at_m, or drop it",
            )  # fmt: skip
        pairs = tuple((ids[i], ids[int(j)]) for i, j in enumerate(image) if i <= j)
        return cls(axis, pairs, at_m)

    def mirrored(self, z: complex) -> complex:
        return z.conjugate() + 2j * self.at_m if self.axis == "x" else 2.0 * self.at_m - z.conjugate()


Pin = Fixed | OnLine | Spar | Symmetric


@dataclass(frozen=True)
class Wish:
    """What to look for.

    Attributes
    ----------
    objective
        What to maximise: "eta"; "box_ratio", the cross-section's area over the folded stack's box; or "wall",
        the least wall offset, while eta is at least `eta_at_least`.
    margin_rad
        Least dead-centre margin at every closing crease.
    panel_m
        Least length of a panel.
    pins
        What has to hold exactly.
    eta_at_least
        Goes with the objective "wall".
    """

    objective: Objective = "eta"
    margin_rad: float = float(np.radians(2.0))
    panel_m: float = 0.0
    pins: tuple[Pin, ...] = ()
    eta_at_least: float = 1.0

    def check(self, layout: Layout, profile: Profile | Cone) -> None:
        """Refuse pins that name what is not there, or bounds that nothing can satisfy."""
        if not 0.0 <= self.margin_rad < 0.5 * np.pi:
            raise LayoutError(
                "margin_rad: not a dead-centre margin", value=self.margin_rad, limit="0 <= margin_rad < pi / 2",
                remedy="a few degrees, 0.035 for two",
            )  # fmt: skip
        if not 0.0 <= self.panel_m < profile.size:
            raise LayoutError(
                "panel_m: not a length of a panel", value=f"{self.panel_m:.6g} m",
                limit=f"0 <= panel_m < {profile.size:.6g} m", remedy="give metres",
            )  # fmt: skip
        if not self.eta_at_least > 0.0:
            raise LayoutError(
                "eta_at_least: not a packaging ratio", value=self.eta_at_least, limit="> 0", remedy="for example 2"
            )
        if self.objective == "box_ratio" and isinstance(profile, Cone):
            raise LayoutError(
                "objective box_ratio: not on a cone", limit="eta, or wall with eta_at_least", remedy="choose one"
            )
        for pin in self.pins:
            for name in _names(pin):
                if all(v.id != name for v in layout.vertices):
                    raise LayoutError(
                        f"pin {pin.name}: unknown vertex", value=name,
                        limit=", ".join(v.id for v in layout.vertices), remedy="mend the id",
                    )  # fmt: skip
            if isinstance(pin, Spar):
                _check_spar(pin, layout)
            if isinstance(pin, Fixed):
                _check_place(pin, layout, profile.base if isinstance(profile, Cone) else profile)

    def equations(self, unknowns: Unknowns, x: Reals, start: Points) -> list[Equation]:
        """All pins at `x`; `start` is where vertices were before anything moved."""
        s, z, dz = unknowns.places(x)
        frame = _Frame(unknowns, s, z, dz)
        return [e for pin in self.pins for e in _equations(pin, frame, start)]


def _names(pin: Pin) -> tuple[str, ...]:
    if isinstance(pin, Fixed):
        return (pin.vertex,)
    if isinstance(pin, Symmetric):
        return tuple(name for pair in pin.pairs for name in pair)
    return pin.vertices


def _check_spar(pin: Spar, layout: Layout) -> None:
    index = {v.id: i for i, v in enumerate(layout.vertices)}
    inner_edges = {
        frozenset((int(t), int(h)))
        for p, (t, h) in enumerate(
            zip(layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel(), strict=True)
        )
        if layout.neighbour[p] >= 0
    }
    ends = [layout.vertices[index[pin.vertices[k]]].inner for k in (0, -1)]
    chain = [frozenset((index[a], index[b])) for a, b in pairwise(pin.vertices)]
    missing = next((sorted(layout.vertices[i].id for i in edge) for edge in chain if edge not in inner_edges), None)
    if len(pin.vertices) < 2 or any(ends) or missing:
        raise LayoutError(
            f"pin {pin.name}: not a chain of inner edges from skin to skin",
            value="-".join(missing) + " is no inner edge" if missing else "an end lies inside",
            limit="consecutive vertices share an inner edge; both ends on the outline",
            remedy="list the spar's vertices in order, from the upper skin to the lower",
        )
    for before, at, after in zip(pin.vertices, pin.vertices[1:], pin.vertices[2:], strict=False):
        if not layout.vertices[index[at]].inner:
            raise LayoutError(
                f"pin {pin.name}: leaves the profile on its way", value=f"{at} is on the outline",
                limit="only its ends are", remedy="end it there",
            )  # fmt: skip
        turn = neighbours_in_turn(layout, index[at])
        apart = (turn.index(index[after]) - turn.index(index[before])) % len(turn)
        if min(apart, len(turn) - apart) < 2:
            straight = [
                f"{layout.vertices[turn[k]].id}-{at}-{layout.vertices[turn[(k + j) % len(turn)]].id}"
                for k in range(len(turn))
                for j in range(2, len(turn) - 1)
                if k < (k + j) % len(turn)
            ]
            raise LayoutError(
                f"pin {pin.name}: cannot be straight",
                value=f"{min(apart, len(turn) - apart)} cell on one side of it at {at}",
                limit="two or more on each side: a single one would have 180 degrees there, its dead centre",
                remedy="for example " + ", ".join(straight[:4]) if straight else "more cells round " + at,
            )


def _check_place(pin: Fixed, layout: Layout, plane: Profile) -> None:
    """Refuse a place off the outline for a vertex on it."""
    if pin.place is None or next(v for v in layout.vertices if v.id == pin.vertex).inner:
        return
    there = complex(plane.point(nearest_parameter(plane, pin.place)))
    if abs(there - pin.place) > _ON_OUTLINE * plane.size:
        raise LayoutError(
            f"pin {pin.name}: not on the outline, where {pin.vertex} is",
            value=f"({pin.place.real:.9g}, {pin.place.imag:.9g}) m, {abs(there - pin.place):.3g} m away from it",
            limit=f"{_ON_OUTLINE * plane.size:.3g} m",
            remedy=f"the nearest place is at_m = [{there.real:.9g}, {there.imag:.9g}]",
        )


def neighbours_in_turn(layout: Layout, p: int) -> list[int]:
    """Opening vertices round an inner vertex, counter-clockwise."""
    following = {}
    for cell in layout.cells:
        if p in cell:
            k = cell.index(p)
            following[cell[(k + 1) % 4]] = cell[k - 1]
    turn = [min(following)]
    while (after := following[turn[-1]]) != turn[0]:
        turn.append(after)
    return turn


@dataclass(frozen=True)
class _Frame:
    """Places of vertices by name, and rows of derivatives."""

    unknowns: Unknowns
    s: Reals
    z: Points
    dz: Points

    def index(self, name: str) -> int:
        return next(i for i, v in enumerate(self.unknowns.layout.vertices) if v.id == name)

    def along(self, name: str, normal: complex, row: Reals, sign: float = 1.0) -> complex:
        """Add the derivatives of `Re(conj(normal) z)` over the size to a row; returns the place."""
        i = self.index(name)
        first, second = self.unknowns.column[i]
        size = self.unknowns.profile.size
        row[first] += sign * (np.conj(normal) * self.dz[i]).real / size
        if second >= 0:
            row[second] += sign * (np.conj(normal) * 1j * self.dz[i]).real / size
        return complex(self.z[i])


def _equations(pin: Pin, frame: _Frame, start: Points) -> Iterator[Equation]:
    size, count = frame.unknowns.profile.size, frame.unknowns.count
    if isinstance(pin, Fixed):
        i = frame.index(pin.vertex)
        goal = complex(start[i]) if pin.place is None else pin.place
        if not frame.unknowns.inner[i]:
            yield _held_on_outline(pin.name, frame, i, goal)
            return
        for normal in (1.0, 1j):
            row = np.zeros(count)
            z = frame.along(pin.vertex, normal, row)
            yield Equation(pin.name, float((np.conj(normal) * (z - goal)).real) / size, row)
    elif isinstance(pin, OnLine):
        normal = 1j * pin.direction / abs(pin.direction)
        for name in pin.vertices:
            row = np.zeros(count)
            z = frame.along(name, normal, row)
            yield Equation(pin.name, float((np.conj(normal) * (z - pin.through)).real) / size, row)
    elif isinstance(pin, Spar):
        if pin.x_m is not None:
            row = np.zeros(count)
            z = frame.along(pin.vertices[0], 1.0, row)
            yield Equation(pin.name, (z.real - pin.x_m) / size, row)
        for above, below in pairwise(pin.vertices):
            row = np.zeros(count)
            gap = frame.along(above, 1.0, row) - frame.along(below, 1.0, row, -1.0)
            yield Equation(pin.name, gap.real / size, row)
    else:
        yield from _mirror_equations(pin, frame)


def _held_on_outline(name: str, frame: _Frame, i: int, goal: complex) -> Equation:
    """Parameters are equated: along the tangent there, a vertex on the far side would be just as near."""
    profile, stride = frame.unknowns.profile, frame.unknowns.stride
    ahead = float(frame.s[i]) - nearest_parameter(profile, goal)
    row = np.zeros(frame.unknowns.count)
    row[frame.unknowns.column[i, 0]] = 1.0
    half = 0.5 * profile.period
    return Equation(name, ((ahead + half) % profile.period - half) / stride, row)


def _mirror_equations(pin: Symmetric, frame: _Frame) -> Iterator[Equation]:
    size, count = frame.unknowns.profile.size, frame.unknowns.count
    across = 1j if pin.axis == "x" else 1.0
    for one, other in pin.pairs:
        i, j = frame.index(one), frame.index(other)
        if i == j:
            row = np.zeros(count)
            z = frame.along(one, across, row)
            yield Equation(pin.name, float((np.conj(across) * (z - pin.mirrored(z))).real) / (2.0 * size), row)
            continue
        # On the outline both slide along it: one equation, along the tangent, says that they are images.
        normals = [1.0, 1j] if frame.unknowns.inner[i] else [frame.dz[j] / abs(frame.dz[j])]
        for normal in normals:
            row = np.zeros(count)
            z = frame.along(other, normal, row)
            image = pin.mirrored(frame.z[i])
            turned = complex(np.conj(normal) if pin.axis == "x" else -np.conj(normal))
            frame.along(one, turned, row, -1.0)
            yield Equation(pin.name, float((np.conj(normal) * (z - image)).real) / size, row)
