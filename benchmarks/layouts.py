"""What enumerating layouts costs.

Each line: layouts per second on one core, the target, their ratio (above 1 is within it).
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterable

from ori_deploy.layout import layouts, slit_choices

CELLS = 9
TARGET = 20_000.0


def per_second(work: Iterable[object]) -> tuple[int, float]:
    """How many there are, and how many a second."""
    start = time.perf_counter()
    n = sum(1 for _ in work)
    return n, n / (time.perf_counter() - start)


def report(what: str, work: Iterable[object], target: float | None) -> None:
    """One line of the table."""
    n, rate = per_second(work)
    ratio = f"target {target:8.4g} /s  ratio {rate / target:5.2f}" if target is not None else ""
    print(f"{what:<52} {n:>9} {rate:9.4g} /s {ratio}")


def main() -> None:
    """Print the table."""
    print(f"layouts: {platform.machine()}, Python {platform.python_version()}")
    report(f"{CELLS} cells", layouts(CELLS), TARGET)
    report(f"{CELLS} cells, mirror images apart", layouts(CELLS, mirror_apart=True), TARGET)
    report(f"{CELLS} cells, one inner vertex", layouts(CELLS, inner=1), TARGET)
    report(f"{CELLS + 1} cells", layouts(CELLS + 1), TARGET)
    every = (slits for tree in layouts(CELLS) for slits in slit_choices(tree, foldable=False))
    report(f"{CELLS} cells, with every slit choice", every, None)
    flat = (slits for tree in layouts(CELLS) for slits in slit_choices(tree))
    report(f"{CELLS} cells, with slit choices that fold flat", flat, None)


if __name__ == "__main__":
    main()
