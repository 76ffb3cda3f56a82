"""The paper's figures, and ours: what is computed for them. Drawing is the business of `view`."""

from __future__ import annotations

from ori_deploy.figures.optima import Optimum, optimum, optimum_table
from ori_deploy.figures.packaging import PackagingPoint, packaging_points, packaging_table
from ori_deploy.figures.prototypes import PROTOTYPES, Prototype, prototype_table, shipped_prototype
from ori_deploy.figures.superellipses import EfficiencyMap, efficiency_map, efficiency_table
from ori_deploy.figures.table import Table
from ori_deploy.figures.walls import WallPoint, WallRow, wall_points, wall_rows, wall_table
from ori_deploy.figures.wing import Wing, wing, wing_of, wing_summary_table, wing_vertex_table

__all__ = [
    "PROTOTYPES",
    "EfficiencyMap",
    "Optimum",
    "PackagingPoint",
    "Prototype",
    "Table",
    "WallPoint",
    "WallRow",
    "Wing",
    "efficiency_map",
    "efficiency_table",
    "optimum",
    "optimum_table",
    "packaging_points",
    "packaging_table",
    "prototype_table",
    "shipped_prototype",
    "wall_points",
    "wall_rows",
    "wall_table",
    "wing",
    "wing_of",
    "wing_summary_table",
    "wing_vertex_table",
]
