"""`python -m tests.campaign`: every fault in every stage on every backend; times, and what broke."""

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

from tests.campaign.faults import CAUSES, STAGES, TIMED, Cause
from tests.campaign.grounds import GROUNDS, available
from tests.campaign.outcome import Trial
from tests.campaign.soak import soak
from tests.campaign.times import ENOUGH, worst
from tests.campaign.trial import run_fairly, run_trial

TIMED_STAGES = ("open", "close", "open", "close", "recover")
"""Where all cells, or some, are moving."""


def main() -> int:
    options = _options()
    logging.disable(logging.CRITICAL)
    seed = secrets.randbelow(10**6) if options.seed is None else options.seed
    print(f"seed {seed}; again with --seed {seed}")
    begun = time.monotonic()
    backends = [name for name in _to_be_had() if name in options.backend]
    trials = _told(trial for name in backends for trial in campaign(name, seed, options.repeat, stages=options.stage))
    print(table(trials))
    if options.timed and "mock" in backends:
        timed = _told(timed_trials(seed, options.timed))
        print(f"\n{TIMED_HEADER}\n{timed_table(timed)}")
        trials += timed
    broken, unjudged = [t for t in trials if t.violations], [t for t in trials if t.not_judged]
    print(f"{len(trials)} trials in {time.monotonic() - begun:.0f} s, {len(broken)} with violations")
    again = [trial for trial in trials if trial.attempts_before]
    if again:
        print(f"{len(again)} trials took more than one attempt, see above")
    if unjudged:
        print(f"{len(unjudged)} TRIALS WERE NOT, OR NOT WHOLLY, JUDGED: the machine was late itself, see above")
    failed = bool(broken)
    if options.soak_hours > 0.0:
        told = soak(options.soak_hours * 3600.0, seed, Path(options.soak_log) if options.soak_log else None)
        print(told)
        failed = failed or bool(told.violations)
    return 1 if failed else 0


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
                    trial = run_fairly(backend, cause, stage, own, Path(folder))
                if trial is not None:
                    yield trial


def timed_trials(seed: int, count: int) -> Iterator[Trial]:
    """What has a limit from the fault to rest, at random moments of moving stages of the mock.

    Until each was noticed `count` times: a jam of a cell that does not move never is. Twice as often at most.
    """
    seeds = np.random.default_rng([seed, count])
    for cause in (cause for cause in CAUSES if cause.name in TIMED):
        noticed = 0
        for k in range(2 * count):
            own, stage = int(seeds.integers(2**31)), TIMED_STAGES[k % len(TIMED_STAGES)]
            trial = run_trial("mock", cause, stage, own, Path(), only_times=True)
            if trial is not None:
                noticed += trial.noticed_s is not None
                yield trial
            if noticed == count:
                break


def table(trials: Sequence[Trial]) -> str:
    """Worst times per fault and backend."""
    head = f"{'fault':24} {'backend':10} {'trials':>6} {'noticed s':>10} {'at rest s':>10} {'shafts s':>10}"
    rows = [f"{head} {'which is':>14}  ended as"]
    for cause in CAUSES:
        for backend in GROUNDS:
            mine = [trial for trial in trials if (trial.fault, trial.backend) == (cause.name, backend)]
            if mine:
                times = ([t.noticed_s for t in mine], [t.rested_s for t in mine], [t.still_s for t in mine])
                told = " ".join(f"{worst(one)[0]:>10}" for one in times)
                row = f"{cause.name:24} {backend:10} {len(mine):6} {told} {worst(times[0])[1]:>14}"
                rows.append(f"{row}  {', '.join(_endings(mine))}")
    return "\n".join(rows)


TIMED_HEADER = "mock, simulated time at 100 Hz, injected at random moments of moving stages:"


def timed_table(trials: Sequence[Trial]) -> str:
    """Quantiles per fault, with the numbers they are made of."""
    head = f"{'fault':24} {'noticed s':>10} {'at rest s':>10} {'in all s':>10} {'shafts s':>10}"
    rows = [f"{head}  which is           longest of all"]
    for name in TIMED:
        mine = [trial for trial in trials if trial.fault == name]
        times = (
            [t.noticed_s for t in mine], [t.rested_s for t in mine],
            [t.within_s for t in mine], [t.still_s for t in mine],
        )  # fmt: skip
        told = " ".join(f"{worst(one)[0]:>10}" for one in times)
        known = [t for t in times[2] if t is not None]
        rows.append(f"{name:24} {told}  {worst(times[2])[1]:18} {max(known, default=0.0):.3f}")
    return "\n".join(rows)


def _told(trials: Iterator[Trial]) -> list[Trial]:
    """All of them; what broke, and what nobody could judge, is told at once."""
    all_of_them = []
    for trial in trials:
        all_of_them.append(trial)
        if trial.violations:
            print(f"VIOLATION {trial}", flush=True)
        where = f"{trial.backend}, {trial.fault}, {trial.stage}, seed {trial.seed}"
        if trial.attempts_before:
            print(f"AGAIN {where}: {'; '.join(trial.attempts_before)}", flush=True)
        if trial.not_judged:
            print(f"NOT JUDGED {where}: {'; '.join(trial.not_judged)}", flush=True)
    return all_of_them


def _to_be_had() -> Iterator[str]:
    for backend, why in available().items():
        if why:
            print(f"SKIPPED {backend}: {why}")
        else:
            yield backend


def _endings(trials: Sequence[Trial]) -> list[str]:
    return sorted({trial.ended.split(" (")[0].removeprefix("fault, ") for trial in trials})


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--seed", type=int, help="of hinges, folds and noise  [default: drawn, and printed]")
    parser.add_argument("--backend", nargs="+", choices=list(GROUNDS), default=list(GROUNDS))
    parser.add_argument("--stage", nargs="+", choices=STAGES, default=STAGES, help="[default: all]")
    parser.add_argument("--repeat", type=int, default=1, help="trials per fault and stage  [default: 1]")
    parser.add_argument(
        "--timed", type=int, default=ENOUGH, metavar="N",
        help=f"more trials of the mock's times per fault that has a limit; 0 for none  [default: {ENOUGH}]",
    )  # fmt: skip
    parser.add_argument("--soak-hours", type=float, default=1.0, help="of simulated time; 0 for none  [default: 1]")
    parser.add_argument("--soak-log", help="keep the soak's log here")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
