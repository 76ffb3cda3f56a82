"""Standard output that cannot be written: one line and a status of its own; none where nobody listens any more."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast

EXIT_UNTOLD, EXIT_UNHEARD = 4, 141
"""The second is what shells tell of programs that a closed pipe ends: 128 and the number of SIGPIPE."""

Status = int | str | None
"""As `sys.exit` takes it."""


class Output:
    """A stream that notes why it could not be written, so that such an error is told from those of other files.

    Attributes
    ----------
    lost
        The last error it raised.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.lost: OSError | None = None

    def write(self, text: str) -> int:
        """Write. Raises OSError."""
        with self._noting():
            return self._stream.write(text)

    def flush(self) -> None:
        """Hand on what was written. Raises OSError."""
        with self._noting():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _noting(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError as wrong:
            # Without its number: by that click knows it, and ends with a status that means something else here.
            self.lost = BrokenPipeError(wrong.strerror)
            raise self.lost from wrong
        except OSError as wrong:
            self.lost = wrong
            raise


def told(run: Callable[[], Status]) -> Status:
    """Run what writes to standard output and ends with a status, by `sys.exit` or by giving it back.

    What somebody was told of, and went on without, as a motion does, changes nothing. What was to be told last and
    could not be is an end of its own, unless the status says already that something is wrong.
    """
    stream = sys.stdout
    if stream is None:  # closed from the start: nobody wants to be told
        return run()
    output = Output(stream)
    sys.stdout = cast(TextIO, output)
    status: Status = 0
    try:
        try:
            status = run()
        except SystemExit as end:
            status = end.code
        if output.lost is None:
            output.flush()
    except OSError as wrong:
        if wrong is not output.lost:
            raise
        status = status or _untold(wrong)
    finally:
        sys.stdout = stream
        if output.lost is not None:
            _discard(stream)
    return status


def _untold(wrong: OSError) -> int:
    if isinstance(wrong, BrokenPipeError):
        return EXIT_UNHEARD
    with suppress(OSError):
        sys.stderr.write(
            f"error: standard output cannot be written: {wrong.strerror or wrong}; remedy: give it a file with room\n"
        )
    return EXIT_UNTOLD


def _discard(stream: TextIO) -> None:
    """What is still in the stream goes nowhere: Python tries once more at its end, and would complain again."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, stream.fileno())
        finally:
            os.close(nowhere)
