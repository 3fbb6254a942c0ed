"""Writes docs/constants.md: every number of the engine that somebody chose, with its reason and what it rests on.

    make constants, or: python -m tools.constants [--check]

The numbers are the fields of dataclasses that `core.numbers.number` made, and those of core/constants.py.
With --check nothing is written; the status is 1 if the page is not what the code says.
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import run_dgs

run_dgs.mount_package()
from dgs.core.numbers import BY_DEFINITION, NOT_CHECKED, NOT_RECORDED, Provenance, numbers_of  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "constants.md"
PACKAGES = ("core", "studies")

HEAD = """# The numbers

Written by `make constants` from the code; change them there. Every estimator keeps its numbers in one frozen
dataclass, and each of them says its unit, its reason, the data it was chosen on and other data it was checked on.
*{definition}* is what follows from a definition, from theory or from another number; *{recorded}*: nobody wrote down
what it was chosen on; *{checked}*: it was never tried on data that it was not chosen on. Whoever changes one of the
latter two should measure first, and write down on what.

| numbers | by definition | chosen on recorded data | choice not recorded | chosen, and checked on other data |
|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Group:
    """The numbers of one dataclass."""

    package: str
    module: str
    name: str
    purpose: str
    numbers: list[tuple[str, Any, Provenance]]


def groups() -> list[Group]:
    """All dataclasses with documented numbers, by package and module."""
    return sorted(_groups(), key=lambda group: (group.package, group.module))


def _groups() -> Iterator[Group]:
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            # Only these files are imported, so that this takes seconds.
            source = file.read_text("utf-8")
            if "numbers import" not in source or not re.search(r"= number\(", source):
                continue
            name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            module = importlib.import_module(f"dgs.{name}")
            for kind in vars(module).values():
                if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module.__name__:
                    numbers = list(numbers_of(kind))
                    if numbers:
                        purpose = (kind.__doc__ or "").strip().partition("\n")[0]
                        yield Group(".".join(name.split(".")[:2]), name, kind.__name__, purpose, numbers)


def shared() -> list[tuple[str, str, str]]:
    """Name, value and reason of each number in core/constants.py; a comment holds for the lines right below it."""
    found, reason, fresh = [], "", True
    constants = importlib.import_module("dgs.core.constants")
    for line in (ROOT / "core" / "constants.py").read_text("utf-8").splitlines():
        assigned = re.match(r"([A-Z][A-Z0-9_]*)(?:: [^=]+)? = ", line)
        if line.startswith("#:"):
            reason = line[2:].strip() if fresh else f"{reason} {line[2:].strip()}"
            fresh = False
        elif assigned:
            found.append((assigned[1], _value(getattr(constants, assigned[1])), reason))
            fresh = True
    return found


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |\n"


def page() -> str:
    """The whole page."""
    found = groups()
    numbers = [number for group in found for number in group.numbers]
    chosen = [origin for _, _, origin in numbers if origin.chosen_on != BY_DEFINITION]
    unrecorded = sum(origin.chosen_on == NOT_RECORDED for origin in chosen)
    checked = sum(origin.checked_on != NOT_CHECKED for origin in chosen)
    text = HEAD.format(definition=BY_DEFINITION, recorded=NOT_RECORDED, checked=NOT_CHECKED)
    counts = (len(numbers), len(numbers) - len(chosen), len(chosen) - unrecorded, unrecorded, checked)
    text += _row(*map(str, counts))
    package = ""
    for group in found:
        if group.package != package:
            package = group.package
            text += f"\n## {package}\n"
        text += f"\n### {group.name}\n\n`{group.module.replace('.', '/')}.py`: {group.purpose}\n\n"
        text += _row("name", "value", "unit", "reason", "chosen on", "checked on") + "|---|---|---|---|---|---|\n"
        for name, value, origin in group.numbers:
            cells = (f"`{name}`", _value(value), origin.unit, origin.reason, origin.chosen_on, origin.checked_on)
            text += _row(*cells)
    text += "\n## Shared by forward and backward passes\n\n`core/constants.py`; kernels are compiled with them.\n\n"
    text += _row("name", "value", "reason") + "|---|---|---|\n"
    return text + "".join(_row(f"`{name}`", value, reason) for name, value, reason in shared())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare only")
    options = parser.parse_args()
    text = page()
    if options.check:
        same = PAGE.is_file() and PAGE.read_text("utf-8") == text
        if not same:
            print("docs/constants.md is not what the code says: run make constants", file=sys.stderr)
        return 0 if same else 1
    PAGE.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
