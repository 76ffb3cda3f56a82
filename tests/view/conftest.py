"""Real structures and plans, and runs of a mock on a virtual clock, each made once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ori_deploy.design import Structure
from ori_deploy.files import build_from_file
from ori_deploy.files.spec import Spec
from ori_deploy.motion import Plan, plan_motion
from ori_deploy.telemetry.read import Run, read_run
from tests.deploy.synthetic import bench, synthetic_plan
from tests.telemetry.inline import InlineLog

EXAMPLES = Path(__file__).parents[2] / "examples"


def ring_structure(n_cells: int) -> Structure:
    """A thin-walled circular ring."""
    spec = {
        "schema": "ori-deploy/spec/1",
        "profile": {"kind": "ellipse", "a_m": 0.1, "b_m": 0.1},
        "structure": {"span_m": 0.5, "wall_m": 0.0005},
        "layout": {"ring": {"cells": n_cells, "phase_rad": 0.5}},
    }
    return Spec.model_validate(spec).build(Path())


@pytest.fixture(scope="session")
def wing() -> Structure:
    return build_from_file(EXAMPLES / "wing_naca2412.toml")[1]


@pytest.fixture(scope="session")
def wing_plan(wing: Structure) -> Plan:
    limits = np.ones((4, 4))
    return plan_motion(wing, limits, 2.0 * limits, 100.0, design_sha256="cd" * 32, design_name="wing")


def _run(path: Path, jammed: bool) -> Run:
    b = bench(synthetic_plan())
    with InlineLog(path, b.plan, b.rig, plan_sha256="ab" * 32) as log:
        b.controller.add_observer(log)
        b.steps(10)
        b.controller.deploy()
        if jammed:
            b.steps(120)
            b.bus.jam(b.bus.hinge_ids[1])
        log.write_result(b.controller.run())
        b.steps(20)
    return read_run(path)


@pytest.fixture(scope="session")
def good_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Deployed, every latch confirmed."""
    return _run(tmp_path_factory.mktemp("good") / "run.mcap", jammed=False)


@pytest.fixture(scope="session")
def faulted_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A hinge jams half-way."""
    return _run(tmp_path_factory.mktemp("fault") / "run.mcap", jammed=True)
