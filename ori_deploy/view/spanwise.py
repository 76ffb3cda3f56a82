"""A span in segments being stowed, in parallel projection: cells close, then the stack folds zig-zag.

Hidden faces are left out by drawing back to front. Segments in step lie between parallel planes (see
`ori_deploy.motion.spanwise`), so their order along the planes' normal is the order in depth; within a
segment all panels are prisms along the span, so which long face hides which is decided in the plane of
the cross-section, and the end faces come last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ori_deploy.motion import SpanFolding
from ori_deploy.profiles.profile import Reals
from ori_deploy.view.ink import FAINT, SLIT, cell_colour, edge_colour, house_style
from ori_deploy.view.strip import CAPTION_IN, GAP_IN, WIDTH_IN, arrange, draw_scale_bar

FRAMES: tuple[tuple[float, float], ...] = (
    (1.0, 0.0), (0.4, 0.0), (0.0, 0.0), (0.0, 0.2), (0.0, 0.5), (0.0, 0.85), (0.0, 1.0),
)  # fmt: skip
"""(fold of the cells, part of the span's folding) to show."""

_MM = 1e3
_SAGITTA = 2e-3
_EYE = np.array([1.0, 0.62, -0.42])
"""Direction towards the eye in (x, y, z): along the panels, through the stack, along the span."""
_LIGHT = np.array([0.45, 0.85, -0.3])


@dataclass(frozen=True)
class SpanFrame:
    """One pose, projected.

    Attributes
    ----------
    fold, hinge_rad
        Of the cells; of the span's hinges.
    faces
        Visible faces, back to front: (k, 2) corners in millimetres, their box's lower left corner at 0.
    panel, light
        (n_faces,) which panel each face belongs to, and how bright it is, 0 to 1.
    hinges
        (n_hinges, 2, 2) ends of the piano hinges.
    size
        (2,) width and height, millimetres.
    """

    fold: float
    hinge_rad: float
    faces: tuple[Reals, ...]
    panel: tuple[int, ...]
    light: tuple[float, ...]
    hinges: Reals
    size: Reals


def span_frames(folding: SpanFolding, frames: tuple[tuple[float, float], ...] = FRAMES) -> tuple[SpanFrame, ...]:
    """The poses of the figure, seen along `_EYE` with the span to the right and the stack upright."""
    return tuple(_frame(folding, fold, part) for fold, part in frames)


def _projection() -> tuple[Reals, Reals]:
    """(2, 3) right and up of the sheet, and (3,) the direction towards the eye, all unit vectors."""
    eye = _EYE / np.linalg.norm(_EYE)
    up = np.array([0.0, 1.0, 0.0]) - eye[1] * eye
    up /= np.linalg.norm(up)
    right = np.cross(up, eye)
    return np.stack([right, up]), eye


def _frame(folding: SpanFolding, fold: float, part: float) -> SpanFrame:
    sheet, eye = _projection()
    angles = np.full((1, folding.segments - 1), np.pi * part)
    matrices = folding.poses([fold], angles)[0]
    axis = folding.stack.axis
    level = np.array([[axis.real, axis.imag, 0.0], [-axis.imag, axis.real, 0.0], [0.0, 0.0, 1.0]])
    # The normal of the planes between segments, in the stack's frame.
    sense = folding.chain.hinge_sign[0]
    normal = np.array([0.0, sense * np.sin(0.5 * np.pi * part), np.cos(0.5 * np.pi * part)])
    order = np.arange(folding.segments)
    faces: list[Reals] = []
    panels: list[int] = []
    lights: list[float] = []
    for k in order if normal @ eye > 0.0 else order[::-1]:
        placed = [
            (p, (corners @ matrices[k, p, :3, :3].T + matrices[k, p, :3, 3]) @ level.T)
            for p, corners in _prism_faces(folding, int(k))
        ]
        seen = [(p, face) for p, face in placed if _outward(face) @ eye > 1e-9]
        for face_number in _back_to_front([face for _, face in seen], level @ matrices[k, 0, :3, 2], eye):
            p, face = seen[face_number]
            faces.append(face @ sheet.T * _MM)
            panels.append(p)
            lights.append(float(0.55 + 0.45 * max(_outward(face) @ _LIGHT / np.linalg.norm(_LIGHT), 0.0)))
    lines = _hinge_lines(folding, matrices) @ level.T @ sheet.T * _MM
    every = np.concatenate(faces)
    corner = every.min(axis=0)
    return SpanFrame(
        fold=fold,
        hinge_rad=float(np.pi * part),
        faces=tuple(face - corner for face in faces),
        panel=tuple(panels),
        light=tuple(lights),
        hinges=lines - corner,
        size=np.ptp(every, axis=0),
    )


def _prism_faces(folding: SpanFolding, segment: int) -> list[tuple[int, Reals]]:
    """(panel, (k, 3) corners) of all faces of one deployed segment, counter-clockwise seen from outside."""
    structure = folding.mechanism.structure
    low, high = segment * folding.length_m, (segment + 1) * folding.length_m
    faces = []
    for p, outline in enumerate(structure.panel_outlines(_SAGITTA * structure.profile.size)):
        if len(outline) < 3:
            continue
        ring = np.stack([outline.real, outline.imag], axis=1)
        near, far = (np.column_stack([ring, np.full(len(ring), z)]) for z in (low, high))
        faces += [(p, near[::-1]), (p, far)]
        following = np.roll(np.arange(len(ring)), -1)
        faces += [
            (p, np.stack([near[a], near[b], far[b], far[a]]))
            for a, b in zip(range(len(ring)), following, strict=True)
        ]
    return faces


def _back_to_front(faces: list[Reals], span: Reals, eye: Reals) -> list[int]:
    """Order of the visible faces of prisms along `span` (3,), seen from `eye` (3,): what hides others last."""
    ends = [n for n, face in enumerate(faces) if np.ptp(face @ span) < 1e-9 * np.ptp(face, axis=0).max()]
    sides = [n for n in range(len(faces)) if n not in set(ends)]
    depth_axis = eye - (eye @ span) * span
    depth_axis /= np.linalg.norm(depth_axis)
    across_axis = np.cross(span, depth_axis)
    # The first two corners of a side are its edge in the cross-section.
    edge = np.array([faces[n][:2] for n in sides])
    across, depth = edge @ across_axis, edge @ depth_axis
    order = np.argsort(across, axis=1)
    across, depth = np.take_along_axis(across, order, 1), np.take_along_axis(depth, order, 1)
    low = np.maximum(across[:, None, 0], across[None, :, 0])
    high = np.minimum(across[:, None, 1], across[None, :, 1])
    slope = (depth[:, 1] - depth[:, 0]) / np.maximum(across[:, 1] - across[:, 0], 1e-300)
    middle = 0.5 * (low + high)
    here = depth[:, None, 0] + slope[:, None] * (middle - across[:, None, 0])
    there = depth[None, :, 0] + slope[None, :] * (middle - across[None, :, 0])
    hides = (high - low > 1e-9 * np.ptp(across)) & (here > there)
    drawn: list[int] = []
    waiting = hides.sum(axis=1).astype(float)  # how many faces each one hides that are not drawn yet
    for _ in sides:
        n = int(np.argmin(waiting))
        drawn.append(sides[n])
        waiting -= hides[:, n]
        waiting[n] = np.inf
    return drawn + ends


def _outward(corners: Reals) -> Reals:
    """(3,) unit normal of a plane polygon, by Newell's formula; 0 for one without area."""
    following = np.roll(corners, -1, axis=0)
    area = np.cross(corners, following).sum(axis=0)
    size = float(np.linalg.norm(area))
    return np.asarray(area / size if size > 0.0 else np.zeros(3))


def _hinge_lines(folding: SpanFolding, matrices: Reals) -> Reals:
    """(n_hinges, 2, 3) where the hinges are; each moves with its panel of the segment before it."""
    ids = folding.mechanism.structure.layout.panel_ids
    return np.array(
        [
            hinge.line_m @ matrices[k, ids.index(hinge.panel), :3, :3].T + matrices[k, ids.index(hinge.panel), :3, 3]
            for k, hinge in enumerate(folding.hinges)
        ]
    )


def draw_spanwise(folding: SpanFolding) -> Figure:
    """Draw the stowing of a span in segments.

    Every frame is one collection with the gid `span<k>`, every hinge a line with the gid `span<k>-<id>`.
    """
    frames = span_frames(folding)
    with house_style():
        scale, rows = arrange([frame.size for frame in frames])
        heights = [max(frames[k].size[1] for k in row) * scale + CAPTION_IN for row in rows]
        height = float(sum(heights)) + GAP_IN * (len(rows) + 1)
        figure = Figure(figsize=(WIDTH_IN, height))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, WIDTH_IN)
        axes.set_ylim(0.0, height)
        top = height - GAP_IN
        for row, tall in zip(rows, heights, strict=True):
            gap = (WIDTH_IN - sum(frames[k].size[0] for k in row) * scale) / (len(row) + 1)
            x = gap
            for k in row:
                width, own = frames[k].size * scale
                foot = top - 0.5 * (tall - CAPTION_IN + own)
                _draw_frame(axes, folding, k, frames[k], np.array([x, foot]), scale)
                _draw_caption(axes, frames[k], x + 0.5 * width, top - tall + CAPTION_IN - 0.1)
                x += width + gap
            top -= tall + GAP_IN
        draw_scale_bar(axes, scale, max(float(frame.size[0]) for frame in frames))
        axes.plot([0.25, 0.6], [0.14, 0.14], color=SLIT, linewidth=2.0)
        axes.text(0.68, 0.14, "piano hinges, on the slit's two faces by turns", va="center", fontsize=8.0)
    return figure


