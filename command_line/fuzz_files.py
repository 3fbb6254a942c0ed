"""`stress --fuzz-files`: damaged files for every reader of the program."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import DgsError
from ..core.machine import machine, use_machine
from ..core.npy import load_npy
from ..core.outputs import check_outputs, note_output
from ..dgs_addon.job.preview import read_preview
from ..dgs_addon.job.record import Record, read_record
from ..dgs_addon.job.worker import event_of
from ..studies.stability import table
from ..studies.stability.damage import damaged, damaged_npy
from ..studies.stability.fuzzed_readers import readers
from ..studies.stability.reader_fuzz import FuzzRecord, Reader, ReaderFuzz, fuzz_line, fuzz_reader, in_memory, markdown


@dataclass(frozen=True)
class FuzzFiles:
    """What is asked for.

    Attributes:
        files: for each reader.
        words: only readers whose name holds one; all where there is none.
        record: file that keeps what came of each reader, to go on from; None for none.
    """

    files: int
    words: list[str]
    record: Path | None = None


def all_readers() -> list[Reader]:
    """Those of `core`, and the add-on's."""
    return [*readers(), _job(), _preview(), _known(), _events()]


def fuzz_files(asked: FuzzFiles, say: Callable[[str], None], cancelled: Callable[[], bool]) -> list[ReaderFuzz]:
    """Lets every reader read damaged files, and says a line or more for each reader.

    Returns:
        One result per reader; the rest are left out where it is cancelled.

    Raises:
        DgsError: the system has no fork, or no reader has such a name.
    """
    if sys.platform == "win32":
        raise DgsError("Damaged files are read in forked processes, which Windows has not", "Use Linux or macOS")
    words = [word.lower() for word in asked.words]
    chosen = [one for one in all_readers() if not words or any(word in one.name.lower() for word in words)]
    if not chosen:
        names = ", ".join(one.name for one in all_readers())
        raise DgsError(f"No reader is called '{' or '.join(asked.words)}'", f"Readers are: {names}")
    record = FuzzRecord(asked.record)
    found = []
    for reader in chosen:
        with tempfile.TemporaryDirectory(dir=in_memory()) as folder:
            before = record.results.get(reader.name)
            found.append(
                fuzz_reader(reader, asked.files, Path(folder), cancelled=cancelled, result=before, kept=record.keep)
            )
        say(fuzz_line(found[-1]))
        for line in found[-1].worst:
            say(f"    file {line}")
        if cancelled():
            break
    return found


def check_document(document: Path, overwrite: bool) -> None:
    """Raises OutputError where the tables would replace somebody else's file."""
    if not table.takes_tables(document):
        check_outputs([document], overwrite=overwrite)


def write_document(document: Path, results: list[ReaderFuzz], threads: int | None) -> None:
    """Puts the table between the marks of a document; raises OutputError."""
    here = table.described(machine(use_machine(threads), "cpu"))
    table.write_markdown(document, markdown(results, here))
    note_output(document)


def _job() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        photos = str((place / "photos").absolute())
        Record("reconstruct", photos, 12, {}, "done", "a.png", 123, "", {"steps": 7}).save(place)

    def read(place: Path) -> object:
        record = read_record(place)
        return record is not None and record.interrupted

    return Reader("job.json", write, read, "job.json", damaged)


def _preview() -> Reader:
    """The picture that Blender's panel shows while a job runs."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        np.save(place / "preview.npy", np.full((30, 40, 3), 100, np.uint8))

    return Reader(
        "preview.npy", write, _explained(lambda p: read_preview(p / "preview.npy")), "preview.npy", damaged_npy
    )


def _known() -> Reader:
    """How far photos fix each splat's colour, for Blender."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        np.save(place / "known.npy", np.linspace(0, 1, 40, dtype=np.float32))

    return Reader("known.npy", write, _explained(lambda p: load_npy(p / "known.npy")), "known.npy", damaged_npy)


def _events() -> Reader:
    """Lines that the engine writes to Blender, which other programs may write into."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        (place / "events").write_text('{"event": "stage", "name": "train", "total": 300}\n', "utf-8")

    def read(place: Path) -> object:
        for line in (place / "events").read_text("utf-8", "replace").splitlines():
            event_of(line)
        return "read"

    return Reader("events of a job", write, read, "events", damaged, forgives=True)


def _explained(read: Callable[[Path], object]) -> Callable[[Path], object]:
    """A reader whose caller explains what it raises."""

    def inner(place: Path) -> object:
        try:
            return read(place)
        except (OSError, ValueError) as error:
            raise DgsError(str(error)) from error

    return inner
