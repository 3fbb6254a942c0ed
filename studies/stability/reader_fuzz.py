"""Every reader on damaged files: a result or an explained error; never a traceback, an abort, a hang or a full memory.

A reader gets a valid file that was changed at random: bytes flipped, cut off, inserted, numbers replaced by extreme
ones, values of JSON by others of every type. It reads in a child process, so that an abort, a hang and the memory are
seen from outside.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import select
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import DgsError

#: A reader that takes longer hangs (s).
HANG_SECONDS = 10.0
#: A reader may take so much memory beyond what the process has (bytes).
MEMORY_BYTES = 2**30
#: Files that one child reads; a child that dies costs the rest of its files a new child.
FILES_A_CHILD = 100
#: What numbers in a text are replaced by.
NUMBERS = (b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"1e-320", b"99999999999999999999", b"2147483648", b"", b"x")
#: What words of 4 bytes in a binary file are replaced by.
WORDS = tuple(struct.pack("<I", value) for value in (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000, 0x7FC00000))
#: What values of a JSON file are replaced by.
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 10**400, 1e308, "", "x", "../../x", "\x00", "a\nb", "\ud800"),
    *([], {}, [[[]]], [None] * 3, {"x": {}}),
)
_NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?")
_MARK = struct.Struct("<iB")
_READ, _REFUSED, _TRACEBACK = 1, 2, 3


Damage = Callable[[bytes, np.random.Generator], bytes]


@dataclass(frozen=True)
class Reader:
    """One reader and how to make it a valid file.

    Attributes:
        name: shown in the table.
        write: makes a valid file or folder at the path.
        read: reads it; ends with a result or a `DgsError`.
        file: the name of the file that is damaged, below the path.
        damage: changes its content; formats with checksums are damaged inside them.
    """

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], object]
    file: str
    damage: Damage


@dataclass
class ReaderFuzz:
    """What came of one reader's files.

    Attributes:
        reader: its name.
        files: how many were read.
        read, refused: with a result, with an explained error.
        tracebacks, aborts, hangs: what must not be.
        worst: the seeds and last words of the first few that must not be.
        slowest: seconds.
    """

    reader: str
    files: int = 0
    read: int = 0
    refused: int = 0
    tracebacks: int = 0
    aborts: int = 0
    hangs: int = 0
    worst: list[str] = field(default_factory=list)
    slowest: float = 0.0

    @property
    def faults(self) -> int:
        """Files that were not read as they should be."""
        return self.tracebacks + self.aborts + self.hangs


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """One random damage, or a few, to a file's content."""
    if content[:1] in (b"{", b"[") and random.random() < 0.6:
        with contextlib.suppress(ValueError):
            return _damaged_json(json.loads(content), random)
    for _ in range(int(random.choice([1, 1, 1, 2, 5]))):
        content = _DAMAGES[int(random.integers(len(_DAMAGES)))](content, random)
    return content


def _flipped(content: bytes, random: np.random.Generator) -> bytes:
    out = bytearray(content)
    for at in random.integers(0, max(1, len(out)), int(random.choice([1, 2, 8, 64]))):
        if out:
            out[at % len(out)] ^= 1 << int(random.integers(8))
    return bytes(out)


def _cut(content: bytes, random: np.random.Generator) -> bytes:
    return content[: int(random.integers(0, len(content) + 1))]


def _removed(content: bytes, random: np.random.Generator) -> bytes:
    at, length = int(random.integers(0, len(content) + 1)), int(random.choice([1, 2, 4, 50, 1000]))
    return content[:at] + content[at + length :]


def _inserted(content: bytes, random: np.random.Generator) -> bytes:
    at, length = int(random.integers(0, len(content) + 1)), int(random.choice([1, 4, 50, 3000]))
    extra = random.bytes(length) if random.random() < 0.5 else content[at : at + length] * 2
    return content[:at] + extra + content[at:]


