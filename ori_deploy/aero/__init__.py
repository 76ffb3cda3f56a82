"""The aircraft that a deployable wing carries: polar, trim, endurance, pressures, and its section's fidelity."""

from __future__ import annotations

from ori_deploy.aero.aircraft import Air, Aircraft, Fin, Fuselage, Power, Published, Tail, Wing
from ori_deploy.aero.polar import Polar

__all__ = ["Air", "Aircraft", "Fin", "Fuselage", "Polar", "Power", "Published", "Tail", "Wing"]
