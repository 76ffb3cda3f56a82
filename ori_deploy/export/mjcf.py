"""MJCF models: the structure for MuJoCo, with joints at its creases and its loops held closed.

Bodies' frames are the design's coordinates when deployed: a body's place and turn are its panel's motion. Loops are
cut at one crease each and tied at both ends of it. Panels do not push each other: at every fold they touch along
creases and bonds by design.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from ori_deploy.export.bodies import Bodies, text
from ori_deploy.export.tree import Hang
from ori_deploy.files import write_atomically

STEP_S = 5e-4

TIE_SOLREF, TIE_SOLIMP = "0.001 1", "0.9999 0.9999 0.001"
"""Of the loops: as stiff as MJCF can say at that step."""

GIVE_RAD = 0.05
"""How far a position actuator lags behind its command at its largest torque."""


def mjcf_text(bodies: Bodies) -> str:
    """The model: lengths in metres, meshes inline, poses "deployed" and "flat" as keyframes."""
    return _Writer(bodies).text()


def write_mjcf(bodies: Bodies, path: Path) -> None:
    """Write the model, whole or not at all. Raises as `write_atomically`."""
    write_atomically(path, mjcf_text(bodies))


class _Writer:
    """Writes a model."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._root = ET.Element("mujoco", model=bodies.design.name)
        self._asset = ET.Element("asset")
        self._elements: dict[int, ET.Element] = {}
        self._in_file: list[Hang] = []
        """Joints in the order in which the compiler numbers them: as they stand in the file."""

    def text(self) -> str:
        root, bodies = self._root, self._bodies
        ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="true")
        ET.SubElement(
            root, "option", timestep=f"{STEP_S}", integrator="implicitfast", tolerance="1e-12", iterations="100"
        )
        root.append(self._asset)
        world = ET.SubElement(root, "worldbody")
        ET.SubElement(world, "light", pos=text((0.0, 0.0, 3.0)), dir=text((0.0, 0.0, -1.0)), directional="true")
        self._panel(world, Hang(-1, 0))
        self._ties()
        if bodies.drives:
            self._actuators()
        self._keyframes()
        ET.indent(root)
        return ET.tostring(root, encoding="unicode") + "\n"

    def _panel(self, above: ET.Element, hang: Hang) -> None:
        """A panel and all that hangs on it."""
        bodies, panel = self._bodies, hang.panel
        body = ET.SubElement(above, "body", name=bodies.link(panel))
        self._elements[panel] = body
        inertia = bodies.inertia(panel)
        full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        ET.SubElement(
            body, "inertial", pos=text(bodies.centroid(panel)), mass=text([bodies.mass_kg(panel)]),
            fullinertia=text(full),
        )  # fmt: skip
        if not hang.bonded:
            self._in_file.append(hang)
            ET.SubElement(
                body, "joint", name=bodies.joint(hang.cell, hang.crease), type="hinge", pos=text(bodies.point(hang)),
                axis=text(bodies.axis(hang)), range=text(bodies.range_rad(hang)),
            )  # fmt: skip
        mesh = bodies.meshes[panel]
        if mesh is not None:
            name = bodies.link(panel)
            vertex, face = text(mesh.vertices.ravel()), " ".join(str(int(i)) for i in mesh.faces.ravel())
            ET.SubElement(self._asset, "mesh", name=name, vertex=vertex, face=face, inertia="shell")
            ET.SubElement(body, "geom", name=name, type="mesh", mesh=name, contype="0", conaffinity="0")
        for below in bodies.tree.below(panel):
            self._panel(body, below)

    def _ties(self) -> None:
        """Loops: both panels of a cut crease have a mark at either end of it; a hinge is two ball joints."""
        bodies = self._bodies
        equality = ET.SubElement(self._root, "equality")
        for loop in bodies.tree.loops:
            crease = bodies.joint(loop.cell, loop.crease)
            for end, place in zip(("near", "far"), bodies.skeleton.crease_ends[loop.cell, loop.crease], strict=True):
                marks = [f"{crease} {end} {bodies.link(panel)}" for panel in loop.panels]
                for panel, mark in zip(loop.panels, marks, strict=True):
                    ET.SubElement(self._elements[panel], "site", name=mark, pos=text(place), size="0.001")
                ET.SubElement(
                    equality, "connect", name=f"{crease} {end}", site1=marks[0], site2=marks[1], solref=TIE_SOLREF,
                    solimp=TIE_SOLIMP,
                )  # fmt: skip

    def _actuators(self) -> None:
        actuator = ET.SubElement(self._root, "actuator")
        for hang in self._in_file:
            drive = self._bodies.drive_of(hang)
            if drive is None:
                continue
            ET.SubElement(
                actuator, "position", name=drive.name, joint=self._bodies.joint(hang.cell, hang.crease),
                kp=text([drive.torque_nm / GIVE_RAD]), dampratio="1", ctrlrange=text(self._bodies.range_rad(hang)),
                forcerange=text((-drive.torque_nm, drive.torque_nm)),
            )  # fmt: skip

    def _keyframes(self) -> None:
        keyframe = ET.SubElement(self._root, "keyframe")
        order = [self._bodies.tree.joints.index(hang) for hang in self._in_file]
        driven = [k for k, hang in enumerate(self._in_file) if self._bodies.drive_of(hang) is not None]
        for name, values in zip(("deployed", "flat"), self._bodies.positions([1.0, 0.0])[:, order], strict=True):
            key = ET.SubElement(keyframe, "key", name=name, qpos=text(values))
            if driven:
                key.set("ctrl", text(values[driven]))
