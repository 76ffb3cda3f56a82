"""Sweeps: which jobs there are, that each is done once, and that nothing that was finished is lost."""

from __future__ import annotations

import copy
import itertools
import json
import math
import os
import pickle
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Spec
from ori_deploy.layout import PlaneTree, layouts, slit_choices
from ori_deploy.sweep import Cluster, Grid, Job, Processes, Store, Sweep, jobs_of, parse_grid, run, run_job
from ori_deploy.sweep.backends import Run, WorkerLost
from ori_deploy.sweep.grid import set_key
from ori_deploy.sweep.job import FAILED, FOUND, INFEASIBLE, Row
from tests.sweep.breaking import breaking

ROOT = Path(__file__).parents[2]

SPEC: dict[str, Any] = tomllib.loads(
    """
    schema = "ori-deploy/spec/1"
    [profile]
    kind = "ellipse"
    a_m = 0.1
    b_m = 0.06
    [structure]
    span_m = 0.5
    wall_m = 0.0005
    [layout]
    ring = { cells = 4, phase_rad = 0.5 }
    slits = [["P", "O1"]]
    """
)

WALLS = "structure.wall_m"
PACKED = next(tree.code for tree in layouts(5) if next(slit_choices(tree), None) is None)
"""A layout that cannot fold flat."""


def jobs(table: dict[str, Any], seed: int = 0, document: dict[str, Any] = SPEC) -> list[Job]:
    return list(jobs_of(document, parse_grid(table, seed), ROOT))


def jobs_in(folder: Path, table: dict[str, Any], document: dict[str, Any]) -> list[Job]:
    return list(jobs_of(document, parse_grid(table), folder))


def table(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
    return rows


# --- the grid ---------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(
    axes=st.dictionaries(
        st.sampled_from(["profile.a_m", "profile.b_m", WALLS, "layout.ring.phase_rad"]),
        st.lists(st.floats(0.001, 1.0), min_size=1, max_size=4, unique=True),
        min_size=1,
    )
)
def test_every_combination_is_a_job_with_its_own_specification(axes: dict[str, list[float]]) -> None:
    found = jobs(axes)
    assert len(found) == len(parse_grid(axes)) == len({job.digest for job in found})
    assert [tuple(job.values.values()) for job in found] == list(itertools.product(*axes.values()))
    for job in found:
        for key, value in job.values.items():
            here: Any = job.document
            for part in key.split("."):
                here = here[part]
            assert here == value
        assert pickle.loads(pickle.dumps(job)) == job
    assert "sweep" not in found[0].document


def test_the_specification_is_left_alone_and_its_own_sweep_does_not_count() -> None:
    before = copy.deepcopy(SPEC)
    first = jobs({WALLS: [0.001]})[0]
    assert before == SPEC
    again = jobs({WALLS: [0.001]}, document={**SPEC, "sweep": {"grid": {WALLS: [9.0]}}})[0]
    assert again.digest == first.digest


def test_a_digest_tells_all_that_a_result_depends_on(tmp_path: Path) -> None:
    assert jobs({WALLS: [0.001]})[0].digest == jobs({WALLS: [0.001]}, seed=7)[0].digest  # nothing is drawn
    drawn = {"optimize": True, "start": [2]}
    assert jobs(drawn)[0].digest != jobs(drawn, seed=7)[0].digest
    assert jobs(drawn)[0].digest != jobs({"optimize": True, "start": [3]})[0].digest
    outline = "1 0\n0 1\n-1 0\n0 -1\n"
    document = {**SPEC, "profile": {"kind": "points", "file": "a.dat"}}
    digests = set()
    for text in (outline, outline.replace("0 1", "0 0.9")):
        (tmp_path / "a.dat").write_text(text)
        digests.add(next(jobs_of(document, parse_grid({WALLS: 0.001}), tmp_path)).digest)
    assert len(digests) == 2


