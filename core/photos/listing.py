"""Photos that a text file names."""

from __future__ import annotations

import os
import unicodedata
from pathlib import Path

from ..errors import PhotoError
from ..names import check_photo_name, shown

#: Ending of a list of photos.
LIST = ".txt"


def listed_files(path: Path) -> list[Path]:
    """The files that a list names, one a line, relative to the list's own folder; sorted by name.

    Empty lines and lines that begin with # do not count.

    Raises:
        PhotoError: the list cannot be read or is empty, a file is missing, or two have the same name.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise PhotoError(f"The list '{path}' cannot be read ({error})", "Save it as UTF-8 text") from error
    wanted = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    files: dict[str, Path] = {}
    for line in wanted:
        file = path.parent / line
        name = unicodedata.normalize("NFC", file.name)
        if not os.path.isfile(file):  # (a path's own method raises where the name is too long)
            raise PhotoError(f"'{path.name}' names '{shown(line[:200])}', which is not there", "Correct the list")
        if name in files and files[name].resolve() != file.resolve():
            raise PhotoError(f"'{path.name}' names two photos '{name}'", "Give every photo its own name")
        check_photo_name(file)
        files[name] = file
    if not files:
        raise PhotoError(f"The list '{path}' names no photos", "Write one file name a line into it")
    return [files[name] for name in sorted(files)]
