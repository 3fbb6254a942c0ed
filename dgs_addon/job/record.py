"""job.json beside the results: what a later Blender needs to know of a job. Knows no Blender.

The file may come from anybody. It is data, never a command: `options` says which values it may hold.
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

from ...core.errors import FormatError
from ...core.files import read_json, write_json
from ...core.json_shape import anything, check_shape, count, sentence, text
from ...core.names import fault_of, shown
from .options import RESUMABLE, Options, absolute_path, check_options, options_of

NAME = "job.json"
LOG = "job.log"
#: Bytes of it that are read: the names of ten thousand chosen photos have room.
_LARGEST = 2**20
#: By how much the system's clocks of files and of processes may differ (s).
_CLOCKS = 2.0


@dataclass
class Record:
    """A job as it was asked for, and how it ended.

    Attributes:
        kind: as in `Request`.
        photos: folder of the photos, or the movie; absolute.
        count: photos in it when the job began.
        options: what else was asked for, as `options.OPTIONS` names it; {} of a job that is not resumed.
        selection: names of the photos that count, one a line; '' for all of the folder.
        phase: as in `JobState`; one that says 'running' while no process does was interrupted.
        pid: of the engine's process.
        error, result: as in `JobState`.
        written: when its file was written (s since 1970); not in the file.
    """

    kind: str
    photos: str
    count: int
    options: Options = field(default_factory=dict)
    phase: str = "running"
    selection: str = ""
    pid: int | None = None
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)
    written: float = math.inf

    def save(self, out: Path) -> None:
        """Writes OUT/job.json; raises OutputError."""
        write_json(out / NAME, {name: value for name, value in asdict(self).items() if name != "written"})

    @property
    def interrupted(self) -> bool:
        """Whether its process ended and nothing says how: Blender was closed, killed, or lost power."""
        return self.phase in ("running", "paused", "cancelling") and not _lives(self.pid, self.written)


def _process(value: object) -> bool:
    """A number that a process can have."""
    return count(value) and 0 < cast(int, value) < 2**31


def _chosen_names(value: object) -> bool:
    """Names of files, one a line, and no paths."""
    names = value.splitlines() if isinstance(value, str) else ["/"]
    return all(name not in ("", ".", "..") and not fault_of(name) and not set("/\\") & set(name) for name in names)


#: What job.json holds, and nothing else.
_SHAPE = {
    "kind": frozenset((*RESUMABLE, "synthesize", "update", "change")),
    "photos": absolute_path,
    "count": count,
    "options?": {"*": anything},
    "arguments?": [text],  # of an earlier version
    "phase?": frozenset(("running", "paused", "cancelling", "done", "cancelled", "failed")),
    "selection?": _chosen_names,
    "pid?": (_process,),
    "error?": sentence,
    "result?": {"registered?": sentence, "*": anything},
}
_NAMES = {key.rstrip("?") for key in _SHAPE}
#: What was read last, or what was wrong with it, by file and time of its last change: a panel asks at every redraw.
_cache: dict[tuple[Path, int], Record | FormatError] = {}


def read_record(out: Path) -> Record | None:
    """What OUT/job.json says; None if there is none.

    Raises:
        FormatError: the file is damaged, or asks for what no job of this add-on does.
    """
    try:
        written = (out / NAME).stat().st_mtime_ns
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise FormatError(f"'{out / NAME}' cannot be read ({error.strerror})", "Check its permissions") from error
    key = (out, written)
    if key not in _cache:
        _cache.clear()
        _cache[key] = _read(out / NAME, written * 1e-9)
    found = _cache[key]
    if isinstance(found, FormatError):
        raise found
    return found


def _read(path: Path, written: float) -> Record | FormatError:
    try:
        record = _record(read_json(path, _LARGEST))
        record.written = written
        return record
    except (OSError, ValueError) as error:
        return FormatError(
            f"'{path}' is damaged, or no job of this add-on ({error})", "Press Optimize to begin anew, or delete it"
        )


def _record(value: Any) -> Record:
    """The record in a file's content; raises ValueError."""
    check_shape(value, _SHAPE)
    others = sorted(value.keys() - _NAMES)
    if others:
        raise ValueError(f"it holds '{shown(others[0])[:40]}', which no job has")
    arguments = value.pop("arguments", None)
    if value["kind"] not in RESUMABLE:
        value["options"] = {}
    elif arguments is not None and "options" not in value:
        value["options"] = options_of(arguments)
    check_options(value["kind"], value.get("options", {}))
    return Record(**value)


def _lives(pid: int | None, written: float) -> bool:
    """Whether the process that a record names works on; one that began after the record was written is another."""
    # Windows has no harmless signal; there, a job that is not ours counts as ended.
    if pid is None or sys.platform == "win32":
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    state, began = _process_facts(pid)
    return state not in ("Z", "X") and began <= written + _CLOCKS


def _process_facts(pid: int) -> tuple[str, float]:
    """Its state's letter and when it began (s since 1970), where the system says so; else '' and 0."""
    try:
        facts = Path(f"/proc/{pid}/stat").read_text("ascii", "replace").rpartition(")")[2].split()
        booted = next(line for line in Path("/proc/stat").read_text("ascii").splitlines() if line.startswith("btime"))
        return facts[0], float(booted.split()[1]) + float(facts[19]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError, StopIteration):
        return "", 0.0
