"""Target shapes: smooth closed outlines that a structure will have when deployed."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.cone import Cone
from ori_deploy.profiles.fourier import Clover, FourierOutline, Heart
from ori_deploy.profiles.naca import Naca4, Naca5, naca_section
from ori_deploy.profiles.points import PointOutline, parse_dat
from ori_deploy.profiles.profile import Profile, xy
from ori_deploy.profiles.superellipse import Superellipse

__all__ = [
    "Clover",
    "Cone",
    "FourierOutline",
    "Heart",
    "Naca4",
    "Naca5",
    "PointOutline",
    "Profile",
    "Superellipse",
    "from_description",
    "naca_section",
    "parse_dat",
    "xy",
]

_FAMILIES: dict[str, Callable[..., Profile]] = {
    "ellipse": Superellipse,
    "superellipse": Superellipse,
    "naca": naca_section,
    "points": PointOutline,
    "clover": Clover,
    "heart": Heart,
}


def from_description(described: dict[str, object]) -> Profile:
    """The profile that `Profile.describe` described.

    Raises
    ------
    ProfileError
        Unknown kind, missing or unusable entries.
    """
    arguments = dict(described)
    kind = str(arguments.pop("kind", None))
    if kind not in _FAMILIES:
        raise ProfileError("profile: unknown kind", value=kind, limit=" | ".join(_FAMILIES), remedy="choose one")
    try:
        profile: Profile = _FAMILIES[kind](**arguments)
    except TypeError as wrong:
        raise ProfileError(f"profile: entries do not fit kind {kind}", value=str(wrong)) from wrong
    return profile


def cone_from_description(described: dict[str, object]) -> Cone:
    """The cone that `Cone.describe` described.

    Raises
    ------
    ProfileError
        Another kind, missing or unusable entries.
    """
    base, apex, plane = (described.get(key) for key in ("base", "apex_m", "plane_z_m"))
    if described.get("kind") != Cone.kind or not isinstance(base, dict) or not isinstance(plane, float):
        raise ProfileError("profile: not a cone", value=described.get("kind"), limit="kind, base, apex_m, plane_z_m")
    try:
        return Cone(from_description(base), apex, plane)  # type: ignore[arg-type]
    except (TypeError, ValueError) as wrong:
        raise ProfileError("profile: entries do not fit kind cone", value=str(wrong)) from wrong
