"""What is told in words: on transitions only, and no more than a link and a pilot can take."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator

from ori_deploy.mav.words import Snapshot
from ori_deploy.wire.vehicle import dialect

CHUNK = 50
LONGEST = 4 * CHUNK
BURST = 5
PER_S = 1.0
WAITING = 8
"""Texts that wait for their turn; of more, only the number is told."""

_SAID = {
    dialect.ORI_STRUCTURE_DISCONNECTED: (dialect.MAV_SEVERITY_ERROR, "no link to the actuators"),
    dialect.ORI_STRUCTURE_MOVING: (dialect.MAV_SEVERITY_INFO, "moving"),
    dialect.ORI_STRUCTURE_DEPLOYED: (dialect.MAV_SEVERITY_NOTICE, "deployed and locked"),
    dialect.ORI_STRUCTURE_STOWED: (dialect.MAV_SEVERITY_NOTICE, "folded"),
    dialect.ORI_STRUCTURE_HOLD: (dialect.MAV_SEVERITY_WARNING, "held on its way"),
    dialect.ORI_STRUCTURE_STOPPING: (dialect.MAV_SEVERITY_WARNING, "stopping"),
    dialect.ORI_STRUCTURE_ARMED: (dialect.MAV_SEVERITY_INFO, "holding its place"),
}


class Texts:
    """STATUSTEXT for everybody.

    Parameters
    ----------
    send
        Sends a message to everybody.
    """

    def __init__(self, send: Callable[[dialect.MAVLink_message], None]) -> None:
        self._send = send
        self._waiting: deque[tuple[int, str]] = deque()
        self._room, self._filled_s = float(BURST), -math.inf
        self._left_out = 0
        self._id = 0
        self._state: int | None = None
        self._fault = ""

    def tell(self, severity: int, text: str) -> None:
        """Say something when there is room for it; the same thing twice in a row waits once."""
        said = (severity, f"ori: {text}")
        if self._waiting and self._waiting[-1] == said:
            return
        self._waiting.append(said)
        if len(self._waiting) > WAITING:  # the newest of the least severe goes: a fault is told, whatever else is
            self._left_out += 1
            worst = max(one[0] for one in self._waiting)
            at = max(k for k, one in enumerate(self._waiting) if one[0] == worst)
            del self._waiting[at]

    def snapshot(self, snapshot: Snapshot) -> None:
        """Tell what has changed since the last one."""
        if snapshot.fault and snapshot.fault != self._fault:
            self.tell(dialect.MAV_SEVERITY_CRITICAL, snapshot.fault_text)
        elif snapshot.state != self._state and self._state is not None and snapshot.state in _SAID:
            self.tell(*_SAID[snapshot.state])
        self._state, self._fault = snapshot.state, snapshot.fault

    def tick(self, now: float) -> None:
        """Send what there is room for."""
        self._room = min(BURST, self._room + max(now - self._filled_s, 0.0) * PER_S)
        self._filled_s = now
        while self._waiting and self._room >= 1.0:
            self._room -= 1.0
            severity, text = self._waiting.popleft()
            if self._left_out and not self._waiting:
                self._waiting.append((dialect.MAV_SEVERITY_INFO, f"ori: {self._left_out} messages left out"))
                self._left_out = 0
            for message in self._chunks(severity, text):
                self._send(message)

    def _chunks(self, severity: int, text: str) -> Iterator[dialect.MAVLink_message]:
        data = text.encode("ascii", "replace")[:LONGEST]
        if len(data) <= CHUNK:
            yield dialect.MAVLink_statustext_message(severity, data)
            return
        self._id = self._id % 65535 + 1
        for sequence, at in enumerate(range(0, len(data), CHUNK)):
            yield dialect.MAVLink_statustext_message(severity, data[at : at + CHUNK], self._id, sequence)
        if len(data) % CHUNK == 0:  # a text ends with a chunk that is not full
            yield dialect.MAVLink_statustext_message(severity, b"", self._id, len(data) // CHUNK)
