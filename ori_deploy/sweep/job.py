"""One job, wherever it runs: a specification in, a row out."""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.errors import InputError
from ori_deploy.files import Spec
from ori_deploy.files.shape_entries import AnyStructure, entries_of
from ori_deploy.files.text import validated
from ori_deploy.sweep.grid import Job
from ori_deploy.sweep.optimise import optimised

Row = dict[str, Any]
"""One line of the table; what is missing is None."""

FOUND, INFEASIBLE, FAILED = "found", "infeasible", "failed"
"""`status` of a row: a structure; none, and `error` says why; the job itself broke, and `error` says how."""


def run_job(job: Job) -> Row:
    """Make a job's structure and measure it. A design that cannot be built is an answer, not an error."""
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="ori-deploy-") as name:
        try:
            found = _measured(*_made(job, Path(name)))
            status, error = FOUND, None
        except InputError as wrong:
            found, status = {}, INFEASIBLE
            error = str(wrong).replace(f"{name}/", "")
    return {
        "job": job.digest,
        "status": status,
        "error": error,
        **found,
        "seconds": time.perf_counter() - begun,
        **job.values,
    }


def _made(job: Job, folder: Path) -> tuple[Spec, AnyStructure]:
    for name, text in job.files.items():
        path = folder / Path(name).name  # whatever folder it came from
        path.write_text(text, encoding="utf-8")
    spec = validated(Spec, _flattened(job.document), "specification")
    return spec, optimised(job, spec, folder) if job.optimize else spec.build(folder)


def _flattened(value: Any) -> Any:
    """The document with the names of its files as `_made` wrote them."""
    if isinstance(value, dict):
        return {
            key: Path(inner).name if key == "file" and isinstance(inner, str) else _flattened(inner)
            for key, inner in value.items()
        }
    return value


def _measured(spec: Spec, structure: AnyStructure) -> Row:
    shape = entries_of(structure, spec.structure.span_m, spec.structure.r_min_m)
    packaging, layout = shape.packaging(), structure.layout
    ids = [v.id for v in layout.vertices]
    return {
        "eta": packaging["eta"],
        "box_ratio": packaging["box_ratio"],
        "smallest_margin_rad": float(np.min(structure.cells.dead_centre_margin)),
        "material_area": packaging["material_area"],
        "cells": layout.n_cells,
        "slits": json.dumps([[ids[a], ids[b]] for a, b in layout.slits]),
        "vertices": json.dumps(dict(zip(ids, shape.vertices(), strict=True))),
    }
