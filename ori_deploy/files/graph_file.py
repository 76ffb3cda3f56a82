"""A planar graph to make a layout of: what a person writes (TOML or JSON, schema ori-deploy/graph/1)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from ori_deploy.errors import InputError, LayoutError
from ori_deploy.files.text import read_json, read_toml, validated
from ori_deploy.layout import AllowableRule, Layout, layout_of_graph, opening_vertices_on_outline

GRAPH_SCHEMA = "ori-deploy/graph/1"

Number = Annotated[float, Field(strict=True, ge=-1e9, le=1e9, allow_inf_nan=False)]
Id = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_+.]+$")]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GraphVertex(_Strict):
    """`[[vertex]]`: an id, a place in any unit, and the role where it is known."""

    id: Id
    xy: tuple[Number, Number]
    role: Literal["closing", "opening"] | None = None


class Graph(_Strict):
    """A whole graph file."""

    schema_: Annotated[Literal["ori-deploy/graph/1"], Field(alias="schema")]
    edges: tuple[tuple[str, ...], ...]
    slits: tuple[tuple[str, ...], ...] | None = None
    vertex: tuple[GraphVertex, ...]


@dataclass(frozen=True)
class DrawnLayout:
    """A layout, and where the file has its vertices.

    Attributes
    ----------
    layout
        Vertices in the file's order.
    places
        One point of the plane per vertex, in the file's unit.
    """

    layout: Layout
    places: tuple[complex, ...]


def load_graph(path: Path, *, allowable: AllowableRule = opening_vertices_on_outline) -> DrawnLayout:
    """Read a graph file and make it a layout. A name that ends in .json is read as JSON, any other as TOML.

    Raises
    ------
    FileError
        Unreadable, unknown or missing keys, values out of range; names file and key.
    LayoutError
        Not a layout; names the file and the vertices.
    """
    data = read_json(path, GRAPH_SCHEMA) if path.suffix.lower() == ".json" else read_toml(path, GRAPH_SCHEMA)
    graph = validated(Graph, data, str(path))
    try:
        return _layout(graph, allowable)
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise


def _layout(graph: Graph, allowable: AllowableRule) -> DrawnLayout:
    places = {v.id: complex(*v.xy) for v in graph.vertex}
    if len(places) < len(graph.vertex):
        ids = [v.id for v in graph.vertex]
        twice = next(v for v in ids if ids.count(v) > 1)
        raise LayoutError(f"vertex {twice}: id given twice", limit="distinct ids", remedy="rename one")
    layout = layout_of_graph(
        places,
        graph.edges,  # type: ignore[arg-type]  # pairs or not is checked there, by name
        roles={v.id: v.role for v in graph.vertex if v.role is not None},
        slits=graph.slits,  # type: ignore[arg-type]
        allowable=allowable,
    )
    return DrawnLayout(layout, tuple(places.values()))
