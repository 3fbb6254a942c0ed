"""Printed markers whose size is known: loose squares (ArUco), or a chessboard with markers in its white squares.

aruco:40mm                      markers of 40 mm, of the usual dictionary
aruco:5x5_100,40+-0.1mm,20-25   of another one, how exactly they were printed, and only those with these numbers
charuco:7x5,30mm,22mm           7 columns and 5 rows of squares of 30 mm, markers of 22 mm
charuco:4x4_50,7x5,30mm,22mm
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from .lengths import parsed_length
from .opencv import opencv_with_markers

Array = NDArray[np.float64]

#: Dictionaries of markers, and how many markers each has; OpenCV's names without 'DICT_'.
DICTIONARIES: Mapping[str, int] = {
    **{f"{cells}x{cells}_{count}": count for cells in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "aruco_original": 1024,
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
}
#: The fewest and largest cells, so that they are read on the smallest photos.
USUAL = "4x4_50"
#: Squares along a side of a chessboard, at least and at most.
_SQUARES = (2, 100)
_WAY_OUT = "Write aruco:4x4_50,40mm or charuco:4x4_50,7x5,30mm,22mm (docs/measure.md)"


@dataclass(frozen=True)
class MarkerBoard:
    """What was printed.

    Attributes:
        text: as it was asked for.
        dictionary: of its markers, one of `DICTIONARIES`.
        side: of a marker, in `unit`.
        deviation: standard deviation of `size`, in `unit`.
        unit: name of all its lengths' unit.
        numbers: first and last of the markers that are meant; None: all.
        columns, rows, square: squares of a chessboard, and their side in `unit`; 0 where markers are loose.
    """

    text: str
    dictionary: str
    side: float
    deviation: float
    unit: str
    numbers: tuple[int, int] | None = None
    columns: int = 0
    rows: int = 0
    square: float = 0.0

    @property
    def is_chessboard(self) -> bool:
        """Whether markers lie in a chessboard, whose corners are what is measured."""
        return self.columns > 0

    @property
    def size(self) -> float:
        """The length that was printed, in `unit`: a square's side, or a marker's."""
        return self.square if self.is_chessboard else self.side

    def means(self, marker: int) -> bool:
        """Whether a marker of this number is one of those that are meant."""
        if self.is_chessboard:
            return marker < self.columns * self.rows // 2
        return self.numbers is None or self.numbers[0] <= marker <= self.numbers[1]


def parsed_board(asked: str) -> MarkerBoard:
    """The board that a text names; raises FormatError."""
    kind, _, rest = asked.strip().partition(":")
    words = [word.strip() for word in rest.split(",")]
    named = words[0].lower().removeprefix("dict_")
    dictionary = named if named in DICTIONARIES else USUAL
    words = words[1:] if named in DICTIONARIES else words
    try:
        if kind.lower() == "aruco" and len(words) in (1, 2):
            return _loose(asked, dictionary, words)
        if kind.lower() == "charuco" and len(words) == 3:
            return _chessboard(asked, dictionary, words)
    except ValueError as error:
        raise FormatError(f"'{asked}' is no marker board: {error}", _WAY_OUT) from error
    raise FormatError(f"'{asked}' is no marker board", _WAY_OUT)


def _loose(asked: str, dictionary: str, words: list[str]) -> MarkerBoard:
    side, deviation, unit = parsed_length(words[0])
    board = MarkerBoard(asked, dictionary, side, deviation, unit)
    if len(words) == 1:
        return board
    match = re.fullmatch(r"(\d{1,6})(?:-(\d{1,6}))?", words[1])
    if match is None:
        raise ValueError(f"'{words[1]}' are no numbers of markers such as 20-25")
    first, last = int(match[1]), int(match[2] or match[1])
    if not first <= last < DICTIONARIES[dictionary]:
        raise ValueError(f"the dictionary {dictionary} has the markers 0 to {DICTIONARIES[dictionary] - 1}")
    return replace(board, numbers=(first, last))


def _chessboard(asked: str, dictionary: str, words: list[str]) -> MarkerBoard:
    match = re.fullmatch(r"(\d{1,4})\s*[xX]\s*(\d{1,4})", words[0])
    if match is None:
        raise ValueError(f"'{words[0]}' are no columns and rows such as 7x5")
    columns, rows = int(match[1]), int(match[2])
    square, deviation, unit = parsed_length(words[1])
    side, _, other = parsed_length(words[2])
    if other != unit:
        raise ValueError(f"its lengths are in {unit} and in {other}")
    if not side < square:
        raise ValueError("its markers are no smaller than its squares (first the square, then the marker)")
    if min(columns, rows) < _SQUARES[0] or max(columns, rows) > _SQUARES[1]:
        raise ValueError(f"it has {_SQUARES[0]} to {_SQUARES[1]} squares along each side")
    if columns * rows // 2 > DICTIONARIES[dictionary]:
        raise ValueError(f"the dictionary {dictionary} has too few markers for it")
    return MarkerBoard(asked, dictionary, side, deviation, unit, None, columns, rows, square)


def dictionary_of(board: MarkerBoard) -> Any:
    """OpenCV's own object."""
    aruco = opencv_with_markers().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{board.dictionary.upper()}"))


def chessboard_of(board: MarkerBoard) -> Any:
    """OpenCV's own object; its lengths in the board's unit."""
    size = (board.columns, board.rows)
    return opencv_with_markers().aruco.CharucoBoard(size, board.square, board.side, dictionary_of(board))


def code_of(board: MarkerBoard, marker: int) -> NDArray[np.bool_]:
    """[cells, cells] where a marker is white; its outermost cells are black."""
    dictionary = dictionary_of(board)
    cells = int(dictionary.markerSize) + 2
    return np.asarray(opencv_with_markers().aruco.generateImageMarker(dictionary, marker, cells) > 0)


def marker_corners(side: float) -> Array:
    """[4, 2] corners of a marker from its upper left one, clockwise as it is read; x to the right, y down."""
    return side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
