"""`design --optimize`: many local searches behind a progress bar, the best kept."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ori_deploy.cli.frame import console, warn
from ori_deploy.design import ConeStructure, Embedding, Structure
from ori_deploy.errors import CellError, InputError, LayoutError
from ori_deploy.files import Spec, load_spec
from ori_deploy.files.wish_spec import OptimizeSpec
from ori_deploy.layout import (
    Layout,
    PlaneTree,
    folds_flat_with_some_slits,
    layout_of,
    layouts,
    make_layout,
    ring,
)
from ori_deploy.motion.slits import deploys_free, with_free_slits
from ori_deploy.profiles import Cone, Profile
from ori_deploy.search import Failure, Job, Solution, best_first, closest, run_jobs
from ori_deploy.search.many import Result, worth
from ori_deploy.search.spars import refuse_too_few_cells, spar_start, sparred_layouts
from ori_deploy.search.starts import start_embedding
from ori_deploy.search.wish import UnmetPinError, Wish

_MOST_CELLS = 10
"""Cells up to which all layouts are searched: some 1,500, and two and a half times as many with every cell more."""

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

    @property
    def words(self) -> str:
        """The options that repeat it, but for the workers, which change nothing."""
        of_layouts = f" --cells {self.cells}" if self.cells is not None else ""
        of_layouts += " --search-layouts" if self.search_layouts else ""
        return f"--optimize{of_layouts} --starts {self.starts} --seed {self.seed}"


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
        Whether it deploys without touching; None where an interrupt came before that was known.
    """

    structure: Structure | ConeStructure
    solution: Solution
    layout_name: str
    tried: int
    failed: int
    interrupted: bool
    free: bool | None


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
    n_jobs, jobs = _plan(spec, spec.profile.make(folder), request)
    best = 0.0

    with Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    ) as progress:  # fmt: skip
        task = progress.add_task("searching", total=n_jobs)

        def watch(result: Result) -> None:
            nonlocal best
            if not isinstance(result, Failure):
                best = max(best, result[1].eta)
            progress.update(task, advance=1, description=f"best eta {best:.4f}" if best else "searching")

        results, interrupted = run_jobs(jobs, workers=min(request.workers, n_jobs), watch=watch, stopping=_stopping)
    ranked = best_first(results)
    failures = [r for r in results if isinstance(r, Failure)]
    if not ranked:
        raise _nothing_found(failures, n_jobs, interrupted)
    job, solution = ranked[0]
    structure, free = solution.structure, None if interrupted else False
    try:
        for other_job, other in _distinct(ranked)[:_LOOKED_AT]:
            parted = with_free_slits(other.structure)
            if deploys_free(parted):
                job, solution, structure, free = other_job, other, parted, True
                break
        else:
            free = False
    except KeyboardInterrupt:
        interrupted, free = True, None
    return Optimum(structure, solution, job.name, len(results), len(failures), interrupted, free)


def _stopping() -> None:
    click.echo("stopping: taking what finishes in a few seconds; Ctrl-C again stops at once", err=True)


def _distinct(ranked: list[tuple[Job, Solution]]) -> list[tuple[Job, Solution]]:
    """One of several starts that led to the same structure."""
    seen: dict[tuple[str, float, float], tuple[Job, Solution]] = {}
    for job, solution in ranked:
        seen.setdefault((job.name, round(worth(solution, job.wish), 6), round(solution.eta, 5)), (job, solution))
    return list(seen.values())


def _nothing_found(failures: list[Failure], n_jobs: int, interrupted: bool) -> InputError:
    if not failures:
        raise KeyboardInterrupt
    told = closest(failures)
    tried = f"{len(failures)} of {n_jobs} starts" + (", interrupted" if interrupted else "")
    if isinstance(told, UnmetPinError):  # from every one
        return LayoutError(
            f"{told.thing}, from {tried}", value=told.value, limit=told.limit, remedy=told.remedy
        )  # fmt: skip
    value = f"{told.thing}: {told.value}" if told.value is not None else told.thing
    return CellError(
        f"no structure found from {tried}",
        value=value if len(failures) == 1 else f"as the closest, {value}",
        limit=told.limit,
        remedy=told.remedy,
    )


