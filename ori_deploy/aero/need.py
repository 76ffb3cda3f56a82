"""AeroSandbox and NeuralFoil, or one line that says how to get them. They take seconds: imported when needed."""

from __future__ import annotations

from typing import Any

from ori_deploy.errors import InputError


def _missing(what: str, why: ImportError) -> InputError:
    return InputError(
        f"aircraft: {what} is not installed",
        value=str(why),
        limit="the extra `aero`",
        remedy="pip install -e '.[aero]'",
    )


def aerosandbox() -> Any:
    """The module.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        import aerosandbox as module
    except ImportError as why:
        raise _missing("AeroSandbox", why) from why
    return module


def neuralfoil() -> Any:
    """The module.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        import neuralfoil as module
    except ImportError as why:
        raise _missing("NeuralFoil", why) from why
    return module
