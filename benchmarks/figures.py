"""`python -m benchmarks.figures`: the whole of Fig. 4c. Not among the others: it takes minutes."""

from __future__ import annotations

import resource
import time

from ori_deploy.figures import packaging_points

WORKERS = 2


def main() -> None:
    """Print wall time and processor time: on a busy machine only the second one says something."""
    begun = time.perf_counter()
    points, _ = packaging_points(workers=WORKERS)
    wall_s = time.perf_counter() - begun
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu_s = sum(u.ru_utime + u.ru_stime for u in used)
    print(f"Fig. 4c, {len(points)} searches, {WORKERS} workers: {wall_s:.1f} s, {cpu_s:.1f} s of processor")


if __name__ == "__main__":
    main()