def test_the_same_job_twice_is_made_once() -> None:
    assert len(jobs({WALLS: [0.001, 0.001, 0.002]})) == 2
    assert len(jobs({"optimize": [False, True], "start": [0, 1]})) == 3  # without the optimiser a start means nothing


def test_tables_in_tables_and_single_values_are_axes_too() -> None:
    nested = parse_grid({"profile": {"b_m": [0.05, 0.06]}, "structure": {"wall_m": 0.001}})
    assert nested.axes == (("profile.b_m", (0.05, 0.06)), (WALLS, (0.001,)))


def test_vertices_are_named_by_their_ids() -> None:
    document = tomllib.loads((ROOT / "examples" / "wing_naca2412.toml").read_text())
    found = jobs({"vertex.T1.x_chord": [0.66, 0.7], "vertex.P.xy_m": [[0.11, 0.012]]}, document=document)
    assert [run_job(job)["status"] for job in found] == [FOUND, FOUND]
    assert [v["x_chord"] for v in found[1].document["vertex"] if v["id"] == "T1"] == [0.7]


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({}, "empty"),
        ({WALLS: []}, "no values"),
        ({"start": [0]}, "without the optimiser"),
        ({"layouts": {"cells": 3}}, "without the optimiser"),
        ({"optimize": [1]}, "optimize: not a value"),
        ({"optimize": True, "start": [-1]}, "start: not a value"),
        ({"optimize": True, "start": [True]}, "start: not a value"),
        ({"optimize": True, "layouts": {"inner": 1}}, "layouts: not a choice"),
        ({"optimize": True, "layouts": {"cells": [0]}}, "cells: not a value"),
        ({"optimize": True, "layouts": ["zzz"]}, "sweep.grid.layouts: layout code"),
        ({"optimize": True, "layouts": [PACKED]}, "cannot fold flat"),
        ({"optimize": True, "layouts": {"cells": 3}, "start": [0, "given"]}, "start: the specification's own"),
        ({WALLS: [0.001, -1.0]}, r"sweep\.grid\.structure\.wall_m: not a value; found -1\.0; limit"),
        ({"profile.b_m": [0.05, "x"]}, r"profile\.b_m: not a value; found 'x'"),
        ({"profile.b_m": [math.nan]}, r"profile\.b_m: not a value; found nan"),
        ({"profile.b_m": [0.05], WALLS: [1e6, 0.001]}, r"wall_m: not a value; found 1000000\.0"),
        ({"profile.b_m": [date(2020, 1, 1)]}, r"profile\.b_m: not a value"),
        ({"optimize": True, "optimize.spars": [0, 2]}, r"no such key as optimize\.spars"),
        ({"optimize": True, "layouts": {"cells": [4], "inner": -1}}, "inner: not a value"),
        ({WALLS: list(range(2000)), "profile.b_m": list(range(2000))}, "too many combinations"),
        ({"profile.c_m": [0.1]}, "profile.c_m"),
        ({"vertex.T1.x_chord": [0.1]}, "no such key as vertex.T1.x_chord"),
        ({"profile.a_m.b": [0.1]}, "no such key as profile.a_m.b"),
    ],
)
def test_a_grid_that_means_nothing_is_refused_before_anything_runs(grid: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        jobs_of(SPEC, parse_grid(grid), ROOT)


def test_a_value_is_right_when_some_combination_can_have_it() -> None:
    """Beginning 1.5 m from the apex goes with a cone of 2 m, not with one of 1 m, which is the grid's first."""
    cone = tomllib.loads((ROOT / "examples" / "cone_circular_6.toml").read_text())
    cone["structure"] = {"wall_rad": 0.001}
    radii = {"structure.r_min_m": [0.0, 1.5], "structure.r_max_m": [1.0, 2.0]}
    assert len(jobs(radii, document=cone)) == 4
    with pytest.raises(InputError, match=r"with structure.r_min_m = 2.5, structure.r_max_m = 1.0: key structure"):
        jobs({**radii, "structure.r_min_m": [0.0, 2.5]}, document=cone)


def test_a_file_that_cannot_be_read_is_refused_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "b.dat").write_text("1 0\n0 1\n-1 0\n0 -1\n")
    document = {**SPEC, "profile": {"kind": "points", "chord_m": 0.1}}
    assert len(jobs_in(tmp_path, {"profile.file": ["b.dat"]}, document)) == 1
    with pytest.raises(InputError, match=r"a\.dat: cannot be read"):
        jobs_in(tmp_path, {"profile.file": ["b.dat", "a.dat"]}, document)


