"""Kinds of number that a rig file may hold, with the bounds of sense."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, StrictStr
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Fraction = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False, strict=True)]
Name = Annotated[StrictStr, Field(min_length=1)]
Count = Annotated[int, Field(ge=0, strict=True)]

STRICT = ConfigDict(extra="forbid", defer_build=True)


@dataclass(frozen=True)
class Bounds:
    """Bounds of sense, inclusive: beyond them a number is a slip of the pen, and the rig unsafe.

    Not pydantic's own, because the reason is told with them; the file's JSON Schema has them all the same.
    """

    low: float | None
    high: float
    reason: str

    def check(self, value: float) -> float:
        """`value`, if it is within."""
        if (self.low is None or self.low <= value) and value <= self.high:
            return value
        bounds = f"at most {self.high:g}" if self.low is None else f"{self.low:g} to {self.high:g}"
        raise ValueError(f"{bounds}: {self.reason}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        told = handler(schema)
        if self.low is not None:
            told["minimum"] = self.low
        told["maximum"] = self.high
        return told


def between(low: float, high: float, reason: str) -> Bounds:
    """A lower and an upper bound of sense."""
    return Bounds(low, high, reason)


def at_most(high: float, reason: str) -> Bounds:
    """An upper bound of sense."""
    return Bounds(None, high, reason)
