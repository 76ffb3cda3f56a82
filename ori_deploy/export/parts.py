"""All printable parts of a design: one per panel, or per panel and span segment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.export.films import LetIn, let_in_films, measure_films, shorten_films
from ori_deploy.export.horns import check_driven, mount_horns
from ori_deploy.export.kernel import Triangles, need, surface
from ori_deploy.export.lettering import engrave
from ori_deploy.export.magnets import Slit, set_magnets
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.recesses import clear, clear_end
from ori_deploy.export.rulings import Kind, panel_shape, s_range, to_user
from ori_deploy.export.solids import panel_body
from ori_deploy.export.span_hinges import let_in_hinge
from ori_deploy.export.workpiece import FilmStrip, Pocket, Remark, Workpiece
from ori_deploy.files import Design
from ori_deploy.motion import Mechanism, SpanFolding
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_RESTS: tuple[Kind, ...] = ("inner", "back", "joint_close")
"""Plane faces that a part can be printed on, if they are broad enough."""


@dataclass(frozen=True)
class Part:
    """One part, deployed, in the design's coordinates (a cone's: the user's). Metres.

    Attributes
    ----------
    id
        The panel's ("c1.ac"); of span segments "c1.ac.s1", ….
    panel, segment
        Numbers from 0.
    points, triangles
        (n, 3), (m, 3) its closed surface, triangles counter-clockwise seen from outside.
    plain_m3
        Volume before anything was cut from it.
    pockets
        What was cut from it, in this order.
    films
        What film covers of it.
    rests
        (3,) outward unit normals of the plane faces that it can be printed on, the inner one first.
    """

    id: str
    panel: int
    segment: int
    points: Vectors
    triangles: Triangles
    plain_m3: float
    pockets: tuple[Pocket, ...]
    films: tuple[FilmStrip, ...]
    rests: tuple[Vectors, ...]

    @cached_property
    def _moments(self) -> tuple[float, Vectors]:
        near = self.points - self.points[0]
        a, b, c = (near[self.triangles[:, k]] for k in range(3))
        six = np.einsum("ij,ij->i", a, np.cross(b, c))
        total = float(six.sum())
        return total / 6.0, self.points[0] + ((a + b + c) * six[:, None]).sum(axis=0) / (4.0 * total)

    @property
    def volume_m3(self) -> float:
        """What the surface encloses."""
        return self._moments[0]

    @property
    def centroid(self) -> Vectors:
        """(3,) metres."""
        return self._moments[1]

    @cached_property
    def faces(self) -> tuple[Vectors, Reals]:
        """(m, 3) unit normals and (m,) areas of its triangles."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        twice = np.linalg.norm(normal, axis=1)
        return normal / np.where(twice > 0.0, twice, 1.0)[:, None], 0.5 * twice

    def mesh(self, scale: float = 1.0) -> Any:
        """A trimesh.Trimesh, as it is, times `scale`."""
        return need("trimesh", "export").Trimesh(scale * self.points, self.triangles, process=False)


@dataclass(frozen=True)
class Parts:
    """What `build_parts` makes.

    Attributes
    ----------
    design, spec
        What from.
    driven
        Crease by cell where servos sit.
    plain
        Whether nothing was cut.
    parts
        By panel, then segment.
    remarks
        What does not fit: left out, or smaller than wished.
    """

    design: Design
    spec: PartsSpec
    driven: Mapping[str, str]
    plain: bool
    parts: tuple[Part, ...]
    remarks: tuple[Remark, ...]

    @property
    def volume_m3(self) -> float:
        return sum(part.volume_m3 for part in self.parts)

    @cached_property
    def worked(self) -> Parts:
        """These parts with everything cut: themselves, but where they are plain."""
        return build_parts(self.design, self.spec, driven=self.driven) if self.plain else self

    @property
    def mounted(self) -> tuple[str, ...]:
        """Driven creases ("c1.close_a") whose horn has a mount."""
        names = {pocket.name for part in self.parts for pocket in part.pockets if pocket.kind == "horn"}
        return tuple(name for cell, crease in self.driven.items() if f"horn {(name := f'{cell}.{crease}')}" in names)


def build_parts(
    design: Design, spec: PartsSpec | None = None, *, driven: Mapping[str, str] | None = None, plain: bool = False
) -> Parts:
    """The printable parts of a design.

    Parameters
    ----------
    spec
        Sizes of pockets and the rest; the defaults where left out.
    driven
        Crease by cell ("c1": "close_a") where a servo sits.
    plain
        Bodies only: no pockets, recesses, clearance or letters.

    Raises
    ------
    InputError
        A driven crease that is none of this design, or the extra is missing.
    """
    spec, driven = spec or PartsSpec(), dict(driven or {})
    check_driven(driven, design.structure.layout)
    pieces, remarks = _blanks(design, spec)
    for piece in pieces.values():
        measure_films(piece, spec.film, design.structure.layout)
    if not plain:
        segments = [{p: piece for (p, k), piece in pieces.items() if k == n} for n in range(design.span_segments)]
        remarks += _work(design, spec, driven, segments)
    parts = tuple(_finished(piece, segment) for (_, segment), piece in sorted(pieces.items()))
    remarks += [remark for _, piece in sorted(pieces.items()) for remark in piece.remarks]
    return Parts(design, spec, driven, plain, parts, tuple(remarks))


