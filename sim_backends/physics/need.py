"""MuJoCo, or one line that says how to get it."""

from __future__ import annotations

from typing import Any

from ori_deploy.errors import InputError


def mujoco() -> Any:
    """The module.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        import mujoco as module
    except ImportError as missing:
        raise InputError(
            "the physics plant needs MuJoCo", value=str(missing), remedy="pip install 'ori-deploy[physics]'"
        ) from missing
    return module
