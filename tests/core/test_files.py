"""Files are whole or absent, and a full disk is a sentence."""

import errno
import os

import pytest
from dgs.core.errors import OutputError
from dgs.core.files import check_writable, make_folder, replacing, write_json, write_text


def test_writes_and_replaces(tmp_path):
    write_text(tmp_path / "new" / "a ü.txt", "one")
    write_text(tmp_path / "new" / "a ü.txt", "two ü")
    assert (tmp_path / "new" / "a ü.txt").read_text("utf-8") == "two ü"
    assert len(list((tmp_path / "new").iterdir())) == 1


def test_a_full_disk_names_the_file_and_keeps_the_old(tmp_path):
    write_text(tmp_path / "report.json", "old")
    with (
        pytest.raises(OutputError, match=r"report\.json.*no space.*Free some space"),
        replacing(tmp_path / "report.json") as temporary,
    ):
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert (tmp_path / "report.json").read_text() == "old"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs Linux's /dev/full")
def test_a_really_full_device(tmp_path):
    (tmp_path / "probe").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="twin"), replacing(tmp_path / "twin") as temporary:
        temporary.symlink_to("/dev/full")
        temporary.write_bytes(b"data")


def test_other_errors_pass_and_leave_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "a") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_a_folder(tmp_path):
    (tmp_path / "out").write_text("")
    for act in (make_folder, check_writable):
        with pytest.raises(OutputError, match="out"):
            act(tmp_path / "out")
    check_writable(tmp_path / "fresh")
    assert list((tmp_path / "fresh").iterdir()) == []


def test_json_refuses_what_json_cannot_hold(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"psnr": float("nan")})
