"""Inverse design: a layout on a profile becomes a structure of panels and creases."""

from __future__ import annotations

from ori_deploy.design.cells import Cells
from ori_deploy.design.embedding import Embedding, embed
from ori_deploy.design.structure import Structure, build

__all__ = ["Cells", "Embedding", "Structure", "build", "embed"]
