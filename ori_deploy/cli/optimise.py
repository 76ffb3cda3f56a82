"""`design --optimize`: many local searches behind a progress bar, the best kept."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ori_deploy.cli.frame import console, warn
from ori_deploy.design import ConeStructure, Embedding, Structure
from ori_deploy.errors import CellError, InputError, LayoutError
from ori_deploy.files import Spec, load_spec
from ori_deploy.files.wish_spec import OptimizeSpec
from ori_deploy.layout import Layout, layout_of, layouts, make_layout, ring, slit_choices
from ori_deploy.motion.slits import deploys_free, with_free_slits
from ori_deploy.profiles import Cone, Profile
from ori_deploy.search import Failure, Job, Solution, best_first, run_jobs
from ori_deploy.search.many import Result, worth
from ori_deploy.search.spars import refuse_too_few_cells, spar_start, sparred_layouts
from ori_deploy.search.starts import start_embedding

_LOOKED_AT = 100
"""Solutions, the best first, among which one that deploys without touching is looked for."""


@dataclass(frozen=True)
class Request:
    """What the command line asks of a search."""

    starts: int
    cells: int | None
    search_layouts: bool
    seed: int
    workers: int


@dataclass(frozen=True)
class Optimum:
    """What a search came to.

    Attributes
    ----------
    structure
        The best that deploys without touching, or the best of all.
    solution
        The local optimum behind it.
    layout_name
        Which layout it has.
    tried, failed
        Local searches, and those that led nowhere.
    interrupted
        Whether Ctrl-C ended the search early.
    free
        Whether it deploys without touching.
    """

    structure: Structure | ConeStructure
    solution: Solution
    layout_name: str
    tried: int
    failed: int
    interrupted: bool
    free: bool


def optimise(path: Path, request: Request) -> tuple[Spec, Optimum]:
    """Search for the best structure for a specification.

    Raises
    ------
    InputError
        A specification or wish that nothing can fulfil; says which condition stands in the way.
    """
    spec = load_spec(path)
    try:
        return spec, _searched(spec, path.parent, request)
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise


def _searched(spec: Spec, folder: Path, request: Request) -> Optimum:
    jobs = list(_jobs(spec, spec.profile.make(folder), request))
    best = 0.0

    with Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    ) as progress:  # fmt: skip
        task = progress.add_task("searching", total=len(jobs))

        def watch(result: Result) -> None:
            nonlocal best
            if not isinstance(result, Failure):
                best = max(best, result[1].eta)
            progress.update(task, advance=1, description=f"best eta {best:.4f}" if best else "searching")

        results, interrupted = run_jobs(jobs, workers=min(request.workers, len(jobs)), watch=watch)
    ranked = best_first(results)
    failures = [r for r in results if isinstance(r, Failure)]
    if not ranked:
        raise _nothing_found(failures, len(jobs), interrupted)
    for job, solution in _distinct(ranked)[:_LOOKED_AT]:
        structure = with_free_slits(solution.structure)
        if deploys_free(structure):
            return Optimum(structure, solution, job.name, len(results), len(failures), interrupted, free=True)
    job, solution = ranked[0]
    return Optimum(solution.structure, solution, job.name, len(results), len(failures), interrupted, free=False)


def _distinct(ranked: list[tuple[Job, Solution]]) -> list[tuple[Job, Solution]]:
    """One of several starts that led to the same structure."""
    seen: dict[tuple[str, float, float], tuple[Job, Solution]] = {}
    for job, solution in ranked:
        seen.setdefault((job.name, round(worth(solution, job.wish), 6), round(solution.eta, 5)), (job, solution))
    return list(seen.values())


def _nothing_found(failures: list[Failure], n_jobs: int, interrupted: bool) -> InputError:
    if not failures:
        raise KeyboardInterrupt
    told = failures[0].error
    return CellError(
        f"no structure found from {len(failures)} of {n_jobs} starts" + (", interrupted" if interrupted else ""),
        value=f"{told.thing}: {told.value}" if told.value is not None else told.thing,
        limit=told.limit,
        remedy="more --starts, a thinner wall, a smaller margin, other pins, or another number of cells",
    )


def _jobs(spec: Spec, profile: Profile | Cone, request: Request) -> Iterator[Job]:
    wanted, wall = spec.wanted()
    plane = profile.base if isinstance(profile, Cone) else profile
    if wanted.spars:
        yield from _spar_jobs(wanted, profile, wall, request)
    elif request.search_layouts:
        _refuse_named_pins(wanted)
        for tree in layouts(_cells(request), mirror_apart=True):
            if next(slit_choices(tree), None) is not None:
                for start in range(request.starts):
                    yield Job(tree.code, profile, layout_of(tree), wall, wanted.wish(None), start, request.seed)
    else:
        given = None if request.cells is not None else spec.embedding(plane)
        layout = _ring(request.cells or 0) if given is None else given.layout
        wish = wanted.wish(start_embedding(plane, layout, 0, request.seed) if given is None else given)
        begins: list[int | Embedding] = [*([given] if given is not None else []), *range(request.starts)]
        for begin in begins[: max(request.starts, 1)]:
            yield Job("as given" if given is not None else "ring", profile, layout, wall, wish, begin, request.seed)


def _cells(request: Request) -> int:
    if request.cells is not None:
        return request.cells
    raise LayoutError(
        "--search-layouts: how many cells", limit="--cells K", remedy="add --cells, for example --cells 6"
    )


def _refuse_named_pins(wanted: OptimizeSpec) -> None:
    if wanted.pins or wanted.symmetric:
        raise LayoutError(
            "--search-layouts: pins name vertices of one layout",
            value="pins" if wanted.pins else "symmetric",
            limit="spars = N, margin_rad, panel_m",
            remedy="leave them out, or give the layout and leave out --search-layouts",
        )


def _spar_jobs(wanted: OptimizeSpec, profile: Profile | Cone, wall_m: float, request: Request) -> Iterator[Job]:
    n_cells = request.cells
    if n_cells is None or not request.search_layouts:
        raise LayoutError(
            "optimize.spars: a layout has to be found for them",
            value=wanted.spars,
            limit="--search-layouts --cells K",
            remedy="add both, or name the spars of a given layout as pins",
        )
    _refuse_named_pins(wanted)
    any_found = False
    plane = profile.base if isinstance(profile, Cone) else profile
    for one in sparred_layouts(n_cells, wanted.spars, locked=wanted.locked):
        any_found = True
        base = wanted.wish(None)
        wish = replace(base, pins=one.pins)
        name = " ".join("-".join(pin.vertices) for pin in one.pins)
        for start in range(request.starts):
            yield Job(name, profile, one.layout, wall_m, wish, spar_start(plane, one, start, request.seed))
    if not any_found:
        raise refuse_too_few_cells(n_cells, wanted.spars, locked=wanted.locked)


def _ring(n: int) -> Layout:
    vertices, cells = ring(n)
    return make_layout(vertices, cells, [("P", "O1")])


def default_workers() -> int:
    """Processes for a search: all that this one may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def tell(optimum: Optimum) -> list[tuple[str, str]]:
    """Rows about an optimum for people; what they should be wary of goes to standard error."""
    if optimum.interrupted:
        warn("interrupted: this is the best found so far")
    if not optimum.free:
        warn(
            "this structure touches itself when it deploys, with any choice of slits: ori-deploy plan will refuse it"
        )
    if not optimum.solution.settled:
        warn("the local search ran out of steps before it came to rest: a little more may be had")
    return [
        ("found from", f"{optimum.tried} starts, {optimum.failed} of them led nowhere; layout {optimum.layout_name}"),
        ("held back by", ", ".join(optimum.solution.active) or "nothing: a free optimum"),
    ]
