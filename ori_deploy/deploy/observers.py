"""Who is told of every cycle; nothing that an observer does reaches the motion."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from ori_deploy.deploy.result import CycleRecord

Observer = Callable[[CycleRecord], None]

log = logging.getLogger(__name__)


class Observers:
    """Calls observers in order; one that raises is not called again.

    What goes wrong in one that can go on, it tells in an attribute `problems`: a row of texts.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self._observers = list(observers)
        self._errors: list[str] = []

    @property
    def errors(self) -> list[str]:
        """What they raised, and what those tell that go on."""
        return self._errors + [problem for one in self._observers for problem in _problems(one)]

    def note(self, problem: str) -> None:
        """What went wrong beside the motion, and is to be told with its result."""
        self._errors.append(problem)

    def add(self, observer: Observer) -> None:
        """Call it from now on."""
        self._observers.append(observer)

    def notify(self, record: CycleRecord) -> None:
        """Hand a record out; its arrays are copies that cannot be written to."""
        sealed = _sealed(record)
        for observer in tuple(self._observers):
            try:
                observer(sealed)
            except Exception as error:  # noqa: BLE001  a full disk must not stop a structure half-way
                log.error("observer %r failed in cycle %d: %r", observer, record.index, error)
                self._observers.remove(observer)
                self._errors += [*_problems(observer), f"{type(error).__name__}: {error}"]


def _problems(observer: Observer) -> list[str]:
    """What an observer tells that went wrong; one that cannot even tell that is no end of anything."""
    try:
        return [str(problem) for problem in getattr(observer, "problems", ())]
    except Exception as error:  # noqa: BLE001  as above
        return [f"{type(error).__name__}: {error}"]


def _sealed(record: CycleRecord) -> CycleRecord:
    readings, health = record.readings, record.health
    return replace(
        record,
        commanded_rad=_read_only(record.commanded_rad),
        folds=_read_only(record.folds),
        readings=replace(readings, **_arrays(readings)),
        health=None if health is None else replace(health, **_arrays(health)),
    )


def _arrays(readings: Any) -> dict[str, NDArray[Any]]:
    return {name: _read_only(getattr(readings, name)) for name in readings.__dataclass_fields__}


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    copy = array.copy()
    copy.flags.writeable = False
    return copy