def test_wishes_that_a_sweep_cannot_meet_are_refused_before_anything_runs() -> None:
    for wish, message in (({"spars": 2}, "spars"), ({"symmetric": "x"}, "symmetric")):
        with pytest.raises(InputError, match=message):
            jobs({"optimize": True, "layouts": {"cells": 3}}, document={**SPEC, "optimize": wish})


def test_layouts_are_all_that_fold_flat() -> None:
    grid = parse_grid({"optimize": True, "layouts": {"cells": [3, 4], "inner": [0, 1]}})
    codes = dict(grid.axes)["layouts"]
    foldable = {tree.code for k in (3, 4) for tree in layouts(k) if next(slit_choices(tree), None) is not None}
    assert len(codes) == len(set(codes))
    assert set(codes) == foldable
    assert {PlaneTree.from_code(code).n_cells for code in codes} == {3, 4}


def test_set_key_reaches_what_is_there_only() -> None:
    document: dict[str, Any] = {"a": {"b": 1}, "vertex": [{"id": "T", "x": 1}]}
    set_key(document, "a.b", 2)
    set_key(document, "vertex.T.x", 3)
    set_key(document, "a.c", 4)
    assert document == {"a": {"b": 2, "c": 4}, "vertex": [{"id": "T", "x": 3}]}
    for key in ("x.y", "vertex.U.x", "a.b.c", "vertex.T"):
        with pytest.raises(InputError, match="no such key"):
            set_key(document, key, 0)


# --- one job ----------------------------------------------------------------------------------------------


def test_a_row_holds_what_the_specification_gives() -> None:
    row = run_job(jobs({WALLS: [0.001]})[0])
    structure = Spec.model_validate({**SPEC, "structure": {"span_m": 0.5, "wall_m": 0.001}}).build(ROOT)
    assert row["status"] == FOUND
    assert row["error"] is None
    assert row["eta"] == pytest.approx(structure.eta)
    assert row["smallest_margin_rad"] == pytest.approx(structure.cells.dead_centre_margin.min())
    assert row["material_area"] == pytest.approx(structure.panel_areas.sum())
    assert row["cells"] == 4
    assert row[WALLS] == 0.001


def test_what_cannot_be_built_is_a_row_with_its_reason() -> None:
    thick = run_job(jobs({WALLS: [0.04]})[0])
    assert thick["status"] == INFEASIBLE
    assert "cell" in thick["error"]
    assert "eta" not in thick


def test_files_travel_with_the_job(tmp_path: Path) -> None:
    (tmp_path / "shapes").mkdir()
    circle = "\n".join(
        f"{x} {y}" for x, y in [(1, 0), (0.7, 0.7), (0, 1), (-0.7, 0.7), (-1, 0), (-0.7, -0.7), (0, -1), (0.7, -0.7)]
    )
    (tmp_path / "shapes" / "round.dat").write_text(circle)
    document = {**SPEC, "profile": {"kind": "points", "file": "shapes/round.dat", "chord_m": 0.1}}
    job = next(jobs_of(document, parse_grid({WALLS: [0.001]}), tmp_path))
    (tmp_path / "shapes" / "round.dat").unlink()
    assert run_job(job)["status"] == FOUND


