"""Loads: masses, film hinges, wind, and the torque that every driven crease asks for."""

from __future__ import annotations

from ori_deploy.loads.loads import Air, Film, Loads, Magnets
from ori_deploy.loads.sizing import HingeTorques, clamp_of, hinge_torques, masses_kg, skin_forces
from ori_deploy.loads.solids import Skin, Solids
from ori_deploy.loads.twists import Twists, clamped, in_space

__all__ = [
    "Air",
    "Film",
    "HingeTorques",
    "Loads",
    "Magnets",
    "Skin",
    "Solids",
    "Twists",
    "clamp_of",
    "clamped",
    "hinge_torques",
    "in_space",
    "masses_kg",
    "skin_forces",
]
