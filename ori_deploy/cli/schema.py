"""`ori-deploy schema`: what may stand in a file, as JSON Schema 2020-12, from the very classes that read it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

import click
from pydantic import TypeAdapter

from ori_deploy.cli.frame import example

DIALECT = "https://json-schema.org/draft/2020-12/schema"

KINDS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "aircraft": ("ori_deploy.files.aircraft_file", "AircraftFile"),
        "design": ("ori_deploy.files.design_schema", "DesignFile"),
        "graph": ("ori_deploy.files.graph_file", "Graph"),
        "loads": ("ori_deploy.files.loads_file", "LoadsFile"),
        "mavlink": ("ori_deploy.mav.settings", "SettingsFile"),
        "parts": ("ori_deploy.export.parts_spec", "PartsSpec"),
        "plan": ("ori_deploy.files.plan_schema", "PlanFile"),
        "rig": ("ori_deploy.actuators.rig", "Rig"),
        "spec": ("ori_deploy.files.spec", "Spec"),
        "sweep": ("ori_deploy.files.sweep_spec", "SweepFile"),
    }
)
"""Module and class of what a file of each kind is read into. Loaded when asked for."""


def model_of(kind: str) -> Any:
    """The class that a file of this kind is read into."""
    module, name = KINDS[kind]
    return getattr(import_module(module), name)


def schema_of(kind: str) -> dict[str, Any]:
    """The JSON Schema of a file of this kind, as plain data.

    It has keys, types, and bounds of single values. What a value means for another one only the reader knows.
    """
    told = TypeAdapter(model_of(kind)).json_schema(by_alias=True)
    # No reader takes a file that does not say which kind and version it is, even where its class has a default.
    required = ["schema", *(key for key in told.get("required", ()) if key != "schema")]
    return {"$schema": DIALECT, **told, "title": f"ori-deploy/{kind}/1", "required": required}


@click.command(epilog=example("ori-deploy schema rig > rig.schema.json"))
@click.argument("kind", type=click.Choice(sorted(KINDS)))
def schema(kind: str) -> None:
    """Print the JSON Schema of a KIND of file, for editors and other programs.

    TOML files are tables, and tables are JSON objects: one schema does for both.
    """
    click.echo(json.dumps(schema_of(kind), indent=2))
