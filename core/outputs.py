"""Outputs never replace what somebody else made: what this program wrote is listed in its folder, by its content.

`.dgs-written` has a line for each file, as `sha256sum` writes it. A file that is not there, or was changed since, is
the user's: it is replaced only where `--overwrite` allows it. What a command reads is never replaced.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import ForeignFiles, OutputError
from .files import file_digest, make_folder, output_error, replacing
from .lock import working_on
from .transaction import changing

#: The list's name in each folder that something was written to.
LIST = ".dgs-written"
#: What the add-on writes into a job's folder before the engine starts (`dgs_addon/job/record.py`).
JOB_FILES = frozenset({"job.json", "job.log"})
#: Seconds that a command waits for another one that is just placing files in the same folder.
OTHERS_WAIT = 10.0
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


@contextmanager
def placing_output(file: Path) -> Iterator[Path]:
    """A temporary path to write to; it takes the place of `file`, which the folder's list then names as this program's.

    The list comes first: a run that is cut off in between may be asked for again, and replaces the file.

    Raises:
        OutputError: no room, or no permission; `file` is as it was.
    """
    with replacing(file) as temporary:
        yield temporary
        _append(file.parent, _line(temporary, file.name))


@contextmanager
def placing_outputs(folder: Path, task: str, note: Callable[[str], None]) -> Iterator[Path]:
    """A folder to write files into; all of them come to stand in `folder` and in its list, or none.

    Args:
        folder: made if missing; nobody else works on it meanwhile.
        task, note: as for `working_on`.

    Raises:
        FolderInUse: another process works on it. OutputError: no room, or no permission; `folder` is as it was.
    """
    with working_on(folder, task, note, OTHERS_WAIT), changing(folder) as change:
        yield change.content
        written = sorted(file.relative_to(change.content) for file in change.content.rglob("*") if file.is_file())
        for inside in sorted({file.parent for file in written}):
            lines = (_line(change.content / file, file.name) for file in written if file.parent == inside)
            listed, text = _listed(folder / inside), "".join(lines)
            change.new((inside / LIST).as_posix()).write_bytes(listed + text.encode("utf-8"))
        for file in written:
            change.new(file.as_posix())


def note_output(file: Path) -> None:
    """Keeps in the folder's list that this program wrote a file; raises OutputError."""
    _append(file.parent, _line(file, file.name))


def _line(file: Path, name: str) -> str:
    return f"{file_digest(file)}  {name}\n"


def _append(folder: Path, text: str) -> None:
    try:
        broken = len(_listed(folder)) - (folder / LIST).stat().st_size if (folder / LIST).is_file() else 0
        with (folder / LIST).open("a", encoding="utf-8") as file:
            file.write("\n" * broken + text)
    except OSError as error:
        raise output_error(folder / LIST, error) from error


def _listed(folder: Path) -> bytes:
    """The list so far, whose last line is ended where a run was cut off in it."""
    if not (folder / LIST).is_file():
        return b""
    listed = (folder / LIST).read_bytes()
    return listed if not listed or listed.endswith(b"\n") else listed + b"\n"


def _is_ours(file: Path) -> bool:
    try:
        lines = (file.parent / LIST).read_text("utf-8", "replace").splitlines()
        return file.is_file() and f"{file_digest(file)}  {file.name}" in lines
    except OSError:
        return False
