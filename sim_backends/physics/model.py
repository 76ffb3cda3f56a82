"""A design file as an MJCF model: bodies, film hinges, loops, contacts, slits, motors.

All bodies' frames are the design's coordinates when deployed, so every joint stands at 0 there and its value is
how much larger its crease's inner angle is than when deployed. Lengths in metres, angles in radians.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.design import Structure
from ori_deploy.files import Design
from ori_deploy.loads import Loads, Solids, clamp_of, masses_kg
from ori_deploy.motion import CREASES, Linkage, mechanism_of
from sim_backends.physics.pieces import panel_pieces
from sim_backends.physics.tree import Hang, hangs_from

FloatArray = NDArray[np.float64]

STEP_S = 1e-3

LOOP_SOLREF, LOOP_SOLIMP = "0.002 1", "0.9999 0.9999 0.001"
"""As stiff as MJCF can say at a step of 1 ms."""

LOOP_SOFTNESS = 1e-5
"""Of a loop in a world, in parts of what MuJoCo makes of the above: at rest, what it gives is in proportion."""

CONTACT_SOLREF, CONTACT_SOLIMP = "0.004 1", "0.95 0.99 0.0005"
LATCH_SOLREF, LATCH_SOLIMP = "0.005 1", "0.99 0.999 0.0005"

STOP_SLACK_RAD = 2e-3
"""How far a crease may go beyond folded shut or open flat: what is flat by design does not push."""

WIND_UP_RAD = 0.05
"""By how much shaft, horn and gears twist under an actuator's largest torque."""

GEAR_RAD_S = 300.0
"""Natural frequency of a free shaft on that spring: what a step of 1 ms carries; it fixes the rotor's inertia."""


@dataclass(frozen=True)
class Drive:
    """An actuator on a crease.

    Attributes
    ----------
    name, cell, crease
        What it is called and what it drives, in the order of `CREASES`.
    shaft_per_crease, zero_rad
        As in a rig: `shaft = zero_rad + shaft_per_crease * inner angle`.
    torque_nm
        The most it gives, at the shaft.
    """

    name: str
    cell: int
    crease: int
    shaft_per_crease: float
    zero_rad: float
    torque_nm: float

    @property
    def stiffness_nm(self) -> float:
        """N m per radian between shaft and crease, at the shaft."""
        return self.torque_nm / WIND_UP_RAD

    @property
    def rotor_kg_m2(self) -> float:
        """Inertia of rotor and gears, at the shaft."""
        return self.stiffness_nm / GEAR_RAD_S**2


@dataclass(frozen=True)
class Obstacle:
    """A box in the way, fixed in space: middle (3,) and half sides (3,), metres."""

    middle: tuple[float, float, float]
    half: tuple[float, float, float]


@dataclass(frozen=True)
class Slit:
    """A slit's two faces.

    Attributes
    ----------
    point
        "slit:P-T2".
    panels
        The panels on either side.
    places
        (2, 3) its opening vertex and its inner vertex, deployed, half way along the span.
    """

    point: str
    panels: tuple[int, int]
    places: FloatArray