@pytest.mark.parametrize("start", [0, "given"])
def test_the_optimiser_does_better_than_the_specification(start: int | str) -> None:
    given, found = (
        run_job(jobs(grid)[0]) for grid in ({WALLS: [0.0005]}, {WALLS: [0.0005], "optimize": True, "start": [start]})
    )
    assert found["status"] == FOUND
    assert found["eta"] >= given["eta"] - 1e-9


def test_the_wish_of_the_specification_is_kept() -> None:
    document = {**SPEC, "optimize": {"margin_rad": 0.05}}
    grid = {"optimize": True, "optimize.margin_rad": [0.05, 0.9], "layout.ring.cells": 6, "start": [0]}
    wide, narrow = (run_job(job) for job in jobs(grid, document=document))
    assert wide["status"] == FOUND
    assert wide["smallest_margin_rad"] >= 0.05 - 1e-6
    assert narrow["status"] == INFEASIBLE or narrow["smallest_margin_rad"] >= 0.9 - 1e-6


def test_a_layout_goes_onto_the_profile_in_place_of_the_specifications_own() -> None:
    row = run_job(jobs({"optimize": True, "layouts": {"cells": 3, "inner": 1}, "start": [0]})[0])
    assert row["status"] == FOUND
    assert row["cells"] == 3


# --- the table --------------------------------------------------------------------------------------------


def test_a_table_goes_on_and_grows_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    with Store(path, [(WALLS, (0, 1))]) as store:
        store.add({"job": "x", "status": FOUND, "eta": 2.0, WALLS: 1})
    with Store(path, [(WALLS, (0.5,)), ("profile.kind", ("ellipse",)), ("vertex.P.xy_m", ([0.1, 0.2],))]) as store:
        assert store.finished() == {"x"}
        store.add({"job": "y", "status": FAILED, WALLS: 0.5, "profile.kind": "ellipse", "vertex.P.xy_m": [0.1, 0.2]})
        assert store.finished() == {"x", "y"}
    rows = table(path)
    assert [(r["job"], r[WALLS], r["profile.kind"], r["vertex.P.xy_m"]) for r in rows] == [
        ("x", 1.0, None, None),
        ("y", 0.5, "ellipse", "[0.1, 0.2]"),
    ]
    with Store(path, [(WALLS, ("thick",))]) as store:
        store.forget_failed()
        assert store.finished() == {"x"}
    assert not list(tmp_path.glob(".*"))


def test_an_axis_may_not_pass_for_a_result(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="column of the results"):
        Store(tmp_path / "a.parquet", [("eta", (1.0,))])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"not a table", b""])
def test_a_file_that_is_something_else_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.parquet"
    path.write_bytes(content)
    with pytest.raises(FileError, match="not a Parquet file"):
        Store(path, [])
    assert path.read_bytes() == content
    other = tmp_path / "b.parquet"
    pq.write_table(pa.table({"job": ["x"]}), other)
    with pytest.raises(FileError, match="not a table of a sweep"):
        Store(other, [])
    assert not list(tmp_path.glob(".*"))


