"""`ori-deploy sweep` as a user meets it: interrupted, killed, resumed, refused."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "examples" / "sweep_ellipse.toml"
GRID = """schema = "ori-deploy/sweep/1"
[grid]
"structure.wall_m" = [{walls}]
"layout.ring.cells" = [4, 6]
"""


@pytest.fixture(autouse=True)
def _own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What workers that are killed leave behind is left there."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def words(*given: str | Path) -> list[str]:
    return [sys.executable, "-m", "ori_deploy.cli", "sweep", *(str(w) for w in given)]


def run(*given: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words(*given), cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


def table(path: Path) -> list[dict[str, Any]]:
    whole = io.BytesIO(path.read_bytes())  # a path is opened twice, and replaced in between
    rows: list[dict[str, Any]] = pq.read_table(whole).to_pylist()
    return rows


def grid(folder: Path, count: int) -> Path:
    path = folder / "grid.toml"
    path.write_text(GRID.format(walls=", ".join(f"{1e-6 * k:.6f}" for k in range(count))))
    return path


def begun(folder: Path, count: int, rows: int) -> subprocess.Popen[str]:
    """A sweep of 2 * count designs that has `rows` of them on disk."""
    process = subprocess.Popen(
        words(SPEC, "--grid", grid(folder, count), "-o", "a.parquet", "--workers", "2"),
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    path = folder / "a.parquet"
    while not (path.exists() and len(table(path)) >= rows):
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    return process


def children(process: subprocess.Popen[str]) -> set[int]:
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return {int(pid) for pid in listed}


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def gone(pids: set[int]) -> bool:
    for _ in range(200):
        if not any(alive(pid) for pid in pids):
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
def test_every_row_has_its_place_in_the_grid_and_a_second_run_has_nothing_to_do(tmp_path: Path) -> None:
    done = run(SPEC, "-o", "a.parquet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = table(tmp_path / "a.parquet")
    assert len({row["job"] for row in rows}) == len(rows) == 48
    infeasible = [row for row in rows if row["status"] == "infeasible"]
    assert all(row["eta"] is None and "cell" in row["error"] for row in infeasible)
    again = run(SPEC, "-o", "a.parquet", cwd=tmp_path)
    assert again.returncode == 0
    assert "0 structures, 0 infeasible" in again.stdout
    assert table(tmp_path / "a.parquet") == rows
    assert {p.name for p in tmp_path.iterdir()} == {"a.parquet"}


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(tmp_path: Path) -> None:
    process = begun(tmp_path, 2000, 2)
    workers = children(process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers get it too
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert error.strip().splitlines() == [
        "interrupted: what was finished is in a.parquet; the same command goes on from there"
    ]
    assert gone(workers)
    kept = table(tmp_path / "a.parquet")
    assert 2 <= len(kept) < 4000
    fewer = run(SPEC, "--grid", grid(tmp_path, 3), "-o", "a.parquet", cwd=tmp_path)
    assert fewer.returncode == 0, fewer.stderr
    rows = {row["job"]: row for row in table(tmp_path / "a.parquet")}
    assert all(rows[row["job"]] == row for row in kept)


def test_ctrl_c_while_workers_are_still_loading_is_one_line_too(tmp_path: Path) -> None:
    process = subprocess.Popen(
        words(SPEC, "-o", "a.parquet", "--workers", "2"),
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    while not any(b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children(process)):
        assert process.poll() is None, process.communicate()
    time.sleep(0.3)  # Python itself has begun there, its imports have not ended
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert error.startswith("interrupted: ")
    assert error.count("\n") == 1


@pytest.mark.slow
def test_a_sweep_that_is_killed_leaves_whole_rows_and_no_workers(tmp_path: Path) -> None:
    process = begun(tmp_path, 2000, 2)
    workers = children(process)
    assert len(workers) >= 2
    process.kill()
    process.communicate(timeout=60)
    assert gone(workers)
    kept = table(tmp_path / "a.parquet")
    assert len(kept) >= 2
    assert all(row["status"] == "found" and row["eta"] > 1.0 for row in kept)
    again = begun(tmp_path, 2000, len(kept) + 1)  # the lock of the killed one holds nobody up
    again.send_signal(signal.SIGTERM)
    again.communicate(timeout=60)
    assert again.returncode == 130
    assert table(tmp_path / "a.parquet")[: len(kept)] == kept


@pytest.mark.slow
def test_a_worker_that_is_killed_takes_no_design_along(tmp_path: Path) -> None:
    process = begun(tmp_path, 60, 2)
    own = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    worker = next(int(pid) for pid in own if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes())
    os.kill(worker, signal.SIGKILL)
    out, error = process.communicate(timeout=120)
    assert process.returncode == 0, error
    rows = table(tmp_path / "a.parquet")
    assert len({row["job"] for row in rows}) == len(rows) == 120
    assert {row["status"] for row in rows} == {"found"}
    assert "workers that ended" in out


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((ROOT / "examples" / "ellipse_6.toml",), "nothing to sweep over"),
        ((SPEC, "--grid", "none.toml"), "none.toml"),
        ((SPEC, "--workers", "2", "--dask", "tcp://127.0.0.1:1"), "--workers"),
        ((SPEC, "-o", SPEC), "is an input"),
        ((SPEC, "--grid", "bad.toml"), "bad.toml: sweep.grid.profile.c_m: not a value"),
        ((SPEC, "--grid", "thin.toml"), "thin.toml: sweep.grid.structure.wall_m: not a value; found -1.0"),
        ((SPEC, "--grid", "extra.toml"), "seeds"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, given: tuple[str | Path, ...], message: str
) -> None:
    (tmp_path / "bad.toml").write_text('schema = "ori-deploy/sweep/1"\n[grid]\n"profile.c_m" = [1.0]\n')
    (tmp_path / "extra.toml").write_text('schema = "ori-deploy/sweep/1"\nseeds = 1\n[grid]\n"profile.b_m" = [1.0]\n')
    (tmp_path / "thin.toml").write_text('schema = "ori-deploy/sweep/1"\n[grid]\n"structure.wall_m" = [-1.0]\n')
    before = {p.name for p in tmp_path.iterdir()}
    done = run(*given, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert message in done.stderr
    assert {p.name for p in tmp_path.iterdir()} == before


@pytest.mark.slow
def test_the_first_reason_is_told_when_designs_cannot_be_built(tmp_path: Path) -> None:
    (tmp_path / "g.toml").write_text('schema = "ori-deploy/sweep/1"\n[grid]\n"structure.wall_m" = [0.001, 0.04]\n')
    done = run(SPEC, "--grid", "g.toml", "-o", "a.parquet", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (reason,) = [row["error"] for row in table(tmp_path / "a.parquet") if row["error"]]
    shown = "".join(done.stdout.split())
    assert "firstof1infeasible" in shown
    assert "structure.wall_m=0.04:" in shown
    told = "".join(line.split("│")[2] for line in done.stdout.splitlines() if line.count("│") == 3)
    assert "".join(reason.split()) in "".join(told.split())