def _plan(spec: Spec, profile: Profile | Cone, request: Request) -> tuple[int, Iterator[Job]]:
    """How many local searches there are to be, and these, made as they are wanted."""
    wanted, wall = spec.wanted()
    plane = profile.base if isinstance(profile, Cone) else profile
    if wanted.spars:
        return _spar_jobs(wanted, profile, wall, request)
    if request.search_layouts:
        return _layout_jobs(wanted, profile, wall, request)
    given = None if request.cells is not None else spec.embedding(plane)
    layout = _ring(request.cells or 0) if given is None else given.layout
    wish = _evenly_wished(wanted, plane, layout) if given is None else wanted.wish(given)
    begins: list[int | Embedding] = [*([given] if given is not None else []), *range(request.starts)]
    name = "as given" if given is not None else "ring"
    taken = begins[: request.starts]
    return len(taken), (Job(name, profile, layout, wall, wish, begin, request.seed) for begin in taken)


def _evenly_wished(wanted: OptimizeSpec, plane: Profile, layout: Layout) -> Wish:
    """The wish for a ring laid on evenly; a symmetric one turned by half a step or a whole one until it is so.

    Raises
    ------
    LayoutError
        It is symmetric in no turn: says why not in the first.
    """
    step = 1.0 / len(layout.outline)
    refused: list[LayoutError] = []
    for turned in (0.0, step, 0.5 * step):
        try:
            return wanted.wish(start_embedding(plane, layout, 0, turned=turned))
        except LayoutError as wrong:
            refused.append(wrong)
    raise refused[0]


def _layout_jobs(
    wanted: OptimizeSpec, profile: Profile | Cone, wall_m: float, request: Request
) -> tuple[int, Iterator[Job]]:
    """Jobs for every layout that folds flat, mirror images apart: the profile tells them apart."""
    _refuse_named_pins(wanted)
    n_cells, wish = _cells(request), wanted.wish(None)

    def trees() -> Iterator[PlaneTree]:
        return layouts(n_cells, mirror_apart=True, allowable=folds_flat_with_some_slits)

    count = sum(1 for _ in trees())
    _tell_size(f"{count} layouts of {n_cells} cells", request)
    return count * request.starts, (
        Job(tree.code, profile, layout_of(tree), wall_m, wish, start, request.seed)
        for tree in trees()
        for start in range(request.starts)
    )


def _tell_size(what: str, request: Request) -> None:
    click.echo(f"searching {what}, {request.starts} starts each; Ctrl-C keeps the best so far", err=True)


def _cells(request: Request) -> int:
    if request.cells is not None and request.cells > _MOST_CELLS:
        raise LayoutError(
            "--search-layouts: too many cells", value=f"{request.cells} cells",
            limit=f"--cells {_MOST_CELLS}: each cell more makes two and a half times as many layouts",
            remedy="fewer cells, or give a layout and leave out --search-layouts",
        )  # fmt: skip
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


def _spar_jobs(
    wanted: OptimizeSpec, profile: Profile | Cone, wall_m: float, request: Request
) -> tuple[int, Iterator[Job]]:
    if request.cells is None or not request.search_layouts:
        raise LayoutError(
            "optimize.spars: a layout has to be found for them",
            value=wanted.spars,
            limit="--search-layouts --cells K",
            remedy="add both, or name the spars of a given layout as pins",
        )
    n_cells = _cells(request)
    _refuse_named_pins(wanted)
    count = sum(1 for _ in sparred_layouts(n_cells, wanted.spars, locked=wanted.locked))
    if not count:
        raise refuse_too_few_cells(n_cells, wanted.spars, locked=wanted.locked)
    _tell_size(f"{count} ways to put {wanted.spars} spars into layouts of {n_cells} cells", request)
    plane, base = profile.base if isinstance(profile, Cone) else profile, wanted.wish(None)
    return count * request.starts, (
        Job(
            " ".join("-".join(pin.vertices) for pin in one.pins), profile, one.layout, wall_m,
            replace(base, pins=one.pins), spar_start(plane, one, start, request.seed),
        )
        for one in sparred_layouts(n_cells, wanted.spars, locked=wanted.locked)
        for start in range(request.starts)
    )  # fmt: skip


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
    if optimum.free is None:
        warn("whether it deploys without touching itself was not looked at any more: ori-deploy plan tells")
    elif not optimum.free:
        warn(
            "this structure touches itself when it deploys, with any choice of slits: ori-deploy plan will refuse it"
        )
    if not optimum.solution.settled:
        warn("the local search ran out of steps before it came to rest: a little more may be had")
    return [
        ("found from", f"{optimum.tried} starts, {optimum.failed} of them led nowhere; layout {optimum.layout_name}"),
        ("held back by", _held_back(optimum)),
    ]


def _held_back(optimum: Optimum) -> str:
    bounds = ", ".join(optimum.solution.active)
    if not optimum.solution.settled:
        return "the search itself, which had not come to rest" + (f"; so far {bounds}" if bounds else "")
    found = bounds or "nothing near: a free local optimum"
    return f"{found}; the search was cut short" if optimum.interrupted else found
