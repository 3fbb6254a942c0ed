"""Every reader on damaged files: a result or an explained error; never a traceback, an abort, a hang or a full memory.

A reader gets a valid file that was changed at random (`damage`). It reads in a child process, so that an abort, a hang
and the memory are seen from outside.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import signal
import struct
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from ...core.errors import DgsError
from ...core.files import write_json
from .damage import Damage

#: A reader that takes longer hangs (s).
HANG_SECONDS = 10.0
#: A reader may take so much memory beyond what the process has (bytes).
MEMORY_BYTES = 2**30
#: Files that one child reads; a child that dies costs the rest of its files a new child.
FILES_A_CHILD = 200
_IN_MEMORY = Path("/dev/shm")
#: Which file, what came of it, the seconds and the bytes that it took.
_MARK = struct.Struct("<iBdQ")
_READ, _REFUSED, _TRACEBACK, _MEMORY = 1, 2, 3, 4


@dataclass(frozen=True)
class Reader:
    """One reader and how to make it a valid file.

    Attributes:
        name: shown in the table.
        write: makes a valid file or folder at the path.
        read: reads it; ends with a result or a `DgsError`.
        file: the name of the file that is damaged, below the path.
        damage: changes its content; formats with checksums are damaged inside them.
        forgives: whether it takes whatever it finds, because what is damaged can be found or made again.
    """

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], object]
    file: str
    damage: Damage
    forgives: bool = False


@dataclass
class ReaderFuzz:
    """What came of one reader's files.

    Attributes:
        reader: its name.
        files: how many were read.
        read, refused: with a result, with an explained error.
        tracebacks, aborts, hangs, greedy: what must not be; greedy asked for more memory than there is.
        worst: the seeds and last words of the first few that must not be.
        slowest: seconds of one file, which is number `slowest_file`; seconds: of all, with making them.
        largest: bytes that one file took, number `largest_file`, beyond what the process has.
    """

    reader: str
    files: int = 0
    read: int = 0
    refused: int = 0
    tracebacks: int = 0
    aborts: int = 0
    hangs: int = 0
    greedy: int = 0
    worst: list[str] = field(default_factory=list)
    slowest: float = 0.0
    slowest_file: int = 0
    seconds: float = 0.0
    largest: int = 0
    largest_file: int = 0

    @property
    def faults(self) -> int:
        """Files that were not read as they should be."""
        return self.tracebacks + self.aborts + self.hangs + self.greedy


def in_memory() -> Path | None:
    """Where files lie in memory, for `tempfile`; None where the system has no such place: a disk would be the brake."""
    return _IN_MEMORY if _IN_MEMORY.is_dir() else None


def fuzz_reader(
    reader: Reader,
    files: int,
    folder: Path,
    seed: int = 0,
    cancelled: Callable[[], bool] = bool,
    result: ReaderFuzz | None = None,
    kept: Callable[[ReaderFuzz], None] = lambda _: None,
) -> ReaderFuzz:
    """Reads damaged files with one reader, until there were `files`.

    Args:
        reader: which.
        files: how many.
        folder: for the files; one at a time is there.
        seed: of the damages; file i of a seed is always the same.
        cancelled: whether to stop between two children.
        result: of files that were read before, to go on from.
        kept: gets the result after each child.
    """
    place = folder / "sample"
    reader.write(place)
    original = (place / reader.file).read_bytes()
    reader.read(place)  # what it loads and compiles is loaded once, and a valid file is no error
    result = ReaderFuzz(reader.name) if result is None else result
    while result.files < files and not cancelled():
        began = time.perf_counter()
        indices = range(result.files, min(files, result.files + FILES_A_CHILD))
        result.files += _one_child(reader, place, original, seed, indices, result)
        result.seconds += time.perf_counter() - began
        kept(result)
    return result


def _one_child(reader: Reader, place: Path, original: bytes, seed: int, indices: range, result: ReaderFuzz) -> int:
    """Lets a child read files until it ends; how many it took."""
    ready, report = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(ready)
        _child(reader, place, original, seed, indices, report)
    os.close(report)
    done = _watch(ready, place, indices, result)
    if done < len(indices):
        hung = os.waitpid(process, os.WNOHANG)[0] == 0 and select.select([ready], [], [], 0.5)[0] == []
        if hung:
            os.kill(process, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):  # (it was waited for above)
            os.waitpid(process, 0)
        result.hangs, result.aborts = result.hangs + hung, result.aborts + (not hung)
        _note(result, f"{indices[done]}: {'hangs' if hung else 'the process ended'}")
        done += 1
    else:
        os.waitpid(process, 0)
    os.close(ready)
    return done


def _watch(ready: int, place: Path, indices: range, result: ReaderFuzz) -> int:
    """Counts what the child reports until it is done, hangs or ends; how many files it reported."""
    for done, index in enumerate(indices):
        readable, _, _ = select.select([ready], [], [], HANG_SECONDS)
        data = os.read(ready, _MARK.size) if readable else b""
        if len(data) < _MARK.size:
            return done
        _, verdict, seconds, memory = _MARK.unpack(data)
        result.slowest, result.slowest_file = max((result.slowest, result.slowest_file), (seconds, index))
        result.largest, result.largest_file = max((result.largest, result.largest_file), (memory, index))
        result.read += verdict == _READ
        result.refused += verdict == _REFUSED
        result.tracebacks += verdict == _TRACEBACK
        result.greedy += verdict == _MEMORY
        if verdict in (_TRACEBACK, _MEMORY):
            _note(result, f"{index}: {_last_words(place, index)}")
    return len(indices)


def _note(result: ReaderFuzz, text: str) -> None:
    if len(result.worst) < 10:
        result.worst.append(text)


def _words_file(place: Path, index: int) -> Path:
    return place.with_name(f"last_words_{index}.txt")


def _last_words(place: Path, index: int) -> str:
    lines = _words_file(place, index).read_text("utf-8", "replace").strip().splitlines()
    return " | ".join(line.strip()[:160] for line in lines[-3:])


def _child(reader: Reader, place: Path, original: bytes, seed: int, indices: range, report: int) -> None:
    """Reads the files and reports each; never returns."""
    try:
        _silence()
        for index in indices:
            content = reader.damage(original, np.random.default_rng([seed, index]))
            (place / reader.file).write_bytes(content)
            del content
            _forget_peak()
            before, began = _memory("VmRSS"), time.perf_counter()
            with _limited():  # (what makes a file may take more: some are a list of thousands of long texts)
                verdict = _verdict(reader, place, index)
            seconds, memory = time.perf_counter() - began, max(0, _memory("VmHWM") - before)
            os.write(report, _MARK.pack(index, verdict, seconds, memory))
    finally:
        os._exit(0)


def _verdict(reader: Reader, place: Path, index: int) -> int:
    """What comes of reading one file."""
    try:
        reader.read(place)
        return _READ
    except BaseException as error:  # noqa: BLE001  (whatever comes out besides what is explained is what is looked for)
        explained, greedy = isinstance(error, DgsError), _for_memory(error)
        if explained and not greedy:
            return _REFUSED
        _words_file(place, index).write_text("".join(traceback.format_exception(error)), "utf-8", "replace")
        return _MEMORY if greedy else _TRACEBACK


def _for_memory(error: BaseException) -> bool:
    """Whether an error was explained only because the memory of this process is limited."""
    cause = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return isinstance(error, MemoryError) or (cause is not None and _for_memory(cause))


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    """This process gets no more than `MEMORY_BYTES` beyond what it has."""
    with open("/proc/self/statm", encoding="ascii") as statm:
        now = int(statm.read().split()[0]) * resource.getpagesize()
    usual, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY_BYTES, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (usual, most))


def _silence() -> None:
    """Sends what is printed nowhere."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    warnings.simplefilter("ignore")


