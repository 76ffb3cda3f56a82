"""Files in, files out: specifications, designs, plans. The only room that reads and writes them."""

from __future__ import annotations

from ori_deploy.files.design_file import Design, design_data, load_design, pose_data, save_design
from ori_deploy.files.plan_file import load_plan, save_plan
from ori_deploy.files.spec import Spec, build_from_file, load_spec
from ori_deploy.files.text import digest, write_atomically

__all__ = [
    "Design",
    "Spec",
    "build_from_file",
    "design_data",
    "digest",
    "load_design",
    "load_plan",
    "load_spec",
    "pose_data",
    "save_design",
    "save_plan",
    "write_atomically",
]
