"""docs/parts.md says what `ori-deploy export` does: its options, and the parts file key by key."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from ori_deploy.cli.export import export
from ori_deploy.export.films import FREE_THICKNESSES
from ori_deploy.export.parts_spec import PartsSpec, load_parts_spec

PAGE = (Path(__file__).parents[1] / "docs" / "parts.md").read_text()


def test_the_parts_file_on_the_page_has_every_key_with_its_default(tmp_path: Path) -> None:
    block = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    (tmp_path / "parts.toml").write_text(block.group(1))
    assert load_parts_spec(tmp_path / "parts.toml") == PartsSpec()
    written = json.loads(json.dumps(tomllib.loads(block.group(1))))
    assert written == json.loads(PartsSpec().model_dump_json(by_alias=True))


def test_the_page_and_the_command_know_the_same_options() -> None:
    known = {name for option in export.params for name in option.opts if name.startswith("--")}
    assert known == set(re.findall(r"--\w+", PAGE))


def test_the_free_length_is_the_page_s() -> None:
    words = "1 mm on either side of the crease stays free, ten thicknesses"
    assert words in " ".join(PAGE.split())
    assert 0.5 * FREE_THICKNESSES * 1e-3 * PartsSpec().film.thickness_um == pytest.approx(1.0)
