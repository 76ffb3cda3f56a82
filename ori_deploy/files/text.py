"""Reading and writing files so that a failure leaves nothing half-written."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ori_deploy.errors import FileError


def read_text(path: Path) -> str:
    """The text of a file, UTF-8.

    Raises
    ------
    FileError
        It cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as wrong:
        raise FileError(
            f"{path}: cannot be read", value=wrong.strerror, remedy="check the name and the permissions"
        ) from wrong
    except UnicodeDecodeError as wrong:
        raise FileError(
            f"{path}: not a text file", value=f"byte {wrong.start}", limit="UTF-8", remedy="check the name"
        ) from wrong


def read_toml(path: Path, schema: str) -> dict[str, Any]:
    """The tables of a TOML file whose `schema` key is as given."""
    try:
        data = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as wrong:
        raise FileError(f"{path}: not TOML", value=str(wrong), remedy="mend the line") from wrong
    check_schema(path, data, schema)
    return data


def read_json(path: Path, schema: str) -> dict[str, Any]:
    """The object of a JSON file whose `schema` key is as given."""
    try:
        data = json.loads(read_text(path))
    except json.JSONDecodeError as wrong:
        raise FileError(f"{path}: not JSON", value=str(wrong), remedy="make the file again") from wrong
    if not isinstance(data, dict):
        raise FileError(
            f"{path}: not a JSON object",
            value=type(data).__name__,
            limit="one object",
            remedy="check the name",
        )
    check_schema(path, data, schema)
    return data


def check_schema(path: Path, data: dict[str, Any], schema: str) -> None:
    """Refuse a file of another kind or version."""
    if data.get("schema") != schema:
        raise FileError(
            f"{path}: key schema",
            value=repr(data.get("schema")),
            limit=repr(schema),
            remedy="check that this is the right file",
        )


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write to a temporary name beside `path`, then rename: readers see the old file or the whole new one.

    Raises
    ------
    FileError
        It cannot be written; nothing is left behind.
    """
    data = content.encode() if isinstance(content, str) else content
    temporary: str | None = None
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
    return hashlib.sha256(read_text(path).encode()).hexdigest()


def refuse_keys(source: str, wrong: ValidationError) -> FileError:
    """The first thing pydantic found, as an error that names the key."""
    first = wrong.errors()[0]
    where = ".".join(str(part) for part in first["loc"] if not str(part).startswith(("function-", "tagged-")))
    more = f" (and {len(wrong.errors()) - 1} more)" if len(wrong.errors()) > 1 else ""
    remedies = {"extra_forbidden": "remove the key or mend its name", "missing": "add the key"}
    value = None if first["type"] == "missing" else repr(first.get("input"))
    return FileError(
        f"key {where or '(top level)'}{more}",
        value=value,
        limit=first["msg"],
        remedy=remedies.get(first["type"], "mend the value"),
        source=source,
    )
