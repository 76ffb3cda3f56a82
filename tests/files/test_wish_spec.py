"""`[optimize]` of a specification: read, refused, and turned into a wish."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ori_deploy.errors import FileError, InputError, LayoutError
from ori_deploy.files import Spec, load_spec
from ori_deploy.files.wish_spec import OptimizeSpec, PinSpec
from ori_deploy.search import Fixed, OnLine, Spar, Symmetric, Wish
from tests.search.cases import ELLIPSE
from tests.shapes import ring_on, wing

SPEC = """schema = "ori-deploy/spec/1"
[profile]
kind = "ellipse"
a_m = 1.0
b_m = 0.6
[structure]
span_m = 1.0
wall_m = 0.01
[layout]
ring = {{ cells = 6 }}
[optimize]
{keys}
"""


def loaded(folder: Path, keys: str) -> Spec:
    path = folder / "a.toml"
    path.write_text(SPEC.format(keys=keys))
    return load_spec(path)


def wish(folder: Path, keys: str) -> Wish:
    wanted = loaded(folder, keys).optimize
    assert wanted is not None
    return wanted.wish(ring_on(ELLIPSE, 6, phase=0.0))


def test_every_key_may_be_left_out(tmp_path: Path) -> None:
    assert wish(tmp_path, "") == Wish()
    assert OptimizeSpec().wish(None) == Wish()


def test_every_key_is_heard(tmp_path: Path) -> None:
    keys = 'objective = "box_ratio"\nmargin_rad = 0.1\npanel_m = 0.02\nsymmetric = "y"\nsymmetric_at_m = 0.0'
    heard = wish(tmp_path, keys)
    assert (heard.objective, heard.margin_rad, heard.panel_m) == ("box_ratio", 0.1, 0.02)
    (pin,) = heard.pins
    assert isinstance(pin, Symmetric)
    assert pin.axis == "y"
    assert wish(tmp_path, 'objective = "wall"\neta_at_least = 3.0').eta_at_least == 3.0
    assert wish(tmp_path, "").margin_rad == pytest.approx(np.radians(2.0))


def test_every_kind_of_pin(tmp_path: Path) -> None:
    keys = """pins = [
      { fixed = "P" },
      { fixed = "P", at_m = [0.1, -0.2] },
      { line = ["P", "O1"], through_m = [0.5, 0.25], direction = [0, 2] },
      { spar = ["O2", "P", "O5"] },
      { spar = ["O2", "P", "O5"], x_m = 0.3 },
    ]"""
    assert wish(tmp_path, keys).pins == (
        Fixed("P", 0j),  # where the specification has it, from every start
        Fixed("P", 0.1 - 0.2j),
        OnLine(("P", "O1"), 0.5 + 0.25j, 2.0j),
        Spar(("O2", "P", "O5")),
        Spar(("O2", "P", "O5"), 0.3),
    )


def test_pins_as_tables_of_their_own(tmp_path: Path) -> None:
    assert wish(tmp_path, '[[optimize.pins]]\nfixed = "P"\n[[optimize.pins]]\nfixed = "O1"').pins == (
        Fixed("P", 0j), Fixed("O1", 1.0 + 0j),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ('objective = "size"', ("objective", "eta", "box_ratio")),
        ("margin_rad = -0.1", ("margin_rad", "0")),
        ("margin_rad = 2.0", ("margin_rad", "1.57")),
        ("margin_rad = nan", ("margin_rad",)),
        ("margin_deg = 2.0", ("margin_deg",)),
        ("panel_m = -1.0", ("panel_m", "0")),
        ("panel_m = inf", ("panel_m",)),
        ("panel_m = nan", ("panel_m",)),
        ('objective = "wall"\neta_at_least = nan', ("eta_at_least",)),
        ('objective = "wall"\neta_at_least = inf', ("eta_at_least",)),
        ('panel_m = "1"', ("panel_m",)),
        ('symmetric = "z"', ("symmetric", "x")),
        ("spars = 1.5", ("spars",)),
        ("spars = -1", ("spars", "0")),
        ("pins = [{}]", ("fixed, line, spar", "none")),
        ('pins = [{ fixed = "P", spar = ["O1", "P", "O4"] }]', ("fixed, line, spar", "fixed, spar")),
        ('pins = [{ fixed = "P", x_m = 0.1 }]', ("x_m goes with spar",)),
        ('pins = [{ spar = ["O1", "P", "O4"], at_m = [0, 0] }]', ("at_m goes with fixed",)),
        ('pins = [{ fixed = "P", direction = [0, 1] }]', ("direction goes with line",)),
        ('pins = [{ line = ["P"] }]', ("through_m",)),
        ('pins = [{ line = ["P"], through_m = [0, 0] }]', ("direction",)),
        ('pins = [{ line = ["P"], through_m = [0, 0], direction = [0, 0] }]', ("not both zero",)),
        ("pins = [{ line = [], through_m = [0, 0], direction = [0, 1] }]", ("line",)),
        ('pins = [{ spar = ["O1"] }]', ("spar",)),
        ('pins = [{ fixed = "" }]', ("fixed",)),
        ('pins = [{ fixed = "P", at_m = [0.1, nan] }]', ("at_m",)),
        ('pins = [{ fixed = "P", at_m = [0.1] }]', ("at_m",)),
        ('objective = "wall"', ("eta_at_least",)),
        ("eta_at_least = 2.0", ("eta_at_least", "wall")),
        ('objective = "wall"\neta_at_least = 0.0', ("eta_at_least",)),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, keys: str, told: tuple[str, ...]) -> None:
    with pytest.raises(FileError) as wrong:
        loaded(tmp_path, keys)
    message = str(wrong.value)
    assert "a.toml" in message
    assert "optimize" in message
    assert "\n" not in message
    for part in told:
        assert part in message


def test_symmetry_of_what_is_not_symmetric(tmp_path: Path) -> None:
    wanted = loaded(tmp_path, 'symmetric = "x"').optimize
    assert wanted is not None
    with pytest.raises(LayoutError, match="not its own mirror image"):
        wanted.wish(wing().embedding)
    with pytest.raises(InputError):
        OptimizeSpec(symmetric="x", symmetric_at_m=0.3).wish(ring_on(ELLIPSE, 6, phase=0.0))


def test_a_pin_says_one_thing() -> None:
    assert PinSpec(fixed="P").pin() == Fixed("P")
