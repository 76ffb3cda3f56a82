"""Target shapes: smooth closed outlines that a structure will have when deployed."""

from __future__ import annotations

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.naca import Naca4
from ori_deploy.profiles.points import PointOutline, parse_dat
from ori_deploy.profiles.profile import Profile, xy
from ori_deploy.profiles.superellipse import Superellipse

__all__ = ["Naca4", "PointOutline", "Profile", "Superellipse", "from_description", "parse_dat", "xy"]

_FAMILIES = {"ellipse": Superellipse, "superellipse": Superellipse, "naca": Naca4, "points": PointOutline}


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
