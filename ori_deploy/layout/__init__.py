"""Layouts as plane graphs: cells, vertices, slits and bonds, without any length."""

from __future__ import annotations

from ori_deploy.layout.enumeration import count_by_inner, layouts, most_inner
from ori_deploy.layout.layout import (
    EDGE_NAMES,
    AllowableRule,
    Layout,
    Vertex,
    make_layout,
    opening_vertices_on_outline,
    ring,
)
from ori_deploy.layout.planar_graph import layout_of_graph
from ori_deploy.layout.plane_tree import PlaneTree, Symmetry
from ori_deploy.layout.slit_choices import folds_flat_with_some_slits, layout_of, slit_choices

__all__ = [
    "EDGE_NAMES",
    "AllowableRule",
    "Layout",
    "PlaneTree",
    "Symmetry",
    "Vertex",
    "count_by_inner",
    "folds_flat_with_some_slits",
    "layout_of",
    "layout_of_graph",
    "layouts",
    "make_layout",
    "most_inner",
    "opening_vertices_on_outline",
    "ring",
    "slit_choices",
]