def _number(content: bytes, random: np.random.Generator) -> bytes:
    found = list(_NUMBER.finditer(content[:20000]))
    if not found:
        return _word(content, random)
    hit = found[int(random.integers(len(found)))]
    return content[: hit.start()] + NUMBERS[int(random.integers(len(NUMBERS)))] + content[hit.end() :]


def _word(content: bytes, random: np.random.Generator) -> bytes:
    # Headers decide most: half of the words are among the first hundred bytes.
    end = min(len(content), 100) if random.random() < 0.5 else len(content)
    at = int(random.integers(0, max(1, end)))
    return content[:at] + WORDS[int(random.integers(len(WORDS)))] + content[at + 4 :]


_DAMAGES = (_flipped, _cut, _removed, _inserted, _number, _word)


def _damaged_json(value: Any, random: np.random.Generator) -> bytes:
    if random.random() < 0.03:
        depth = int(random.choice([200, 5000, 200000]))
        return b"[" * depth + b"]" * depth
    places: list[tuple[Any, Any]] = []

    def collect(node: Any) -> None:
        for key in node if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], (dict, list)):
                collect(node[key])

    if isinstance(value, (dict, list)):
        collect(value)
    if not places or random.random() < 0.02:
        return json.dumps(VALUES[int(random.integers(len(VALUES)))]).encode("utf-8", "surrogatepass")
    node, key = places[int(random.integers(len(places)))]
    if isinstance(node, dict) and random.random() < 0.25:
        del node[key]
    else:
        node[key] = VALUES[int(random.integers(len(VALUES)))]
    return json.dumps(value).encode("utf-8", "surrogatepass")


def fuzz_reader(
    reader: Reader, files: int, folder: Path, seed: int = 0, cancelled: Callable[[], bool] = bool
) -> ReaderFuzz:
    """Reads `files` damaged files with one reader.

    Args:
        reader: which.
        files: how many.
        folder: for the files; one at a time is there.
        seed: of the damages; file i of a seed is always the same.
        cancelled: whether to stop between two children.
    """
    place = folder / "sample"
    reader.write(place)
    original, result, index = (place / reader.file).read_bytes(), ReaderFuzz(reader.name), 0
    while index < files and not cancelled():
        index += _one_child(reader, place, original, seed, range(index, min(files, index + FILES_A_CHILD)), result)
    result.files = index
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
    began = time.perf_counter()
    for done, index in enumerate(indices):
        readable, _, _ = select.select([ready], [], [], HANG_SECONDS)
        data = os.read(ready, _MARK.size) if readable else b""
        if len(data) < _MARK.size:
            return done
        now = time.perf_counter()
        result.slowest, began = max(result.slowest, now - began), now
        verdict = _MARK.unpack(data)[1]
        result.read += verdict == _READ
        result.refused += verdict == _REFUSED
        if verdict == _TRACEBACK:
            result.tracebacks += 1
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
        _limit()
        for index in indices:
            content = reader.damage(original, np.random.default_rng([seed, index]))
            (place / reader.file).write_bytes(content)
            try:
                reader.read(place)
                verdict = _READ
            except DgsError:
                verdict = _REFUSED
            except BaseException:  # noqa: BLE001  (whatever else comes out is what is looked for)
                words = "".join(traceback.format_exception(*sys.exc_info()))
                _words_file(place, index).write_text(words, "utf-8", "replace")
                verdict = _TRACEBACK
            os.write(report, _MARK.pack(index, verdict))
    finally:
        os._exit(0)


def _limit() -> None:
    """Limits the memory, and sends what is printed nowhere."""
    with open("/proc/self/statm", encoding="ascii") as statm:
        now = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY_BYTES, now + MEMORY_BYTES))
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    warnings.simplefilter("ignore")


def fuzz_line(result: ReaderFuzz) -> str:
    """One line of the table."""
    faults = f"{result.tracebacks} tracebacks, {result.aborts} aborts, {result.hangs} hangs"
    return (
        f"{result.reader:<22}{result.files:>6} files: {result.read} read, {result.refused} refused; "
        f"{faults if result.faults else 'fine'}; slowest {result.slowest:.2f} s"
    )
