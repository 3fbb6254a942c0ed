"""`stress --fuzz-files`: damaged files for every reader of the program."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ..core.errors import DgsError
from ..dgs_addon.job.record import Record, read_record
from ..studies.stability.fuzzed_readers import readers
from ..studies.stability.reader_fuzz import Reader, damaged, fuzz_line, fuzz_reader


def all_readers() -> list[Reader]:
    """Those of `core`, and the add-on's."""
    return [*readers(), _job()]


def fuzz_files(
    files: int, words: list[str], say: Callable[[str], None], cancelled: Callable[[], bool]
) -> tuple[int, int]:
    """Lets every reader read damaged files, and says a line or more for each reader.

    Args:
        files: for each reader.
        words: only readers whose name holds one; all where there is none.

    Returns:
        (readers, those with faults).

    Raises:
        DgsError: the system has no fork, or no reader has such a name.
    """
    if sys.platform == "win32":
        raise DgsError("Damaged files are read in forked processes, which Windows has not", "Use Linux or macOS")
    chosen = [one for one in all_readers() if not words or any(w.lower() in one.name.lower() for w in words)]
    if not chosen:
        names = ", ".join(one.name for one in all_readers())
        raise DgsError(f"No reader is called '{' or '.join(words)}'", f"Readers are: {names}")
    faulty = 0
    for reader in chosen:
        with tempfile.TemporaryDirectory() as folder:
            result = fuzz_reader(reader, files, Path(folder), cancelled=cancelled)
        faulty += bool(result.faults)
        say(fuzz_line(result))
        for line in result.worst:
            say(f"    file {line}")
        if cancelled():
            break
    return len(chosen), faulty


def _job() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        arguments = ["reconstruct", "photos", "--out", "twin"]
        Record("reconstruct", "photos", 12, arguments, "done", "a.png", 123, "", {"steps": 7}).save(place)

    def read(place: Path) -> object:
        record = read_record(place)
        return record is not None and record.interrupted

    return Reader("job.json", write, read, "job.json", damaged)
