"""Every tolerance of the geometry, each with its reason.

Lengths are relative to the profile's size (its larger extent) so that a wing in metres and one in
millimetres are judged alike.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """Named tolerances.

    Attributes
    ----------
    root
        Residual of (1), (2) over the profile's size below which a crease counts as found: a few
        hundred roundings of the arithmetic that evaluates it.
    unfolded_length
        Residual of (3) over the profile's size. It is solved in closed form, so anything above
        rounding means faces that are nearly parallel and a design nobody should build.
    corner_rad
        Turn of a point profile's outline above which a vertex is a corner of the shape and not a
        sample of a smooth curve: airfoil files turn by up to 25 degrees from point to point round a
        sharp nose and by over 100 at the trailing edge.
    vertex_gap
        Smallest distance along the outline between two vertices, over its length: closer ones are
        a typing error, and their cell has no area.
    edge_end
        Part of an inner edge at each end, over the profile's size, that is judged by directions at
        the vertex instead of by crossing the sampled outline, which leaves the true one by its sagitta.
    thickness
        Thickest panel, over the profile's size, below which a structure is all air and no box holds it.
    dead_centre_rad
        Least dead-centre margin. At less, rounding in (3) is magnified to angles a motor would see.
    sagitta
        Distance between the outline and the polygon drawn for it, over the profile's size. A
        quarter of `penetration`, so that sampling cannot hide what the check looks for.
    penetration
        Depth to which two panels may reach into each other before it counts as interference, over
        the profile's size. 1e-4 is 0.025 mm on a 250 mm chord: below what a printed part holds,
        far above rounding.
    motion_step
        Distance, over the profile's size, that panels may move relative to each other between two
        poses before the interval between them has to be certified or halved.
    flat_link
        Link lengths, over the cell's perimeter, that count as equal. At the flat state of a cell
        without wall thickness the sign of their difference decides the branch, and rounding must not.
    hinge_flat
        How far a face may leave a plane and still count as flat, over the profile's size, or in radians:
        a hundredth of `penetration`, far above rounding.
    hinge_length
        Shortest flat strip that carries a piano hinge, over the folded stack's width: where a smooth bulge
        touches a plane, a strip of a hundredth is flat by `hinge_flat`, and no screw holds in it.
    rebuild
        Difference, over the profile's size, between creases recorded in a design file and those
        built from its layout: larger means the file was edited or the construction has changed.
    """

    root: float = 1e-13
    unfolded_length: float = 1e-11
    corner_rad: float = 0.7
    vertex_gap: float = 1e-6
    edge_end: float = 1e-3
    thickness: float = 1e-8
    dead_centre_rad: float = 1e-4
    sagitta: float = 2.5e-5
    penetration: float = 1e-4
    motion_step: float = 0.02
    flat_link: float = 1e-13
    hinge_flat: float = 1e-6
    hinge_length: float = 0.05
    rebuild: float = 1e-9


TOLERANCE = Tolerance()