def test_only_one_sweep_writes_a_table(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    with Store(path, []), pytest.raises(FileError, match="another sweep"):
        Store(path, [])
    with Store(path, []):
        pass


# --- under way --------------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Workers import `tests.sweep.breaking`."""
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.setenv("ORI_DEPLOY_TEST_MARK", str(tmp_path / "mark"))


def swept(path: Path, walls: list[float], **how: Any) -> Sweep:
    grid = parse_grid({WALLS: walls})
    with Store(path, grid.axes) as store:
        under_way = Sweep(store, Processes(2), run=breaking, **how)
        under_way.carry_out(jobs_of(SPEC, grid, ROOT))
    return under_way


@pytest.mark.slow
def test_nothing_is_lost_when_workers_end_and_the_guilty_are_named(tmp_path: Path) -> None:
    walls = [0.0001 * k for k in range(1, 9)] + [0.0011, 0.0012, 0.0013, 0.0014]
    done = swept(tmp_path / "a.parquet", walls)
    rows = {row[WALLS]: row for row in table(tmp_path / "a.parquet")}
    assert len(rows) == len(walls)
    assert done.count == {FOUND: 9, FAILED: 3}
    assert done.lost_workers >= 3
    assert rows[0.0011]["error"] == "worker process ended: exit status 3, twice"
    assert rows[0.0012]["error"] == "worker process ended: killed by signal 9, twice"
    assert rows[0.0013]["error"] == "RuntimeError: a fault in the program over two lines"
    assert rows[0.0014]["status"] == FOUND
    expected = {wall: run_job(job)["eta"] for wall, job in zip(walls[:8], jobs({WALLS: walls[:8]}), strict=True)}
    assert {wall: rows[wall]["eta"] for wall in walls[:8]} == expected

    again = swept(tmp_path / "a.parquet", [*walls, 0.0009])
    assert again.count == {FOUND: 1}
    assert again.reused == len(walls)


@pytest.mark.slow
def test_a_stopped_sweep_keeps_what_is_done_and_goes_on_from_there(tmp_path: Path) -> None:
    path, walls = tmp_path / "a.parquet", [0.0015, *(0.0001 * k for k in range(1, 10))]
    seen: list[str] = []
    stopped = swept(path, walls, tell=lambda row: seen.append(row["job"]), stop=lambda: len(seen) >= 3)
    assert stopped.stopped
    kept = {row["job"]: row for row in table(path)}
    assert set(seen) == set(kept)
    assert 3 <= len(kept) < len(walls)  # the first one never ends, and was dropped
    resumed = swept(path, walls[1:])
    assert resumed.reused == len(kept)
    assert resumed.count == {FOUND: 9 - len(kept)}
    assert {row["job"]: row for row in table(path) if row["job"] in kept} == kept


@dataclass
class Prompt:
    """A backend whose jobs have all come to their end, or lost their worker, before anybody looks."""

    width: int
    breaks: bool
    losing: list[str]

    def submit(self, run: Run, job: Job) -> Future[Row]:
        del run
        future: Future[Row] = Future()
        if job.digest in self.losing:
            self.losing.remove(job.digest)
            future.set_exception(WorkerLost("ended"))
        else:
            future.set_result({"job": job.digest, "status": FOUND})
        return future

    def lost(self, error: BaseException) -> str | None:
        return "ended" if isinstance(error, WorkerLost) else None

    def renewed(self, workers: int | None = None) -> Prompt:
        del workers
        return self

    def check(self) -> None:
        """There is always somebody."""

    def close(self) -> None:
        """There is nothing under way."""


@settings(max_examples=60)
@given(
    count=st.integers(1, 12),
    width=st.integers(1, 5),
    breaks=st.booleans(),
    losing=st.lists(st.integers(0, 11), max_size=14),
)
def test_nothing_is_left_out_however_fast_jobs_end(count: int, width: int, breaks: bool, losing: list[int]) -> None:
    todo = jobs({WALLS: [1e-4 * (k + 1) for k in range(count)]})
    kept: list[Row] = []
    lost = [todo[k].digest for k in losing if k < count]
    store = SimpleNamespace(finished=frozenset, add=kept.append, flush=lambda: None)
    under_way = Sweep(store, Prompt(width, breaks, list(lost)))  # type: ignore[arg-type]
    under_way.carry_out(todo)
    assert sorted(row["job"] for row in kept) == sorted(job.digest for job in todo)
    blamed = {row["job"] for row in kept if row["status"] == FAILED}
    assert blamed == {digest for digest in lost if lost.count(digest) >= 3}, "once in company, then twice alone"


def test_rows_land_while_the_sweep_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    landed: list[int] = []

    def stop() -> bool:
        landed.append(len(table(path)) if path.exists() else 0)
        return landed[-1] == 3  # all but the one that never ends

    assert swept(path, [0.0015, 0.0001, 0.0002, 0.0003], stop=stop).stopped
    assert landed[-1] == 3


def test_one_slow_write_does_not_keep_rows_from_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first write loads a library; were the next put off for twenty times that, all of it could be lost."""
    now, took, writes = 0.0, iter([2.0, 0.01, 0.4, 0.4, 0.01]), []

    class Slow:
        def flush(self) -> None:
            nonlocal now
            now += next(took, 0.0)
            writes.append(now)

    monkeypatch.setattr(run, "time", SimpleNamespace(monotonic=lambda: now))
    under_way = Sweep(Slow(), Processes(1))  # type: ignore[arg-type]
    while len(writes) < 6:
        now += 0.1
        under_way._flush()
    pauses = np.diff(writes)
    assert (pauses[[0, 1, 2]] < 2.0).all()
    assert 7.5 < pauses[3] < 8.0  # two slow ones in a row are how it is
    assert pauses[4] < 2.0


# --- a cluster --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real scheduler and two workers, as processes on the loopback."""
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed: --dask is NOT tested")
    folder = tmp_path_factory.mktemp("cluster")
    where = folder / "scheduler.json"
    started: list[subprocess.Popen[bytes]] = []

    def start(*words: str) -> None:
        environment = os.environ | {
            "PYTHONPATH": str(ROOT),
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0",
            "DASK_TEMPORARY_DIRECTORY": str(folder),
            "TMPDIR": str(folder),
        }
        log = (folder / f"{len(started)}.log").open("wb")
        command = [sys.executable, "-m", "distributed.cli." + words[0], *words[1:], "--no-dashboard"]
        started.append(
            subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)
        )

    try:
        start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(where))
        while not (where.exists() and where.stat().st_size):
            assert started[0].poll() is None, (folder / "0.log").read_text()
            time.sleep(0.05)
        for _ in range(2):
            start("dask_worker", "--scheduler-file", str(where), "--nthreads", "1", "--host", "127.0.0.1")
        yield json.loads(where.read_text())["address"]
    finally:
        for process in started:  # each leads a group: a nanny takes its worker along
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.slow
def test_a_cluster_gives_the_same_rows_and_outlives_its_workers(cluster: str, tmp_path: Path) -> None:
    walls = [0.0001 * k for k in range(1, 9)] + [0.0011, 0.0013]
    grid = parse_grid({WALLS: walls})
    with Store(tmp_path / "a.parquet", grid.axes) as store:
        done = Sweep(store, Cluster(cluster), run=breaking)
        done.carry_out(jobs_of(SPEC, grid, ROOT))
    rows = {row[WALLS]: row for row in table(tmp_path / "a.parquet")}
    assert {wall: row["error"] for wall, row in rows.items() if row["error"]}.keys() == {0.0011, 0.0013}
    assert done.count == {FOUND: 8, FAILED: 2}
    assert rows[0.0011]["error"].startswith("workers ended")
    assert rows[0.0011]["error"].endswith("twice")
    assert rows[0.0013]["error"].startswith("RuntimeError")
    expected = {wall: run_job(job)["eta"] for wall, job in zip(walls[:8], jobs({WALLS: walls[:8]}), strict=True)}
    assert {wall: rows[wall]["eta"] for wall in walls[:8]} == expected


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://"])
def test_a_scheduler_that_is_not_there_is_told(address: str) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed: --dask is NOT tested")
    with pytest.raises(InputError, match="no scheduler answers"):
        Cluster(address, within_s=0.5)


def test_extras_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="extra `cluster`"):
        Cluster("tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match="extra `sweep`"):
        Store(tmp_path / "a.parquet", [])


def test_the_grid_counts_its_combinations() -> None:
    assert len(Grid((("a", (1, 2, 3)), ("b", (1, 2))))) == 6
