"""Files in, files out: specifications, designs, plans. The only room that reads and writes them."""

from __future__ import annotations

from ori_deploy.files.aircraft_file import load_aircraft
from ori_deploy.files.design_file import Design, design_data, load_design, pose_data, save_design
from ori_deploy.files.graph_file import DrawnLayout, load_graph
from ori_deploy.files.loads_file import load_loads, save_loads
from ori_deploy.files.plan_file import load_plan, save_plan
from ori_deploy.files.spec import Spec, build_from_file, load_spec
from ori_deploy.files.spec_text import save_spec
from ori_deploy.files.sweep_spec import SweepSpec, load_sweep
from ori_deploy.files.text import digest, write_atomically

__all__ = [
    "Design",
    "DrawnLayout",
    "Spec",
    "SweepSpec",
    "build_from_file",
    "design_data",
    "digest",
    "load_aircraft",
    "load_design",
    "load_graph",
    "load_loads",
    "load_plan",
    "load_spec",
    "load_sweep",
    "pose_data",
    "save_design",
    "save_loads",
    "save_plan",
    "save_spec",
    "write_atomically",
]
