"""Programs nobody here wrote at the other end of a MAVLink link: started, told lines, waited for and ended."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import pytest

HERE = Path(__file__).parent
Kind = Literal["udpout", "udpin", "tcpout", "tcpin"]
MAVPROXY = Path(sys.executable).with_name("mavproxy.py")
WING = 140  # MAV_COMP_ID_SERVO1


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port of the loopback that nothing listens on just now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def needs(package: str, remedy: str) -> None:
    """Skip the test, and say what is not tested."""
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"NOT TESTED against {package}, which is missing: {remedy}")


class Program:
    """A program with lines in and lines out; for `with`, which ends it whatever happens."""

    def __init__(self, *words: str, home: Path | None = None) -> None:
        self._words = words
        self._own_home = home is None
        self._home = home if home is not None else Path(tempfile.mkdtemp(prefix="od-mav-"))
        self._lines: list[str] = []
        self._cursors = {"events": 0, "answers": 0}
        self._ended = False
        self._changed = threading.Condition()

    def __enter__(self) -> Self:
        self._errors = tempfile.TemporaryFile()  # apart: MAVSDK's log would tear the answers' lines
        self._process = subprocess.Popen(
            self._words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            bufsize=1,
            env=os.environ | {"PYTHONUNBUFFERED": "1", "HOME": str(self._home), "MPLBACKEND": "agg"},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self.started()
        except BaseException:
            self.end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.end()

    @property
    def pid(self) -> int:
        return self._process.pid

    def started(self) -> None:
        """Wait until it can be told something."""

    def send(self, line: str) -> None:
        """A line to its standard input."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def wait_for(self, pattern: str, within: float = 20.0) -> re.Match[str]:
        """The next line with this in it, after the last one that was waited for."""
        return self._wait("events", pattern, within)

    def seen(self, pattern: str) -> list[re.Match[str]]:
        """Every line so far with this in it."""
        with self._changed:
            return [found for line in self._lines if (found := re.search(pattern, line))]

    def story(self) -> str:
        """All it said, for whoever has to find out why."""
        said = os.pread(self._errors.fileno(), 1 << 20, 0).decode(
            errors="replace"
        )  # leaves the program's place alone
        return "it said:\n" + "\n".join(self._lines) + f"\nand on the error stream:\n{said}"

    def end(self) -> None:
        """The end of its input is its wish to go; killed where it does not."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(5.0)
        self._errors.close()
        if self._own_home:
            shutil.rmtree(self._home, ignore_errors=True)

    def clean(self, line: str) -> str:
        """A line without what is no part of it."""
        return line

    def _wait(self, reader: str, pattern: str, within: float) -> re.Match[str]:
        deadline = time.monotonic() + within
        with self._changed:
            while True:
                found = self._next(reader, pattern)
                if found is not None:
                    return found
                left = deadline - time.monotonic()
                if self._ended or left <= 0.0:
                    break
                self._changed.wait(left)
        raise AssertionError(f"no line with {pattern!r} from {self._words[1:2]}; {self.story()}")

    def _next(self, reader: str, pattern: str) -> re.Match[str] | None:
        for number in range(self._cursors[reader], len(self._lines)):
            if found := re.search(pattern, self._lines[number]):
                self._cursors[reader] = number + 1
                return found
        return None

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._changed:
                self._lines.append(self.clean(line.rstrip("\n")))
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()


class Told(Program):
    """A program that answers each line with `ok` or `error: why`."""

    def started(self) -> None:
        self.wait_for("^event ready")

    def tell(self, line: str, within: float = 20.0) -> str:
        """What it answered after `ok`; an event that came first is still there to be waited for."""
        self.send(line)
        answer = self._wait("answers", "^(ok|error:) ?(.*)", within)
        assert answer[1] == "ok", f"{line!r}: {answer[0]}"
        return answer[2]


class Autopilot(Told):
    """MAVSDK as the autopilot: on the ground and disarmed to begin with."""

    def __init__(self, port: int, kind: Kind = "udpout", *, period: float = 0.25) -> None:
        needs("mavsdk", "pip install 'mavsdk>=4.1,<5'")
        link = f"{kind}://127.0.0.1:{port}"
        super().__init__(sys.executable, str(HERE / "autopilot.py"), "--link", link, "--period", str(period))

    def armed(self, flag: bool) -> None:
        """Seen by others with the next heartbeat, up to a second later."""
        self.tell(f"armed {int(flag)}")

    def landed(self, state: Literal["unknown", "on_ground", "in_air", "taking_off", "landing", "none"]) -> None:
        """Sent at once, and every period from now on; `none` stops sending it."""
        self.tell(f"landed {state}")

    def silent(self) -> None:
        self.tell("silent")

    def speak(self) -> None:
        self.tell("speak")

    def authorize(self, component: int = WING) -> int:
        """The MAV_RESULT of a component that is asked for leave to arm."""
        self.tell(f"authorize {component}")
        in_progress = 5
        return int(
            self.wait_for(rf"^event ack component={component} command=3001 result=(?!{in_progress}\b)(\d+)")[1]
        )


class MavsdkStation(Told):
    """MAVSDK as a ground station; it starts only when something of system 1 is heard."""

    def __init__(self, port: int, kind: Kind = "udpout") -> None:
        needs("mavsdk", "pip install 'mavsdk>=4.1,<5'")
        super().__init__(sys.executable, str(HERE / "ground_station.py"), "--link", f"{kind}://127.0.0.1:{port}")

    def command(
        self, command: int, *params: float, component: int = WING, kind: Literal["long", "int"] = "long"
    ) -> None:
        """MAVSDK sends it again, with the same confirmation, while nothing acknowledges it: four times in 2 s."""
        self.tell(" ".join([kind, str(component), str(command), *(str(param) for param in params)]))

    def final(self, within: float = 30.0) -> int:
        """The MAV_RESULT that ended the last command; the `event ack` of the same may come before it or after."""
        return int(self.wait_for(r"^event final .*result=(\d+)", within)[1])


class MavProxy(Program):
    """MAVProxy without its windows; `long`, `param` and `set` are typed at its prompt."""

    MODULES = "cmdlong,param,link,signing"  # the rest ask an autopilot for missions, fences and logs

    def __init__(self, port: int, kind: Kind = "udpout", *, component: int = WING, system: int = 255) -> None:
        needs("MAVProxy", "pip install --no-deps MAVProxy (see the Makefile)")
        link = f"{kind.replace('tcpout', 'tcp')}:127.0.0.1:{port}"
        super().__init__(
            sys.executable,
            str(MAVPROXY),
            f"--master={link}",
            "--nowait",  # else it wants a heartbeat before it has sent one, and a listener waits for it
            "--no-state",
            f"--default-modules={self.MODULES}",
            f"--source-system={system}",
            "--target-system=1",
            f"--target-component={component}",
        )

    def started(self) -> None:
        """It asks for the parameters of what it hears."""
        self.wait_for("^Detected vehicle 1:")

    def command(self, command: int | str, *params: float) -> None:
        self.send(" ".join(["long", str(command), *(str(param) for param in params)]))

    def acknowledged(self, command: str = "USER_1", within: float = 20.0) -> str:
        """The result of the next COMMAND_ACK it shows, without MAV_RESULT_."""
        return self.wait_for(rf"Got COMMAND_ACK: {command}: (\w+)", within)[1]

    def parameters(self) -> int:
        """How many it has fetched, which it does by itself at first; before that it can neither show nor set any."""
        return int(self.wait_for(r"^Received (\d+) parameters")[1])

    def parameter(self, name: str) -> float:
        """What it holds for a parameter."""
        self.send(f"param show {name}")
        return float(self.wait_for(rf"^{name}\s+(\S+)")[1])

    def clean(self, line: str) -> str:
        """Its prompt ends no line of its own."""
        return re.sub("^(MAV> ?)+", "", line)
