"""`python -m ori_deploy.page FD WORDS`: the page of the controller that started it, in a process of its own.

WORDS is a JSON object. The first line on FD is the page's address, or why there is none. The page outlives its
controller for as long as somebody looks at it, so that how it ended can be seen; and not for long without.
"""

from __future__ import annotations

import json
import logging
import select
import signal
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any

from ori_deploy.errors import OriDeployError
from ori_deploy.files import load_plan
from ori_deploy.operate.places import socket_path
from ori_deploy.page.channel import Channel
from ori_deploy.page.door import Door
from ori_deploy.page.line import Lines
from ori_deploy.page.listening import listening
from ori_deploy.page.live import Live
from ori_deploy.page.process import Process
from ori_deploy.page.site import serve
from ori_deploy.page.sources import design_with
from ori_deploy.runtime_dir import runtime_dir

_LINGERS_S = 600.0
_DESERTED_S = 20.0
"""Without a browser for so long nobody looks: one that loads the page again, or whose network is gone, comes back."""
_LOOK_S = 0.2
_TURN_S = 1e-3
"""How long one thread may keep the others waiting: a stop comes in by one, and poses are worked out in another."""


def main(words: list[str]) -> int:
    """Serve until the controller has ended and nobody looks any more."""
    logging.basicConfig(level=logging.CRITICAL)
    end = socket.socket(fileno=int(words[0]))
    how: dict[str, Any] = json.loads(words[1])
    # Born deaf, as all that a controller starts: but a page that lingers must be possible to end.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    sys.setswitchinterval(_TURN_S)
    try:
        channel, live, address = _page(how)
    except (OriDeployError, OSError) as wrong:
        end.sendall(json.dumps({"error": str(wrong)}).encode() + b"\n")
        return 1
    threading.Thread(target=live.run, daemon=True).start()
    end.sendall(json.dumps({"address": address}).encode() + b"\n")
    _until_over(end, channel)
    return 0


def _page(how: dict[str, Any]) -> tuple[Channel, Live, str]:
    plan_path = Path(how["plan"])
    plan = load_plan(plan_path)
    design = design_with(plan.design_sha256, plan_path, None if how["design"] is None else Path(how["design"]))
    door = Door.on(how["host"], beyond_loopback=how["beyond_loopback"], option="--view-host")
    pid = int(how["pid"])
    lines = Lines(socket_path(runtime_dir(), pid), Process.of(pid))
    channel = Channel(lines)
    ear = listening(door.host, how["port"], ("--view-host", "--view-port"))
    server = serve(door, ear, design.name, channel)
    return channel, Live(server, lines, channel, design, plan), door.address(server.get_port())


def _until_over(end: socket.socket, channel: Channel) -> None:
    """Until the starter is gone; then for as long as somebody looks, with a bound. A word from it ends it at once."""
    now = looked_s = time.monotonic()
    deadline = None
    while deadline is None or (now < deadline and now - looked_s < _DESERTED_S):
        if deadline is not None:
            time.sleep(_LOOK_S)
        elif select.select([end], [], [], _LOOK_S)[0]:
            if end.recv(1):
                return
            deadline = time.monotonic() + _LINGERS_S
        now = time.monotonic()
        if channel.browsers:
            looked_s = now


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
