"""The `span` entry of a design file: a span cut into segments, its hinges and what it stows to."""

from __future__ import annotations

from typing import Any

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.errors import FileError
from ori_deploy.motion import Mechanism, SpanFolding


def span_data(structure: Structure, span_m: float, segments: int) -> dict[str, Any]:
    """What a design file says of a span in segments; nothing for a span in one piece.

    Raises
    ------
    MotionError
        The folded stack has no flat face for the hinges.
    """
    if segments == 1:
        return {}
    folding = SpanFolding(Mechanism(structure), span_m, segments)
    return {
        "span": {
            "segments": segments,
            "segment_length_m": folding.length_m,
            "hinges": [
                {
                    "id": hinge.id,
                    "face": hinge.side,
                    "panel": hinge.panel,
                    "point": hinge.point.tolist(),
                    "axis": hinge.axis.tolist(),
                    "length_m": hinge.length_m,
                    "line_on_panel": hinge.line_m.tolist(),
                }
                for hinge in folding.hinges
            ],
            "stowed_thickness_m": folding.stack.thickness_m * segments,
            "stowed_box_m": list(folding.stowed_box_m),
            "stowed_box_ratio": folding.stowed_box_ratio,
        }
    }


def read_span(data: dict[str, Any], structure: Structure, span_m: float) -> int:
    """How many segments a design file cuts the span into; 1 where it says nothing.

    Raises
    ------
    FileError
        The entry is not the one its structure gives.
    """
    entry = data.get("span")
    if entry is None:
        return 1
    segments = entry.get("segments") if isinstance(entry, dict) else None
    if not (isinstance(segments, int) and segments > 1):
        raise FileError("span.segments", value=segments, limit="2 or more", remedy="make the file again")
    built = span_data(structure, span_m, segments)["span"]
    for key in ("stowed_box_m", "stowed_box_ratio", "stowed_thickness_m"):
        if not np.allclose(entry.get(key, np.nan), built[key], rtol=1e-6):
            raise FileError(
                f"span.{key}",
                value=entry.get(key),
                limit=str(built[key]),
                remedy="don't edit design files: change the specification and design again",
            )
    return segments