def _blanks(design: Design, spec: PartsSpec) -> tuple[dict[tuple[int, int], Workpiece], list[Remark]]:
    """A body per panel and segment, and panels that have none."""
    structure, count = design.structure, design.span_segments
    low, high = s_range(structure, design.span_m, design.r_min_m)
    cuts = np.linspace(low, high, count + 1)
    chord = 1e-3 * spec.print.chord_mm
    pieces, remarks = {}, []
    frame = to_user(structure)
    for panel, name in enumerate(structure.layout.panel_ids):
        shape = panel_shape(structure, panel, chord / design.unit_m)
        if shape is None:
            remark = Remark(name, "panel", "no area", "some material", "a wall_m above 0 in the specification")
            remarks.append(remark)
            continue
        for k in range(count):
            area = float(structure.panel_areas[panel])
            body = panel_body(shape, float(cuts[k]), float(cuts[k + 1]), area, chord)
            own = name if count == 1 else f"{name}.s{k + 1}"
            wall = 1e-3 * spec.print.wall_mm
            pieces[panel, k] = Workpiece(own, shape, float(cuts[k]), float(cuts[k + 1]), body, wall, frame)
    return pieces, remarks


def _work(
    design: Design, spec: PartsSpec, driven: Mapping[str, str], segments: list[dict[int, Workpiece]]
) -> list[Remark]:
    """Cut everything into the parts of all segments; what has no place yet comes after what has one."""
    layout, last = design.structure.layout, design.span_segments - 1
    films: list[tuple[Workpiece, list[LetIn]]] = []
    for segment, pieces in enumerate(segments):
        for panel, piece in pieces.items():
            clear(piece, spec.clearance, bool(layout.is_slit[panel]))
            for at_high, is_cut in ((False, segment > 0), (True, segment < last)):
                if is_cut:
                    clear_end(piece, at_high, 1e-3 * spec.clearance.segment_mm)
            films.append((piece, let_in_films(piece, pieces, spec, layout)))
    _hang(design, spec, segments)
    remarks = mount_horns(segments[0], design, driven, spec)
    for segment, pieces in enumerate(segments):
        for slit in _slits(design, spec, pieces, segment):
            set_magnets(slit, spec)
        for piece in pieces.values():
            engrave(piece, spec.text, 1e-3 * spec.film.glue_mm)
    for piece, let_in in films:
        shorten_films(piece, let_in)
    return remarks


def _slits(design: Design, spec: PartsSpec, pieces: Mapping[int, Workpiece], segment: int) -> list[Slit]:
    layout = design.structure.layout
    clear_m = 0.0 if design.span_segments == 1 else 1e-3 * (spec.span_hinge.leaf_width_mm + spec.print.wall_mm)
    found = []
    for a, b in layout.slits:
        name = f"slit:{layout.vertices[a].id}-{layout.vertices[b].id}"
        ends = {a, b}
        panels = [
            p for p in map(int, np.flatnonzero(layout.is_slit)) if set(_edge(layout.cells[p // 4], p % 4)) == ends
        ]
        even, odd = sorted(panels, key=lambda p: p % 2)
        if even in pieces and odd in pieces:
            found.append(Slit(name, (pieces[even], pieces[odd]), clear_m, segment))
    return found


def _edge(cell: tuple[int, int, int, int], k: int) -> tuple[int, int]:
    return cell[k], cell[(k + 1) % 4]


def _hang(design: Design, spec: PartsSpec, segments: list[dict[int, Workpiece]]) -> None:
    """Let in the piano hinges between segments."""
    structure = design.structure
    if len(segments) == 1 or not isinstance(structure, Structure):
        return
    mechanism = Mechanism(structure)
    ids = structure.layout.panel_ids
    for k, hinge in enumerate(SpanFolding(mechanism, design.span_m, design.span_segments).hinges):
        let_in_hinge((segments[k], segments[k + 1]), ids.index(hinge.panel), hinge, mechanism, spec.span_hinge)


def _finished(piece: Workpiece, segment: int) -> Part:
    points, triangles = surface(piece.body)
    turn, shift = piece.to_user[:3, :3], piece.to_user[:3, 3]
    if float(np.linalg.det(turn)) < 0.0:
        triangles = triangles[:, ::-1]
    plane = [f.rulings for kind in _RESTS if (f := piece.shape.face(kind, piece.s_high))]
    broadest = max(float(row.widths(piece.s_high)[0]) for row in plane)
    rests = [row.normals(piece.s_high)[0] for row in plane if row.widths(piece.s_high)[0] > 0.5 * broadest]
    return Part(
        piece.id, piece.shape.panel, segment, points @ turn.T + shift, triangles, piece.plain_m3,
        tuple(piece.pockets), tuple(piece.films), tuple(turn @ outward for outward in rests),
    )  # fmt: skip
