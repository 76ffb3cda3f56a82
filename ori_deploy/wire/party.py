"""Who sends on a MAVLink network."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Party:
    """Who sends: MAVLink's system and component."""

    system: int
    component: int
