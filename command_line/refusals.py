"""Which failures of the system are the user's to mend, and which are bugs of ours."""

from __future__ import annotations

import errno
import os
import sysconfig
from collections.abc import Iterable
from pathlib import Path

from ..core.errors import DgsError, OutputError
from ..core.names import shown

#: What a system refuses however right the program is: permissions, full or failing disks, names, folders for files.
_REFUSALS = frozenset(
    getattr(errno, name)
    for name in (
        *("EACCES", "EPERM", "EROFS", "ENOSPC", "EDQUOT", "EFBIG", "EIO", "ENAMETOOLONG", "ELOOP", "ENOTDIR"),
        *("EISDIR", "ESTALE", "EBUSY", "ETXTBSY", "ENODEV", "ENXIO", "EMFILE", "ENFILE"),
    )
    if hasattr(errno, name)
)
_CODE = Path(__file__).resolve().parents[1]
#: Folders that only this program and its packages write.
_OURS = tuple(
    [_CODE / name for name in ("core", "studies", "command_line", "dgs_addon", "operators", "panels")]
    + [Path(sysconfig.get_path(kind)).resolve() for kind in ("stdlib", "purelib")]
)


def refusal(error: OSError, given: Iterable[Path]) -> str:
    """What the system refused, in a line; '' where the failure is a bug.

    A file that is part of the program is never the user's to mend. A file that is not there, or there already, is the
    user's where it lies in what the user gave: elsewhere only the program can have expected it.

    Args:
        error: what no part of the program has explained.
        given: files and folders that the user named.
    """
    if not isinstance(error.filename, (str, bytes)):
        return ""
    name = os.fsdecode(error.filename)
    file = Path(name).absolute()
    if any(file.is_relative_to(folder) for folder in _OURS):
        return ""
    if error.errno not in _REFUSALS and not any(file.is_relative_to(path.absolute()) for path in given):
        return ""
    return _line(error)


def denial(error: DgsError) -> str:
    """A line in the place of an error's own where a file was called damaged that may only not be read; '' elsewhere."""
    cause = error.__cause__
    if isinstance(error, OutputError) or not isinstance(cause, PermissionError):
        return ""
    return _line(cause) if isinstance(cause.filename, (str, bytes)) else ""


def _line(error: OSError) -> str:
    name = shown(os.fsdecode(error.filename))[:200]
    return f"'{name}': {(error.strerror or str(error)).lower()}. Check the path, its permissions and the disk."
