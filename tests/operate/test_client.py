"""Which controller is meant, and what is said when it is not clear."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ori_deploy import runtime_dir
from ori_deploy.deploy.states import State
from ori_deploy.operate import client
from ori_deploy.operate.client import Found, NoController, NotAnswering, ask, find
from ori_deploy.operate.messages import Answer, Do, Request, answer_line
from ori_deploy.operate.places import socket_path
from tests.operate.served import served
from tests.operate.test_messages import STATUS


@contextmanager
def controller(runtime_folder: Path, pid: int, *lines: bytes) -> Iterator[Found]:
    """Something that listens as a controller does, and says these lines to everybody who asks."""
    path = socket_path(runtime_folder, pid)
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()

    def serve() -> None:
        while True:
            try:
                link, _ = listener.accept()
            except OSError:
                return
            with link:
                if link.recv(1000):
                    link.sendall(b"".join(lines))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield Found(pid, path)
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        path.unlink()
        thread.join()


def tells(pid: int, *ports: str) -> bytes:
    data = {**{name: getattr(STATUS, name) for name in STATUS.__dataclass_fields__}, "pid": pid, "ports": ports}
    return answer_line(Answer(True, STATUS.state, status=type(STATUS)(**data)))


@pytest.fixture
def made(runtime_folder: Path) -> Path:
    runtime_folder.mkdir(mode=0o700)
    return runtime_folder


def test_without_a_controller_the_remedy_is_to_start_one(runtime_folder: Path) -> None:
    with pytest.raises(NoController, match=r"no controller is running.*remedy: start one"):
        find()
    assert not runtime_folder.exists()  # who only looks makes nothing


def test_the_only_one_needs_no_option(made: Path) -> None:
    with controller(made, 1, tells(1)) as one:
        assert find() == one
        assert find(pid=1) == one
        with pytest.raises(NoController, match=r"no such controller.*pid 1 \(wing.plan.json, no port, moving\)"):
            find(pid=2)


def test_among_several_pid_or_port_chooses_and_the_error_lists_them(made: Path) -> None:
    device = made / "ttyDXL"
    device.touch()
    link = made / "link"
    link.symlink_to(device)
    with controller(made, 1, tells(1, str(device))) as one, controller(made, os.getpid(), tells(2, "/dev/b")) as two:
        with pytest.raises(NoController) as several:
            find()
        for part in ("more than one", f"pid 1 (wing.plan.json, {device}, moving)", "/dev/b", "--pid or --port"):
            assert part in str(several.value)
        assert find(port=str(link)) == one
        assert find(port="/dev/b") == two
        assert find(pid=os.getpid()) == two


def test_silence_is_told_with_what_helps(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "PATIENCE_S", 0.05)
    with socket.socket(socket.AF_UNIX) as deaf:
        path = socket_path(made, 1)
        deaf.bind(str(path))
        deaf.listen()
        with pytest.raises(NotAnswering, match="kill -INT 1"):
            list(ask(Found(1, path), Request(Do.STOP)))


@pytest.mark.parametrize(
    ("lines", "says"),
    [((), "ended without an answer"), ((b'{"took": tr',), "ended without"), ((b'{"yes": 1}\n',), "same version")],
)
def test_an_end_or_another_version_is_found_out(made: Path, lines: tuple[bytes, ...], says: str) -> None:
    with controller(made, 1, *lines) as one, pytest.raises(NotAnswering, match=says):
        list(ask(one, Request(Do.STOP)))


def test_an_end_before_rest_is_found_out(made: Path) -> None:
    with controller(made, 1, tells(1)) as one:
        answers = ask(one, Request(Do.STOP, wait=True))
        assert next(answers).took
        with pytest.raises(NotAnswering, match="see its terminal"):
            next(answers)


def _serve_as_nobody(ready: int) -> None:
    """A session of user 65534: deploys, and ends when it was stopped."""
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
    with served() as s:
        s.bench.controller.deploy()
        s.cycles(50)
        os.write(ready, b"x")
        s.bench.controller.hold()
        while s.bench.controller.state is not State.ARMED:  # held and waiting for whoever may command it
            s.cycles()
            time.sleep(0.001)


def test_root_commands_another_user_s_controller_by_its_pid(runtime_folder: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("NOT TESTED: commanding another user's controller needs root")
    runtime_folder.parent.chmod(0o755)
    runtime_dir.FALLBACK.mkdir()
    runtime_dir.FALLBACK.chmod(0o1777)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:  # no exception may leave this branch, or pytest runs twice
        status = 1
        try:
            _serve_as_nobody(write)
            status = 0
        finally:
            os._exit(status)
    os.read(read, 1)
    with pytest.raises(NoController, match="root names another user's with --pid"):
        find()
    answers = list(ask(find(pid=child), Request(Do.STOP, wait=True)))
    assert [answer.state for answer in answers] == [State.STOPPING, State.ARMED]
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    os.close(read)
    os.close(write)
