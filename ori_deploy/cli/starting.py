"""Ctrl-C while the program is still being loaded, which takes a second or two: no traceback of somebody's import."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_INTERRUPTED = 130


@contextmanager
def quiet_interrupts() -> Iterator[None]:
    """Until the end of the block an interrupt ends the process in one line.

    Does nothing where interrupts are ignored or somebody else's business already, nor outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _leave(number: int, frame: FrameType | None) -> None:
    """End at once: nothing is open yet, and an exception would be lost in, or changed by, a half-done import."""
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(_INTERRUPTED)
