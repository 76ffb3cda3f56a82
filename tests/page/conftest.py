"""Files of the example wing, made once, with a log of its deployment."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.inside import run

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with designs of a wing, a cone and a wing in segments, plans, and a log of the wing."""
    folder = tmp_path_factory.mktemp("page")
    for name, example in (("wing", "wing_naca2412"), ("span", "wing_span_3"), ("cone", "cone_circular_6")):
        spec, design = EXAMPLES / f"{example}.toml", f"{name}.design.json"
        assert run("design", spec, "-o", design, cwd=folder).returncode == 0
        if name != "cone":
            assert run("plan", design, "--rig", RIG, "-o", f"{name}.plan.json", cwd=folder).returncode == 0
    done = run("deploy", "wing.plan.json", "--rig", RIG, "--log", "run.mcap", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder
