"""Kinds of number that a rig file may hold, with the bounds of sense."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field, StrictStr

Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Fraction = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False, strict=True)]
Name = Annotated[StrictStr, Field(min_length=1)]
Count = Annotated[int, Field(ge=0, strict=True)]

STRICT = ConfigDict(extra="forbid")


def between(low: float, high: float, reason: str) -> AfterValidator:
    """Bounds of sense, inclusive: beyond them a number is a slip of the pen, and the rig unsafe."""

    def check(value: float) -> float:
        if not low <= value <= high:
            raise ValueError(f"{low:g} to {high:g}: {reason}")
        return value

    return AfterValidator(check)


def at_most(high: float, reason: str) -> AfterValidator:
    """An upper bound of sense, inclusive."""

    def check(value: float) -> float:
        if value > high:
            raise ValueError(f"at most {high:g}: {reason}")
        return value

    return AfterValidator(check)
