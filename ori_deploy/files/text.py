"""Reading and writing files so that a failure leaves nothing half-written."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path, PosixPath
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ori_deploy.errors import FileError
from ori_deploy.spelling import keys_beside, meant

_Model = TypeVar("_Model", bound=BaseModel)


class HeldFile(PosixPath):
    """A file that was read before: it goes by its name, and gives what was read then.

    A pipe can be read only once, and a file may be another by the time of a second look; what is in a log is no
    file at all. Whoever reads files by `read_text` and `read_json` takes one of these as any other.
    """

    data: bytes

    @classmethod
    def of(cls, name: str | Path, data: bytes) -> HeldFile:
        """What was read of a file, under the name that errors are to tell."""
        made = cls(name)
        made.data = data
        return made

    def read_bytes(self) -> bytes:
        """What was read."""
        return self.data


def read_bytes(path: Path) -> bytes:
    """What is in a file.

    Raises
    ------
    FileError
        It cannot be read.
    """
    if "\0" in str(path):
        raise FileError(f"{str(path)!r}: not a file name", limit="no NUL characters", remedy="mend the name")
    try:
        return path.read_bytes()
    except OSError as wrong:
        raise FileError(
            f"{path}: cannot be read", value=wrong.strerror, remedy="check the name and the permissions"
        ) from wrong


def read_text(path: Path) -> str:
    """The text of a file, UTF-8, each line ended by a line feed alone.

    Raises
    ------
    FileError
        It cannot be read.
    """
    data = read_bytes(path)
    try:
        return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as wrong:
        raise FileError(
            f"{path}: not a text file", value=f"byte {wrong.start}", limit="UTF-8", remedy="check the name"
        ) from wrong


def read_toml(path: Path, schema: str) -> dict[str, Any]:
    """The tables of a TOML file whose `schema` key is as given."""
    text = read_text(path)
    try:
        data = tomllib.loads(text)
    except RecursionError as wrong:
        raise FileError(f"{path}: nested too deeply", remedy="check that this is the right file") from wrong
    except tomllib.TOMLDecodeError as wrong:
        json_like = text.lstrip().startswith("{")
        remedy = "this looks like a design or a plan: give the file a person wrote" if json_like else "mend the line"
        raise FileError(f"{path}: not TOML", value=str(wrong), remedy=remedy) from wrong
    check_schema(path, data, schema)
    return data


def read_json(path: Path, schema: str) -> dict[str, Any]:
    """The object of a JSON file whose `schema` key is as given."""
    text = read_text(path)
    try:
        data = json.loads(text, parse_constant=_refuse_constant)
    except RecursionError as wrong:
        raise FileError(f"{path}: nested too deeply", remedy="check that this is the right file") from wrong
    except json.JSONDecodeError as wrong:
        spec_like = "ori-deploy/spec" in text
        remedy = "this is a specification: run ori-deploy design on it first" if spec_like else "make the file again"
        raise FileError(f"{path}: not JSON", value=str(wrong), remedy=remedy) from wrong
    except NotANumberError as wrong:
        raise FileError(
            f"{path}: holds {wrong}", limit="finite numbers", remedy="make the file again instead of editing it"
        ) from wrong
    except ValueError as wrong:
        raise FileError(f"{path}: holds a number beyond all use", value=str(wrong)[:80], remedy="mend it") from wrong
    if not isinstance(data, dict):
        raise FileError(
            f"{path}: not a JSON object",
            value=type(data).__name__,
            limit="one object",
            remedy="check the name",
        )
    check_schema(path, data, schema)
    return data


class NotANumberError(ValueError):
    """JSON holds NaN or an infinity, which JSON does not have."""


def _refuse_constant(name: str) -> float:
    raise NotANumberError(name)


_LEADS_TO = {
    ("design", "plan"): "this is a design: run ori-deploy plan on it first",
    ("plan", "design"): "this is a plan: give the design that it was made from",
}
"""Kinds of files, that given and that wanted: what leads from the one to the other."""


def check_schema(path: Path, data: dict[str, Any], schema: str) -> None:
    """Refuse a file of another kind or version."""
    given = data.get("schema")
    if given != schema:
        kinds = tuple(str(one).removeprefix("ori-deploy/").partition("/")[0] for one in (given, schema))
        remedy = _LEADS_TO.get((kinds[0], kinds[1]), "check that this is the right file")
        raise FileError(f"{path}: key schema", value=repr(given), limit=repr(schema), remedy=remedy)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write to a temporary name beside `path`, then rename: readers see the old file or the whole new one.

    Raises
    ------
    FileError
        It cannot be written; nothing is left behind.
    """
    # Half a surrogate pair stands for a byte of a name that is not UTF-8: it is shown, and costs nobody the page.
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    temporary: str | None = None
    path = path.resolve()  # through a link, not in its place
    if not path.name or (path.exists() and not path.is_file()):
        raise FileError(f"{path}: not a file", limit="a regular file", remedy="choose another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except OSError as wrong:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise FileError(
            f"{path}: cannot be written", value=wrong.strerror, remedy="check the folder and the space left"
        ) from wrong


def digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as wrong:
        raise FileError(f"{path}: cannot be read", value=wrong.strerror, remedy="check the name") from wrong


def validated(model: type[_Model], document: dict[str, Any], source: str) -> _Model:
    """A document as an instance of its class.

    Raises
    ------
    FileError
        Keys that are unknown or missing, values out of range; names source and key.
    """
    try:
        return model.model_validate(document)
    except ValidationError as wrong:
        raise _refusal(model, document, source, wrong.errors()) from wrong


def _refusal(
    model: type[BaseModel], document: dict[str, Any], source: str, found: Sequence[ErrorDetails]
) -> FileError:
    """What pydantic found, as an error that names the key as the file has it.

    A key that should not be there is told first: it is often the misspelling of one that is missing.
    """
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
    others = len({_key(e["loc"], document) for e in found} - {_key(first["loc"], document)})
    more = f" (and {others} more)" if others else ""
    key = _key(first["loc"], document)
    limit = first["msg"].removeprefix("Value error, ")
    value = first.get("input")
    shown = None if isinstance(value, dict) or first["type"] == "missing" else repr(value)
    remedy = "mend the value"
    if first["type"] == "extra_forbidden":
        limit = "only keys that this kind of file has"
        missing = [str(e["loc"][-1]) for e in found if e["type"] == "missing" and e["loc"][:-1] == first["loc"][:-1]]
        if missing:
            remedy = f"did you mean {' or '.join(missing)}? It is missing"
        else:
            remedy = meant(str(first["loc"][-1]), keys_beside(model.model_json_schema(), first["loc"]))
    elif first["type"] == "missing":
        limit, remedy = "has to be there", "add the key"
    elif first["type"] == "union_tag_invalid":
        key, shown = f"{key}.kind", repr(first["ctx"]["tag"])
        limit = str(first["ctx"]["expected_tags"]).replace("'", "")
    elif first["type"] == "union_tag_not_found":
        key, limit, remedy = f"{key}.kind", "has to be there", "add the key"
    return FileError(f"key {key}{more}", value=shown, limit=limit, remedy=remedy, source=source)


def _key(loc: tuple[int | str, ...], document: dict[str, Any]) -> str:
    """A key's path as the file has it: entries of a list by their id, no names of variants."""
    parts: list[str] = []
    here: Any = document
    for part in loc:
        if isinstance(here, dict) and part not in here and part == here.get("kind"):
            continue  # pydantic's name for the variant, not a key
        if isinstance(part, int) and isinstance(here, (list, tuple)) and part < len(here):
            here = here[part]
            name = here.get("id") if isinstance(here, dict) else None
            parts[-1:] = [f"{parts[-1] if parts else ''}[{name if name is not None else part + 1}]"]
            continue
        here = here.get(part) if isinstance(here, dict) else None
        parts.append(str(part))
    return ".".join(parts) or "(top level)"
