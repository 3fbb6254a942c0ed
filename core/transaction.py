"""Changes of several files in a folder that happen together or not at all.

New files are written beside, in `.change-next`; one rename to `.change-commit` decides; then each is put in its place
by a rename. A process that dies before the deciding rename has changed nothing; what one that died after it left
undone is completed by `recover`, which whoever opens the folder calls first. Nothing after the decision needs room on
the disk. A file is never missing in between; a folder that is replaced is, for the time between two renames.

    with changing(folder) as change:
        write_ply(change.new("twin.ply"), cloud)
        change.remove("update.json")
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from .errors import OutputError
from .files import make_folder, output_error, read_json, sync_file, sync_folder, write_json
from .json_shape import check_shape, count, text

#: What is being written, and what is decided but not yet all in its place.
NEXT, COMMIT = ".change-next", ".change-commit"
#: In both: the new content, what was taken out of the way, and the list of both.
CONTENT, OUTGOING, LIST = "new", "old", "list.json"
#: Raised whenever the list changes its meaning.
FORMAT = 1
#: What the list holds: names that are put in their place, and names that go.
_LISTS = {"format": count, "place": [text], "remove": [text]}


class FolderChange:
    """One change of a folder that is being prepared; made by `changing`.

    Args:
        folder: the folder that will be changed.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._next = folder, folder / NEXT
        self._placed: list[str] = []
        self._removed: list[str] = []

    def new(self, name: str) -> Path:
        """Where to write the new file or folder that will stand at `name` (relative, with slashes)."""
        checked = _inside(name)
        if checked not in self._placed:
            self._placed.append(checked)
        target = self._next / CONTENT / checked
        make_folder(target.parent)
        return target

    @property
    def content(self) -> Path:
        """The folder in which everything new is written; what lies in it only counts once `new` has named it."""
        return self._next / CONTENT

    def remove(self, name: str) -> None:
        """`name` (a file or a folder) will be gone; it need not be there."""
        self._removed.append(_inside(name))

    def commit(self) -> None:
        """Decides and puts everything in its place.

        Raises:
            OutputError: before the decision, the folder is as it was; after it, `recover` completes the change.
        """
        for name in self._placed:
            if not (self._next / CONTENT / name).exists():
                raise OutputError(f"'{name}' was announced and not written", "Report this as a bug")
        lists = {"format": FORMAT, "place": self._placed, "remove": self._removed}
        write_json(self._next / LIST, lists)
        try:
            _sync_tree(self._next / CONTENT)
            os.rename(self._next, self._folder / COMMIT)
            sync_folder(self._folder)
        except OSError as error:
            raise output_error(self._folder, error) from error
        _complete(self._folder)

    def discard(self) -> None:
        """Nothing of it will have happened."""
        shutil.rmtree(self._next, ignore_errors=True)


@contextmanager
def changing(folder: Path) -> Iterator[FolderChange]:
    """A change of `folder` that is committed when the block ends well, and discarded when it does not.

    Raises:
        OutputError: the disk is full, or the place cannot be written to.
    """
    recover(folder)
    make_folder(folder / NEXT / CONTENT)
    change = FolderChange(folder)
    try:
        yield change
        change.commit()
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        change.discard()


def recover(folder: Path) -> str | None:
    """Undoes or completes what a process that died left behind.

    Returns:
        what was done, in one sentence, or None if there was nothing to do.

    Raises:
        OutputError: the folder cannot be written to, or the list of the change is damaged.
    """
    try:
        if (folder / COMMIT).is_dir():
            done = (folder / COMMIT / LIST).is_file()
            _complete(folder)
            return f"A change of '{folder}' that had been cut off was completed" if done else None
        if (folder / NEXT).is_dir():
            shutil.rmtree(folder / NEXT)
            return f"A change of '{folder}' that had been cut off was undone"
    except OSError as error:
        raise output_error(folder, error) from error
    return None


def _complete(folder: Path) -> None:
    """Puts everything of a decided change in its place; may be called again after any step of it."""
    commit = folder / COMMIT
    if not (commit / LIST).is_file():
        if any(path.is_file() for path in (commit / CONTENT).rglob("*")):
            raise _damaged(commit / LIST, "it is gone")
        shutil.rmtree(commit, ignore_errors=True)  # everything was in its place: only the remains were left
        return
    lists = _read_list(commit / LIST)
    try:
        for name in lists["place"]:
            fresh = commit / CONTENT / name
            if fresh.exists():  # else it is in its place already
                make_folder((folder / name).parent)
                if fresh.is_dir() or (folder / name).is_dir():
                    _take_away(folder / name, commit / OUTGOING / name)
                os.replace(fresh, folder / name)
        for name in lists["remove"]:
            _take_away(folder / name, commit / OUTGOING / name)
        for parent in sorted({(folder / name).parent for name in lists["place"]} | {folder}):
            if parent.is_dir():
                sync_folder(parent)
        (commit / LIST).unlink()  # from here on only remains are left
    except OSError as error:
        raise output_error(folder, error) from error
    shutil.rmtree(commit, ignore_errors=True)


def _take_away(old: Path, outgoing: Path) -> None:
    """Moves `old`, if it is there, to `outgoing`."""
    if not old.exists() and not old.is_symlink():
        return
    if outgoing.exists():
        shutil.rmtree(outgoing) if outgoing.is_dir() else outgoing.unlink()
    make_folder(outgoing.parent)
    os.rename(old, outgoing)


def _read_list(path: Path) -> dict[str, list[str]]:
    try:
        lists = read_json(path)
        check_shape(lists, _LISTS)
        if lists["format"] != FORMAT:
            raise ValueError(f"format {lists['format']}")
        return {key: [_inside(name) for name in lists[key]] for key in ("place", "remove")}
    except (OSError, ValueError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, why: object) -> OutputError:
    return OutputError(
        f"'{path}', the list of an unfinished change, is damaged ({why})",
        f"Look into '{path.parent}': its '{CONTENT}' holds the new files, its '{OUTGOING}' the old ones",
    )


def _inside(name: str) -> str:
    """A relative name that stays inside the folder."""
    pure = PurePosixPath(name)
    if not pure.parts or pure.is_absolute() or ".." in pure.parts or "\\" in name or ":" in pure.parts[0]:
        raise ValueError(f"'{name}' is no name inside a folder")
    return pure.as_posix()


def _sync_tree(folder: Path) -> None:
    """Everything below is on the disk, not only in its cache."""
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            sync_file(path)
        elif path.is_dir():
            sync_folder(path)
    sync_folder(folder)
