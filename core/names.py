"""Names that come from files: names of files, never paths to somewhere else."""

from __future__ import annotations

import errno
import stat
import unicodedata
from pathlib import Path

from .errors import DgsError, PhotoError

#: Bytes of a file's name that every file system takes.
_LONGEST = 255


def shown(text: object) -> str:
    """A name as a message can hold it: what is no text is written out, such as a line break as backslash n."""
    name = str(text)
    return name if not fault_of(name) else name.encode("unicode_escape", "backslashreplace").decode("ascii")


def fault_of(name: str) -> str:
    """What hinders a name from being kept in our files: '' if nothing does."""
    if not _is_unicode(name):
        return "is not UTF-8"
    if len(name.splitlines()) > 1 or any(unicodedata.category(c) in ("Cc", "Zl", "Zp") for c in name):
        return "holds a line break or another control character"
    return ""


def _is_unicode(name: str) -> bool:
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def check_photo_name(file: Path) -> None:
    """Refuses a photo whose name could not be kept in a twin's list of photos or its camera model.

    Raises:
        PhotoError: it is not UTF-8, or holds control characters or a backslash, in its name or its folder's.
    """
    fault = fault_of(str(file.absolute())) or ("holds a backslash" if "\\" in file.name else "")
    if fault:
        named = file if fault_of(str(file)) or "\\" in file.name else file.absolute()
        raise PhotoError(f"The name of the photo '{shown(named)}' {fault}", "Rename it, or its folder")


def check_given(path: Path) -> None:
    """Refuses a path that a user gave where nothing but a file or a folder can be meant; it need not be there.

    Raises:
        DgsError: no file can have the name, its links lead in a circle, or it is a device or a pipe, which may never
            end.
    """
    try:
        mode = path.stat().st_mode
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise DgsError(f"'{shown(path)[:60]}...' is longer than a file's name can be", "Give another") from error
        if error.errno == errno.ELOOP:
            raise DgsError(f"'{shown(path)}' is a link that leads to itself", "Give the file that is meant") from error
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise DgsError(f"'{shown(path)}' is neither a file nor a folder", "Copy what it gives into a file")


def inner_name(text: str) -> str:
    """A name from a camera model without what leads out of its folder: 'cam1/a.png' stays, '../../a.png' is 'a.png'.

    Raises:
        ValueError: nothing is left, or no file can have the name.
    """
    fault = fault_of(text)
    if fault:
        raise ValueError(f"the image name '{shown(text)}' {fault}")
    bare = text.replace("\\", "/")
    drive, colon, rest = bare.partition(":")
    if colon and len(drive) == 1 and drive.isalpha():
        bare = rest
    parts = [part for part in bare.split("/") if part.strip(" .")]
    if not parts or any(len(part.encode("utf-8")) > _LONGEST for part in parts):
        raise ValueError(f"the image name '{text[:40]}' is no file's name")
    return "/".join(parts)
