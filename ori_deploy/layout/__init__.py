"""Layouts as plane graphs: cells, vertices, slits and bonds, without any length."""

from __future__ import annotations

from ori_deploy.layout.layout import (
    EDGE_NAMES,
    Layout,
    Vertex,
    make_layout,
    opening_vertices_on_outline,
    ring,
)

__all__ = ["EDGE_NAMES", "Layout", "Vertex", "make_layout", "opening_vertices_on_outline", "ring"]
