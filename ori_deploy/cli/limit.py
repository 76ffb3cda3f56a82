"""`ori-deploy limit`: how much packaging every further cell buys on a profile."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ori_deploy.cli.frame import print_table
from ori_deploy.design.continuum import continuum_limit
from ori_deploy.errors import InputError, ProfileError
from ori_deploy.files import load_spec
from ori_deploy.profiles import Profile

_ROUNDING = 1e-12
"""Coordinates below this share of the outline's size are 0."""


@click.command(
    help="Print the continuum limit, the paper's equation (8), of the profile in SPEC: the packaging ratio that "
    "every further cell adds round one inner vertex, without wall thickness. Only the profile counts.",
    epilog="\b\nExample:\n  ori-deploy limit examples/ellipse_6.toml --json",
)
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--center", type=(float, float), metavar="X Y", help="The inner vertex, metres.  [default: centroid]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON: profile, area (m2), eta_per_cell, center_m.")
def limit(spec: Path, center: tuple[float, float] | None, as_json: bool) -> None:
    wanted = load_spec(spec).profile
    try:
        profile = wanted.make(spec.parent)
        if not isinstance(profile, Profile):
            raise ProfileError(
                "profile: the continuum limit, equation (8), is that of a cylinder",
                value=f'kind = "{profile.kind}"',
                limit="outlines in the plane",
                remedy="give the cross-section's own profile",
            )
        found = continuum_limit(profile, None if center is None else complex(*center))
    except InputError as wrong:
        wrong.source = wrong.source or str(spec)
        raise
    center_m = _shown(found.center, profile)
    if as_json:
        data = {
            "profile": profile.describe(),
            "area": found.area,
            "eta_per_cell": found.eta_per_cell,
            "center_m": center_m,
        }
        click.echo(json.dumps(data, allow_nan=False))
        return
    print_table(
        f"{spec.name.removesuffix('.toml')}: {profile.kind}",
        [
            ("eta per cell", f"{found.eta_per_cell:.7g}"),
            ("area", f"{found.area:.7g} m2"),
            ("inner vertex", "({:.3f}, {:.3f}) mm".format(*(round(1e3 * c, 3) + 0.0 for c in center_m))),
        ],
    )


def _shown(place: complex, profile: Profile) -> list[float]:
    """(x, y) in metres without what only rounding has left of a 0."""
    return [0.0 if abs(c) < _ROUNDING * profile.size else c for c in (place.real, place.imag)]