def _draw_frame(axes: Axes, folding: SpanFolding, k: int, frame: SpanFrame, corner: Reals, scale: float) -> None:
    n_cells = folding.mechanism.structure.layout.n_cells
    colours = [
        tuple(light * channel + (1.0 - light) * 0.1 for channel in to_rgb(cell_colour(p // 4, n_cells)))
        for p, light in zip(frame.panel, frame.light, strict=True)
    ]
    axes.add_collection(
        PolyCollection(
            [corner + scale * face for face in frame.faces],
            facecolors=colours,
            edgecolors=[edge_colour(p // 4, n_cells) for p in frame.panel],
            linewidths=0.15,
            joinstyle="round",
            gid=f"span{k}",
        )
    )
    for hinge, ends in zip(folding.hinges, corner + scale * frame.hinges, strict=True):
        axes.plot(*ends.T, color=SLIT, linewidth=2.0, gid=f"span{k}-{hinge.id}")


def _draw_caption(axes: Axes, frame: SpanFrame, x: float, y: float) -> None:
    words = {(1.0, 0.0): "deployed", (0.0, 0.0): "cells flat", (0.0, np.pi): "stowed"}
    title = words.get((frame.fold, frame.hinge_rad), "span folds" if frame.hinge_rad else "cells close")
    axes.text(x, y, title, ha="center", va="top", fontweight="bold")
    detail = f"fold {frame.fold:g}, hinges {np.degrees(frame.hinge_rad):.0f}°"
    axes.text(x, y - 0.17, detail, ha="center", va="top", fontsize=7.5, color=FAINT)