def _forget_peak() -> None:
    """The process's peak memory counts from now on."""
    with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")


def _memory(kind: str) -> int:
    """Bytes that this process has in memory (VmRSS), or had at most (VmHWM)."""
    with open("/proc/self/status", encoding="ascii", errors="replace") as file:
        for line in file:
            if line.startswith(kind):
                return int(line.split()[1]) * 1024
    return 0


def fuzz_line(result: ReaderFuzz) -> str:
    """One line of the table."""
    faults = f"{result.tracebacks} tracebacks, {result.aborts} aborts, {result.hangs} hangs, {result.greedy} greedy"
    return (
        f"{result.reader:<22}{result.files:>6} files: {result.read} read, {result.refused} refused; "
        f"{faults if result.faults else 'fine'}; slowest {result.slowest:.2f} s, largest {result.largest / 1e6:.0f} MB"
    )


def markdown(results: list[ReaderFuzz], machine: str) -> str:
    """All readers as a table."""
    files, seconds = sum(one.files for one in results), sum(one.seconds for one in results)
    faults = sum(one.faults for one in results)
    return "\n".join(
        [
            f"{len(results)} readers, {files:,} files in {seconds:.0f} s on {machine}, one process at a time: "
            f"{sum(one.read for one in results):,} were read, {sum(one.refused for one in results):,} refused with "
            f"their reason, {faults} ended otherwise.",
            "",
            "| reader | files | read | refused | tracebacks | aborts | hangs | greedy | slowest, s | most memory, MB "
            "| all, s |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
            *(
                f"| {r.reader} | {r.files} | {r.read} | {r.refused} | {r.tracebacks} | {r.aborts} | {r.hangs} | "
                f"{r.greedy} | {r.slowest:.2f} | {r.largest / 1e6:.0f} | {r.seconds:.0f} |"
                for r in results
            ),
            "",
        ]
    )


class FuzzRecord:
    """What came of readers so far, in a file, so that a long fuzz can be interrupted and goes on.

    Args:
        path: of the file; None keeps nothing.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.results: dict[str, ReaderFuzz] = {}
        if path is not None and path.is_file():
            try:
                rows = json.loads(path.read_text("utf-8"))
                self.results = {row["reader"]: ReaderFuzz(**row) for row in rows}
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise DgsError(f"'{path}' is no record of a fuzz ({error})", "Delete it") from error

    def keep(self, result: ReaderFuzz) -> None:
        """Raises OutputError."""
        self.results[result.reader] = result
        if self._path is not None:
            write_json(self._path, [asdict(one) for one in self.results.values()])
