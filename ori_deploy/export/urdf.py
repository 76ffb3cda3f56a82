"""URDF models: the structure as a tree of links, which is all that URDF can say.

A link's frame stands at the middle of the crease by which it hangs, turned like the design's coordinates when
deployed. URDF has no loops, and its `mimic` no couplings but linear ones: the creases at which loops are cut are told
in an element of our own, `ori_deploy`, which readers pass over, with both panels' names for the crease's ends. Joints
that are set to a fold's crease angles close all loops by themselves. Meshes lie in a folder beside the file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ori_deploy.export.bodies import Bodies, Mesh, text
from ori_deploy.export.tree import Hang
from ori_deploy.profiles.profile import Reals

BASE = "base"
"""Link without mass to which the first panel is fixed: readers want no inertia at the root."""


@dataclass(frozen=True)
class UrdfModel:
    """A model and the meshes it names.

    Attributes
    ----------
    xml
        What the file holds.
    meshes
        By path, relative to the file's folder: binary STL in metres, in the links' own frames.
    """

    xml: str
    meshes: dict[str, bytes] = field(repr=False)


def mesh_folder(path: Path) -> str:
    """Name of the folder of meshes beside a URDF file."""
    return f"{path.stem}_meshes"


def urdf_model(bodies: Bodies, folder: str) -> UrdfModel:
    """The model.

    Parameters
    ----------
    folder
        Name of the folder that its meshes will be in.
    """
    root = ET.Element("robot", name=bodies.design.name)
    root.append(ET.Comment(_WORDS))
    # MuJoCo's own: it would leave out what is only to be seen, and join what is fixed.
    mujoco = ET.SubElement(root, "mujoco")
    ET.SubElement(mujoco, "compiler", strippath="false", discardvisual="false", fusestatic="false")
    ET.SubElement(root, "link", name=BASE)
    origins, meshes = {-1: np.zeros(3)}, {}
    for hang in (Hang(-1, 0), *bodies.tree.hangs):
        origin = origins[hang.above] if hang.bonded else bodies.point(hang)
        origins[hang.panel] = origin
        mesh = bodies.meshes[hang.panel]
        file = None if mesh is None else f"{folder}/{bodies.link(hang.panel)}.stl"
        if mesh is not None and file is not None:
            meshes[file] = stl_bytes(mesh, origin)
        _link(root, bodies, hang.panel, origin, file)
        _joint(root, bodies, hang, origin - origins[hang.above])
    _loops(root, bodies, origins)
    ET.indent(root)
    return UrdfModel('<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n", meshes)


_WORDS = (
    " Joints stand at 0 when deployed; their values are how much larger a crease's inner angle is than then. "
    "Cut creases are in the element ori_deploy at the end: the panels of each have to keep meeting there. "
)


def _link(root: ET.Element, bodies: Bodies, panel: int, origin: Reals, file: str | None) -> None:
    link = ET.SubElement(root, "link", name=bodies.link(panel))
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=text(bodies.centroid(panel) - origin), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=text([bodies.mass_kg(panel)]))
    inertia, names = bodies.inertia(panel), "xyz"
    full = {f"i{names[i]}{names[j]}": text([inertia[i, j]]) for i in range(3) for j in range(i, 3)}
    ET.SubElement(inertial, "inertia", full)
    if file is not None:
        visual = ET.SubElement(link, "visual")
        ET.SubElement(visual, "origin", xyz="0 0 0", rpy="0 0 0")
        ET.SubElement(ET.SubElement(visual, "geometry"), "mesh", filename=file)


def _joint(root: ET.Element, bodies: Bodies, hang: Hang, shift: Reals) -> None:
    above = BASE if hang.above < 0 else bodies.link(hang.above)
    below = bodies.link(hang.panel)
    kind, name = ("fixed", f"{above}-{below}") if hang.bonded else ("revolute", bodies.joint(hang.cell, hang.crease))
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=above)
    ET.SubElement(joint, "child", link=below)
    ET.SubElement(joint, "origin", xyz=text(shift), rpy="0 0 0")
    if hang.bonded:
        return
    ET.SubElement(joint, "axis", xyz=text(bodies.axis(hang)))
    low, high = bodies.range_rad(hang)
    drive = bodies.drive_of(hang)
    effort, velocity = (0.0, 0.0) if drive is None else (drive.torque_nm, drive.velocity_rad_s)
    ET.SubElement(
        joint, "limit", lower=text([low]), upper=text([high]), effort=text([effort]), velocity=text([velocity])
    )
    if drive is not None:
        _transmission(root, name, drive.name, drive.gear_ratio)


def _transmission(root: ET.Element, joint: str, actuator: str, gear_ratio: float) -> None:
    made = ET.SubElement(root, "transmission", name=f"{actuator} to {joint}")
    ET.SubElement(made, "type").text = "transmission_interface/SimpleTransmission"
    interface = "hardware_interface/PositionJointInterface"
    ET.SubElement(ET.SubElement(made, "joint", name=joint), "hardwareInterface").text = interface
    motor = ET.SubElement(made, "actuator", name=actuator)
    ET.SubElement(motor, "hardwareInterface").text = interface
    ET.SubElement(motor, "mechanicalReduction").text = text([gear_ratio])


def _loops(root: ET.Element, bodies: Bodies, origins: dict[int, Reals]) -> None:
    """Of every cut crease, in either panel's link frame: both its ends."""
    ours = ET.SubElement(root, "ori_deploy")
    for loop in bodies.tree.loops:
        made = ET.SubElement(ours, "loop", crease=bodies.joint(loop.cell, loop.crease))
        for panel in loop.panels:
            near, far = bodies.skeleton.crease_ends[loop.cell, loop.crease] - origins[panel]
            ET.SubElement(made, "end", link=bodies.link(panel), near=text(near), far=text(far))


def stl_bytes(mesh: Mesh, origin: Reals) -> bytes:
    """A binary STL file of a mesh, metres, seen from `origin` (3,)."""
    corners = (mesh.vertices - origin)[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0.0)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["normal"], rows["corners"] = normal, corners
    return b"ori-deploy, metres".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
