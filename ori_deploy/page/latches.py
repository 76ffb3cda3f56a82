"""What the sensors of latches said in a flight, by latch point, as the page shows it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ori_deploy.actuators.resolve import FROM_TEMPLATE
from ori_deploy.actuators.rig import parse_rig
from ori_deploy.errors import OriDeployError
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run

NAMES = {"unknown": "latch, not known", "open": "latch open", "closed": "latch closed"}
"""What is told of the states."""

_RIG_FILE = "rig.toml"
_ROUNDED_S = 1e-5
"""Times of cycles are in a log to a millionth of a second, those of latches whole."""


@dataclass(frozen=True)
class Latches:
    """States over time.

    Attributes
    ----------
    time_s
        (n,) by latch point: when it was read, increasing.
    states
        (n,) by latch point: what it was from then on.
    """

    time_s: Mapping[str, Reals]
    states: Mapping[str, tuple[str, ...]]

    def at(self, time_s: float) -> dict[str, str]:
        """By latch point, at a time."""
        until = time_s + _ROUNDED_S
        before = {point: int(np.searchsorted(read, until, side="right")) for point, read in self.time_s.items()}
        return {point: self.states[point][k - 1] if k else "unknown" for point, k in before.items()}


def told(confirmed: Iterable[bool | None]) -> str:
    """What is known of a latch point from all of its latches: it is closed when every one is."""
    seen = set(confirmed)
    return "open" if False in seen else "unknown" if None in seen or not seen else "closed"


def seen_in(run: Run, begin_s: float) -> Latches:
    """What a log says of its latches, in seconds from its begin."""
    points = _points(run)
    now: dict[str, dict[str, bool | None]] = {}
    times: dict[str, list[float]] = {}
    states: dict[str, list[str]] = {}
    for one in run.latches:
        point = points.get(one.id, one.id.removeprefix(FROM_TEMPLATE))
        known = now.setdefault(point, {})
        known[one.id] = one.confirmed if one.valid else None
        times.setdefault(point, []).append(one.time_s - begin_s)
        states.setdefault(point, []).append(told(known.values()))
    return Latches(
        {point: np.array(read) for point, read in times.items()},
        {point: tuple(of) for point, of in states.items()},
    )


def _points(run: Run) -> dict[str, str]:
    """Where every latch of a log's rig is that has a name of its own."""
    with suppress(OriDeployError, tomllib.TOMLDecodeError):
        rig = parse_rig(tomllib.loads(run.files.get(_RIG_FILE, "")), _RIG_FILE)
        return {latch.id: latch.secures for latch in rig.latch}
    return {}
