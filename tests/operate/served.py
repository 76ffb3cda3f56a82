"""A controller on a virtual clock with an operator's socket, and clients that behave or do not."""

from __future__ import annotations

import gc
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ori_deploy.operate.desk import Desk, Session
from ori_deploy.operate.server import OperatorSocket
from tests.deploy.synthetic import Bench, bench

SESSION = Session(Path("/somewhere/wing.plan.json"), Path("/somewhere/rig.toml"), None)


@dataclass
class Served:
    """The loop is stepped by hand: nothing here waits."""

    bench: Bench
    desk: Desk
    socket: OperatorSocket

    def cycles(self, count: int = 1) -> int:
        """Do so many; returns how many the controller counts."""
        for _ in range(count):
            self.socket.poll()
            self.bench.controller.step()
        return self.bench.records[-1].index + 1

    def ask(self, do: str, **more: Any) -> dict[str, Any]:
        """One request over a connection of its own, answered in one cycle."""
        with Client(self.socket.path) as client:
            client.send({"do": do, **more})
            self.cycles()
            return client.answer()


@contextmanager
def served(made: Bench | None = None) -> Iterator[Served]:
    """A controller, armed."""
    b = bench() if made is None else made
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now())
    b.controller.add_observer(desk)
    with OperatorSocket(desk) as opened:
        yield Served(b, desk, opened)


class Client:
    """A connection."""

    def __init__(self, path: Path) -> None:
        self.link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.link.settimeout(10.0)
        self.link.connect(str(path))
        self.link.setblocking(False)  # no test waits for a loop that it steps itself
        self._heard = b""

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def send(self, request: dict[str, Any] | bytes) -> None:
        self.link.sendall(request if isinstance(request, bytes) else json.dumps(request).encode() + b"\n")

    def answer(self) -> dict[str, Any]:
        """What has been sent already."""
        while b"\n" not in self._heard:
            data = self.link.recv(1 << 16)
            if not data:
                raise EOFError
            self._heard += data
        line, _, self._heard = self._heard.partition(b"\n")
        document: dict[str, Any] = json.loads(line)
        return document

    @property
    def dropped(self) -> bool:
        """Whether the other side has closed it; what it said before is thrown away."""
        try:
            while self.link.recv(1 << 16):
                pass
        except BlockingIOError:
            return False
        except ConnectionResetError:
            pass
        return True


def descriptors() -> int:
    """Open file descriptors of this process."""
    gc.collect()
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208
