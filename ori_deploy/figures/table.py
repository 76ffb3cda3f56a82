"""The data behind a figure as CSV: what the picture shows, number by number."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

Value = str | int | float | bool


@dataclass(frozen=True)
class Table:
    """Rows under named columns; a column that is not SI carries its unit.

    Attributes
    ----------
    columns
        Names, as long as every row.
    rows
        Values; a NaN is left empty in the file.
    """

    columns: tuple[str, ...]
    rows: Sequence[tuple[Value, ...]]

    def csv(self) -> str:
        """The table as CSV; numbers read back as exactly what they are.

        Raises
        ------
        ValueError
            A row that does not fit the columns.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{len(row)} values under {len(self.columns)} columns")
            writer.writerow([_text(value) for value in row])
        return out.getvalue()


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "" if value != value else repr(float(value))
    return str(value)
