"""Corners of printed markers on one picture, between px.

OpenCV finds and names the markers. A corner of a loose marker is where the straight lines along its sides meet, each
through the middles of the edge's rise across it: a blur that is the same to both sides does not move them, while it
rounds the corner itself. Ink that spreads, and a blur in light of what is displayed otherwise, make all that is black
larger or smaller: by how much is read off the edges within the marker, of which half look the other way. Corners of a
chessboard are saddles, which nothing of this moves; OpenCV refines them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ..evaluation.profiles import Sampler
from ..numbers import number
from .boards import MarkerBoard, chessboard_of, code_of, dictionary_of
from .opencv import opencv_with_markers

Array = NDArray[np.float64]
#: A marker's number and its corner (0 to 3 from its upper left one, clockwise); `CHESS` and the corner's number.
Corner = tuple[int, int]
#: Stands for a marker's number where corners are those of a chessboard.
CHESS = -1


@dataclass(frozen=True)
class MarkerSettings:
    """Of the search on one picture."""

    longest: float = number(1600.0, "px", "to which small pictures are enlarged before markers are sought")
    enlarged: float = number(4.0, "times", "at most: larger ones show no smaller markers")
    smoothed: float = number(
        0.7, "px", "standard deviation of the Gaussian before edges are read, which px alone would make jagged"
    )
    stations: int = number(15, "count", "places along a marker's side where its edge is looked for")
    spared: float = number(0.18, "sides", "beside each corner, where the blur rounds the edge")
    reach: float = number(0.8, "cells", "to both sides of an edge; one cell inwards, the marker's code begins")
    shortest: float = number(1.5, "px", "the same at least")
    within: float = number(0.55, "cells", "to both sides of an edge within a marker")
    beside: tuple[float, ...] = number((-0.25, 0.0, 0.25), "cells", "beside a cell's middle where such an edge is read")
    step: float = number(0.25, "px", "between samples across an edge")
    rounds: int = number(3, "count", "of the search, each about the lines that the last one found")
    moved: float = number(1.0, "cells", "that a corner may move from where the detector has it; else there is no edge")
    straight: float = number(1.0, "px", "rms that an edge's middles may lie off its line")


SETTINGS = MarkerSettings()


@dataclass(frozen=True)
class FoundCorners:
    """What one picture shows.

    Attributes:
        corners: (x, y) px by corner; pixel centres lie at +0.5.
        twice: markers that it shows more than once, whose corners are left out.
        spread: px that all black of a marker reaches too far on every side.
    """

    corners: dict[Corner, tuple[float, float]]
    twice: frozenset[int] = frozenset()
    spread: dict[int, float] = field(default_factory=dict)


def found_corners(board: MarkerBoard, grey: NDArray[np.float32]) -> FoundCorners:
    """Corners of a board's markers, and of its squares.

    Args:
        grey: [H, W] as displayed (sRGB), in [0, 1].
    """
    larger = min(SETTINGS.enlarged, max(1.0, SETTINGS.longest / max(grey.shape)))
    chess, markers = _detected(board, _enlarged(grey, larger), larger)
    counted = Counter(marker for marker, _ in markers)
    twice = frozenset(marker for marker, count in counted.items() if count > 1)
    sampler, cells = Sampler.of(gaussian_filter(grey, SETTINGS.smoothed)), int(dictionary_of(board).markerSize) + 2
    found, spread = dict(chess), dict[int, float]()
    for marker, coarse in markers:
        exact = None if marker in twice or not board.means(marker) else _by_sides(sampler, coarse, cells)
        if exact is not None:
            found |= {(marker, index): (float(x), float(y)) for index, (x, y) in enumerate(exact)}
            px = _spread(sampler, exact, code_of(board, marker))
            spread |= {} if px is None else {marker: px}
    return FoundCorners(found, frozenset(filter(board.means, twice)), spread)


def _enlarged(grey: NDArray[np.float32], larger: float) -> NDArray[np.uint8]:
    cv2 = opencv_with_markers()
    size = (round(grey.shape[1] * larger), round(grey.shape[0] * larger))
    picture = grey if larger == 1.0 else cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(picture * 255.0 + 0.5, 0, 255), np.uint8)


def _detected(
    board: MarkerBoard, picture: NDArray[np.uint8], larger: float
) -> tuple[dict[Corner, tuple[float, float]], list[tuple[int, Array]]]:
    """Corners of the chessboard, and number and corners [4, 2] of each marker; px of the picture as it was."""
    aruco = opencv_with_markers().aruco
    chess: dict[Corner, tuple[float, float]] = {}
    if board.is_chessboard:
        at, numbers, corners, markers = aruco.CharucoDetector(chessboard_of(board)).detectBoard(picture)
        for index, place in zip(_flat(numbers), [] if at is None else at, strict=True):
            x, y = (np.asarray(place, np.float64).ravel() + 0.5) / larger
            chess[CHESS, index] = (float(x), float(y))
    else:
        corners, markers, _ = aruco.ArucoDetector(dictionary_of(board)).detectMarkers(picture)
    placed = [(np.asarray(four, np.float64).reshape(4, 2) + 0.5) / larger for four in corners or ()]
    return chess, list(zip(_flat(markers), placed, strict=True))


def _flat(numbers: Any) -> list[int]:
    return [] if numbers is None else [int(value) for value in np.asarray(numbers).ravel()]


def _by_sides(sampler: Sampler, coarse: Array, cells: int) -> Array | None:
    """[4, 2] corners where the lines along a marker's sides meet; None where they are no edges."""
    corners = coarse
    cell = float(np.linalg.norm(np.roll(coarse, -1, axis=0) - coarse, axis=1).min()) / cells
    reach = max(SETTINGS.shortest, SETTINGS.reach * cell)
    for _ in range(SETTINGS.rounds):
        lines = [_line(sampler, corners[side], corners[(side + 1) % 4], reach) for side in range(4)]
        if any(line is None for line in lines):
            return None
        met = [_crossing(lines[side - 1], lines[side]) for side in range(4)]
        if any(one is None for one in met):
            return None
        corners = np.stack(met)  # type: ignore[arg-type]
        if float(np.linalg.norm(corners - coarse, axis=1).max()) > SETTINGS.moved * max(cell, SETTINGS.shortest):
            return None
    return corners


