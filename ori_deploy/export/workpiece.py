"""A panel while things are cut from it: what comes off is told by name and volume, and so is what does not fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from ori_deploy.errors import InputError
from ori_deploy.export.kernel import Body, Triangles, depths, surface
from ori_deploy.export.rulings import PanelShape, Rulings
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

PocketKind = Literal["clearance", "film", "magnet", "mark", "horn", "screw", "bolt", "leaf", "pin", "text"]

_SMALL = 0.02
"""Part of a panel that may come off as crumbs where a cut meets a thin edge; more is a panel in two pieces."""
_ROUNDING = 1e-6
"""Part of a shape that may lie outside a body that holds it: faces of both may be one plane."""
_NO_PLACES = np.zeros((0, 3))


@dataclass(frozen=True)
class Pocket:
    """Something cut from a panel.

    Attributes
    ----------
    kind, name
        What for: ("film", "film c1.open_c"), ("magnet", "magnet slit:P-O1 1 +"), ….
    volume_m3
        What it took off; where cuts overlap, the first counts what they share.
    at
        (3,) its middle on the panel's face, in the user's coordinates, metres.
    length_m
        Of a piano hinge's leaf, along its pin; 0 for others.
    floor, into
        (k, 3) places on its floor and the (3,) unit vector from there into the panel, in the user's coordinates; no
        places where what is left under it is no thin wall.
    """

    kind: PocketKind
    name: str
    volume_m3: float
    at: Vectors
    length_m: float = 0.0
    floor: Vectors = field(default_factory=lambda: _NO_PLACES)
    into: Vectors = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Cut:
    """A shape to take off a panel.

    Attributes
    ----------
    tool
        The shape.
    kind, name, at, length_m
        As of a `Pocket`, `at` in the design's own frame.
    floor, into
        As of a `Pocket`, in the design's own frame.
    """

    tool: Body
    kind: PocketKind
    name: str
    at: Vectors
    length_m: float = 0.0
    floor: Vectors = field(default_factory=lambda: _NO_PLACES)
    into: Vectors = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Remark:
    """Something that does not fit as wished: what, the value found, the limit it breaks, and what helps.

    Attributes
    ----------
    part
        Id of the part.
    left_out
        Whether it is missing; otherwise it is there, but smaller.
    """

    part: str
    thing: str
    value: str
    limit: str
    remedy: str
    left_out: bool = True

    def __str__(self) -> str:
        done = "left out" if self.left_out else "made smaller"
        return f"{self.part}: {self.thing} {done}; found {self.value}; limit: {self.limit}; remedy: {self.remedy}"


@dataclass(frozen=True)
class FilmStrip:
    """What a crease's film covers of one panel.

    Attributes
    ----------
    crease
        "c1.open_c".
    width_m, length_m, area_m2
        Width at `s_high`, length along the crease, area, as far as the panel's face goes: what has to be bought.
    at
        (3,) its middle, in the user's coordinates.
    reach
        How far it reaches from the crease: metres, on a cone radians about the apex.
    s_low, s_high
        Where along the crease it begins and ends.
    glue_from_m
        From how far off the crease on it is let in and glued; None where it is not.
    """

    crease: str
    width_m: float
    length_m: float
    area_m2: float
    at: Vectors
    reach: float
    s_low: float = 0.0
    s_high: float = 0.0
    glue_from_m: float | None = None


@dataclass(frozen=True)
class Plane:
    """A plane face of a panel, seen from one of its two bounding lines.

    Attributes
    ----------
    row
        Its two lines, counter-clockwise round the panel.
    from_last
        Whether places are told from the second line backwards.
    """

    row: Rulings
    from_last: bool

    @property
    def along(self) -> Vectors:
        """(3,) direction of the line that places are told from."""
        return np.asarray(self.row.direction[-1 if self.from_last else 0])

    @cached_property
    def outward(self) -> Vectors:
        """(3,) unit normal, out of the panel."""
        return np.asarray(self.row.normals(1.0)[0])

    @property
    def across(self) -> Vectors:
        """(3,) unit vector in the face, from the one line towards the other, at right angles to it."""
        ahead = -np.cross(self.outward, self.along)
        return -ahead if self.from_last else ahead

    def point(self, s: float, a: float) -> Vectors:
        """(3,) the place `s` along the line and `a` across from it."""
        return np.asarray(self.row.at(s)[-1 if self.from_last else 0] + a * self.across)

    def width(self, s: float) -> float:
        """Distance of the other line, across from the place `s`."""
        near, far = self.point(s, 0.0), self.row.at(s)[0 if self.from_last else -1]
        other = self.row.direction[0 if self.from_last else -1]
        # The other line is not parallel on a cone: where it crosses the perpendicular through `near`.
        gone = (near - far) @ self.along / (other @ self.along)
        return float((far + gone * other - near) @ self.across)


@dataclass
class Workpiece:
    """A part in the making, in the design's own frame (`rulings`).

    Attributes
    ----------
    id, shape
        The part's id, and its panel's cross-section.
    s_low, s_high
        The part of the span it is.
    body
        What is left of it.
    wall_m
        The thinnest wall that may be left.
    to_user
        (4, 4) to the user's coordinates.
    """

    id: str
    shape: PanelShape
    s_low: float
    s_high: float
    body: Body
    wall_m: float
    to_user: Reals
    pockets: list[Pocket] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    films: list[FilmStrip] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.plain_m3 = float(self.body.volume())
        self._plain: tuple[Vectors, Triangles] = surface(self.body)
        self._left: tuple[Body, tuple[Vectors, Triangles]] = self.body, self._plain

    def plane(self, kind: Literal["back", "inner"], from_last: bool) -> Plane | None:
        """A plane face of the panel, or None where it has none."""
        face = self.shape.face(kind, self.s_high)
        return None if face is None else Plane(face.rulings, from_last)

    def depth(self, origins: Vectors, into: Vectors) -> Reals:
        """(n,) how thick the panel was under places on its surface before anything was cut."""
        return depths(*self._plain, origins, into)

    def room(self, origins: Vectors, into: Vectors, floor_m: float) -> Reals:
        """(n,) how thick the panel, as it stands, is under places on its plain surface, a floor `floor_m` below.

        No more than to the floor where that lies in something that was cut already, or beside the panel.
        """
        if self._left[0] is not self.body:
            self._left = self.body, surface(self.body)
        left = depths(*self._left[1], origins + floor_m * into, into)
        return np.where(left > 0.0, floor_m + left, np.minimum(self.depth(origins, into), floor_m))

    def holds(self, shape: Body) -> bool:
        """Whether all of a shape lies within what is left of the panel."""
        return bool((shape - self.body).volume() <= _ROUNDING * shape.volume())

    def cut(self, tool: Body, kind: PocketKind, name: str, at: Vectors, length_m: float = 0.0) -> bool:
        """Take a tool's shape off; see `take`."""
        return self.take(Cut(tool, kind, name, at, length_m))

    def take(self, cut: Cut) -> bool:
        """Take a shape off; False, and told, where that would take nothing, or break the panel.

        Raises
        ------
        InputError
            A clearance that leaves nothing.
        """
        after = self.body - cut.tool
        before = float(self.body.volume())
        if before - float(after.volume()) <= 1e-12 * self.plain_m3:
            if cut.kind != "clearance":
                self.remark(
                    cut.name, "nothing left to cut there", "some of the panel", "smaller pockets, or clearances"
                )
            return False
        pieces = after.decompose()
        main = max(pieces, key=lambda piece: float(piece.volume()), default=after)
        kept = float(main.volume())
        if cut.kind == "clearance" and kept <= _SMALL * before:
            raise InputError(
                f"{self.id}: {cut.name}: larger than the panel",
                value=f"{100.0 * (1.0 - kept / before):.0f} % of the panel taken off",
                limit=f"less than {100.0 * (1.0 - _SMALL):.0f} %",
                remedy="a smaller value of that key of [clearance] in the parts file",
            )
        if kept < float(after.volume()) - _SMALL * before or kept <= 0.0:
            self.remark(cut.name, f"{len(pieces)} pieces", "one piece", "a thicker wall_m, or a smaller pocket")
            return False
        self.body = main
        turn = self.to_user[:3, :3]
        floor = cut.floor @ turn.T + self.to_user[:3, 3]
        self.pockets.append(
            Pocket(cut.kind, cut.name, before - kept, self.placed(cut.at), cut.length_m, floor, turn @ cut.into)
        )
        return True

    def placed(self, at: Vectors) -> Vectors:
        """(3,) a place in the user's coordinates."""
        return np.asarray(self.to_user[:3, :3] @ at + self.to_user[:3, 3])

    def remark(self, thing: str, value: str, limit: str, remedy: str, *, left_out: bool = True) -> None:
        """Note what does not fit."""
        self.remarks.append(Remark(self.id, thing, value, limit, remedy, left_out))


def take_together(cuts: Sequence[tuple[Workpiece, Cut]]) -> bool:
    """All cuts or none: nothing is mounted by half. What fails is told by its panel."""
    before = [(piece, piece.body, len(piece.pockets)) for piece, _ in cuts]
    if all(piece.take(cut) for piece, cut in cuts):
        return True
    for piece, body, count in reversed(before):
        piece.body = body
        del piece.pockets[count:]
    return False
