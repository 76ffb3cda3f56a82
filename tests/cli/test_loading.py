"""What commands load before they do anything: nobody waits at the field for what is not used."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("room", ["ori_deploy.cli.session", "ori_deploy.cli.serve", "ori_deploy.cli.operate"])
def test_commands_that_operate_do_not_load_what_designs_are_made_with(room: str) -> None:
    told = f"import {room}, sys; print(*(name for name in sys.modules if '.' in name))"
    loaded = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True).stdout.split()
    assert room in loaded
    assert not [name for name in loaded if name.startswith(("scipy.", "trimesh.", "matplotlib.", "mujoco."))]