@dataclass(frozen=True)
class Model:
    """What a design is as a multibody system.

    Attributes
    ----------
    design, loads
        What it is made from.
    drives
        Actuators.
    contact
        Whether panels that could meet push each other apart.
    obstacles
        Boxes in the way.
    """

    design: Design
    loads: Loads = field(default_factory=Loads)
    drives: tuple[Drive, ...] = ()
    contact: bool = True
    obstacles: tuple[Obstacle, ...] = ()

    @cached_property
    def linkage(self) -> Linkage[Any]:
        """The design as it moves."""
        return mechanism_of(self.design.structure, self.design.unit_m)

    @cached_property
    def solids(self) -> Solids:
        """Its panels."""
        return Solids.of(self.design.structure, self.design.span_m, self.design.r_min_m)

    @cached_property
    def clamp(self) -> int:
        """Number of the panel that is held."""
        return clamp_of(self.design.structure.layout, self.loads)

    @cached_property
    def hangs(self) -> tuple[Hang, ...]:
        """Its tree."""
        return hangs_from(self.design.structure.layout, self.clamp)

    @cached_property
    def masses(self) -> FloatArray:
        """(n_panels,) kg."""
        return masses_kg(self.design.structure.layout, self.solids, self.loads)

    @cached_property
    def slits(self) -> tuple[Slit, ...]:
        """Its slits, in the order of the layout."""
        layout = self.design.structure.layout
        made = []
        for inner, outer in layout.slits:
            tail, head = layout.corners.reshape(-1), np.roll(layout.corners, -1, axis=1).reshape(-1)
            first = np.flatnonzero(((tail == inner) & (head == outer)) | ((tail == outer) & (head == inner)))
            name = f"slit:{layout.vertices[inner].id}-{layout.vertices[outer].id}"
            made.append(Slit(name, (int(first[0]), int(first[1])), self._places([outer, inner])))
        return tuple(made)

    def joint(self, cell: int, crease: int) -> str:
        """Name of a crease's joint."""
        return f"{self.design.structure.layout.cell_ids[cell]}.{CREASES[crease]}"

    def body(self, panel: int) -> str:
        """Name of the body that a panel belongs to."""
        layout = self.design.structure.layout
        held = (self.clamp, int(layout.bonded_to[self.clamp]))
        return "world" if panel in held else layout.panel_ids[int(layout.bodies[panel])]

    def positions(self, fold: ArrayLike) -> FloatArray:
        """(n_joints,) joint values, in the order of `hangs`, at a fold of all cells or (n_cells,) of each."""
        folds = np.broadcast_to(np.asarray(fold, dtype=float), (self.linkage.n_cells,))
        return self.of_angles(self.linkage.four_bars.angles(folds[None])[0])

    def of_angles(self, angles: FloatArray) -> FloatArray:
        """(n_joints,) joint values for inner angles (n_cells, 4)."""
        opened = angles - self.linkage.four_bars.deployed
        return np.array([opened[hang.cell, hang.crease] for hang in self.hangs])

    def xml(self, *, cuts_apart: bool = False) -> str:
        """The model as MJCF; with what loops are held by on bodies of its own, for `LOOP_SOFTNESS`."""
        return _Writer(self, cuts_apart).text()

    def _places(self, vertices: Sequence[int]) -> FloatArray:
        structure, some = self.design.structure, list(vertices)
        if isinstance(structure, Structure):
            z = structure.embedding.z[some]
            return np.column_stack([z.real, z.imag, np.full(len(some), 0.5 * self.design.span_m)])
        middle = self.design.r_min_m + 0.5 * self.design.span_m
        rays = structure.profile.to_user(structure.embedding.u[some])
        return np.asarray(structure.profile.apex + middle * rays)


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(v):.17g}" for v in values)


