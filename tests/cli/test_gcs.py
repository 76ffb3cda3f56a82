"""`ori-deploy gcs ...` against a component that serves in a process of its own."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result as Done

from ori_deploy.mav.ground import Result, Verdict
from ori_deploy.mav.interlock import ON_GROUND
from tests.cli.serving import Autopilot, Served, quick_plan, serving
from tests.cli.virtual import command, document, is_one_line
from tests.mav.stations import free_port
from tests.mav.world import IN_AIR


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A component that all tests here command in turn; each leaves it where it found it."""
    folder = tmp_path_factory.mktemp("gcs")
    with pytest.MonkeyPatch.context() as patched, tempfile.TemporaryDirectory(prefix="od-") as short:
        patched.setenv("XDG_RUNTIME_DIR", short)
        with serving(quick_plan(folder), folder) as made:
            yield made


def gcs(served: Served, *words: object) -> Done:
    return command("gcs", *words, "--link", served.link)


def ended(done: Done, status: int, words: str) -> None:
    """That a command ended so, and said so in its last line."""
    said = (done.stdout if status == 0 else done.stderr).splitlines()
    assert (done.exit_code, said[-1:]) == (status, [words]), done.output


@pytest.mark.slow
def test_what_nobody_vouches_for_is_refused(served: Served) -> None:
    told = document(gcs(served, "status", "--json"))
    assert (told["state"], told["locked"], told["may_fold"], told["may_deploy"]) == ("ready", False, False, False)
    assert told["fold"] is None  # nothing is powered: nobody commands a place
    assert "not known" in gcs(served, "status").stdout
    ended(gcs(served, "deploy"), 3, "error: temporarily rejected: arming unknown")
    ended(gcs(served, "fold"), 3, "error: temporarily rejected: landed unknown")
    ended(gcs(served, "fold", "--force"), 3, "error: denied: force not allowed")
    ended(gcs(served, "deploy", "--system", 7), 3, "error: denied: not listed")
    assert document(gcs(served, "status", "--json"))["state"] == "ready"


@pytest.mark.slow
def test_deployed_refused_in_the_air_and_folded_on_the_ground(served: Served) -> None:
    with Autopilot(served.port) as autopilot:
        served.until(lambda told: told.may_fold and told.may_deploy)
        done = gcs(served, "deploy")
        ended(done, 0, "accepted")
        percents = [int(line.removesuffix(" %")) for line in done.stdout.splitlines()[:-1]]
        assert len(percents) > 1
        assert percents == sorted(percents)
        told = document(gcs(served, "status", "--json"))
        assert (told["state"], told["locked"], told["latches_confirmed"]) == ("deployed", True, 2)
        ended(gcs(served, "deploy"), 0, "accepted")  # it is there already
        autopilot.landed = IN_AIR
        served.until(lambda told: not told.may_fold)
        ended(gcs(served, "fold"), 3, "error: temporarily rejected: airborne")
        assert document(gcs(served, "status", "--json"))["state"] == "deployed"
        autopilot.landed, autopilot.armed = ON_GROUND, True
        served.until(lambda told: not told.may_deploy)
        done = gcs(served, "fold", "--json")
        assert (done.exit_code, json.loads(done.stdout)) == (3, {"result": "temporarily_rejected", "reason": "armed"})
        autopilot.armed = False
        served.until(lambda told: told.may_fold)
        assert document(gcs(served, "fold", "--json")) == {"result": "accepted", "reason": "none"}
        assert document(gcs(served, "status", "--json"))["state"] == "stowed"
    ended(gcs(served, "stop"), 0, "accepted: nothing to do")
    ended(gcs(served, "clear-fault"), 0, "accepted: nothing to do")


def test_parameters_are_listed_set_and_bounded(served: Served) -> None:
    listed = gcs(served, "params").stdout
    for name in ("ORI_SPEED", "ORI_LINK_LOSS", "ORI_LINK_TMO", "ORI_DEPLOY_WHEN", "ORI_TLM_HZ", "ORI_NAMED_VAL"):
        assert name in listed
    ended(gcs(served, "params", "ORI_TLM_HZ=10"), 0, "ORI_TLM_HZ = 10")
    refused = gcs(served, "params", "ORI_TLM_HZ=100")
    assert refused.stdout == "ORI_TLM_HZ = 10\n"
    is_one_line(refused, "ORI_TLM_HZ: 100 was refused")
    is_one_line(gcs(served, "params", "ORI_NONE=1"), "ORI_NONE: the structure has no such parameter")
    wrong = gcs(served, "params", "ORI_TLM_HZ=fast")
    assert wrong.exit_code == 2
    is_one_line(wrong, "not a change", "NAME=VALUE")


@pytest.mark.slow
def test_the_monitor_tells_line_by_line_for_so_long(served: Served) -> None:
    lines = gcs(served, "monitor", "--seconds", 1).stdout.splitlines()
    assert lines
    assert all("latches" in line or "ori: " in line for line in lines)
    documents: list[dict[str, Any]] = [
        json.loads(line) for line in gcs(served, "monitor", "--seconds", 1, "--json").stdout.splitlines()
    ]
    assert any("state" in one for one in documents)


@pytest.mark.slow
def test_an_address_without_a_structure_is_told_from_one_that_cannot_be(tmp_path: Path) -> None:
    nobody = f"udpout:127.0.0.1:{free_port()}"
    done = command("gcs", "status", "--link", nobody)
    assert done.exit_code == 1
    is_one_line(done, "system 1 component 140 is not heard", nobody, "ori-deploy serve")
    done = command("gcs", "monitor", "--seconds", 0.2, "--link", nobody)
    assert done.exit_code == 1
    is_one_line(done, "nothing was heard")
    for link, words in (("carrier:pigeon", "not a link"), ("udpin:0.0.0.0:14560", "--beyond-loopback")):
        done = command("gcs", "status", "--link", link)
        assert done.exit_code == 2
        is_one_line(done, words)
    readable = tmp_path / "key"
    readable.write_text("passphrase: open sesame")
    readable.chmod(0o644)
    done = command("gcs", "status", "--key", readable)
    assert done.exit_code == 2
    is_one_line(done, "others may read the signing key", "chmod 600")
    assert "sesame" not in done.output


def test_a_refusal_of_the_controller_moved_nothing() -> None:
    assert Verdict(Result.FAILED, "refused").refused
    assert not Verdict(Result.FAILED, "fault").refused  # that may have been in the middle
    assert not Verdict(Result.CANCELLED, "stopped").refused


@pytest.mark.slow
@pytest.mark.usefixtures("runtime_folder")
def test_only_who_has_the_key_is_heard(tmp_path: Path) -> None:
    for name, phrase in (("right", "open sesame"), ("wrong", "open barley")):
        (tmp_path / name).touch(mode=0o600)
        (tmp_path / name).write_text(f"passphrase:{phrase}\n")
    with serving(quick_plan(tmp_path), tmp_path, key_file="right", deploy_when="always") as served:
        ended(gcs(served, "deploy", "--key", tmp_path / "right"), 0, "accepted")
        for words in ((), ("--key", tmp_path / "wrong")):
            assert gcs(served, "stop", *words).exit_code == 1
        assert document(gcs(served, "status", "--json", "--key", tmp_path / "right"))["state"] == "deployed"
