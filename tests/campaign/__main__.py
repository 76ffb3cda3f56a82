"""`python -m tests.campaign`: every fault in every stage on every backend; worst times, and what broke."""

from __future__ import annotations

import argparse
import logging
import secrets
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.campaign.faults import CAUSES, STAGES, Cause
from tests.campaign.grounds import GROUNDS, available
from tests.campaign.soak import soak
from tests.campaign.trial import Trial, run_trial


def main() -> int:
    options = _options()
    logging.disable(logging.CRITICAL)
    seed = secrets.randbelow(10**6) if options.seed is None else options.seed
    print(f"seed {seed}; again with --seed {seed}")
    begun, trials = time.monotonic(), []
    for backend, why in available().items():
        if backend not in options.backend:
            continue
        if why:
            print(f"SKIPPED {backend}: {why}")
            continue
        for trial in campaign(backend, seed, options.repeat):
            trials.append(trial)
            if trial.violations:
                print(f"VIOLATION {trial}")
    print(table(trials))
    broken = [trial for trial in trials if trial.violations]
    print(f"{len(trials)} trials in {time.monotonic() - begun:.0f} s, {len(broken)} with violations")
    if options.soak_hours > 0.0:
        told = soak(options.soak_hours * 3600.0, seed, Path(options.soak_log) if options.soak_log else None)
        print(told)
        broken += [told] if told.violations else []  # type: ignore[list-item]
    return 1 if broken else 0


def campaign(
    backend: str, seed: int, repeat: int = 1, causes: Sequence[Cause] = CAUSES, stages: Sequence[str] = STAGES
) -> Iterator[Trial]:
    """Every cause in every stage, each trial with a seed of its own."""
    seeds = np.random.default_rng(seed)
    for cause in causes:
        for stage in stages:
            for _ in range(repeat):
                own = int(seeds.integers(2**31))
                with tempfile.TemporaryDirectory() as folder:
                    trial = run_trial(backend, cause, stage, own, Path(folder))
                if trial is not None:
                    yield trial


def table(trials: Sequence[Trial]) -> str:
    """Worst times per fault and backend."""
    rows = [f"{'fault':24} {'backend':10} {'trials':>6} {'noticed s':>10} {'at rest s':>10}  ended as"]
    for cause in CAUSES:
        for backend in GROUNDS:
            mine = [trial for trial in trials if (trial.fault, trial.backend) == (cause.name, backend)]
            if mine:
                endings = sorted({trial.ended.split(" (")[0].removeprefix("fault, ") for trial in mine})
                noticed = _worst([trial.noticed_s for trial in mine])
                rested = _worst([trial.rested_s for trial in mine])
                rows.append(
                    f"{cause.name:24} {backend:10} {len(mine):6} {noticed:>10} {rested:>10}  {', '.join(endings)}"
                )
    return "\n".join(rows)


def _worst(times: Sequence[float | None]) -> str:
    known = [value for value in times if value is not None]
    return f"{max(known):.3f}" if known else "-"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--seed", type=int, help="of hinges, folds and noise  [default: drawn, and printed]")
    parser.add_argument("--backend", nargs="+", choices=list(GROUNDS), default=list(GROUNDS))
    parser.add_argument("--repeat", type=int, default=1, help="trials per fault and stage  [default: 1]")
    parser.add_argument("--soak-hours", type=float, default=1.0, help="of simulated time; 0 for none  [default: 1]")
    parser.add_argument("--soak-log", help="keep the soak's log here")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
