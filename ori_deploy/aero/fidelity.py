"""How near the section that is built comes to the one that was wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from ori_deploy.design import Structure
from ori_deploy.errors import InputError
from ori_deploy.motion import Mechanism
from ori_deploy.profiles import Profile, xy
from ori_deploy.profiles.profile import Points, Reals

_FINE = 1e-6
"""Sagitta of outlines that are compared, relative to the profile's size."""
_LEAST_POINTS = 24
"""Of each panel's piece: deviations are looked for between nodes, too."""
_ALIGNMENTS = 12
_HALVINGS = 80
_LOWEST_FOLD = 0.9


@dataclass(frozen=True)
class Outline:
    """The outer surface of a structure at a fold, along the profile from s = 0.

    Attributes
    ----------
    s
        (n,) parameter of the profile that each point stands for.
    z
        (n,) where it is, metres.
    gap_m
        Largest opening between neighbouring pieces.
    """

    s: Reals
    z: Points
    gap_m: float


@dataclass(frozen=True)
class Deviation:
    """Distance of an outline from a profile, after the rigid motion that makes it least; metres.

    Attributes
    ----------
    largest, rms
        Along the outline, every millimetre of it counted alike.
    at
        Point of the outline, as it was, at which it is largest.
    aligned
        (n,) the outline, moved.
    outwards
        (n,) how far each of its points is outside the profile; negative inside.
    """

    largest: float
    rms: float
    at: complex
    aligned: Points
    outwards: Reals


def outline_at(structure: Structure, fold: float) -> Outline:
    """The skins of all panels at a fold, all cells in step, as they follow each other along the profile."""
    profile = structure.profile
    poses = Mechanism(structure).poses(fold)
    pieces = structure.outline_pieces
    curved = np.flatnonzero(pieces[:, 1] > pieces[:, 0])
    order = curved[np.argsort(pieces[curved, 0] % profile.period, kind="stable")]
    s, z = [], []
    for panel in order:
        start, stop = pieces[panel]
        nodes = np.linspace(start, stop, max(_LEAST_POINTS, int(np.ceil(600.0 * (stop - start) / profile.period))))
        s.append(nodes)
        z.append(poses.turn[panel, 0] * profile.point(nodes) + poses.shift[panel, 0])
    gaps = [abs(after[0] - before[-1]) for before, after in zip(z, z[1:] + z[:1], strict=True)]
    return Outline(np.concatenate(s), np.concatenate(z), float(max(gaps)))


def fold_with_gap(structure: Structure, gap_m: float) -> float:
    """The fold nearest to 1 at which the skin is open by `gap_m` somewhere: how slits stand that do not quite close.

    Raises
    ------
    InputError
        It never is, or the gap is not a length.
    """
    if not (np.isfinite(gap_m) and gap_m >= 0.0):
        raise InputError("slit_gap_mm", value=1e3 * gap_m, limit="0 or more", remedy="give the gap in millimetres")
    if gap_m <= outline_at(structure, 1.0).gap_m:
        return 1.0
    low, high = np.log(1e-12), np.log(1.0 - _LOWEST_FOLD)
    widest = outline_at(structure, _LOWEST_FOLD).gap_m
    if widest < gap_m:
        raise InputError(
            "slit_gap_mm: the skin never opens so far near its deployed end",
            value=1e3 * gap_m,
            limit=f"{1e3 * widest:.3g} mm",
            remedy="give a smaller gap",
        )
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if outline_at(structure, float(1.0 - np.exp(middle))).gap_m < gap_m:
            low = middle
        else:
            high = middle
    return float(1.0 - np.exp(low))


def deviation(outline: Outline, target: Profile, scale: float = 1.0) -> Deviation:
    """How far an outline stands off a profile.

    Parameters
    ----------
    scale
        What the profile is enlarged by: chords may differ.
    """
    ring = target.sample(0.0, target.period, _FINE * target.size) * scale
    line, inside = shapely.LinearRing(xy(ring)), shapely.Polygon(xy(ring))
    z = outline.z
    for _ in range(_ALIGNMENTS):
        z = z + _step_onto(z, ring)
    away = shapely.distance(line, shapely.points(xy(z)))
    outwards = np.where(shapely.contains_xy(inside, z.real, z.imag), -away, away)
    closed = np.append(outline.z, outline.z[0])
    length = np.abs(np.diff(closed))
    weight = 0.5 * (length + np.roll(length, 1))
    rms = float(np.sqrt((weight * away**2).sum() / weight.sum()))
    worst = int(away.argmax())
    return Deviation(float(away[worst]), rms, complex(outline.z[worst]), z, outwards)


def _step_onto(z: Points, ring: Points) -> Points:
    """What a small turn and shift, the best towards the ring's nearest sides, moves each point by."""
    side = np.diff(ring)
    length = np.abs(side)
    keep = length > 0.0
    start, along = ring[:-1][keep], (side[keep] / length[keep])
    reach = length[keep]
    tree = shapely.STRtree(shapely.linestrings(np.stack([xy(start), xy(start + along * reach)], axis=1)))
    near = tree.nearest(shapely.points(xy(z)))
    normal = 1j * along[near]
    off = (np.conj(normal) * (z - start[near])).real
    centre = z.mean()
    lever = (np.conj(normal) * 1j * (z - centre)).real
    system = np.stack([normal.real, normal.imag, lever], axis=1)
    x, y, turn = np.linalg.lstsq(system, -off, rcond=None)[0]
    return np.asarray((x + 1j * y) + (np.exp(1j * turn) - 1.0) * (z - centre))
