"""The command line: the only room that knows all the others."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from ori_deploy.cli.starting import quiet_interrupts

if TYPE_CHECKING:
    from ori_deploy.cli.commands import main

__all__ = ["main"]

_AT_ONCE = frozenset({"status", "pause", "resume", "stop", "estop"})
"""Commands that wait for none of the rooms: loading them all takes a second, and the structure moves meanwhile."""


def __getattr__(name: str) -> Any:
    if name != "main":
        raise AttributeError(f"module {__name__} has no attribute {name}")
    with quiet_interrupts():
        if _AT_ONCE.intersection(sys.argv[1:2]):
            from ori_deploy.cli.operate import operator

            return operator
        from ori_deploy.cli.commands import main

        return main
