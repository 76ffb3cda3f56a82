"""Deployable thick origami: inverse design, checked motion, deployment on hardware or simulators.

Five lines from a shape to a moving structure:

>>> from ori_deploy.files import build_from_file
>>> from ori_deploy.motion import Mechanism
>>> spec, wing = build_from_file("examples/wing_naca2412.toml")
>>> print(f"eta {wing.eta:.4f}, {wing.layout.n_cells} cells, slits {wing.layout.latch_points}")
eta 2.1311, 4 cells, slits ('slit:P-T2',)
>>> Mechanism(wing).poses(0.5).matrices().shape
(1, 16, 3, 3)
"""

from __future__ import annotations

from importlib.metadata import version

__version__ = version("ori-deploy")
