"""Where no two panels could ever meet there is no smallest clearance, and a plan says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from ori_deploy.files.plan_file import load_plan, save_plan
from ori_deploy.motion import Interference, mechanism_of
from ori_deploy.view.facts import plan_facts
from tests import shapes
from tests.deploy.synthetic import synthetic_plan


def test_a_plan_of_which_no_panels_could_meet_is_written_and_read(tmp_path: Path) -> None:
    plan = synthetic_plan()
    none = replace(plan.check, smallest_clearance_m=float("inf"), clearance_panels=("", ""))
    save_plan(replace(plan, check=none), tmp_path / "a.plan.json")
    told = json.loads((tmp_path / "a.plan.json").read_text())["check"]
    assert told["smallest_clearance_m"] is told["clearance_panels"] is None
    read = load_plan(tmp_path / "a.plan.json")
    assert read.check == none
    assert not read.check.has_clearance
    (fact,) = [fact for fact in plan_facts(read) if fact.name == "smallest clearance"]
    assert fact.value == "none"


def test_where_all_share_creases_there_is_no_clearance() -> None:
    interference = Interference(mechanism_of(shapes.structure("one cell")))
    assert np.isfinite(interference.clearance(np.array([0.5])).distance_m)
    vars(interference)["hinged"] = np.ones_like(interference.hinged)
    none = interference.clearance(np.array([0.5]))
    assert (none.distance_m, none.panels) == (np.inf, ("", ""))
