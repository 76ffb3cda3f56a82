"""The table of results: one Parquet file that is replaced whole, so that what is in it survives everything."""

from __future__ import annotations

import fcntl
import io
import json
import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ori_deploy.errors import FileError, InputError
from ori_deploy.files.text import write_atomically
from ori_deploy.sweep.job import FAILED, Row

TABLE_SCHEMA = "ori-deploy/sweep-table/1"
_MARK = b"ori_deploy"

_OWN_COLUMNS = {
    "job": "string",
    "status": "string",
    "error": "string",
    "eta": "double",
    "box_ratio": "double",
    "smallest_margin_rad": "double",
    "material_area": "double",
    "cells": "int64",
    "slits": "string",
    "vertices": "string",
    "seconds": "double",
}


def _arrow() -> Any:
    try:
        import pyarrow as pa
        import pyarrow.parquet
    except ImportError as missing:
        raise InputError(
            "sweep: pyarrow is not installed", limit="the extra `sweep`", remedy="pip install -e '.[sweep]'"
        ) from missing
    return pa


class Store:
    """Rows on their way into a Parquet file; only one process may hold a file.

    Parameters
    ----------
    path
        The file. One that is there is gone on with.
    axes
        What the rows to come have of every axis: (name, values) pairs, for the columns' types.

    Raises
    ------
    FileError
        The file is something else, or another sweep is writing it.
    InputError
        pyarrow is missing.
    """

    def __init__(self, path: Path, axes: Iterable[tuple[str, tuple[Any, ...]]]) -> None:
        self._pa = _arrow()
        self.path = path
        self._new: list[Row] = []
        self._lock: int | None = _locked(path)
        try:
            self._table = self._read()
            self._widen(axes)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.flush()
        finally:
            self.close()

    def close(self) -> None:
        """Let go of the file, without writing."""
        if self._lock is not None:
            lock, self._lock = self._lock, None
            _lock_path(self.path).unlink(missing_ok=True)
            os.close(lock)

    def finished(self) -> frozenset[str]:
        """Digests of all jobs that have a row."""
        return frozenset(self._table.column("job").to_pylist()) | {row["job"] for row in self._new}

    def forget_failed(self) -> None:
        """Take rows of jobs that broke out of the table."""
        kept = [status != FAILED for status in self._table.column("status").to_pylist()]
        self._table = self._table.filter(self._pa.array(kept, type=self._pa.bool_()))

    def add(self, row: Row) -> None:
        """Keep a row; `flush` writes it."""
        self._new.append(row)

    def flush(self) -> None:
        """Write all rows to the file, whole or not at all."""
        if not self._new:
            return
        rows = [{name: self._plain(name, row.get(name)) for name in self._table.schema.names} for row in self._new]
        table = self._pa.concat_tables([self._table, self._pa.Table.from_pylist(rows, schema=self._table.schema)])
        out = io.BytesIO()
        self._pa.parquet.write_table(table, out)
        write_atomically(self.path, out.getvalue())
        self._table, self._new = table, []

    def rows(self) -> list[Row]:
        """All rows, those not written yet included."""
        return [*self._table.to_pylist(), *self._new]

    def _plain(self, name: str, value: Any) -> Any:
        kind = self._table.schema.field(name).type
        if value is None:
            return None
        if kind == self._pa.string():
            return value if isinstance(value, str) else json.dumps(value)
        return float(value) if kind == self._pa.float64() else value

    def _read(self) -> Any:
        pa = self._pa
        if not self.path.exists():
            mark = {_MARK: TABLE_SCHEMA.encode()}
            fields = [(name, pa.type_for_alias(kind)) for name, kind in _OWN_COLUMNS.items()]
            return pa.schema(fields, metadata=mark).empty_table()
        try:
            table = pa.parquet.read_table(self.path)
        except (pa.ArrowException, OSError) as wrong:
            raise FileError(
                f"{self.path}: not a Parquet file", value=str(wrong)[:80], remedy="choose another name with -o"
            ) from wrong
        if (table.schema.metadata or {}).get(_MARK) != TABLE_SCHEMA.encode():
            raise FileError(
                f"{self.path}: not a table of a sweep", limit=TABLE_SCHEMA, remedy="choose another name with -o"
            )
        return table

    def _widen(self, axes: Iterable[tuple[str, tuple[Any, ...]]]) -> None:
        """Give the table a column for every axis that holds its values and those already there."""
        pa = self._pa
        for name, values in axes:
            if name in _OWN_COLUMNS:
                raise InputError(
                    f"sweep.grid.{name}: is a column of the results", remedy="it is no key of a specification"
                )
            kind = self._kind(values)
            index = self._table.schema.get_field_index(name)
            if index < 0:
                self._table = self._table.append_column(name, pa.nulls(len(self._table), kind))
                continue
            there = self._table.schema.field(index).type
            if there == kind:
                continue
            both = pa.float64() if {there, kind} == {pa.int64(), pa.float64()} else pa.string()
            old = self._table.column(index).to_pylist()
            if both == pa.string():
                old = [v if v is None or isinstance(v, str) else json.dumps(v) for v in old]
            self._table = self._table.set_column(index, name, pa.array(old, type=both))

    def _kind(self, values: tuple[Any, ...]) -> Any:
        types = {type(value) for value in values}
        if types == {bool}:
            return self._pa.bool_()
        if types == {int}:
            return self._pa.int64()
        return self._pa.float64() if types <= {int, float} else self._pa.string()


def _lock_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _locked(path: Path) -> int:
    """A lock beside the file that ends with this process, however it ends."""
    lock = _lock_path(path)
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        while True:
            handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if lock.exists() and os.fstat(handle).st_ino == lock.stat().st_ino:
                return handle
            os.close(handle)  # its last owner removed it in between
    except BlockingIOError as held:
        os.close(handle)
        raise FileError(
            f"{path}: another sweep is writing it", remedy="wait for it, or choose another name with -o"
        ) from held
    except OSError as wrong:
        raise FileError(f"{path}: cannot be written", value=wrong.strerror, remedy="check the folder") from wrong
