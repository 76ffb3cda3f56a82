"""Errors a user can act on.

Every error says what is wrong, the value found, the limit it breaks and what to do about it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class OriDeployError(Exception):
    """Base of every error this package raises on purpose.

    Attributes
    ----------
    refused
        Whether what was asked is known not to have been begun: nothing moved because of it.
    """

    refused = False


@contextmanager
def begun(*, already: bool = True) -> Iterator[None]:
    """From here on something has moved, gone limp or been changed: no error of the block is a mere refusal.

    Parameters
    ----------
    already
        Whether that is so; nothing is different otherwise.
    """
    try:
        yield
    except OriDeployError as wrong:
        wrong.refused = wrong.refused and not already
        raise


class InputError(OriDeployError):
    """Input that cannot be used.

    Parameters
    ----------
    thing
        What is wrong, and where: the key, cell, vertex or panel.
    value
        The value found, where there is one.
    limit
        The rule or bound the value breaks.
    remedy
        What the user can do.
    source
        The file the input came from; added by whoever read the file.
    """

    def __init__(
        self,
        thing: str,
        *,
        value: object = None,
        limit: str | None = None,
        remedy: str | None = None,
        source: str | None = None,
    ) -> None:
        super().__init__(thing)
        self.thing = thing
        self.value = value
        self.limit = limit
        self.remedy = remedy
        self.source = source

    def __str__(self) -> str:
        text = f"{self.source}: {self.thing}" if self.source else self.thing
        if self.value is not None:
            text += f"; found {self.value}"
        if self.limit is not None:
            text += f"; limit: {self.limit}"
        if self.remedy is not None:
            text += f"; remedy: {self.remedy}"
        return text


class ProfileError(InputError):
    """A target shape that is not a simple closed counter-clockwise curve, or a query off it."""


class LayoutError(InputError):
    """A layout that is not an allowable quadrangulation of the profile."""


class CellError(InputError):
    """A cell that cannot be built, or cannot reach its flat state."""


class MotionError(InputError):
    """A motion that collides or cannot be timed."""


class FileError(InputError):
    """A file that cannot be read, or does not hold what its schema says."""


class RigError(InputError):
    """A rig that does not fit the design, or contradicts itself."""


class StripError(InputError):
    """A strip that does not fit on the structure that is to carry it."""
