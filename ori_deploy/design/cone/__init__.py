"""Structures of generalized cones: the construction of `design` on the unit sphere (geometry: section 4)."""

from __future__ import annotations

from ori_deploy.design.cone.cells import ConeCells
from ori_deploy.design.cone.embedding import ConeEmbedding, embed_cone
from ori_deploy.design.cone.structure import ConeStructure, build_cone

__all__ = ["ConeCells", "ConeEmbedding", "ConeStructure", "build_cone", "embed_cone"]
