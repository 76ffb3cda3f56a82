"""How a command starts: what must be so before numpy is loaded, and Ctrl-C before anything could move."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_INTERRUPTED = 130
_unanswered = False
"""Whether an interrupt has come in a block of `remembered_interrupts`."""


def keep_to_one_thread() -> None:
    """Have linear algebra use one thread, unless the environment says otherwise; numpy reads it when it is loaded.

    Matrices here are of a few rows: more threads only wait for one another, on processors that motions in real time,
    or the search's own processes, have use for. Nor do sums depend on how many processors there are.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def keep_standard_descriptors() -> None:
    """Open on nothing what is closed of standard input, output and error.

    The next file would take its number: a log, or a port, into which whatever is started would read and write. Errors
    go to nothing there, too, instead of to a stream that is None: a loop that has one to tell must not break by that.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # it takes the lowest that is free: this one
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115  for as long as the process lives


@contextmanager
def quiet_interrupts() -> Iterator[None]:
    """Until the end of the block an interrupt ends the process in one line: no traceback of somebody's import.

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


@contextmanager
def remembered_interrupts() -> Iterator[None]:
    """Until the end of the block an interrupt is remembered, for `answer_interrupt`; it raises as ever, besides.

    Libraries swallow what is raised inside of them: pydantic does so with KeyboardInterrupt while it makes a
    validator, and the command went on to move. Interrupts that are ignored, as a shell has it for jobs in the
    background, are remembered only. Outside the main thread there are none.
    """
    global _unanswered
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _unanswered = False
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    before = signal.signal(signal.SIGINT, _remember if ignored else _remember_and_raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def answer_interrupt() -> None:
    """Raise KeyboardInterrupt where an interrupt was remembered, and has not ended the command."""
    global _unanswered
    if _unanswered:
        _unanswered = False
        raise KeyboardInterrupt


def _remember(number: int, frame: FrameType | None) -> None:
    global _unanswered
    del number, frame
    _unanswered = True


def _remember_and_raise(number: int, frame: FrameType | None) -> None:
    _remember(number, frame)
    raise KeyboardInterrupt
