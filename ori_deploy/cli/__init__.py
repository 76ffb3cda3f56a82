"""The command line: the only room that knows all the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ori_deploy.cli.starting import keep_standard_descriptors, keep_to_one_thread, quiet_interrupts

if TYPE_CHECKING:
    from ori_deploy.cli.commands import main

__all__ = ["main"]


def __getattr__(name: str) -> Any:
    if name != "main":
        raise AttributeError(f"module {__name__} has no attribute {name}")
    keep_standard_descriptors()
    keep_to_one_thread()
    with quiet_interrupts():
        from ori_deploy.cli.commands import main

        return main