def _line(sampler: Sampler, start: Array, end: Array, reach: float) -> tuple[Array, Array] | None:
    """A point and the direction of the edge between two corners; None where nothing rises across it."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / max(length, 1e-9)
    outwards = np.array([along[1], -along[0]])  # (corners go clockwise, y is down: the white is there)
    at = length * np.linspace(SETTINGS.spared, 1 - SETTINGS.spared, SETTINGS.stations)
    across = np.arange(-reach, reach + SETTINGS.step / 2, SETTINGS.step)
    places = start + at[:, None, None] * along + across[None, :, None] * outwards
    if length < 2 * reach or not sampler.covers(places):
        return None
    rise = np.maximum(np.diff(sampler.at(places)[..., 0], axis=1), 0.0)
    total = rise.sum(axis=1)
    seen = total > 0.5 * np.median(total)
    if seen.sum() < 3 or not total.max() > 0:
        return None
    middles = (rise[seen] * (across[:-1] + SETTINGS.step / 2)).sum(axis=1) / total[seen]
    slope, offset = _straight(at[seen], middles)
    if float(np.sqrt(np.mean((middles - offset - slope * at[seen]) ** 2))) > SETTINGS.straight:
        return None
    return start + offset * outwards, along + slope * outwards


def _straight(at: Array, off: Array) -> tuple[float, float]:
    """Slope and offset of a line that a few wild places do not bend (Theil and Sen)."""
    first, second = np.triu_indices(len(at), 1)
    slope = float(np.median((off[second] - off[first]) / (at[second] - at[first])))
    return slope, float(np.median(off - slope * at))


def _crossing(first: Any, second: Any) -> Array | None:
    """[2] where two lines (point, direction) meet."""
    sides = np.stack([first[1], -second[1]], axis=1)
    if abs(float(np.linalg.det(sides))) < 1e-3:
        return None
    return np.asarray(first[0] + np.linalg.solve(sides, second[0] - first[0])[0] * first[1])


def _spread(sampler: Sampler, corners: Array, white: NDArray[np.bool_]) -> float | None:
    """px that black reaches too far on every side of a marker, from the edges of its code; None where none is seen.

    With b cells of it, an edge at X of N cells, black before it (p = 1) or behind it (p = -1), is seen between the
    outer edges at X + b (p + 1 - 2 X / N).
    """
    cells = len(white)
    to_px = opencv_with_markers().getPerspectiveTransform(_ends(cells), np.asarray(corners, np.float32))
    off, lever = list[float](), list[float]()
    for axis in (0, 1):
        code = white if axis == 0 else white.T
        rows, columns = np.nonzero(code[:, 1:] != code[:, :-1])
        for row, edge in zip(rows, columns + 1, strict=True):
            way = 1.0 if code[row, edge] else -1.0
            found = _edge_at(sampler, to_px, axis, float(edge), float(row), way)
            if found is not None:
                off.append(found - edge)
                lever.append(way + 1 - 2 * edge / cells)
    if not lever:
        return None
    levers = np.array(lever)
    side = float(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).mean())
    return float(levers @ np.array(off) / (levers @ levers)) * side / cells


def _ends(cells: int) -> NDArray[np.float32]:
    return np.array([[0, 0], [cells, 0], [cells, cells], [0, cells]], np.float32)


def _edge_at(sampler: Sampler, to_px: Array, axis: int, edge: float, row: float, way: float) -> float | None:
    """Where an edge within a marker lies along its row (axis 0) or column, in cells; None where none is seen."""
    steps = np.linspace(-SETTINGS.within, SETTINGS.within, 25)
    middle = edge
    for _ in range(SETTINGS.rounds):
        along, across = np.meshgrid(middle + steps, row + 0.5 + np.array(SETTINGS.beside))
        cells = np.stack([along, across] if axis == 0 else [across, along], axis=-1)
        places = cells @ to_px[:2, :2].T + to_px[:2, 2]
        places = places / (cells @ to_px[2, :2] + to_px[2, 2])[..., None]
        if not sampler.covers(places):
            return None
        rise = np.maximum(way * np.diff(sampler.at(places)[..., 0].mean(axis=0)), 0.0)
        if not rise.sum() > 0:
            return None
        middle = float(rise @ (middle + (steps[1:] + steps[:-1]) / 2) / rise.sum())
        if abs(middle - edge) > SETTINGS.within:
            return None
    return middle
