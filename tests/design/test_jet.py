"""Jets: every rule against differences, and mixed with plain numbers on either side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.design.jet import Jet, select, stacked, value_of

N_VARIABLES = 3
A = np.array([[0.7, -1.3, 0.2], [0.4, 0.9, -0.6]])
B = np.array([[0.3, 0.5, -0.8], [1.1, -0.2, 0.7]])


def real(x: Any) -> Any:
    """Two real jets' worth of variables: (2,) values, each mixing all variables."""
    return 1.6 + A[:, 0] * x[0] + A[:, 1] * x[1] * x[2] + A[:, 2] * x[2]


def plane(x: Any) -> Any:
    """(2,) complex values."""
    return (0.4 + 1.1j) + B[:, 0] * x[0] * x[1] + 1j * B[:, 1] * x[1] + (B[:, 2] - 0.5j) * x[2]


def seeded(x: np.ndarray[Any, Any]) -> list[Jet]:
    """The variables as jets of shape (1,)."""
    return [Jet(np.array([v]), np.eye(N_VARIABLES)[None, k]) for k, v in enumerate(x)]


CASES: dict[str, Callable[[Any], Any]] = {
    "sum of both": lambda x: real(x) + real(x) * 2.0,
    "number before": lambda x: 3.0 + real(x),
    "number less": lambda x: 3.0 - real(x),
    "less number": lambda x: real(x) - 3.0,
    "array before": lambda x: np.array([1.0, 2.0]) * real(x),
    "array less": lambda x: np.array([1.0, 2.0]) - real(x),
    "array over": lambda x: np.array([1.0, 2.0]) / real(x),
    "over array": lambda x: real(x) / np.array([1.0, 2.0]),
    "product": lambda x: real(x) * plane(x),
    "quotient": lambda x: plane(x) / real(x),
    "negative": lambda x: -plane(x),
    "conjugate": lambda x: np.conj(plane(x)) * plane(x),
    "absolute": lambda x: np.abs(plane(x)),
    "absolute of a negative": lambda x: np.abs(-real(x)),
    "angle": lambda x: np.angle(plane(x)),
    "sin": lambda x: np.sin(real(x)),
    "cos": lambda x: np.cos(real(x)),
    "tan": lambda x: np.tan(0.2 * real(x)),
    "sqrt": lambda x: np.sqrt(real(x)),
    "log": lambda x: np.log(real(x)),
    "arctan2": lambda x: np.arctan2(plane(x).imag, real(x)),
    "arctan2 of a number": lambda x: np.arctan2(np.array([0.3, 0.4]), real(x)),
    "arctan2 over a number": lambda x: np.arctan2(real(x), np.array([0.3, 0.4])),
    "hypot": lambda x: np.hypot(real(x), plane(x).imag),
    "hypot with a number": lambda x: np.hypot(real(x), 0.5),
    "real part": lambda x: plane(x).real,
    "roll": lambda x: np.roll(plane(x), 1, axis=-1) * np.array([1.0, 2.0]),
    "where": lambda x: np.where(np.array([True, False]), real(x), plane(x).imag),
    "where with a number": lambda x: np.where(np.array([True, False]), real(x), 5.0),
    "stack": lambda x: np.stack([real(x), plane(x).imag], axis=1),
    "stack on the last axis": lambda x: np.stack([real(x), np.array([1.0, 2.0])], axis=-1),
    "concatenate": lambda x: np.concatenate([np.array([1.0]), real(x)]),
    "sum along an axis": lambda x: np.stack([real(x), plane(x).imag], axis=0).sum(axis=0),
    "sum along the last axis": lambda x: np.stack([real(x), plane(x).imag], axis=0).sum(axis=-1),
    "reshape": lambda x: np.stack([real(x), plane(x).imag], axis=0).reshape(4, 1)[1:3, 0],
    "last of all": lambda x: np.stack([real(x), plane(x).imag], axis=0)[..., 0],
    "new axis kept": lambda x: np.stack([real(x), plane(x).imag], axis=0)[:, [1, 0, 0]],
}


@pytest.mark.parametrize("name", CASES)
def test_every_rule_against_differences(name: str) -> None:
    case, x = CASES[name], np.array([0.21, -0.34, 0.17])
    jet = case(seeded(x))
    assert isinstance(jet, Jet)
    plain = np.asarray(case(x))
    assert jet.shape == plain.shape
    assert jet.slope.shape == (*plain.shape, N_VARIABLES)
    assert np.allclose(jet.value, plain, rtol=1e-14)
    h = 1e-4
    for k, step in enumerate(h * np.eye(N_VARIABLES)):
        near, far = case(x + step) - case(x - step), case(x + 2.0 * step) - case(x - 2.0 * step)
        assert np.allclose(jet.slope[..., k], (8.0 * near - far) / (12.0 * h), atol=1e-10)


@settings(max_examples=50)
@given(st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3))
def test_a_circle_of_rules_closes(x: list[float]) -> None:
    """|z| exp(i angle z) is z again, slopes and all."""
    z = plane(seeded(np.array(x)))
    size, angle = np.abs(z), np.angle(z)
    again = stacked([size * np.cos(angle), size * np.sin(angle)], axis=1)
    assert np.allclose(again.value, np.stack([z.value.real, z.value.imag], axis=1), atol=1e-14)
    assert np.allclose(again.slope, np.stack([z.slope.real, z.slope.imag], axis=1), atol=1e-13)


def test_choosing_keeps_the_slopes_of_what_is_chosen() -> None:
    one, other = real(seeded(np.zeros(3))), real(seeded(np.ones(3)))
    chosen = select(np.array([True, False]), one, other)
    assert np.array_equal(chosen.slope, np.stack([one.slope[0], other.slope[1]]))
    assert np.array_equal(value_of(chosen), np.array([one.value[0], other.value[1]]))
    assert np.array_equal(select(np.array([True, False]), one, 2.0).slope[1], np.zeros(N_VARIABLES))


def test_what_has_no_rule_is_refused() -> None:
    """Nothing is silently differentiated as a constant."""
    with pytest.raises(TypeError):
        np.exp(real(seeded(np.zeros(3))))
    with pytest.raises(TypeError):
        np.median(real(seeded(np.zeros(3))))
    with pytest.raises(TypeError):
        np.add.reduce(real(seeded(np.zeros(3))))
