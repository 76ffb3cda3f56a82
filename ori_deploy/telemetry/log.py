"""Writing a flight log: MCAP, JSON messages and the tape, compressed in chunks. Loads nothing heavy."""

from __future__ import annotations

import errno
import json
import math
import os
import re
from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from io import UnsupportedOperation
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from mcap.writer import CompressionType, Writer

from ori_deploy.telemetry.channel import Frame, Item
from ori_deploy.telemetry.schema import CHANNELS, TAPE, TAPE_ENCODING, json_schema

CHUNK_BYTES = 32 * 1024
FLUSH_EVERY_S = 0.5
"""Of record time, and of real time where somebody calls `sync`: what a crash may cost, at any rate."""

CLOSED = "closed"
"""How a log ends whose session ended by itself."""

_NON_FINITE = re.compile(r"(?<=[:,\[])-?(?:nan|inf)(?=[,\]}])")
"""Numbers in a cycle's text that JSON has no word for; names are quoted, and never match."""


def open_partial(path: Path) -> tuple[Path, BinaryIO]:
    """The file that a log is written to until it is whole, beside where `path` leads. Raises OSError."""
    path = behind(path)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    return partial, partial.open("wb")


def behind(path: Path) -> Path:
    """Where a link leads, whether or not anything is there yet: a log goes through a link, not in its place.

    Other names stay as they were given, which is how people are told of them.
    """
    return Path(os.path.realpath(path)) if os.path.islink(path) else path  # noqa: PTH114  as `there`


class ClosedAtEnd(ABC):
    """For `with`: closed at its end, however that came."""

    @abstractmethod
    def close(self) -> None:
        """Finish. Raises OSError."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except OSError as failure:
            if error is None:
                raise
            error.add_note(str(failure))  # what ended the run matters more, and this is not to be lost


class LogWriter(ClosedAtEnd):
    """Writes frames into a log.

    It writes to a name of its own beside `path` and renames at `close`, so that `path` never holds half a
    log. After a crash the file under that other name can be read up to about the last second. After a
    failed write nothing more is written, since it would not line up, and `close` says where the rest is.

    Parameters
    ----------
    path
        Where the log will be; a log that is there already is kept under a numbered name.
    info
        The message of `/plan_info`.
    partial, stream
        From `open_partial`; opened here when left out.

    Raises
    ------
    OSError
        From here and from every write: the disk is full, say.
    """

    def __init__(
        self,
        path: str | Path,
        info: dict[str, Any],
        partial: tuple[Path, BinaryIO] | None = None,
    ) -> None:
        self.path = Path(path)
        self._whole_path = behind(self.path)
        self.partial_path, self._stream = open_partial(self.path) if partial is None else partial
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="ori-deploy")
        self._channels = {channel: self._register(channel) for channel in CHANNELS}
        self._channels[TAPE] = self._writer.register_channel(topic=TAPE, message_encoding=TAPE_ENCODING, schema_id=0)
        self._n_hinges = len(info["hinge_ids"])
        self._format = _cycle_format(self._n_hinges)
        self._all_valid = _booleans(b"\1" * self._n_hinges)
        self._info: dict[str, Any] | None = info
        self._flush_due = -math.inf
        self._failure: OSError | None = None
        self._closed = False
        self._time_s = 0.0
        self._dropped = 0

    def write(self, frame: Frame) -> None:
        """Write all items of a frame."""
        with self._writing():
            for item in frame:
                self._items[item[0]](self, item)

    def sync(self) -> None:
        """Put what is written where it outlives the machine's power, as far as the system can."""
        with self._writing():
            self._flush()
            try:
                os.fdatasync(self._stream.fileno())
            except UnsupportedOperation:
                pass  # not a file of the system's
            except OSError as error:
                if error.errno in (errno.EIO, errno.ENOSPC, errno.EDQUOT):  # what was written is lost
                    raise

    def close(self, ending: str = CLOSED) -> None:
        """Finish the file and give it its name. Safe to call twice.

        Raises
        ------
        OSError
            The log is not whole. The message names the file that holds what was written.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._finish(ending)
            keep_older(self._whole_path)
            self.partial_path.replace(self._whole_path)
        except OSError as error:
            reason = f"{error.strerror or error}; what was written is in {self.partial_path}"
            raise OSError(error.errno, reason, str(self.path)) from error

    # -- the kinds of items --------------------------------------------------------------------------

    def _message(self, item: Item) -> None:
        _, channel, time_s, text = item
        self._emit(channel, time_s, text.encode())
        if channel == "/result":
            self._flush()

    def _cycle(self, item: Item) -> None:
        _, log_time_s, *scalars, valid, numbers = item
        values = array("d", numbers)
        text = self._format % (
            *scalars,
            self._all_valid if valid == b"\1" * self._n_hinges else _booleans(valid),
            *values,
        )
        if "nan" in text or "inf" in text:
            text = _NON_FINITE.sub("null", text)
        self._emit("/cycle", log_time_s, text.encode())
        if log_time_s >= self._flush_due:
            self._flush_due = log_time_s + FLUSH_EVERY_S
            self._flush()

    def _health(self, item: Item) -> None:
        _, time_s, numbers, valid, errors, torque = item
        values = [value if math.isfinite(value) else None for value in array("d", numbers)]
        message = {
            "time_s": time_s,
            "valid": [bool(value) for value in valid],
            "temperature_c": values[: len(valid)],
            "voltage_v": values[len(valid) :],
            "hardware_error": list(errors),
            "torque_on": [bool(value) for value in torque],
        }
        self._emit("/health", time_s, json.dumps(message).encode())

    def _latches(self, item: Item) -> None:
        _, time_s, readings = item
        for name, engaged, confirmed, valid, fault in readings:
            message = {
                "time_s": time_s,
                "id": name,
                "engaged": engaged,
                "confirmed": confirmed,
                "valid": valid,
                "fault": fault,
            }
            self._emit("/latch", time_s, json.dumps(message).encode())

    def _timing(self, item: Item) -> None:
        fields = dict(zip(CHANNELS["/timing"], item[1:], strict=True))
        self._emit("/timing", item[1], json.dumps({name: round(value, 7) for name, value in fields.items()}).encode())

    def _tape(self, item: Item) -> None:
        self._emit(TAPE, item[1], item[2])

    def _drop(self, item: Item) -> None:
        self._dropped = item[1]
        self._recorder("")

    _items = {  # noqa: RUF012  a table of this class's methods
        "message": _message,
        "cycle": _cycle,
        "health": _health,
        "latches": _latches,
        "timing": _timing,
        "tape": _tape,
        "dropped": _drop,
    }

    # -- the file ------------------------------------------------------------------------------------

    def _recorder(self, ending: str) -> None:
        message = {"time_s": self._time_s, "dropped": self._dropped, "ending": ending}
        self._emit("/recorder", self._time_s, json.dumps(message).encode())

    def _flush(self) -> None:
        """Finish the chunk and hand it to the operating system: it outlives this process."""
        self._writer.flush()  # type: ignore[no-untyped-call]  # mcap is typed in part

    def _finish(self, ending: str) -> None:
        """Complete and close the stream. Raises the first failure of all writes."""
        with self._stream:
            if self._failure is not None:
                raise self._failure
            self._recorder(ending)
            self._writer.finish()  # type: ignore[no-untyped-call]  # mcap is typed in part

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Remember the first failure, and refuse to write after it."""
        if self._failure is not None:
            raise OSError(self._failure.errno, f"the log failed before: {self._failure.strerror}", str(self.path))
        try:
            yield
        except OSError as error:
            self._failure = error
            raise

    def _emit(self, channel: str, time_s: float, data: bytes) -> None:
        if self._info is not None:  # first of all, and at the time of what follows: no log begins at zero
            info, self._info = self._info, None
            self._emit("/plan_info", time_s, json.dumps(info).encode())
        self._time_s = time_s
        time_ns = int(time_s * 1e9)
        self._writer.add_message(self._channels[channel], log_time=time_ns, data=data, publish_time=time_ns)

    def _register(self, channel: str) -> int:
        schema = self._writer.register_schema(
            name=f"ori_deploy{channel.replace('/', '.')}",
            encoding="jsonschema",
            data=json.dumps(json_schema(channel)).encode(),
        )
        number: int = self._writer.register_channel(topic=channel, message_encoding="json", schema_id=schema)
        return number


