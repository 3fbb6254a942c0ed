"""The states of a twin, one folder each: what an update would change is kept first, and can be brought back."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from ..errors import FormatError
from ..files import make_folder, output_error, write_json

HISTORY, FACTS = "history", "twin.json"
#: What makes a state; photos are only ever added, and stay.
FILES = (
    "twin.ply",
    "checkpoint.npz",
    "report.json",
    FACTS,
    "photos.txt",
    "update.json",
    "known.npy",
    "next_views.json",
)
FOLDERS = ("cameras",)


def read_facts(folder: Path) -> dict[str, Any]:
    """What updates noted about a twin: 'held' names, 'psf' by photo name, 'states'; empty before the first.

    Raises:
        FormatError: the file is damaged.
    """
    path = folder / FACTS
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text("utf-8"))
        if not isinstance(content, dict):
            raise ValueError
    except (OSError, ValueError) as error:
        raise FormatError(f"'{path}' is damaged", "Bring an earlier state back: update TWIN --rollback") from error
    return content


def states(folder: Path) -> list[Path]:
    """Kept states, oldest first."""
    return sorted(p for p in (folder / HISTORY).glob("[0-9][0-9][0-9]") if (p / "twin.ply").is_file())


def keep(folder: Path) -> Path:
    """Copies the present state to history/NNN; a copy that was cut off is never taken for a state.

    Raises:
        OutputError: no room, or no permission.
    """
    numbers = [int(path.name) for path in states(folder)]
    target = folder / HISTORY / f"{max(numbers, default=-1) + 1:03d}"
    half = target.with_name(f".{target.name}.part")
    try:
        shutil.rmtree(half, ignore_errors=True)
        make_folder(half)
        for name in FILES:
            if (folder / name).is_file():
                shutil.copy2(folder / name, half / name)
        for name in FOLDERS:
            if (folder / name).is_dir():
                shutil.copytree(folder / name, half / name)
        half.rename(target)
    except OSError as error:
        raise output_error(target, error) from error
    return target


def rollback(folder: Path) -> Path:
    """Brings the latest kept state back and takes it out of the history; returns what it was called.

    Raises:
        FormatError: nothing is kept. OutputError: it cannot be written.
    """
    kept = states(folder)
    if not kept:
        raise FormatError(f"'{folder}' has no earlier state", "There is nothing to roll back")
    state = kept[-1]
    try:
        for name in FILES:
            if (state / name).is_file():
                shutil.copy2(state / name, folder / f".{name}.part")
                (folder / f".{name}.part").replace(folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        for name in FOLDERS:
            if (state / name).is_dir():
                shutil.rmtree(folder / name, ignore_errors=True)
                shutil.copytree(state / name, folder / name)
        shutil.rmtree(state)
    except OSError as error:
        raise output_error(folder, error) from error
    return state


def note_facts(folder: Path, facts: dict[str, Any]) -> None:
    """Writes what `read_facts` reads."""
    write_json(folder / FACTS, facts)
