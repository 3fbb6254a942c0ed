"""Marker boards as text, and as they are printed."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.errors import DgsError, FormatError
from dgs.core.measure.boards import DICTIONARIES, MarkerBoard, chessboard_of, dictionary_of, parsed_board
from dgs.core.measure.opencv import opencv_with_markers
from dgs.core.measure.printed import SHEET, picture_of, sheet_of, write_sheet
from dgs.core.measure.request import KnownLength, parsed_request
from PIL import Image


def test_a_board_says_what_was_printed() -> None:
    assert parsed_board("aruco:40mm") == MarkerBoard("aruco:40mm", "4x4_50", 40.0, 0.0, "mm")
    some = parsed_board("ArUco: DICT_5x5_100, 40+-0.1mm, 20-25")
    assert (some.dictionary, some.side, some.deviation, some.unit) == ("5x5_100", 40.0, 0.1, "mm")
    assert [some.means(number) for number in (19, 20, 25, 26)] == [False, True, True, False]
    assert parsed_board("aruco:4cm,7").numbers == (7, 7)
    board = parsed_board("charuco:7x5,30mm,22mm")
    assert (board.columns, board.rows, board.square, board.side, board.size) == (7, 5, 30.0, 22.0, 30.0)
    assert board.is_chessboard and not some.is_chessboard
    assert parsed_board("charuco:apriltag_36h11,7x5,3cm,2.2cm").dictionary == "apriltag_36h11"


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ("", "no marker board"),
        ("aruco", "no marker board"),
        ("aruco:4x4_50", "'4x4_50' is no length|no marker board"),
        ("aruco:40", "no length"),
        ("aruco:0mm", "makes no sense"),
        ("aruco:-4mm", "no length"),
        ("aruco:nanmm", "no length"),
        ("aruco:40+-40mm", "makes no sense"),
        ("aruco:9x9_50,40mm", "no length"),
        ("aruco:40mm,a-b", "no numbers"),
        ("aruco:40mm,9-5", "markers 0 to 49"),
        ("aruco:40mm,50", "markers 0 to 49"),
        ("charuco:7x5,30mm", "no marker board"),
        ("charuco:7,30mm,22mm", "no columns and rows"),
        ("charuco:1x5,30mm,22mm", "2 to 100 squares"),
        ("charuco:7x5,22mm,30mm", "no smaller"),
        ("charuco:7x5,3cm,22mm", "in cm and in mm"),
        ("charuco:20x20,30mm,22mm", "too few markers"),
        ("qr:40mm", "no marker board"),
    ],
)
def test_what_is_no_board_is_refused_with_the_way_out(asked: str, why: str) -> None:
    with pytest.raises(FormatError, match=why) as caught:
        parsed_board(asked)
    assert "Write aruco:" in str(caught.value) and "\n" not in str(caught.value)


def test_every_dictionary_is_opencvs_and_has_as_many_markers() -> None:
    for name, count in DICTIONARIES.items():
        assert len(dictionary_of(parsed_board(f"aruco:{name},4mm")).bytesList) == count, name


LENGTH = {"name": "edge", "kind": "length", "of": ["a", "b"]}
PLACES = {"a": {"photo": "a.png", "at": [8, 9]}, "b": {"photo": "a.png", "at": [20, 12]}}
KNOWN = {"measure": "edge", "value": 12, "unit": "mm"}


def asked(given: dict[str, Any] | None, **more: Any) -> Any:
    content = {"places": PLACES, "measures": [LENGTH]}
    return parsed_request(content if given is None else {**content, "scale": given}, **more)


def test_a_scale_is_a_known_length_or_a_board() -> None:
    assert asked({"board": "aruco:40mm"}).board == parsed_board("aruco:40mm")
    assert asked(KNOWN, board="aruco:40mm").board is not None and asked(KNOWN, board="aruco:40mm").scale is None
    found = asked({"board": "aruco:40mm"}, scale="edge=3mm")  # the command's comes first
    assert found.board is None and found.scale == KnownLength("edge", 3.0, 0.0, "mm")
    assert parsed_request({"measures": [], "scale": {"board": "aruco:40mm"}}).board is not None
    for scale, more, why in (
        ({**KNOWN, "board": "aruco:40mm"}, {}, "a known length and a board"),
        (None, {"scale": "edge=3mm", "board": "aruco:40mm"}, "from a known length and from a board"),
        ({"value": 3, "unit": "mm"}, {}, "scale.measure is missing"),
    ):
        with pytest.raises(ValueError, match=why):
            asked(scale, **more)
    with pytest.raises(FormatError, match="no marker board"):
        asked({"board": "aruco"})


def test_a_sheet_has_the_size_that_was_asked_for() -> None:
    sheet = sheet_of(parsed_board("charuco:7x5,3cm,2.2cm"))
    margin = SHEET.margin * 22.0
    assert np.isclose(sheet.width, 7 * 30 + 2 * margin) and np.isclose(sheet.height, 5 * 30 + 2 * margin)
    squares = [box for box in sheet.boxes if box.black and np.isclose(box.width, 30.0)]
    markers = [box for box in sheet.boxes if box.black and np.isclose(box.width, 22.0)]
    assert (len(squares), len(markers)) == (18, 17)
    loose = sheet_of(parsed_board("aruco:1in,3-4"))
    assert np.isclose(loose.width, 25.4 * (2 + SHEET.gap + 2 * SHEET.margin)) and np.isclose(loose.cell, 25.4 / 6)


def test_the_picture_is_what_opencv_draws() -> None:
    """Cell by cell, so that a board of any other program is the same one."""
    board = parsed_board("charuco:4x3,60mm,36mm")
    dots = 25.4  # a px is a mm
    ours = picture_of(sheet_of(board), dots)
    margin = round(SHEET.margin * 36)
    inner = ours[margin:-margin, margin:-margin]
    theirs = chessboard_of(board).generateImage((240, 180), marginSize=0)
    assert inner.shape == theirs.shape and np.mean(inner != theirs) < 0.001


def test_the_command_writes_a_picture_or_a_page_of_exact_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("b.png", "b.pdf"):
        assert run(["board", "aruco:40mm,0-3", "--out", str(tmp_path / name), "--dpi", "200"]) == 0
        assert "120.0 x 120.0 mm" in capsys.readouterr().out
    with Image.open(tmp_path / "b.png") as picture:
        assert np.allclose(picture.info["dpi"], 200, atol=0.1) and picture.width == round(120 / 25.4 * 200)
    page = (tmp_path / "b.pdf").read_bytes()
    box = page[page.index(b"/MediaBox") :].split(b"]")[0].split()[-2:]
    assert np.allclose([float(word) for word in box], 120 / 25.4 * 72, atol=0.01)
    assert run(["board", "aruco:40mm", "--out", str(tmp_path / "b.txt")]) == 2
    assert "End it with .png or .pdf" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "dpi", "why"),
    [
        ("aruco:4fathoms", 300.0, "whose size is not known"),
        ("aruco:3m", 300.0, "Give a board of another size"),
        ("aruco:0.0001mm", 300.0, "Give a board of another size"),
        ("aruco:4mm", 72.0, "Give --dpi 153"),
        ("aruco:300mm,0-3", 2400.0, "lower --dpi"),
    ],
)
def test_what_cannot_be_printed_is_refused(tmp_path: Path, text: str, dpi: float, why: str) -> None:
    with pytest.raises(FormatError, match=why):
        write_sheet(parsed_board(text), tmp_path / "b.png", dpi)
    assert list(tmp_path.iterdir()) == []


def test_without_opencv_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(DgsError, match="opencv-python-headless.*Install the engine again"):
        opencv_with_markers()
    monkeypatch.setattr(importlib, "import_module", lambda _: json)
    with pytest.raises(DgsError, match="finds no markers"):
        opencv_with_markers()
