"""`view` and `--view` from the command line, as far as no browser is needed."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from ori_deploy.cli import main, viewing
from tests.page.conftest import RIG

pytestmark = pytest.mark.usefixtures("runtime_folder")


def words(*told: object) -> list[str]:
    return [str(word) for word in told]


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
        assert "ori-deploy[view]" in refused.stderr
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
