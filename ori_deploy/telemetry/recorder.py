"""The flight recorder as the control loop sees it: an observer that packs, and leaves the rest to another process."""

from __future__ import annotations

import errno
import subprocess
import time
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any

from ori_deploy.clock import Clock
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.telemetry.channel import NAP_S, ROOM_BYTES, Frame, Sender, spawn
from ori_deploy.telemetry.frames import CycleFrames, message, result_item
from ori_deploy.telemetry.log import ClosedAtEnd, open_partial
from ori_deploy.telemetry.tape import Tape

START_S = 20.0
STOP_S = 20.0
"""How long its process may take to come up, and to write what it still has."""


class Recorder(ClosedAtEnd):
    """Records a session; give it to the controller as an observer, and its tape to bus, clock and controller.

    The log is written by another process, which outlives this one: whatever ends the loop, the log is finished,
    and holds all that happened up to about the last cycle. Nothing here waits for a disk.

    Parameters
    ----------
    path
        Where the log will be.
    info
        The message of `/plan_info`.
    clock
        The controller's, not on the tape.
    versions
        Gives the message of `/versions` after the first cycle: by then the loop has the priority it asked for.
    files
        Plan and rig, by name.
    waits
        Whether to wait for a recorder that is behind, instead of dropping records: where time is virtual.
    room_bytes
        What is kept for a recorder that is behind.

    Attributes
    ----------
    tape
        What bus, clock and controller say to each other.

    Raises
    ------
    OSError
        The file cannot be written, or the process does not come up.
    """

    def __init__(
        self,
        path: str | Path,
        info: dict[str, Any],
        clock: Clock,
        *,
        versions: Callable[[], dict[str, Any]],
        files: Mapping[str, bytes],
        waits: bool,
        room_bytes: int = ROOM_BYTES,
    ) -> None:
        self.path = Path(path)
        self.tape = Tape()
        self._clock = clock
        self._cycles = CycleFrames()
        self._failure: OSError | None = None
        self._told = False  # whether the failure went out as an exception, which the controller passes on
        self._whole = self._closed = self._ready = False
        self._record_s = 0.0
        self.partial_path, stream = open_partial(self.path)
        with stream:
            nap_s = 0.0 if waits else NAP_S
            words = (str(stream.fileno()), str(self.path), str(self.partial_path), str(nap_s))
            self._process, end = spawn(
                "ori_deploy.telemetry.record_process",
                words,
                pass_fds=(stream.fileno(),),
                stdout=subprocess.DEVNULL,
            )
        self._sender = Sender(end, waits=waits, room_bytes=room_bytes)
        self._versions: Callable[[], dict[str, Any]] | None = versions
        self._begin(info, files)

    @property
    def pid(self) -> int:
        """Of the process that writes."""
        return self._process.pid

    def __call__(self, record: CycleRecord) -> None:
        """Pass on one cycle and all that happened in it. Raises OSError when the recorder is gone."""
        begun = perf_counter()
        tape = self.tape
        tape.decided(record)
        frame = self._cycles.frame(record)
        time_s = self._cycles.time_s
        decide_s = begun - tape.woke - tape.read_s - tape.send_s
        lateness_s = float(record.time_s - record.deadline_s)
        frame.append(("timing", time_s, lateness_s, tape.wait_s, tape.read_s, tape.send_s, decide_s, self._record_s))
        frame.append(("tape", time_s, tape.take()))
        if self._versions is not None:
            frame.append(message("/versions", time_s, self._versions()))
            self._versions = None
        self._send(frame)
        self._record_s = perf_counter() - begun

    def command(self, name: str, arguments: str, outcome: str, detail: str, state: str) -> None:
        """Note a command of the operator, and pass on what is on the tape. Never raises."""
        time_s = self._clock.now()
        content = {
            "time_s": time_s,
            "command": name,
            "arguments": arguments,
            "outcome": outcome,
            "detail": detail,
            "state": state,
        }
        frame = [message("/command", time_s, content)] if name else []
        self._try([*frame, ("tape", time_s, self.tape.take())])

    def write_result(self, result: MotionResult) -> None:
        """Write how a command ended. Never raises."""
        self._try([result_item(result, self._clock.now())])

    @property
    def problems(self) -> tuple[str, ...]:
        """What went wrong that the controller has not been told by an exception."""
        if not self._closed:
            self._listen()
        found = []
        if self._failure is not None and not self._told:
            found.append(f"flight recorder: {self._failure}")
        if self._sender.dropped:
            found.append(f"flight recorder: {self._sender.dropped} records dropped, it was too far behind")
        return tuple(found)

    def close(self) -> None:
        """Have the log finished, and wait for it, with a bound. Safe to call twice.

        Raises
        ------
        OSError
            The log is not whole; the message names the file that holds what was written.
        """
        if self._closed:
            return
        self._closed = True
        deadline = time.monotonic() + STOP_S
        try:
            if self._failure is None:
                self._last_words(deadline)
        finally:
            self._sender.close()
        try:
            self._process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:  # it is left alone: what it holds is evidence
            self._fail(self._slow())
        if self._failure is None and not self._whole:
            self._fail(self._death())
        if self._failure is not None:
            reason = str(self._failure.strerror or self._failure)
            if str(self.partial_path) not in reason:
                reason += f"; what was written is in {self.partial_path}"
            raise OSError(self._failure.errno, reason, str(self.path)) from self._failure

    # -- inside --------------------------------------------------------------------------------------

    def _begin(self, info: dict[str, Any], files: Mapping[str, bytes]) -> None:
        """Hand over what does not change, and wait until the process writes."""
        now = self._clock.now()
        frame = []
        for name, data in files.items():
            text = {"name": name, "sha256": sha256(data).hexdigest(), "text": data.decode()}
            frame.append(message("/file", now, text))
        deadline = time.monotonic() + START_S
        try:
            self._sender.send([("info", info)], urgent=True)
            if frame:
                self._sender.send(frame, urgent=True)
            while not self._ready:
                self._listen()
                if self._failure is not None or self._process.poll() is not None or time.monotonic() > deadline:
                    raise self._failure or BrokenPipeError
                self._sender.push()
                time.sleep(0.002)
        except OSError as error:
            failure = self._failure or self._death()
            self._process.kill()
            self._process.wait()
            self._sender.close()
            self.partial_path.unlink(missing_ok=True)
            raise failure from error

    def _try(self, frame: Frame) -> None:
        """Pass on what is rare and matters. A failure is kept for `problems` and `close`."""
        if self._failure is None and not self._closed:
            try:
                self._send(frame, urgent=True)
            except OSError:
                self._told = False

    def _send(self, frame: Frame, *, urgent: bool = False) -> None:
        try:
            self._sender.send(frame, urgent=urgent)
        except OSError as error:
            self._listen()
            self._fail(error if isinstance(error, TimeoutError) else self._death(0.0))
        else:
            self._listen()
        if self._failure is not None:
            self._told = True
            raise self._failure

    def _last_words(self, deadline: float) -> None:
        """Pass on the end, and hear how it went."""
        try:
            self._sender.send([("end",)], urgent=True)
            for frame in self._sender.finish(deadline):
                self._take(frame)
        except TimeoutError:
            self._fail(self._slow())
        except OSError:
            self._listen()
            self._fail(self._death())

    def _listen(self) -> None:
        for frame in self._sender.heard():
            self._take(frame)

    def _take(self, frame: Frame) -> None:
        for word in frame:
            if word[0] == "ready":
                self._ready = True
            elif word[0] == "whole":
                self._whole = True
            elif word[0] == "failed":
                self._fail(OSError(word[1], word[2]))

    def _fail(self, error: OSError) -> None:
        """The first failure stays, and nothing is taken down any more: a loop lives for hours after it."""
        self._failure = self._failure or error
        self.tape.stop()

    def _slow(self) -> OSError:
        return OSError(errno.ETIMEDOUT, f"process {self.pid} has not finished after {STOP_S:g} s; it may yet")

    def _death(self, patience_s: float = 1.0) -> OSError:
        """Why nobody listens; the system may still be burying it, and a loop does not wait for that."""
        try:
            status = self._process.wait(patience_s) if patience_s else self._process.poll()
        except subprocess.TimeoutExpired:
            status = None
        if status is None:
            return OSError(errno.EPIPE, f"process {self.pid} no longer listens")
        how = f"killed by signal {-status}" if status < 0 else f"status {status}"
        return OSError(errno.EPIPE, f"process {self.pid} ended before its time ({how})")
