"""A panel while things are cut from it: what comes off is told by name and volume, and so is what does not fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from ori_deploy.export.kernel import Body, Triangles, depths, surface
from ori_deploy.export.rulings import PanelShape, Rulings
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

PocketKind = Literal["clearance", "film", "magnet", "mark", "horn", "screw", "leaf", "pin", "text"]

_SMALL = 0.02
"""Part of a panel that may come off as crumbs where a cut meets a thin edge; more is a panel in two pieces."""


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
    """

    kind: PocketKind
    name: str
    volume_m3: float
    at: Vectors
    length_m: float = 0.0


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
        Width at `s_high`, length along the crease, area.
    at
        (3,) its middle, in the user's coordinates.
    """

    crease: str
    width_m: float
    length_m: float
    area_m2: float
    at: Vectors


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
        self._surface: tuple[Vectors, Triangles] = surface(self.body)

    def plane(self, kind: Literal["back", "inner"], from_last: bool) -> Plane | None:
        """A plane face of the panel, or None where it has none."""
        face = self.shape.face(kind, self.s_high)
        return None if face is None else Plane(face.rulings, from_last)

    def depth(self, origins: Vectors, into: Vectors) -> Reals:
        """(n,) how thick the panel was under places on its surface before anything was cut."""
        return depths(*self._surface, origins, into)

    def cut(self, tool: Body, kind: PocketKind, name: str, at: Vectors, length_m: float = 0.0) -> bool:
        """Take a tool's shape off; False where that would take nothing, or break the panel."""
        after = self.body - tool
        before = float(self.body.volume())
        if before - float(after.volume()) <= 1e-12 * self.plain_m3:
            return False
        pieces = after.decompose()
        main = max(pieces, key=lambda piece: float(piece.volume()), default=after)
        kept = float(main.volume())
        if kept < float(after.volume()) - _SMALL * before or kept <= 0.0:
            self.remark(name, f"{len(pieces)} pieces", "one piece", "a thicker wall_m, or a smaller pocket")
            return False
        self.body = main
        self.pockets.append(Pocket(kind, name, before - kept, self.placed(at), length_m))
        return True

    def placed(self, at: Vectors) -> Vectors:
        """(3,) a place in the user's coordinates."""
        return np.asarray(self.to_user[:3, :3] @ at + self.to_user[:3, 3])

    def remark(self, thing: str, value: str, limit: str, remedy: str, *, left_out: bool = True) -> None:
        """Note what does not fit."""
        self.remarks.append(Remark(self.id, thing, value, limit, remedy, left_out))
