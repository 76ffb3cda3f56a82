"""The recorder's own process: `python -m ori_deploy.telemetry.record_process SOCKET FILE PATH PARTIAL NAP_S`.

Reads frames until the loop says that the log is whole, or is gone: then the log is finished all the same. After a
failed write it tells the loop, and goes on reading so that nobody waits for it.
"""

from __future__ import annotations

import errno
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ori_deploy.telemetry.channel import Frame, incoming, packed
from ori_deploy.telemetry.log import CLOSED, FLUSH_EVERY_S, LogWriter

LOST = "the process of the control loop ended without a word"
"""How a log ends whose loop was killed."""

_SYNC_EVERY_S = 0.5 * FLUSH_EVERY_S


def main(words: list[str]) -> None:
    """Record until there is nothing more to record."""
    end = socket.socket(fileno=int(words[0]))
    path, partial = Path(words[2]), Path(words[3])
    frames = incoming(end, _SYNC_EVERY_S, float(words[4]))
    first = next((frame for frame in frames if frame is not None), None)
    if first is None:
        return  # the loop was gone before anything happened
    said: tuple[object, ...] = ("whole",)
    try:
        log = LogWriter(path, first[0][1], (partial, os.fdopen(int(words[1]), "wb")))
        end.sendall(packed([("ready",)]))
        log.close(_record(log, frames))
    except OSError as error:
        said = ("failed", error.errno or errno.EIO, str(error.strerror or error))
        _say(end, said)
        for _ in frames:
            pass
    _say(end, said)


def _record(log: LogWriter, frames: Iterator[Frame | None]) -> str:
    """Write everything; how the log ended."""
    unsaved = False
    for frame in frames:
        if frame is None:
            if unsaved:
                log.sync()
            unsaved = False
        elif frame[-1][0] == "end":
            return CLOSED
        else:
            log.write(frame)
            unsaved = True
    return LOST


def _say(end: socket.socket, word: tuple[object, ...]) -> None:
    with suppress(OSError):  # nobody may be there any more
        end.sendall(packed([word]))


if __name__ == "__main__":
    main(sys.argv[1:])