class _Writer:
    """Writes a model."""

    def __init__(self, model: Model, cuts_apart: bool) -> None:
        self._model, self._cuts_apart = model, cuts_apart
        self._layout = model.design.structure.layout
        self._root = ET.Element("mujoco", model=model.design.name)
        self._asset = ET.Element("asset")
        self._bodies: dict[str, ET.Element] = {}
        self._halved = {hang.panel for hang in model.hangs if hang.half}

    def text(self) -> str:
        model, root = self._model, self._root
        ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="true")
        option = ET.SubElement(
            root, "option", timestep=f"{STEP_S}", gravity=_text(model.loads.gravity_m_s2),
            integrator="implicitfast", tolerance="1e-12", iterations="100",
        )  # fmt: skip
        ET.SubElement(option, "flag", energy="enable")
        root.append(self._asset)
        world = ET.SubElement(root, "worldbody")
        self._bodies["world"] = world
        for panel in range(self._layout.n_panels):
            if model.body(panel) == "world":
                self._geoms(world, panel)
        # A body of their own: what meets the held panels at a crease does not touch these, but touches obstacles.
        fixed = ET.SubElement(world, "body", name="obstacles") if model.obstacles else world
        for number, box in enumerate(model.obstacles):
            shape = {"name": f"obstacle {number}", "type": "box", "pos": _text(box.middle), "size": _text(box.half)}
            ET.SubElement(fixed, "geom", {**shape, **_TOUCH})
        for hang in model.hangs:
            self._hang(hang)
        for slit in model.slits:
            self._slit_sites(slit)
        self._contacts()
        self._equalities()
        self._motors()
        self._keyframes()
        ET.indent(root)
        return ET.tostring(root, encoding="unicode") + "\n"

    # -- bodies --------------------------------------------------------------------------------------

    def _hang(self, hang: Hang) -> None:
        model, layout = self._model, self._layout
        half = _half(layout.panel_ids[hang.panel])
        above = self._bodies[model.body(hang.above)]
        name = half if hang.half else model.body(hang.panel)
        body = ET.SubElement(above, "body", name=name)
        self._bodies[name] = body
        panels = [hang.panel] if hang.half else [p for p in range(layout.n_panels) if model.body(p) == name]
        self._inertia(body, panels)
        loads, solids = model.loads, model.solids
        deployed = float(model.linkage.four_bars.deployed[hang.cell, hang.crease])
        shut, flat = -deployed - STOP_SLACK_RAD, np.pi - deployed + STOP_SLACK_RAD
        ET.SubElement(
            body, "joint", name=model.joint(hang.cell, hang.crease), type="hinge",
            pos=_text(solids.crease_point[hang.cell, hang.crease]),
            axis=_text(hang.sense * solids.crease_axis[hang.cell, hang.crease]),
            stiffness=f"{loads.film.stiffness_nm(solids.span_m):.17g}",
            springref=f"{loads.film.rest_rad[hang.crease] - deployed:.17g}",
            damping=f"{loads.damping_nm_s:.17g}", frictionloss=f"{loads.friction_nm:.17g}",
            armature=f"{self._armature(hang):.17g}",
            range=_text((shut, flat)), solreflimit=CONTACT_SOLREF, solimplimit=CONTACT_SOLIMP,
        )  # fmt: skip
        if not hang.half:
            for panel in panels:
                self._geoms(body, panel)
        for panel in panels:
            if panel in self._halved:
                self._cut(body, f"{name} {layout.panel_ids[panel]}", model.solids.centroid[panel])

    def _cut(self, body: ET.Element, name: str, place: FloatArray) -> None:
        """Where a half of a cut panel is held: on a body of its own, contacts do not see how stiffly."""
        at = {"pos": _text(place)}
        if self._cuts_apart:
            # Standing there, too: how easily its own origin moves is what MuJoCo scales the softness by.
            body, at = ET.SubElement(body, "body", {"name": f"{name} cut", **at}), {}
        ET.SubElement(body, "site", {"name": name, "size": "0.001", **at})

    def _armature(self, hang: Hang) -> float:
        here = [d for d in self._model.drives if (d.cell, d.crease) == (hang.cell, hang.crease)]
        return sum(d.rotor_kg_m2 * d.shaft_per_crease**2 for d in here)

    def _inertia(self, body: ET.Element, panels: Sequence[int]) -> None:
        """What the panels weigh together; of a cut panel, half."""
        model = self._model
        share = [0.5 if p in self._halved else 1.0 for p in panels]
        mass = np.array([s * model.masses[p] for s, p in zip(share, panels, strict=True)])
        total = float(mass.sum())
        place = model.solids.centroid[list(panels)]
        middle = mass @ place / total
        inertia = np.zeros((3, 3))
        for s, m, p, at in zip(share, mass, panels, place, strict=True):
            arm = at - middle
            inertia += s * model.loads.density_kg_m3 * model.solids.inertia(p)
            inertia += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        ET.SubElement(body, "inertial", pos=_text(middle), mass=f"{total:.17g}", fullinertia=_text(full))

    def _geoms(self, body: ET.Element, panel: int) -> None:
        design, name = self._model.design, self._layout.panel_ids[panel]
        for number, corners in enumerate(panel_pieces(design.structure, panel, design.r_min_m, design.span_m)):
            mesh = f"{name} {number}"
            ET.SubElement(self._asset, "mesh", name=mesh, vertex=_text(corners.ravel()), inertia="shell")
            touch = _TOUCH if self._model.contact or self._model.obstacles else _GHOST
            ET.SubElement(body, "geom", {"name": mesh, "type": "mesh", "mesh": mesh, **touch})

    def _slit_sites(self, slit: Slit) -> None:
        for side, panel in zip("ab", slit.panels, strict=True):
            for end, place in zip(("opening", "inner"), slit.places, strict=True):
                name = f"{slit.point} {end} {side}"
                body = self._bodies[self._model.body(panel)]
                ET.SubElement(body, "site", name=name, pos=_text(place), size="0.001")

    # -- what is between bodies ----------------------------------------------------------------------

    def _contacts(self) -> None:
        """No contact between bodies that meet at a crease; their joint's range stands for it."""
        if not (self._model.contact or self._model.obstacles):
            return
        names = [self._model.body(p) for p in range(self._layout.n_panels)]
        meet = (
            np.ones((len(names),) * 2, dtype=bool) if not self._model.contact else self._model.linkage.shared_crease
        )
        pairs = {tuple(sorted((names[i], names[j]))) for i, j in np.argwhere(meet) if names[i] != names[j]}
        contact = ET.SubElement(self._root, "contact")
        for first, second in sorted(pairs):
            ET.SubElement(contact, "exclude", body1=first, body2=second)

    def _equalities(self) -> None:
        model, layout = self._model, self._layout
        equality = ET.SubElement(self._root, "equality")
        for hang in model.hangs:
            if hang.half:
                name, body = layout.panel_ids[hang.panel], model.body(hang.panel)
                ET.SubElement(
                    equality, "weld", name=f"loop {layout.cell_ids[hang.cell]}", site1=f"{body} {name}",
                    site2=f"{_half(name)} {name}", solref=LOOP_SOLREF, solimp=LOOP_SOLIMP,
                )  # fmt: skip
        for slit in model.slits:
            for end in ("opening", "inner"):
                ET.SubElement(
                    equality, "connect", name=f"{slit.point} {end}", site1=f"{slit.point} {end} a",
                    site2=f"{slit.point} {end} b", active="false", solref=LATCH_SOLREF, solimp=LATCH_SOLIMP,
                )  # fmt: skip
        stowed = model.positions(0.0)
        for hang, value in zip(model.hangs, stowed, strict=True):
            if CREASES[hang.crease] != "close_a":
                continue
            cell = layout.cell_ids[hang.cell]
            for name, at in ((f"cell:{cell}", 0.0), (f"stow {cell}", float(value))):
                ET.SubElement(
                    equality, "joint", name=name, joint1=model.joint(hang.cell, hang.crease),
                    polycoef=_text((at, 0, 0, 0, 0)), active="false", solref=LATCH_SOLREF, solimp=LATCH_SOLIMP,
                )  # fmt: skip

    def _motors(self) -> None:
        actuator = ET.SubElement(self._root, "actuator")
        for drive in self._model.drives:
            ET.SubElement(
                actuator, "motor", name=drive.name, joint=self._model.joint(drive.cell, drive.crease),
                gear=f"{drive.shaft_per_crease:.17g}",
            )  # fmt: skip

    def _keyframes(self) -> None:
        keyframe = ET.SubElement(self._root, "keyframe")
        for name, fold in (("deployed", 1.0), ("stowed", 0.0)):
            ET.SubElement(keyframe, "key", name=name, qpos=_text(self._in_file_order(self._model.positions(fold))))

    def _in_file_order(self, values: FloatArray) -> FloatArray:
        """Joint values as the compiler numbers joints: depth first, as they stand in the file."""
        by_name = {self._model.joint(h.cell, h.crease): v for h, v in zip(self._model.hangs, values, strict=True)}
        return np.array([by_name[joint.get("name", "")] for joint in self._bodies["world"].iter("joint")])


_TOUCH = {
    "contype": "1", "conaffinity": "1", "condim": "1", "solref": CONTACT_SOLREF, "solimp": CONTACT_SOLIMP,
}  # fmt: skip
_GHOST = {"contype": "0", "conaffinity": "0"}


def _half(panel_id: str) -> str:
    return f"{panel_id} half"


def mjcf(design: Design, loads: Loads | None = None, drives: tuple[Drive, ...] = ()) -> str:
    """A design as MJCF text: for `--mjcf` and for any export."""
    return Model(design, Loads() if loads is None else loads, drives).xml()
