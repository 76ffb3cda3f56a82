"""The one place that chooses how a structure moves by what it is: on a cylinder, or on a cone."""

from __future__ import annotations

from typing import Any, overload

from ori_deploy.design import Structure
from ori_deploy.design.cone import ConeStructure
from ori_deploy.motion.cone_mechanism import ConeMechanism
from ori_deploy.motion.mechanism import AnyStructure, Linkage, Mechanism


@overload
def mechanism_of(structure: Structure, r_max_m: float = ...) -> Mechanism: ...
@overload
def mechanism_of(structure: ConeStructure, r_max_m: float = ...) -> ConeMechanism: ...
@overload
def mechanism_of(structure: AnyStructure, r_max_m: float = ...) -> Linkage[Any]: ...
def mechanism_of(structure: AnyStructure, r_max_m: float = 1.0) -> Linkage[Any]:
    """The mechanism of a structure.

    Parameters
    ----------
    structure
        On a cylinder or on a cone.
    r_max_m
        Outer radius of a truncated cone: lengths are told in metres there. A cylinder has its own.
    """
    return ConeMechanism(structure, r_max_m) if isinstance(structure, ConeStructure) else Mechanism(structure)
