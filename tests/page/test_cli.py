"""`view` and `--view` from the command line, as far as no browser is needed."""

from __future__ import annotations

import os
import signal
import socket
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from websockets.sync.client import connect

from ori_deploy.cli import main, viewing
from ori_deploy.errors import InputError
from ori_deploy.page.door import Door
from ori_deploy.page.listening import PORT, listening
from ori_deploy.page.sources import source_of
from tests.page.browser import Command, page_process
from tests.page.conftest import RIG

pytestmark = pytest.mark.usefixtures("runtime_folder")


def words(*told: object) -> list[str]:
    return [str(word) for word in told]


@contextmanager
def taken(port: int = 0) -> Iterator[int]:
    """A port that another program listens on."""
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", port))
        other.listen()
        yield other.getsockname()[1]


@pytest.mark.slow
def test_other_machines_are_let_in_on_purpose_only(made: Path) -> None:
    refused = CliRunner().invoke(main, words("view", made / "wing.design.json", "--host", "0.0.0.0"))
    assert refused.exit_code == 2
    assert "--beyond-loopback" in refused.stderr


def test_an_address_that_is_not_this_machine_s_is_refused(made: Path) -> None:
    line = words("view", made / "wing.design.json", "--host", "192.0.2.1", "--beyond-loopback")
    refused = CliRunner().invoke(main, line)
    assert refused.exit_code == 2
    assert "cannot listen there" in refused.stderr


def test_without_viser_there_is_one_line_that_names_the_extra(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewing, "find_spec", lambda _: None)
    for line in (("view", made / "wing.design.json"), ("deploy", made / "wing.plan.json", "--rig", RIG, "--view")):
        refused = CliRunner().invoke(main, words(*line))
        assert refused.exit_code == 2
        assert "pip install -e '.[view]'" in refused.stderr
        assert refused.stderr.count("\n") == 1


def test_a_page_that_cannot_be_made_stops_the_command_before_anything_moves(made: Path, tmp_path: Path) -> None:
    alone = tmp_path / "wing.plan.json"
    alone.write_bytes((made / "wing.plan.json").read_bytes())
    refused = CliRunner().invoke(main, words("deploy", alone, "--rig", RIG, "--view", "--view-port", 0))
    assert refused.exit_code == 2
    assert "--design" in refused.stderr
    assert "moving" not in refused.output


def test_a_file_of_another_kind_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("{}")
    refused = CliRunner().invoke(main, words("view", tmp_path / "x.json"))
    assert refused.exit_code == 2
    assert "nothing to show" in refused.stderr


def test_a_design_beside_another_design_is_refused(made: Path) -> None:
    """Reproduced: `view A --design B` showed A and said nothing."""
    shown, other = made / "wing.design.json", made / "cone.design.json"
    with pytest.raises(InputError):
        source_of(shown, other)
    line = words("view", shown, "--design", other, "--port", 0)
    refused = CliRunner().invoke(main, line)
    assert refused.exit_code == 2
    assert "error: --design: " in refused.stderr
    assert "cone.design.json" in refused.stderr
    assert "plan" in refused.stderr
    assert "leave --design out" in refused.stderr


