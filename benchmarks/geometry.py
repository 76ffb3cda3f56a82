"""What building, moving and checking a structure costs.

Each line: median of several runs, the target, their ratio (below 1 is within it), and how many times a
plain numpy sine over as many numbers would fit in: a measure that travels between machines.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ori_deploy.design import build, embed
from ori_deploy.files import build_from_file
from ori_deploy.motion import FourBars, Interference, Mechanism, mechanism_of, step_tolerance

EXAMPLES = Path(__file__).parents[1] / "examples"
SEED = 7
POSES, CELLS = 100_000, 6


def median_s(work: Callable[[], object], runs: int = 15) -> float:
    """Median seconds of `work`, after one warm-up."""
    work()
    taken = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def report(what: str, figure: float, unit: str, target: float | None) -> None:
    """One line of the table."""
    ratio = f"target {target:8.4g} {unit:<3} ratio {figure / target:5.2f}" if target is not None else ""
    print(f"{what:<64} {figure:9.4g} {unit:<3} {ratio}")


def main() -> None:
    """Print the table."""
    print(f"geometry: {platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, seed {SEED}")
    folds = np.random.default_rng(SEED).random((POSES, CELLS))
    sine = median_s(lambda: np.sin(folds))
    report("numpy sine of 600,000 numbers, per number", 1e9 * sine / folds.size, "ns", None)

    _, ellipse = build_from_file(EXAMPLES / "ellipse_6.toml")
    bars = FourBars.of(ellipse.cells)
    angles = median_s(lambda: bars.angles(folds))
    report("four crease angles, per cell and pose (6 cells, 100,000 poses)", 1e9 * angles / folds.size, "ns", 100.0)
    print(f"{'':<64} {angles / sine:9.4g} sines")

    for name in ("ellipse_6", "wing_naca0024_6"):
        _, structure = build_from_file(EXAMPLES / f"{name}.toml")
        e = structure.embedding
        report(f"build {name}, eta included", 1e3 * median_s(lambda: build(e, structure.wall_m).eta, 200), "ms", 1.0)  # noqa: B023
        ids = [v.id for v in e.layout.vertices]
        outline = {v: float(s) for v, s in zip(ids, e.s, strict=True) if np.isfinite(s)}
        inner = {v: (z.real, z.imag) for v, z, s in zip(ids, e.z, e.s, strict=True) if np.isnan(s)}
        report(
            f"embed and check {name}",
            1e3 * median_s(lambda: embed(e.profile, e.layout, outline, inner), 200),  # noqa: B023
            "ms",
            None,
        )
    check = Interference(Mechanism(structure))
    in_step = np.linspace(0.0, 1.0, 200)
    report(
        "interference, 6-cell wing, 200 poses",
        1e3 * median_s(lambda: check.first_collision(in_step, between=False)),
        "ms",
        100.0,
    )
    report(
        "  the same with every interval between poses certified",
        1e3 * median_s(lambda: check.first_collision(in_step)),
        "ms",
        100.0,
    )
    report("safe step tolerance, 6-cell wing", median_s(lambda: step_tolerance(check), 3), "s", None)
    cones()


def cones() -> None:
    """The same on the sphere."""
    _, cone = build_from_file(EXAMPLES / "cone_elliptic_6.toml")
    check = Interference(mechanism_of(cone))
    folds = np.random.default_rng(SEED).random((POSES, CELLS))
    angles = median_s(lambda: check.mechanism.four_bars.angles(folds))
    report("four crease angles, per spherical cell and pose (6 cells)", 1e9 * angles / folds.size, "ns", None)
    in_step = np.linspace(0.0, 1.0, 200)
    report(
        "interference, 6-cell cone, 200 poses",
        1e3 * median_s(lambda: check.first_collision(in_step, between=False)),
        "ms",
        None,
    )
    report(
        "  the same with every interval between poses certified",
        1e3 * median_s(lambda: check.first_collision(in_step)),
        "ms",
        None,
    )
    report("safe step tolerance, 6-cell cone", median_s(lambda: step_tolerance(check), 1), "s", None)


if __name__ == "__main__":
    main()
