"""`python -m ori_deploy.cli`, the same as `ori-deploy`."""

from __future__ import annotations

from ori_deploy.cli import main

main(prog_name="ori-deploy")
