"""docs/studies/mutation.csv: a row for each mutant that was tried."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

COLUMNS = ("sample", "group", "package", "file", "line", "function", "operator", "occurrence", "old", "new", "outcome",
           "by", "verdict", "reason")  # fmt: skip


class Table:
    """The rows, in the order in which they were tried.

    Args:
        path: of the CSV file; need not be there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, str]] = []
        if path.is_file():
            with path.open(encoding="utf-8", newline="") as file:
                self.rows = list(csv.DictReader(file))

    def _found(self, sample: str, mutant: dict[str, Any]) -> dict[str, str] | None:
        key = (sample, mutant["file"], mutant["operator"], str(mutant["occurrence"]))
        for row in self.rows:
            if (row["sample"], row["file"], row["operator"], row["occurrence"]) == key:
                return row
        return None

    def has(self, sample: str, mutant: dict[str, Any]) -> bool:
        """Whether a mutant was tried."""
        return self._found(sample, mutant) is not None

    def open(self, sample: str, mutant: dict[str, Any]) -> bool:
        """Whether it survived, when it was tried, and is not known to be equivalent."""
        row = self._found(sample, mutant)
        return row is not None and row["outcome"] == "survived" and row["verdict"] != "equivalent"

    def add(self, sample: str, mutant: dict[str, Any], result: dict[str, Any]) -> None:
        """Adds a mutant and writes the file."""
        row = self._found(sample, mutant)
        if row is None:
            row = {"verdict": "", "reason": ""}
            self.rows.append(row)
        row |= {name: str(mutant[name]) for name in COLUMNS if name in mutant}
        row |= {"sample": sample, "outcome": result["outcome"], "by": result["by"]}
        self.write()

    def write(self) -> None:
        """Writes the file."""
        with self.path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(self.rows)
