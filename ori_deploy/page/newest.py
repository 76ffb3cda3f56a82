"""Work that is behind may skip what is old: only the newest of what was asked is done."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

log = logging.getLogger(__name__)


class Newest(Generic[T]):
    """Does something with the newest item, in a thread of its own.

    Parameters
    ----------
    do
        What; what it raises is logged, and the next item is done all the same.
    rest_s
        How long to leave things be after each.
    """

    def __init__(self, do: Callable[[T], None], rest_s: float = 0.0) -> None:
        self._do, self._rest_s = do, rest_s
        self._item: tuple[T] | None = None
        self._there = threading.Condition()
        threading.Thread(target=self._work, daemon=True).start()

    def give(self, item: T) -> None:
        """Put something in place of what has not been begun."""
        with self._there:
            self._item = (item,)
            self._there.notify()

    def _work(self) -> None:
        while True:
            with self._there:
                while self._item is None:
                    self._there.wait()
                (item,), self._item = self._item, None
            try:
                self._do(item)
            except Exception:  # a pose that cannot be judged must not end the judging
                log.exception("not done")
            time.sleep(self._rest_s)
