"""What somebody may have meant by a word that does not exist: a key in a file, a command."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

SHOWN = 12
"""Keys that are listed when none is near; a longer list is no help."""


def keys_beside(schema: dict[str, Any], loc: Sequence[int | str]) -> frozenset[str]:
    """The keys that may stand where one was found that may not.

    Parameters
    ----------
    schema
        JSON Schema of the whole file, as pydantic makes it.
    loc
        Where the key is, as pydantic tells it: keys, places in lists and names of variants.
    """
    here = list(_variants(schema, schema))
    for part in loc[:-1]:
        inside = [one for node in here for one in _inside(schema, node, part)]
        here = inside or [one for one in here if part in _kinds(one)] or here  # the name of a variant leads nowhere
    return frozenset(key for node in here for key in node.get("properties", {}))


def near(word: str, known: Iterable[str]) -> list[str]:
    """Words that are much like it, the likest first; two at most."""
    return difflib.get_close_matches(word, sorted(known), n=2)


def meant(key: str, known: Iterable[str]) -> str:
    """What to do about a key that is not known, in words."""
    names = sorted(known)
    likely = near(key, names)
    if likely:
        return f"did you mean {' or '.join(likely)}?"
    if 0 < len(names) <= SHOWN:
        return f"remove the key or mend its name; there are {', '.join(names)}"
    return "remove the key or mend its name"


def _variants(schema: dict[str, Any], node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A node of the schema with references followed, and every variant of it."""
    if "$ref" in node:
        yield from _variants(schema, schema["$defs"][node["$ref"].rpartition("/")[2]])
        return
    yield node
    for one in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())):
        yield from _variants(schema, one)


def _inside(schema: dict[str, Any], node: dict[str, Any], part: int | str) -> Iterator[dict[str, Any]]:
    if isinstance(part, int):
        nodes = [*node.get("prefixItems", ()), node.get("items")]
    else:
        nodes = [node.get("properties", {}).get(part), node.get("additionalProperties")]
    for one in nodes:
        if isinstance(one, dict):
            yield from _variants(schema, one)


def _kinds(node: dict[str, Any]) -> Iterator[Any]:
    """The names under which a variant may be known: the constants among its keys."""
    for one in node.get("properties", {}).values():
        if "const" in one:
            yield one["const"]