def there(path: Path) -> bool:
    """Whether there is such a file, as far as can be seen: unlike `Path.exists`, for names that cannot be, too."""
    return os.path.exists(path)  # noqa: PTH110  as it says


def keep_older(path: Path) -> None:
    """A log is evidence: one of the same name is kept under a numbered one."""
    if there(path):
        path.replace(kept_as(path))


def kept_as(path: Path) -> Path:
    """The name under which a log that is there is kept when another of its name is finished."""
    path = behind(path)
    return next(name for n in count(1) if not there(name := path.with_stem(f"{path.stem}-{n}")))


def _cycle_format(n_hinges: int) -> str:
    """One template for a whole message: a tenth of the time that a general JSON encoder takes."""
    numbers = "[" + ",".join(["%.7g"] * n_hinges) + "]"
    fields = {
        "index": "%d",
        "time_s": "%.6f",
        "lateness_s": "%.6f",
        "state": '"%s"',
        "stage": '"%s"',
        "path_time_s": "%.6f",
        "rate": "%.6g",
        "rate_limit": "%.6g",
        "commanded_fold": "%.8g",
        "lost_replies": "%d",
        "overruns": "%d",
        "valid": "[%s]",
    }
    arrays = ("fold", "commanded_rad", "position_rad", "velocity_rad_s", "current_a", "age_s")
    fields.update(dict.fromkeys(arrays, numbers))
    return "{" + ",".join(f'"{name}":{form}' for name, form in fields.items()) + "}"


def _booleans(values: bytes) -> str:
    return ",".join("true" if value else "false" for value in values)
