"""STL and 3MF files, in millimetres.

Both hold single-precision numbers or few digits: surfaces are rounded first and then mended, so that a closed body
stays closed in the file.
"""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.errors import InputError
from ori_deploy.export.kernel import Triangles, need
from ori_deploy.export.parts import Part, Parts
from ori_deploy.export.plates import Placed, lay_out
from ori_deploy.files import write_atomically
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

ROUNDING_MM = 2e-4
"""Edges shorter than this are left out of files; a printer's step is fifty times as long."""

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


def rounded(part: Part, matrix: Reals | None = None) -> tuple[Vectors, Triangles]:
    """Points in millimetres that single precision can hold, and triangles: closed, and one body.

    Parameters
    ----------
    matrix
        (4, 4) where to put the part, metres; where it is when left out.

    Raises
    ------
    InputError
        A part too small to be told in single precision where it is.
    """
    m = need("manifold3d", "export")
    at = part.points if matrix is None else part.points @ matrix[:3, :3].T + matrix[:3, 3]
    points = np.ascontiguousarray(1e3 * at, dtype=np.float32)
    body = m.Manifold(m.Mesh(points, part.triangles.astype(np.uint32))).simplify(ROUNDING_MM)
    if body.status() != m.Error.NoError or body.is_empty():
        raise InputError(
            f"part {part.id}: not a body after rounding to single precision",
            value=f"{1e9 * part.volume_m3:.3g} mm³",
            limit=f"edges above {ROUNDING_MM:g} mm",
            remedy="a larger design",
        )
    mesh = body.to_mesh()
    return np.asarray(mesh.vert_properties, dtype=float)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)


def write_stl(parts: Parts, folder: Path) -> tuple[Path, ...]:
    """One binary STL per part, in millimetres, where the part is when deployed; named by its id.

    Raises
    ------
    FileError, InputError
        They cannot be written, or the extra is missing.
    """
    trimesh = need("trimesh", "export")
    written = []
    for part in parts.parts:
        mesh = trimesh.Trimesh(*rounded(part), process=False)
        path = folder / f"{part.id}.stl"
        write_atomically(path, bytes(mesh.export(file_type="stl")))
        written.append(path)
    return tuple(written)


def write_3mf(parts: Parts, path: Path) -> tuple[Placed, ...]:
    """All parts on their build plates, named; plates lie side by side, a fifth of a bed apart.

    Returns
    -------
    Where every part lies.

    Raises
    ------
    FileError, InputError
        It cannot be written, or the extra is missing.
    """
    placed = lay_out(parts)
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (
            ("[Content_Types].xml", _TYPES.encode()),
            ("_rels/.rels", _RELATIONS.encode()),
            ("3D/3dmodel.model", _model(parts, placed)),
        ):
            # A fixed date: the same design gives the same file.
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), text, zipfile.ZIP_DEFLATED)
    write_atomically(path, packed.getvalue())
    return placed


def _model(parts: Parts, placed: tuple[Placed, ...]) -> bytes:
    etree = need("lxml.etree", "export")
    model = etree.Element(f"{{{_CORE}}}model", unit="millimeter", nsmap={None: _CORE})
    for name, value in (("Title", parts.design.name), ("Application", "ori-deploy")):
        etree.SubElement(model, f"{{{_CORE}}}metadata", name=name).text = value
    resources = etree.SubElement(model, f"{{{_CORE}}}resources")
    build = etree.SubElement(model, f"{{{_CORE}}}build")
    left = _plates_from(placed, parts.spec.print.bed_mm[0])
    for number, item in enumerate(placed, start=1):
        turned = item.matrix.copy()
        shift = 1e3 * turned[:3, 3] + np.array([left[item.plate], 0.0, 0.0])
        turned[:3, 3] = 0.0
        _object(etree, resources, number, item, turned)
        where = " ".join(f"{x:.6f}" for x in (*np.eye(3).ravel(), *shift))
        told = f"{item.part.id} plate {item.plate + 1}"
        etree.SubElement(build, f"{{{_CORE}}}item", objectid=str(number), transform=where, partnumber=told)
    return bytes(etree.tostring(model, xml_declaration=True, encoding="UTF-8"))


def _plates_from(placed: tuple[Placed, ...], bed_mm: float) -> Reals:
    """(n_plates,) where each plate begins in x, millimetres; one with a part that hangs over is as wide as that."""
    width = np.full(max(item.plate for item in placed) + 1 if placed else 0, bed_mm)
    for item in placed:
        width[item.plate] = max(width[item.plate], 1e3 * float(item.size_m[0]))
    return np.append(0.0, np.cumsum(width + 0.2 * bed_mm))[:-1]


def _object(etree: Any, resources: Any, number: int, item: Placed, turned: Reals) -> None:
    """One part as an object, turned as it lies, the design's origin its own."""
    points, triangles = rounded(item.part, turned)
    thing = etree.SubElement(
        resources, f"{{{_CORE}}}object", id=str(number), type="model", name=item.part.id, partnumber=item.part.id
    )
    mesh = etree.SubElement(thing, f"{{{_CORE}}}mesh")
    vertices = etree.SubElement(mesh, f"{{{_CORE}}}vertices")
    for x, y, z in points:
        etree.SubElement(vertices, f"{{{_CORE}}}vertex", x=f"{x:.6f}", y=f"{y:.6f}", z=f"{z:.6f}")
    faces = etree.SubElement(mesh, f"{{{_CORE}}}triangles")
    for a, b, c in triangles:
        etree.SubElement(faces, f"{{{_CORE}}}triangle", v1=str(a), v2=str(b), v3=str(c))
