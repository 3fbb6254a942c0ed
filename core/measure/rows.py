"""Measures as the text of a file. Needs neither numpy nor torch: Blender writes them, too."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import FormatError

#: The unit of lengths without a known one.
NO_SCALE = "px-equivalent"
#: Endings of the files that measures are written to.
SUFFIXES = (".json", ".csv")
_COLUMNS = ("name", "kind", "value", "deviation", "low", "high", "unit", "photos", "of", "reason")


def check_table_name(path: Path) -> None:
    """Raises FormatError where a name has no ending that can be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(
            f"'{path.name}' is no table that can be written", f"End its name with {' or '.join(SUFFIXES)}"
        )


def table_text(rows: Sequence[Mapping[str, Any]], suffix: str, **more: Any) -> str:
    """The whole content of a file.

    Args:
        rows: of measures, with the columns of the CSV.
        more: what a JSON holds besides.
    """
    if suffix == ".json":
        return json.dumps({"measures": list(rows), **more}, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    out = io.StringIO()
    table = csv.DictWriter(out, _COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows([{**row, "of": " ".join(row["of"])} for row in rows])
    return out.getvalue()
