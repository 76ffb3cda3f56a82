"""The structure in the browser: meshes are uploaded once; after that only poses and colours are sent.

Without a graphics card the browser's processor draws. Lighting every pixel takes most of its time, and every object a
third of a millisecond: so bodies have their light painted on and no rims, and all creases and slits are one object,
whose ends are sent. A panel that turns red is another body that was uploaded with it, and hidden.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from ori_deploy.page.content import RED, Content, Line, Rgb
from ori_deploy.page.glb import painted
from ori_deploy.page.placing import Mover, Places
from ori_deploy.profiles.profile import Reals

LATCH_COLOURS: Mapping[str, Rgb] = {"unknown": (150, 158, 170), "open": (240, 160, 0), "closed": (0, 150, 70)}


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
        self._own: dict[str, list[viser.GlbHandle]] = {panel.id: [] for panel in content.panels}
        self._reds: dict[str, list[viser.GlbHandle]] = {panel.id: [] for panel in content.panels}
        self._red: frozenset[str] = frozenset()
        self._latches: dict[str, list[viser.IcosphereHandle]] = {latch.id: [] for latch in content.latches}
        self._latch_states: dict[str, str] = {}
        server.scene.set_up_direction("+y")
        server.scene.configure_default_lights(enabled=False)
        server.scene.add_light_ambient("/daylight", intensity=3.0)
        for k in range(content.segments):
            self._upload(k)
        self._lines = _Lines(server, content)

    # --- once -----------------------------------------------------------------------------------------

    def _upload(self, segment: int) -> None:
        scene, root = self._server.scene, f"/s{segment}"
        self._segments.append(scene.add_frame(root, show_axes=False))
        frames = {int(b): scene.add_frame(f"{root}/b{b}", show_axes=False) for b in self._bodies}
        self._frames.append(frames)
        for panel in self._content.panels:
            name = f"{root}/b{panel.body}/{panel.id}"
            self._own[panel.id].append(_add(scene, name, painted(panel.solid, panel.colour), visible=True))
            self._reds[panel.id].append(_add(scene, f"{name}.red", painted(panel.solid, RED), visible=False))
        for latch in self._content.latches:
            self._latches[latch.id].append(
                scene.add_icosphere(
                    f"{root}/b{latch.body}/{latch.id}",
                    radius=0.012 * self._size,
                    color=LATCH_COLOURS["unknown"],
                    subdivisions=1,
                    position=latch.place,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )

    # --- again and again --------------------------------------------------------------------------------

    def pose(self, fold: ArrayLike, span_folded: float = 0.0) -> None:
        """Put everything where it is at one fold per cell; sends what has moved."""
        panels = self._mover.panels(np.asarray(fold, dtype=float))
        bodies = Places(panels.wxyz[self._bodies], panels.position[self._bodies])
        segments = self._mover.segments(span_folded)
        with self._server.atomic():
            for frame, wxyz, position in zip(self._segments, segments.wxyz, segments.position, strict=True):
                _move(frame, wxyz, position)
            self._lines.move(panels.matrices(), segments.matrices())
            for frames in self._frames:
                for frame, wxyz, position in zip(frames.values(), bodies.wxyz, bodies.position, strict=True):
                    _move(frame, wxyz, position)

    def redden(self, panels: frozenset[str]) -> None:
        """Show these panels red, and no others."""
        if panels == self._red:
            return
        with self._server.atomic():
            for name in panels ^ self._red:
                for own, red in zip(self._own.get(name, ()), self._reds.get(name, ()), strict=True):
                    own.visible, red.visible = name not in panels, name in panels
        self._red = panels

    def latch(self, states: Mapping[str, str]) -> None:
        """Show what is known of the latches: "unknown", "open" or "closed"."""
        for name, state in states.items():
            if self._latch_states.get(name) == state or name not in self._latches:
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


def _add(scene: viser.SceneApi, name: str, body: bytes, *, visible: bool) -> viser.GlbHandle:
    return scene.add_glb(name, body, visible=visible, cast_shadow=False, receive_shadow=False)


class _Lines:
    """Creases and slits of all span segments as one object."""

    def __init__(self, server: viser.ViserServer, content: Content) -> None:
        lines: list[Line] = [*content.creases, *content.slits]
        self._ends = np.concatenate([line.segments for line in lines])
        counts = [len(line.segments) for line in lines]
        self._body = np.repeat([line.body for line in lines], counts)
        colours = np.repeat(np.array([line.colour for line in lines], dtype=np.uint8), counts, axis=0)
        colours = np.tile(np.repeat(colours[:, None], 2, axis=1), (content.segments, 1, 1))
        points = np.tile(self._ends, (content.segments, 1, 1)).astype(np.float32)
        self._handle = server.scene.add_line_segments(
            "/lines", points, colours, thickness=3.0, thickness_units="screen"
        )

    def move(self, panels: Reals, segments: Reals) -> None:
        """To the poses of all panels and span segments, (n, 4, 4) each."""
        own = panels[self._body]
        placed = self._ends @ own[:, :3, :3].transpose(0, 2, 1) + own[:, None, :3, 3]
        all_of = [placed @ m[:3, :3].T + m[:3, 3] for m in segments]
        self._handle.points = np.concatenate(all_of).astype(np.float32)
