"""The one place where a sweep meets the optimiser."""

from __future__ import annotations

from pathlib import Path

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.errors import InputError
from ori_deploy.files import Spec
from ori_deploy.files.wish_spec import OptimizeSpec
from ori_deploy.layout import PlaneTree, layout_of
from ori_deploy.profiles import Cone
from ori_deploy.search import solve
from ori_deploy.sweep.grid import GIVEN, Job


def optimised(job: Job, spec: Spec, folder: Path) -> Structure | ConeStructure:
    """The local optimum that a job's start leads to.

    Raises
    ------
    InputError
        No structure near this start.
    """
    refuse_unsweepable(job, spec)
    profile = spec.profile.make(folder)
    wanted, wall = spec.wanted()
    if job.layout is None:
        place = spec.embedding(profile.base if isinstance(profile, Cone) else profile)
        start = place if job.start == GIVEN else int(job.start)
        return solve(profile, place.layout, wall, wanted.wish(place), start=start, seed=job.seed).structure
    layout = layout_of(PlaneTree.from_code(job.layout))
    return solve(profile, layout, wall, wanted.wish(None), start=int(job.start), seed=job.seed).structure


def refuse_unsweepable(job: Job, spec: Spec) -> None:
    """Refuse wishes that a sweep cannot meet, and those of the specification's own vertices where it has others.

    Raises
    ------
    InputError
        Spars; or start "given", pins or symmetry together with a layout.
    """
    wanted = spec.optimize or OptimizeSpec()
    if wanted.spars:
        raise InputError(
            "optimize.spars: not in a sweep",
            value=wanted.spars,
            limit="0",
            remedy="ori-deploy design SPEC --optimize --search-layouts --cells K",
        )
    if job.layout is None:
        return
    told = {"start": job.start == GIVEN, "optimize.pins": bool(wanted.pins), "optimize.symmetric": wanted.symmetric}
    for name, given in told.items():
        if given:
            raise InputError(
                f"{name}: the specification's own places, and this layout has others",
                value=job.layout,
                limit="numbered starts, no pins, no symmetry with layouts",
                remedy="mend it, or leave out layouts",
            )
