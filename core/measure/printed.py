"""A marker board as it is printed: rectangles of exact size, as a picture or as a PDF."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from PIL import Image

from ..errors import FormatError
from ..files import check_writable
from ..numbers import BY_DEFINITION, number
from ..outputs import check_outputs, placing_output
from .boards import DICTIONARIES, MarkerBoard, chessboard_of, code_of, dictionary_of
from .lengths import MILLIMETRES

#: What a board can be written as.
SUFFIXES = (".png", ".pdf")
#: mm of an inch, of which printers count their dots.
_INCH = MILLIMETRES["in"]


@dataclass(frozen=True)
class SheetSettings:
    """Of a sheet of markers."""

    loose: int = number(6, "count", "markers on a sheet where no numbers are given", BY_DEFINITION)
    gap: float = number(0.5, "sides", "of white between loose markers: each must be cut out, or seen apart")
    margin: float = number(0.25, "sides", "of white around all: a marker is found by the white about it")
    smallest: float = number(1.0, "mm", "shortest side of a sheet", BY_DEFINITION)
    largest: float = number(2000.0, "mm", "longest side of a sheet: what plotters print", BY_DEFINITION)
    most_px: int = number(20_000, "px", "along a side of a picture", BY_DEFINITION)
    fewest: float = number(4.0, "px", "of a marker's cell: fewer lose its size to rounding")


SHEET = SheetSettings()


@dataclass(frozen=True)
class Box:
    """A rectangle in mm from the sheet's upper left corner; painted in order."""

    x: float
    y: float
    width: float
    height: float
    black: bool


@dataclass(frozen=True)
class Sheet:
    """What is printed: mm."""

    width: float
    height: float
    boxes: tuple[Box, ...]
    cell: float


def sheet_of(board: MarkerBoard) -> Sheet:
    """The printed sheet; raises FormatError where it has no size, or none that can be printed."""
    mm = MILLIMETRES.get(board.unit)
    if mm is None:
        raise FormatError(f"'{board.text}' is in '{board.unit}', whose size is not known", "Give it in mm, cm, m or in")
    side, cells = board.side * mm, int(dictionary_of(board).markerSize) + 2
    if board.is_chessboard:
        placed, squares, inner = _chessboard(board, mm)
    else:
        placed, squares, inner = _loose(board, side)
    margin = SHEET.margin * side
    boxes = [Box(x + margin, y + margin, w, w, True) for x, y, w in squares]
    for marker, (x, y) in placed.items():
        boxes += _marker(board, marker, x + margin, y + margin, side)
    sheet = Sheet(inner[0] + 2 * margin, inner[1] + 2 * margin, tuple(boxes), side / cells)
    sides = sorted((sheet.width, sheet.height))
    if not SHEET.smallest <= sides[0] <= sides[1] <= SHEET.largest:
        size = f"{sheet.width:.3g} x {sheet.height:.3g} mm"
        raise FormatError(
            f"The sheet of '{board.text}' has {size}, not {SHEET.smallest:g} to {SHEET.largest:g} mm along a side",
            "Give a board of another size, or other markers",
        )
    return sheet


def write_sheet(board: MarkerBoard, out: Path, dpi: float, overwrite: bool = False) -> Sheet:
    """Writes the board; a PDF has no px.

    Args:
        dpi: dots per inch of a picture.

    Raises:
        FormatError: it cannot be printed so. OutputError: it cannot be written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise FormatError(f"'{out.name}' is nothing that a board is written as", f"End it with {' or '.join(SUFFIXES)}")
    sheet = sheet_of(board)
    check_outputs([out], (), overwrite)
    check_writable(out.parent)
    picture = None if out.suffix.lower() == ".pdf" else picture_of(sheet, dpi)
    with placing_output(out) as temporary:
        if picture is None:
            _write_pdf(sheet, temporary)
        else:
            Image.fromarray(picture).save(temporary, "PNG", dpi=(dpi, dpi))
    return sheet


def picture_of(sheet: Sheet, dpi: float) -> NDArray[np.uint8]:
    """[H, W] grey values; each edge lies within half a px of its place. Raises FormatError."""
    scale = dpi / _INCH
    if sheet.cell * scale < SHEET.fewest:
        least = math.ceil(SHEET.fewest * _INCH / sheet.cell)
        raise FormatError(f"At {dpi:g} dpi a marker's cell is {sheet.cell * scale:.1f} px", f"Give --dpi {least}")
    if max(sheet.width, sheet.height) * scale > SHEET.most_px:
        raise FormatError(
            f"The picture would have more than {SHEET.most_px} px along a side", "Give a lower --dpi, or write a PDF"
        )
    width, height = round(sheet.width * scale), round(sheet.height * scale)
    picture = np.full((height, width), 255, np.uint8)
    for box in sheet.boxes:
        left, top = round(box.x * scale), round(box.y * scale)
        right, below = round((box.x + box.width) * scale), round((box.y + box.height) * scale)
        picture[top:below, left:right] = 0 if box.black else 255
    return picture


def _write_pdf(sheet: Sheet, path: Path) -> None:
    """One page of the sheet's own size, in exact rectangles."""
    figure = Figure((sheet.width / _INCH, sheet.height / _INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, sheet.width), ylim=(sheet.height, 0.0))
    axes.set_axis_off()
    for box in sheet.boxes:
        colour = "black" if box.black else "white"
        axes.add_patch(Rectangle((box.x, box.y), box.width, box.height, facecolor=colour, linewidth=0))
    FigureCanvasPdf(figure).print_pdf(path)


def _chessboard(
    board: MarkerBoard, mm: float
) -> tuple[dict[int, tuple[float, float]], list[tuple[float, float, float]], tuple[float, float]]:
    """Where markers lie (upper left corners), the black squares (corner, side), and the size of all; mm."""
    found, square = chessboard_of(board), board.square * mm
    placed = {
        int(marker): (float(corners[:, 0].min()) * mm, float(corners[:, 1].min()) * mm)
        for marker, corners in zip(found.getIds().ravel(), found.getObjPoints(), strict=True)
    }
    white = {(int(x // square), int(y // square)) for x, y in placed.values()}
    cells = [(column, row) for row in range(board.rows) for column in range(board.columns)]
    squares = [(column * square, row * square, square) for column, row in cells if (column, row) not in white]
    return placed, squares, (board.columns * square, board.rows * square)


def _loose(
    board: MarkerBoard, side: float
) -> tuple[dict[int, tuple[float, float]], list[tuple[float, float, float]], tuple[float, float]]:
    """As `_chessboard`; there are no squares."""
    first, last = board.numbers or (0, min(SHEET.loose, DICTIONARIES[board.dictionary]) - 1)
    count = last - first + 1
    columns = math.ceil(math.sqrt(count))
    step = side * (1 + SHEET.gap)
    placed = {first + index: (index % columns * step, index // columns * step) for index in range(count)}
    rows = math.ceil(count / columns)
    return placed, [], (columns * step - SHEET.gap * side, rows * step - SHEET.gap * side)


def _marker(board: MarkerBoard, marker: int, x: float, y: float, side: float) -> Iterator[Box]:
    """A black square, and the white of its code in it: a box for each run of cells."""
    white = code_of(board, marker)
    cells = len(white)
    cell = side / cells
    yield Box(x, y, side, side, True)
    for row in range(cells):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], white[row].astype(np.int8), [0]])))
        for start, end in edges.reshape(-1, 2):
            yield Box(x + start * cell, y + row * cell, (end - start) * cell, cell, False)
