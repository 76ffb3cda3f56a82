"""Designs that tests of exports share: a cylinder, cones with and without their tip, a mirrored one, a strip."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ori_deploy.files import Design, build_from_file
from tests import cones, shapes
from tests.design.turned import Kind, flat_sided

EXAMPLES = Path(__file__).parents[2] / "examples"

NAMES = ("wing", "ellipse 6 without wall", "two inner vertices", "one cell", "cone elliptic 6", "cone tip", "tapered")
"""`design` knows more; these are one of each kind."""

FROM_EXAMPLES = {
    "tapered": "wing_tapered",
    "cone elliptic": "cone_elliptic_6",
    "helix": "antenna_helix",
    "spiral": "antenna_conical_spiral",
    "segments": "wing_span_3",
}


@cache
def design(name: str) -> Design:
    """A structure of the examples or of the catalogues; "cone …" of the cones', "cone tip" reaches its apex."""
    if name in FROM_EXAMPLES:
        spec, structure = build_from_file(EXAMPLES / f"{FROM_EXAMPLES[name]}.toml")
        cut = spec.structure
        return Design(
            name, cut.span_m, structure, span_segments=cut.span_segments, r_min_m=cut.r_min_m, strip=spec.strip
        )
    if name.startswith("flat-sided "):  # half of its panels are flat: a wall of 0 leaves them no area
        kind: Kind = "cone" if name.endswith("cone") else "cylinder"
        return Design(name, 0.3, flat_sided(kind, 4, 0.3, 0.2, 0.0), r_min_m=0.1 if kind == "cone" else 0.0)
    if name == "wing":
        return Design(name, 1.26, shapes.wing(0.005, chord=0.25))
    if name == "cone tip":
        return Design(name, 0.3, cones.cone("circular 6"))
    if name.startswith("cone "):
        return Design(name, 0.4, cones.cone(name.removeprefix("cone ")), r_min_m=0.4)
    return Design(name, 0.3, shapes.structure(name))
