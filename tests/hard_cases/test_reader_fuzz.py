"""Every reader on 200 damaged files: a result or an explained error, never a traceback, an abort or a hang."""

import os
import signal
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import pytest
from dgs.command_line.fuzz_files import all_readers
from dgs.core.errors import DgsError, FormatError
from dgs.studies.stability import reader_fuzz
from dgs.studies.stability.damage import damaged
from dgs.studies.stability.reader_fuzz import FuzzRecord, Reader, ReaderFuzz, fuzz_line, fuzz_reader, in_memory

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs fork")


@pytest.mark.parametrize("reader", all_readers(), ids=lambda reader: reader.name)
def test_damaged_files(reader):
    with tempfile.TemporaryDirectory(dir=in_memory()) as name:
        folder = Path(name)
        reader.write(folder / "good")
        assert reader.read(folder / "good") is not None
        found = fuzz_reader(reader, 200, folder)
    assert found.files == 200
    assert not found.faults, "\n".join([fuzz_line(found), *found.worst])
    assert found.read, "all were refused"
    if not reader.forgives:
        assert found.refused, "none was refused: nothing was damaged"


def reader_that(read):
    def write(place):
        place.mkdir(exist_ok=True)
        (place / "a").write_bytes(b"1234567890")

    return Reader("made up", write, lambda place: read((place / "a").read_bytes()), "a", damaged)


def explodes(data):
    raise KeyError(data)


def hoards(data):
    try:
        return bytearray(3 * 2**30)
    except MemoryError as error:
        raise FormatError("too large") from error


def unless_valid(read):
    return reader_that(lambda data: read(data) if data != b"1234567890" else "fine")


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (explodes, "tracebacks"),
        (hoards, "greedy"),
        (lambda data: os.kill(os.getpid(), signal.SIGSEGV), "aborts"),
        (lambda data: time.sleep(60), "hangs"),
    ],
)
def test_what_a_reader_must_not_do_is_seen(read, kind, tmp_path, monkeypatch):
    monkeypatch.setattr(reader_fuzz, "HANG_SECONDS", 1.0 if kind == "hangs" else 10.0)
    found = fuzz_reader(unless_valid(read), 3, tmp_path)
    assert getattr(found, kind) == found.faults == 3 and found.worst


def test_what_it_takes_to_make_a_file_is_not_the_readers(tmp_path, monkeypatch):
    """A list of thousands of long texts, which did not fit into the memory of its reader, counted as an abort."""
    monkeypatch.setattr(reader_fuzz, "MEMORY_BYTES", 2**26)
    usual = reader_that(lambda data: len(data))
    found = fuzz_reader(replace(usual, damage=lambda content, _: content + bytes(2**28)[:9]), 3, tmp_path)
    assert (found.read, found.faults) == (3, 0)


def test_memory_and_time_of_a_file_are_measured(tmp_path):
    def slow(data):
        time.sleep(0.1)
        return bytes(50 * 2**20) + data

    found = fuzz_reader(reader_that(slow), 3, tmp_path)
    assert found.slowest > 0.1 and 45e6 < found.largest < 200e6 and not found.faults


def test_a_fuzz_goes_on_where_it_stopped(tmp_path):
    whole = fuzz_reader(reader_that(lambda data: data[:5].decode("ascii")), 300, tmp_path)
    record = FuzzRecord(tmp_path / "record.json")
    fuzz_reader(reader_that(lambda data: data[:5].decode("ascii")), 100, tmp_path, kept=record.keep)
    before = FuzzRecord(tmp_path / "record.json").results["made up"]
    assert before.files == 100
    again = fuzz_reader(reader_that(lambda data: data[:5].decode("ascii")), 300, tmp_path, result=before)
    assert (again.files, again.read, again.tracebacks) == (300, whole.read, whole.tracebacks)
    (tmp_path / "record.json").write_text("[1]")
    with pytest.raises(DgsError, match="no record"):
        FuzzRecord(tmp_path / "record.json")


#: Files that were read in another way than they should: by reader, their numbers.
FOUND = {
    "kernel .npy": [883, 924],
    "kernel .png": [1766],
    "photo .png": [4322],
    "photo .tif": [1907],
    "16-bit photo .tif": [711, 775, 1303, 1462],
    "runs of a machine": [2170, 2491],
}


@pytest.mark.parametrize("name", FOUND)
def test_files_that_were_found(name):
    """They asked for up to 960 GiB, or left NaN where none can be written."""
    (reader,) = [one for one in all_readers() if one.name == name]
    for number in FOUND[name]:
        with tempfile.TemporaryDirectory(dir=in_memory()) as folder:
            before = ReaderFuzz(name, files=number)
            found = fuzz_reader(reader, number + 1, Path(folder), result=before)
        assert not found.faults, "\n".join(found.worst)
