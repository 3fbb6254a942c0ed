"""Outputs never replace what somebody else made: what this program wrote is listed in its folder, by its content.

`.dgs-written` has a line for each file, as `sha256sum` writes it. A file that is not there, or was changed since, is
the user's: it is replaced only where `--overwrite` allows it. What a command reads is never replaced.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from .errors import ForeignFiles, OutputError
from .files import make_folder, output_error

#: The list's name in each folder that something was written to.
LIST = ".dgs-written"
#: What the add-on writes into a job's folder before the engine starts (`dgs_addon/job/record.py`).
JOB_FILES = frozenset({"job.json", "job.log"})
_WAY_OUT = "Give another --out, or allow it with --overwrite"


def check_outputs(files: Iterable[Path], inputs: Iterable[Path] = (), overwrite: bool = False) -> None:
    """Refuses to write files in the place of what this program did not write.

    Args:
        files: that will be written.
        inputs: files that are read meanwhile, which nothing ever replaces.
        overwrite: the user allowed to replace the files of others.

    Raises:
        ForeignFiles: one of them is somebody else's. OutputError: one is an input, or a folder.
    """
    read = {path.resolve() for path in inputs}
    there = [file for file in files if os.path.lexists(file)]
    for file in there:
        if file.resolve() in read:
            raise OutputError(f"'{file}' is read by this command and would be replaced", "Give another --out")
        if file.is_dir():
            raise OutputError(f"'{file}' is a folder; a file would be written there", "Give another name")
    others = [] if overwrite else [file for file in there if not _is_ours(file)]
    if others:
        more = f" (and {len(others) - 1} more files)" if len(others) > 1 else ""
        raise ForeignFiles(
            f"'{others[0]}'{more} is there already and was not written by this program, or changed since", _WAY_OUT
        )


def check_output_folder(
    folder: Path, marks: Iterable[str], overwrite: bool = False, replaced: Iterable[str] | None = None
) -> None:
    """Refuses a folder with content that this program did not write; changes nothing.

    Args:
        folder: where many files will be written; need not be there.
        marks: names of files or folders that only this command leaves there.
        overwrite: the user allowed to replace the files of others.
        replaced: names that will be written, where all else in the folder is left alone; None: everything may be.

    Raises:
        ForeignFiles: it holds something else.
    """
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    seen = {name for name in names - JOB_FILES if not name.startswith(".")}
    if replaced is not None:
        seen &= set(replaced)
    if seen and not overwrite and LIST not in names and not names & set(marks):
        named = f", such as '{min(seen)}'"
        raise ForeignFiles(f"The folder '{folder}' holds files that this program did not write{named}", _WAY_OUT)


def asks_to_overwrite(line: str) -> bool:
    """Whether a command ended with this line because of the files of others, so that --overwrite would help."""
    return line.rstrip(". ").endswith(_WAY_OUT)


def claim_output_folder(folder: Path) -> None:
    """Marks a folder, made if missing, as one that this program writes into; raises OutputError."""
    _append(make_folder(folder), "")


def note_output(file: Path) -> None:
    """Keeps in the folder's list that this program wrote a file; raises OutputError."""
    _append(file.parent, f"{_digest(file)}  {file.name}\n")


def _append(folder: Path, text: str) -> None:
    try:
        with (folder / LIST).open("a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise output_error(folder / LIST, error) from error


def _is_ours(file: Path) -> bool:
    try:
        lines = (file.parent / LIST).read_text("utf-8", "replace").splitlines()
        return file.is_file() and f"{_digest(file)}  {file.name}" in lines
    except OSError:
        return False


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
