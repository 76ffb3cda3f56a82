"""Numbers that carry their derivatives: forward-mode differentiation of the construction.

A `Jet` is an array of values with the partial derivatives of each by a handful of variables. It
takes part in numpy's functions, so the construction is written once, for arrays, and gives exact
derivatives when jets run through it. Complex values are points of the plane; variables are real.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Jet:
    """Values and their derivatives.

    Attributes
    ----------
    value
        Array of any shape, real or complex.
    slope
        (*value.shape, n_variables) partial derivatives.
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Array, slope: Array) -> None:
        self.value = value
        self.slope = slope

    # --- shape --------------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.value.shape)

    @property
    def ndim(self) -> int:
        return int(self.value.ndim)

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, key: Any) -> Jet:
        whole = key if isinstance(key, tuple) else (key,)
        if not any(part is Ellipsis for part in whole):
            whole = (*whole, Ellipsis)
        return Jet(self.value[key], self.slope[(*whole, slice(None))])

    def reshape(self, *shape: int) -> Jet:
        value = self.value.reshape(*shape)
        return Jet(value, self.slope.reshape(*value.shape, self.slope.shape[-1]))

    def sum(self, axis: int) -> Jet:
        return Jet(self.value.sum(axis=axis), self.slope.sum(axis=axis % self.ndim))

    # --- parts of complex values --------------------------------------------------------------------

    @property
    def real(self) -> Jet:
        return Jet(self.value.real, self.slope.real)

    @property
    def imag(self) -> Jet:
        return Jet(self.value.imag, self.slope.imag)

    # --- numpy's functions --------------------------------------------------------------------------

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **rest: Any) -> Any:
        rule = _RULES.get(ufunc) if method == "__call__" and not rest else None
        return NotImplemented if rule is None else rule(*inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        del types
        rule = _FUNCTIONS.get(function)
        return NotImplemented if rule is None else rule(*args, **kwargs)

    def __add__(self, other: Any) -> Jet:
        return _add(self, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Jet:
        return _subtract(self, other)

    def __rsub__(self, other: Any) -> Jet:
        return _subtract(other, self)

    def __mul__(self, other: Any) -> Jet:
        return _multiply(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Jet:
        return _divide(self, other)

    def __rtruediv__(self, other: Any) -> Jet:
        return _divide(other, self)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.slope)


def value_of(x: Any) -> Array:
    """The values of a jet, or an array as it is."""
    return x.value if isinstance(x, Jet) else np.asarray(x)


def _wide(slope: Array, value: Array) -> Array:
    """Slopes broadcast to the shape of a result."""
    return np.broadcast_to(slope, (*value.shape, slope.shape[-1])) if slope.shape[:-1] != value.shape else slope


def _add(a: Any, b: Any) -> Jet:
    if not isinstance(b, Jet):
        value = a.value + b
        return Jet(value, _wide(a.slope, value))
    if not isinstance(a, Jet):
        return _add(b, a)
    return Jet(a.value + b.value, a.slope + b.slope)


def _subtract(a: Any, b: Any) -> Jet:
    if not isinstance(b, Jet):
        value = a.value - b
        return Jet(value, _wide(a.slope, value))
    if not isinstance(a, Jet):
        value = a - b.value
        return Jet(value, _wide(-b.slope, value))
    return Jet(a.value - b.value, a.slope - b.slope)


def _multiply(a: Any, b: Any) -> Jet:
    if not isinstance(a, Jet):
        a, b = b, a
    if not isinstance(b, Jet):
        return Jet(a.value * b, a.slope * np.asarray(b)[..., None])
    return Jet(a.value * b.value, a.slope * b.value[..., None] + b.slope * a.value[..., None])


def _divide(a: Any, b: Any) -> Jet:
    if not isinstance(b, Jet):
        return _multiply(a, 1.0 / np.asarray(b))
    ratio = value_of(a) / b.value
    lost = ratio[..., None] * b.slope
    return Jet(ratio, ((a.slope - lost) if isinstance(a, Jet) else -lost) / b.value[..., None])


def _one(function: Callable[[Array], Array], slope: Callable[[Array, Array], Array]) -> Callable[[Jet], Jet]:
    """Rule of a real function of one variable; `slope` is given argument and value."""

    def rule(a: Jet) -> Jet:
        value = function(a.value)
        return Jet(value, slope(a.value, value)[..., None] * a.slope)

    return rule


def _absolute(a: Jet) -> Jet:
    size = np.abs(a.value)
    unit = a.value / size
    return Jet(size, (np.conj(unit)[..., None] * a.slope).real)


def _arctan2(y: Any, x: Any) -> Jet:
    v, u = value_of(y), value_of(x)
    square = u * u + v * v
    slope: Any = 0.0
    if isinstance(y, Jet):
        slope = slope + (u / square)[..., None] * y.slope
    if isinstance(x, Jet):
        slope = slope - (v / square)[..., None] * x.slope
    return Jet(np.arctan2(v, u), slope)


def _hypot(a: Any, b: Any) -> Any:
    return np.sqrt(a * a + b * b)


def _angle(a: Jet) -> Jet:
    square = (np.conj(a.value) * a.value).real
    return Jet(np.angle(a.value), (np.conj(a.value)[..., None] * a.slope).imag / square[..., None])


def _roll(a: Jet, shift: int, axis: int) -> Jet:
    axis %= a.ndim
    return Jet(np.roll(a.value, shift, axis), np.roll(a.slope, shift, axis))


def _joined(join: Callable[..., Array]) -> Callable[..., Jet]:
    def rule(parts: Any, axis: int = 0) -> Jet:
        n = next(p.slope.shape[-1] for p in parts if isinstance(p, Jet))
        values = [value_of(p) for p in parts]
        slopes = [p.slope if isinstance(p, Jet) else np.zeros((*np.shape(p), n)) for p in parts]
        ndim = values[0].ndim + (join is np.stack)
        return Jet(join(values, axis=axis), join(slopes, axis=axis % ndim))

    return rule


def _where(condition: Any, a: Any, b: Any) -> Jet:
    value = np.where(condition, value_of(a), value_of(b))
    slopes = [x.slope if isinstance(x, Jet) else np.zeros(1) for x in (a, b)]
    return Jet(value, np.where(np.asarray(condition)[..., None], *slopes))


def select(condition: Any, a: Any, b: Any) -> Jet:
    """`np.where` with a jet among the choices."""
    return _where(condition, a, b)


def stacked(parts: Any, axis: int) -> Jet:
    """`np.stack` with a jet among the parts."""
    return _joined(np.stack)(parts, axis=axis)


_RULES: dict[Any, Callable[..., Any]] = {
    np.add: _add,
    np.subtract: _subtract,
    np.multiply: _multiply,
    np.divide: _divide,
    np.negative: lambda a: -a,
    np.conjugate: lambda a: Jet(np.conj(a.value), np.conj(a.slope)),
    np.absolute: _absolute,
    np.sin: _one(np.sin, lambda x, _: np.cos(x)),
    np.cos: _one(np.cos, lambda x, _: -np.sin(x)),
    np.tan: _one(np.tan, lambda _, y: 1.0 + y * y),
    np.sqrt: _one(np.sqrt, lambda _, y: 0.5 / y),
    np.log: _one(np.log, lambda x, _: 1.0 / x),
    np.arctan2: _arctan2,
    np.hypot: _hypot,
}
_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.angle: _angle,
    np.roll: _roll,
    np.stack: _joined(np.stack),
    np.concatenate: _joined(np.concatenate),
    np.where: _where,
}
