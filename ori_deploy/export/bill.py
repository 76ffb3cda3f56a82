"""Bill of materials: what to buy and print, what it weighs, and where the centre of mass is along the fold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.export.horns import crease_line
from ori_deploy.export.parts import Parts
from ori_deploy.export.rulings import s_range, to_user
from ori_deploy.motion import CREASES, NEXT_CREASE, mechanism_of
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

FOLDS = 11
"""Folds at which the centre of mass is told where nobody asks for a number."""


@dataclass(frozen=True)
class Item:
    """A line of the bill.

    Attributes
    ----------
    thing, amount
        What, and how much of it in words: "16 panels", "0.31 m²".
    count
        Pieces.
    mass_kg
        Of all of them.
    """

    thing: str
    amount: str
    count: int
    mass_kg: float


@dataclass(frozen=True)
class Bill:
    """What a structure is made of.

    Attributes
    ----------
    items
        Material, film, magnets, servos, piano hinges: those that there are. Of plain parts the bill tells what the
        finished structure carries, too; only their volume is without pockets.
    panel_kg
        Mass by panel, with all that sits on it; of span segments together.
    fold
        (n,) from flat (0) to deployed (1), all cells in step, the span unfolded.
    centre_m
        (n, 3) centre of mass, the first panel staying where it is when deployed; the user's coordinates.
    """

    items: tuple[Item, ...]
    panel_kg: dict[str, float]
    fold: Reals
    centre_m: Vectors

    @property
    def mass_kg(self) -> float:
        return sum(item.mass_kg for item in self.items)

    def data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "mass_kg": self.mass_kg,
            "items": [
                {"thing": i.thing, "amount": i.amount, "count": i.count, "mass_kg": i.mass_kg} for i in self.items
            ],
            "panel_kg": self.panel_kg,
            "centre_of_mass": {"fold": self.fold.tolist(), "centre_m": self.centre_m.tolist()},
        }

    def text(self) -> str:
        """As a table."""
        rows = [(i.thing, str(i.count), i.amount, f"{1e3 * i.mass_kg:.1f} g") for i in self.items]
        rows = [("what", "count", "amount", "mass"), *rows, ("all", "", "", f"{1e3 * self.mass_kg:.1f} g")]
        lines = _aligned(rows)
        places = [
            (f"{f:.2f}", *(f"{1e3 * x:.1f}" for x in centre))
            for f, centre in zip(self.fold, self.centre_m, strict=True)
        ]
        lines += ["", "centre of mass over the fold", *_aligned([("fold", "x mm", "y mm", "z mm"), *places])]
        return "\n".join(lines) + "\n"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]


@dataclass(frozen=True)
class _Mass:
    """A point mass on a panel, deployed."""

    thing: str
    panel: int
    at: Vectors
    kg: float


def bill_of(parts: Parts, fold: Reals | int = FOLDS) -> Bill:
    """The bill of parts.

    Parameters
    ----------
    fold
        (n,) folds in [0, 1] at which to tell the centre of mass, or how many at equal steps.
    """
    folds = np.linspace(0.0, 1.0, fold) if isinstance(fold, int) else np.asarray(fold, dtype=float)
    masses = list(_masses(parts))
    return Bill(_items(parts, masses), _by_panel(parts, masses), folds, _centre(parts, masses, folds))


def _masses(parts: Parts) -> Iterator[_Mass]:
    spec = parts.spec
    film = 1e-6 * spec.film.thickness_um * spec.film.density_kg_m3
    for part in parts.parts:
        yield _Mass("panels", part.panel, part.centroid, spec.material.density_kg_m3 * part.volume_m3)
        for strip in part.films:
            yield _Mass("film", part.panel, strip.at, film * strip.area_m2)
    for part in parts.worked.parts:
        for pocket in part.pockets:
            if pocket.kind == "magnet":
                yield _Mass("magnets", part.panel, pocket.at, 1e-3 * spec.magnet.mass_g)
            elif pocket.kind == "leaf":
                yield _Mass(
                    "piano hinges", part.panel, pocket.at, 0.5e-3 * spec.span_hinge.mass_g_m * pocket.length_m
                )
    structure = parts.design.structure
    low, high = s_range(structure, parts.design.span_m, parts.design.r_min_m)
    end = low if isinstance(structure, Structure) else high
    frame = to_user(structure)
    for cell, crease in parts.driven.items():
        number, index = structure.layout.cell_ids.index(cell), CREASES.index(crease)
        base, along = crease_line(structure, number, index)
        at = frame[:3, :3] @ (base + end * along) + frame[:3, 3]
        yield _Mass("servos", 4 * number + NEXT_CREASE.index(index), at, 1e-3 * spec.horn.mass_g)


def _items(parts: Parts, masses: list[_Mass]) -> tuple[Item, ...]:
    spec = parts.spec
    creases = {strip.crease for part in parts.parts for strip in part.films}
    film = sum(strip.area_m2 for part in parts.parts for strip in part.films)
    hinges = {p.name for part in parts.worked.parts for p in part.pockets if p.kind == "leaf"}
    mounted = len(parts.worked.mounted)
    mounts = "" if mounted == len(parts.driven) else f"mounts for {mounted} of them"
    told = {
        "panels": (f"panels of {spec.material.name}", f"{1e6 * parts.volume_m3:.1f} cm³", len(parts.parts)),
        "film": (f"{spec.film.name}, {spec.film.thickness_um:g} µm", f"{1e4 * film:.1f} cm²", len(creases)),
        "magnets": (spec.magnet.name, "", sum(m.thing == "magnets" for m in masses)),
        "servos": (spec.horn.name, mounts, len(parts.driven)),
        "piano hinges": (f"piano hinge, pin {spec.span_hinge.pin_diameter_mm:g} mm", "", len(hinges)),
    }
    return tuple(
        Item(*told[thing], sum(m.kg for m in masses if m.thing == thing)) for thing in told if told[thing][2] > 0
    )


def _by_panel(parts: Parts, masses: list[_Mass]) -> dict[str, float]:
    ids = parts.design.structure.layout.panel_ids
    out = dict.fromkeys(ids, 0.0)
    for mass in masses:
        out[ids[mass.panel]] += mass.kg
    return out


def _centre(parts: Parts, masses: list[_Mass], folds: Reals) -> Vectors:
    matrices = mechanism_of(parts.design.structure, parts.design.unit_m).poses(folds).matrices()
    if matrices.shape[-1] == 3:  # of the cross-section's plane; the span stays where it is
        plane, matrices = matrices, np.zeros((*matrices.shape[:2], 4, 4))
        matrices[..., :2, :2], matrices[..., :2, 3] = plane[..., :2, :2], plane[..., :2, 2]
        matrices[..., 2, 2] = matrices[..., 3, 3] = 1.0
    kg = np.array([m.kg for m in masses])
    at = np.array([[*m.at, 1.0] for m in masses])
    moved = np.einsum("fmij,mj->fmi", matrices[:, [m.panel for m in masses]], at)[..., :3]
    total = float(kg.sum())
    weight = kg / total if total > 0.0 else np.full(len(kg), 1.0 / len(kg))
    return np.asarray(np.einsum("m,fmi->fi", weight, moved))
