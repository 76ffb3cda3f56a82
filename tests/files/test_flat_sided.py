"""Flat-sided shapes come out alike at every angle: the same refusal, or a file that is read again."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from ori_deploy.errors import InputError
from ori_deploy.files import Design, load_design, save_design
from tests.design.turned import Kind, flat_sided

PHASES = (0.0, 0.5, 0.2)
"""Openings on corners, in the middle of sides, and between, where some panels are flat and others are not."""


def outcome(kind: Kind, sides: int, turn_rad: float, phase: float, wall: float, away: float = 0.0) -> Any:
    """What is refused, without its numbers; or areas, as they are read again."""
    try:
        structure = flat_sided(kind, sides, turn_rad, phase, wall, away)
    except InputError as refused:
        return str(refused).split("; found")[0]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "made.design.json"
        save_design(Design("turned", 0.3, structure, r_min_m=0.1 if kind == "cone" else 0.0), path)
        told = [panel["area"] for panel in json.loads(path.read_text())["panels"]]
        read = load_design(path).structure.panel_areas
    np.testing.assert_allclose(read, told, rtol=0.0, atol=1e-12)
    return read


@cache
def unturned(kind: Kind, sides: int, phase: float, wall: float) -> Any:
    return outcome(kind, sides, 0.0, phase, wall)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("wall", [0.0, 0.004])
@pytest.mark.parametrize(
    ("kind", "sides"),
    [("cylinder", 3), ("cylinder", 4), *(pytest.param("cone", k, marks=pytest.mark.slow) for k in (3, 4))],
)
@settings(max_examples=6, phases=(Phase.explicit, Phase.generate))
@example(turn_rad=0.3, away=0.0)
@given(turn_rad=st.floats(0.0, 2.0 * np.pi), away=st.sampled_from([0.0, 1.0, 40.0]))
def test_outcomes_do_not_depend_on_the_angle(
    kind: Kind, sides: int, wall: float, phase: float, turn_rad: float, away: float
) -> None:
    plain, turned = unturned(kind, sides, phase, wall), outcome(kind, sides, turn_rad, phase, wall, away)
    if isinstance(plain, str):
        assert turned == plain
        return
    assert not isinstance(turned, str), turned
    assert turned.min() >= 0.0
    np.testing.assert_array_equal(turned == 0.0, plain == 0.0)
    np.testing.assert_allclose(turned, plain, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("kind", ["cylinder", "cone"])
def test_both_outcomes_are_seen(kind: Kind) -> None:
    """Neither all are refused nor all made, and of those made some have panels without area."""
    refused = outcome(kind, 4, 0.3, 0.5, 0.0)
    assert isinstance(refused, str)
    assert "no panel has any thickness" in refused
    made = outcome(kind, 4, 0.3, 0.2, 0.0)
    assert (made == 0.0).sum() == 8
    assert (made > 1e-3).sum() == 8
