"""The command line: the only room that knows all the others."""

from __future__ import annotations

from ori_deploy.cli.starting import quiet_interrupts

with quiet_interrupts():
    from ori_deploy.cli.commands import main

__all__ = ["main"]
