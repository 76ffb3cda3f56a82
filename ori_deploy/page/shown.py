"""The structure in the browser: meshes are uploaded once; after that only poses and colours are sent.

Without a graphics card the browser's processor draws. Lighting every pixel takes most of its time, and every object
a third of a millisecond: so bodies have their light painted on and no rims, and all of a rigid body is one object:
its panels, and its creases and slits as rods. With a red panel it is another object, uploaded when it first has one,
and so it is in grey, where nobody knows where it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from ori_deploy.page.content import GREY, RED, Content, Rgb
from ori_deploy.page.glb import Paint, body, painted, rods
from ori_deploy.page.placing import Mover, Places

_ROD = 2.2e-3
"""Radius of the rods that creases and slits are, in diagonals of the box round the deployed structure."""

Look = frozenset[str] | None
"""Panels of a body that are red; None where it is grey."""

UNKNOWN = "unknown"
LATCH_COLOURS: Mapping[str, Rgb] = {UNKNOWN: (150, 158, 170), "open": (240, 160, 0), "closed": (0, 150, 70)}


class Shown:
    """A design in a viser scene.

    Parameters
    ----------
    server
        Where.
    content
        What is uploaded.
    mover
        How it moves.
    """

    def __init__(self, server: viser.ViserServer, content: Content, mover: Mover) -> None:
        self._server, self._content, self._mover = server, content, mover
        self._size = mover.mechanism.size_m
        self._bodies = np.array(content.bodies)
        self._frames: list[dict[int, viser.FrameHandle]] = []
        self._segments: list[viser.FrameHandle] = []
        self._rods = _rods(content)
        self._looks: dict[tuple[int, Look], list[viser.GlbHandle]] = {}
        self._panels_of = {
            number: frozenset(panel.id for panel in content.panels if panel.body == number)
            for number in content.bodies
        }
        self._look: dict[int, Look] = dict.fromkeys(content.bodies, frozenset[str]())
        self._latches: dict[str, list[viser.IcosphereHandle]] = {latch.id: [] for latch in content.latches}
        self._latch_states = dict.fromkeys(self._latches, UNKNOWN)
        server.scene.set_up_direction("+y")
        server.scene.configure_default_lights(enabled=False)
        server.scene.add_light_ambient("/daylight", intensity=3.0)
        for k in range(content.segments):
            self._upload(k)
        for number in content.bodies:
            self._looks_like(number, frozenset())

    # --- once -----------------------------------------------------------------------------------------

    def _upload(self, segment: int) -> None:
        scene, root = self._server.scene, f"/s{segment}"
        self._segments.append(scene.add_frame(root, show_axes=False))
        frames = {int(b): scene.add_frame(f"{root}/b{b}", show_axes=False) for b in self._bodies}
        self._frames.append(frames)
        for latch in self._content.latches:
            self._latches[latch.id].append(
                scene.add_icosphere(
                    f"{root}/b{latch.body}/{latch.id}",
                    radius=0.02 * self._size,
                    color=LATCH_COLOURS[UNKNOWN],
                    subdivisions=1,
                    position=latch.place,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )

    def _looks_like(self, number: int, look: Look) -> list[viser.GlbHandle]:
        """A rigid body, some of its panels red or all of them grey, in every segment."""
        if (number, look) not in self._looks:
            paints = [
                painted(panel.solid, GREY if look is None else RED if panel.id in look else panel.colour)
                for panel in self._content.panels
                if panel.body == number
            ]
            data = body([*paints, *self._rods.get(number, [])])
            name = "grey" if look is None else "+".join(("look", *sorted(look)))
            names = [f"/s{k}/b{number}/{name}" for k in range(self._content.segments)]
            self._looks[number, look] = [_add(self._server.scene, name, data) for name in names]
        return self._looks[number, look]

    # --- again and again --------------------------------------------------------------------------------

    def pose(self, fold: ArrayLike, span_folded: float = 0.0) -> None:
        """Put everything where it is at one fold per cell; sends what has moved."""
        panels = self._mover.panels(np.asarray(fold, dtype=float))
        bodies = Places(panels.wxyz[self._bodies], panels.position[self._bodies])
        segments = self._mover.segments(span_folded)
        with self._server.atomic():
            for frame, wxyz, position in zip(self._segments, segments.wxyz, segments.position, strict=True):
                _move(frame, wxyz, position)
            for frames in self._frames:
                for frame, wxyz, position in zip(frames.values(), bodies.wxyz, bodies.position, strict=True):
                    _move(frame, wxyz, position)

    def redden(self, panels: frozenset[str]) -> None:
        """Show these panels red, and no others."""
        self._change({number: panels & of for number, of in self._panels_of.items()})

    def grey(self) -> None:
        """Show that nobody knows where it is, until it is reddened, or not, again."""
        self._change(dict.fromkeys(self._panels_of))

    def _change(self, looks: Mapping[int, Look]) -> None:
        with self._server.atomic():
            for number, look in looks.items():
                before = self._look[number]
                if look == before:
                    continue
                for one, visible in ((before, False), (look, True)):
                    for handle in self._looks_like(number, one):
                        handle.visible = visible
                self._look[number] = look

    def latch(self, states: Mapping[str, str]) -> None:
        """Show what is known of the latches: "open" or "closed"; those that are not told of are "unknown"."""
        for name, before in self._latch_states.items():
            state = states.get(name, UNKNOWN)
            if state == before:
                continue
            self._latch_states[name] = state
            for ball in self._latches[name]:
                ball.color = LATCH_COLOURS[state]


def _move(frame: viser.FrameHandle, wxyz: NDArray[np.float64], position: NDArray[np.float64]) -> None:
    """A message for each of the two that has changed: none for what stands still."""
    if not np.array_equal(frame.wxyz, wxyz):
        frame.wxyz = wxyz
    if not np.array_equal(frame.position, position):
        frame.position = position


def _add(scene: viser.SceneApi, name: str, data: bytes) -> viser.GlbHandle:
    return scene.add_glb(name, data, cast_shadow=False, receive_shadow=False)


def _rods(content: Content) -> dict[int, list[Paint]]:
    """Creases and slits, by the bodies that carry them."""
    lines = (*content.creases, *content.slits)
    corners = np.concatenate([line.segments.reshape(-1, 3) for line in lines])
    sides = np.ptp(corners, axis=0)
    sides[2] += (content.segments - 1) * content.segment_m
    radius = _ROD * float(np.linalg.norm(sides))
    made: dict[int, list[Paint]] = {}
    for line in lines:
        made.setdefault(line.body, []).append(rods(line.segments, line.colour, radius))
    return made
