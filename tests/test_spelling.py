"""Somebody who misspells a word is told which one was meant."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter

from ori_deploy.actuators.rig import Rig
from ori_deploy.cli.schema import KINDS, model_of
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.files.spec import Spec
from ori_deploy.spelling import keys_beside, meant, near
from tests.cli.virtual import command

SPEC: dict[str, Any] = TypeAdapter(Spec).json_schema()


def test_keys_are_those_of_the_table_that_the_word_stands_in() -> None:
    assert keys_beside(SPEC, ("colour",)) == set(SPEC["properties"])
    inside = keys_beside(SPEC, ("structure", "span"))
    assert "span_m" in inside
    assert "profile" not in inside
    hinge = keys_beside(TypeAdapter(Rig).json_schema(), ("hinge", 2, "gear"))
    assert "gear_ratio" in hinge
    assert "rate_hz" not in hinge


def test_of_variants_only_the_one_that_was_chosen_counts() -> None:
    chosen = keys_beside(SPEC, ("profile", "naca", "cod"))
    assert "code" in chosen
    assert chosen < keys_beside(SPEC, ("profile", "cod"))


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_of_file_knows_its_keys(kind: str) -> None:
    schema = TypeAdapter(model_of(kind)).json_schema(by_alias=True)
    known = keys_beside(schema, ("nothing_like_it",))
    assert known == set(schema["properties"])
    for key in known:
        assert near(key[:-1] + "_" if len(key) > 4 else key, known)[0] == key


def test_a_key_like_no_other_is_answered_with_those_there_are() -> None:
    known = keys_beside(PartsSpec.model_json_schema(), ("film", "zzz"))
    assert "thickness_um" in meant("zzz", known)
    assert "did you mean thickness_um?" in meant("thicknes_um", known)
    assert meant("zzz", ()) == meant("zzz", (f"key_{i}" for i in range(99)))


@pytest.mark.parametrize(
    ("words", "told"),
    [(("deplyo",), "deploy"), (("bus", "scn"), "scan"), (("mcu", "moniter"), "monitor")],
)
def test_a_misspelt_command_names_the_right_one(words: tuple[str, ...], told: str) -> None:
    result = command(*words)
    assert result.exit_code == 2
    assert f"did you mean {told}" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_command_like_no_other_is_only_refused() -> None:
    result = command("qqqqqq")
    assert result.exit_code == 2
    assert "did you mean" not in result.stderr
