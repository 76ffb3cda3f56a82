"""Bodies as binary glTF 2.0 with their light painted on: a processor that draws has no time to light them anew."""

from __future__ import annotations

import json
import struct

import numpy as np

from ori_deploy.page.solids import Solid
from ori_deploy.profiles.profile import Reals

_LIGHT = np.array([-0.35, 0.8, 0.5])
"""Towards the light, in the deployed structure: from before, above, and off the span's end."""
_SHADE = 0.74
"""How bright a face is that is turned away from it."""

_FLOAT, _BUFFER, _TRIANGLES = 5126, 34962, 4


def painted(solid: Solid, rgb: tuple[int, int, int]) -> bytes:
    """A body in one colour, its faces as bright as the light makes them when it is deployed."""
    corners = solid.vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    facing = normal @ _LIGHT / (np.linalg.norm(_LIGHT) * np.where(length > 0.0, length, 1.0))
    bright = _SHADE + (1.0 - _SHADE) * np.clip(facing, 0.0, 1.0)
    colour = _linear(bright[:, None] * np.array(rgb) / 255.0)
    return glb(corners.reshape(-1, 3), np.repeat(colour, 3, axis=0))


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
