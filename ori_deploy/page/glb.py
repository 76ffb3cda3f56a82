"""Bodies as binary glTF 2.0 with their light painted on: a processor that draws has no time to light them anew."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence

import numpy as np

from ori_deploy.page.content import Rgb
from ori_deploy.page.solids import Solid
from ori_deploy.profiles.profile import Reals

_LIGHT = np.array([-0.35, 0.8, 0.5])
"""Towards the light, in the deployed structure: from before, above, and off the span's end."""
_SHADE = 0.74
"""How bright a face is that is turned away from it."""

_ROD = np.array(
    [[k, (k + 1) % 4, 4 + (k + 1) % 4] for k in range(4)]
    + [[k, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    + [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
)
"""Corners of the triangles of a rod: four round one end, then four round the other."""

_FLOAT, _BUFFER, _TRIANGLES = 5126, 34962, 4


Paint = tuple[Reals, Reals]
"""Corners (3 m, 3) of m triangles, and their colours."""


def painted(solid: Solid, rgb: Rgb) -> Paint:
    """A body in one colour, its faces as bright as the light makes them when it is deployed."""
    corners = solid.vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    facing = normal @ _LIGHT / (np.linalg.norm(_LIGHT) * np.where(length > 0.0, length, 1.0))
    bright = _SHADE + (1.0 - _SHADE) * np.clip(facing, 0.0, 1.0)
    colour = _linear(bright[:, None] * np.array(rgb) / 255.0)
    return corners.reshape(-1, 3), np.repeat(colour, 3, axis=0)


def rods(ends: Reals, rgb: Rgb, radius_m: float) -> Paint:
    """Lines (n, 2, 3) as rods with four sides: part of the body that carries them, and no object of their own."""
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    other = np.where(np.abs(along[:, [1]]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(other, along)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    round_ = radius_m * np.stack([right, np.cross(along, right), -right, -np.cross(along, right)], axis=1)
    corners = (ends[:, :, None] + round_[:, None]).reshape(-1, 8, 3)
    triangles = corners[:, _ROD].reshape(-1, 3)
    return triangles, np.repeat(_linear(np.array([rgb]) / 255.0), len(triangles), axis=0)


def body(paints: Sequence[Paint]) -> bytes:
    """All of it as one object."""
    return glb(np.concatenate([points for points, _ in paints]), np.concatenate([colours for _, colours in paints]))


def _linear(colour: Reals) -> Reals:
    """From what a screen is sent to amounts of light, which glTF wants."""
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def glb(points: Reals, colours: Reals) -> bytes:
    """Triangles of their own corners (n, 3) and colours (n, 3); shown as they are, whatever the light."""
    place, paint = points.astype("<f4").tobytes(), colours.astype("<f4").tobytes()
    n = len(points)
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 0, "mode": _TRIANGLES}]}
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": n,
                "type": "VEC3",
                "min": points.astype(np.float32).min(axis=0).tolist(),
                "max": points.astype(np.float32).max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": _FLOAT, "count": n, "type": "VEC3"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(place), "target": _BUFFER},
            {"buffer": 0, "byteOffset": len(place), "byteLength": len(paint), "target": _BUFFER},
        ],
        "buffers": [{"byteLength": len(place) + len(paint)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = place + paint
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
