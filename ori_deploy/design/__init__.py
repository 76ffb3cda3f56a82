"""Inverse design: a layout on a profile becomes a structure of panels and creases."""

from __future__ import annotations

from ori_deploy.design.cells import Cells
from ori_deploy.design.cone import ConeCells, ConeEmbedding, ConeStructure, build_cone, embed_cone
from ori_deploy.design.embedding import Embedding, embed
from ori_deploy.design.structure import Structure, build

__all__ = [
    "Cells",
    "ConeCells",
    "ConeEmbedding",
    "ConeStructure",
    "Embedding",
    "Structure",
    "build",
    "build_cone",
    "embed",
    "embed_cone",
]