def test_a_port_that_is_named_and_in_use_is_refused_in_the_words_of_the_command(made: Path) -> None:
    with taken() as port:
        viewed = CliRunner().invoke(main, words("view", made / "wing.design.json", "--port", port))
        line = ("deploy", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", port)
        deployed = CliRunner().invoke(main, words(*line))
    for refused, option in ((viewed, "--port"), (deployed, "--view-port")):
        assert refused.exit_code == 2
        assert f"error: {option}: the port is in use; found {port}" in refused.stderr
        assert refused.stderr.count("\n") == 1
    assert "moving" not in deployed.output


def test_a_port_beyond_the_last_is_not_tried() -> None:
    with taken(65535), pytest.raises(InputError, match="in use"):
        listening("127.0.0.1", 65535)


def test_only_the_usual_port_moves_on_and_that_is_told() -> None:
    try:
        with listening("127.0.0.1", PORT), listening("127.0.0.1", None) as moved:
            port = moved.getsockname()[1]
    except InputError:
        pytest.skip("the usual ports are all in use here")
    assert PORT < port < PORT + 20
    told = viewing.moved_on(None, f"http://127.0.0.1:{port}/secret")
    assert told is not None
    assert f"on {port}" in told
    assert viewing.moved_on(port, f"http://127.0.0.1:{port}/secret") is None
    assert viewing.moved_on(None, f"http://127.0.0.1:{PORT}/secret") is None


def test_refusals_name_the_option_of_their_command(made: Path) -> None:
    line = ("deploy", made / "wing.plan.json", "--rig", RIG, "--view", "--view-host")
    refused = CliRunner().invoke(main, words(*line, "0.0.0.0"))
    assert refused.stderr.startswith("error: --view-host: ")
    assert "--beyond-loopback" in refused.stderr
    refused = CliRunner().invoke(main, words(*line, "192.0.2.1", "--beyond-loopback"))
    assert refused.stderr.startswith("error: --view-host: cannot listen there")


@pytest.mark.slow
@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
def test_a_host_may_have_the_brackets_of_an_address(made: Path, tmp_path: Path) -> None:
    line = ("view", made / "wing.design.json", "--port", 0, "--host", "[::1]")
    with Command(*line, cwd=tmp_path) as page, urllib.request.urlopen(page.address) as answer:
        assert page.address.startswith("http://[::1]:")
        assert answer.status == 200


def test_what_no_browser_would_ask_is_refused() -> None:
    door = Door("secret", "127.0.0.1")
    assert door.refuses("/secret", "127.0.0.1:8080", None) is None
    assert door.refuses("/secret/operate?x=1", "127.0.0.1:8080", "http://127.0.0.1:8080") is None
    for path, host, origin in (
        ("//[", "127.0.0.1", None),
        ("/secret", "[", None),
        ("/secret", "127.0.0.1", "http://["),
        ("/\udcff", "127.0.0.1", None),
        ("//secret.example/secret", "127.0.0.1", None),
    ):
        assert door.refuses(path, host, origin) is not None


def test_an_old_viser_or_shapely_is_named(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, old in (("viser", "1.0.9"), ("viser", "2.0.0"), ("shapely", "2.0.7")):
        with monkeypatch.context() as patch:
            patch.setattr(viewing, "version", lambda what, n=name, o=old: o if what == n else version(what))
            refused = CliRunner().invoke(main, words("view", made / "wing.design.json"))
        assert refused.exit_code == 2
        assert f"this {name}; found {old}" in refused.stderr


@pytest.mark.slow
def test_a_page_that_lingers_can_be_ended(made: Path, tmp_path: Path) -> None:
    line = ("serve", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*line, cwd=tmp_path) as served:
        page = page_process(served)
        with connect(served.address.replace("http", "ws") + "/operate") as somebody_looks:
            somebody_looks.recv(20.0)
            served.process.send_signal(signal.SIGINT)
            served.process.wait(20.0)
            os.kill(page, 0)  # it is there still
            os.kill(page, signal.SIGTERM)
            gone = time.monotonic() + 10.0
            while Path(f"/proc/{page}").exists() and time.monotonic() < gone:
                time.sleep(0.05)
            assert not Path(f"/proc/{page}").exists()


@pytest.mark.slow
@pytest.mark.parametrize("begun", [signal.default_int_handler, signal.SIG_IGN])
def test_a_page_that_stays_after_a_motion_ends_as_it_says(made: Path, tmp_path: Path, begun: Any) -> None:
    """Reproduced: behind `&` a shell has interrupts ignored, and `kill -INT` did not end it."""
    before = signal.signal(signal.SIGINT, begun)
    try:
        line = ("deploy", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
        command = Command(*line, cwd=tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    with command as deployed:
        deployed.said(r"(stays until Ctrl-C)")
        deployed.process.send_signal(signal.SIGINT)
        assert deployed.process.wait(20.0) == 0
