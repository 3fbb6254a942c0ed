"""Every reader on 200 damaged files: a result or an explained error, never a traceback, an abort or a hang."""

import sys

import pytest
from dgs.command_line.fuzz_files import all_readers
from dgs.studies.stability.reader_fuzz import fuzz_line, fuzz_reader

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs fork")


@pytest.mark.parametrize("reader", all_readers(), ids=lambda reader: reader.name)
def test_damaged_files(reader, tmp_path):
    reader.write(tmp_path / "good")
    assert reader.read(tmp_path / "good") is not None
    found = fuzz_reader(reader, 200, tmp_path)
    assert found.files == 200
    assert not found.faults, "\n".join([fuzz_line(found), *found.worst])
    assert found.read, "all were refused"
    if reader.name not in ("features", "mask"):  # found again; the photo is left out with a note
        assert found.refused, "none was refused: nothing was damaged"
