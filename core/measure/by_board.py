"""The size of a twin's world from printed markers: where rays to their corners meet, against what was printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, DgsError
from ..numbers import number
from ..progress import Progress
from ..twin.opened import OpenedTwin
from .board_fit import Group, fit_size, median_ratio
from .boards import MarkerBoard, chessboard_of, marker_corners
from .corner_places import marks_of, placed
from .markers import CHESS, Corner, FoundCorners, found_corners
from .pictures import PICTURES, pictures_of
from .places import SurfacePoint
from .request import Point
from .sights import Sights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoardSettings:
    """Of the way from corners on photos to a scale."""

    edge: float = number(
        0.05,
        "px",
        "standard deviation of where all edges of loose markers lie, after what black reaches too far was taken off:"
        " the scale came out 0.24 % too small on sharp photos, a marker 32 px large",
        "the loose markers of benchmarks/marker_wall.py, cameras known",
    )
    edge_blur: float = number(
        0.02, "px per px of blur", "the same through a blur, which is inverted: 0.12 % through 3 px", "as of edge"
    )
    ratio: float = number(
        0.05, "share", "that a chessboard's markers may be off its squares by, else the print is another"
    )


SETTINGS = BoardSettings()
_MORE = "Take more photos that show it, from different sides"


@dataclass(frozen=True)
class BoardScale:
    """How large the unit of a print is in a twin.

    Attributes:
        board: what was printed.
        size, deviation: units of the print for each of the scene's own units, and its standard deviation.
        markers, corners, photos: how many it rests on.
        pictures: which of the photos' pictures show them: a key of `PICTURES`.
        residual_px: rms of the corners on photos about where their rays meet.
        residual: rms of the distances, in the board's unit.
        left_out: corners on photos, or corners, that did not agree with the others.
    """

    board: MarkerBoard
    size: float
    deviation: float
    markers: int
    corners: int
    photos: int
    pictures: str
    residual_px: float
    residual: float
    left_out: int

    def drawn(self, draws: int, generator: np.random.Generator) -> Array:
        """[1 + draws] sizes: the best guess, then as many that are as likely."""
        maybe = self.size + self.deviation * generator.standard_normal(draws)
        return np.concatenate([[self.size], np.maximum(maybe, 1e-3 * self.size)])

    def plain(self, world: float) -> dict[str, Any]:
        """For JSON.

        Args:
            world: size of the scene's own unit in the twin's world.
        """
        return {
            "board": self.board.text,
            "size": self.size / world,
            "deviation": self.deviation / world,
            "unit": self.board.unit,
            "pictures": self.pictures,
            **{name: getattr(self, name) for name in ("markers", "corners", "photos", "left_out")},
            **{name: round(getattr(self, name), 9) for name in ("residual_px", "residual")},
        }

    def sentence(self) -> str:
        """What it rests on, for a terminal."""
        return (
            f"Scale by {self.board.text}: {self.markers} markers on {self.photos} photos ({PICTURES[self.pictures]}), "
            f"off by {self.residual_px:.2f} px and {self.residual:.3g} {self.board.unit}; "
            f"the scale is known to {100 * self.deviation / self.size:.2g} %"
        )


def board_scale(board: MarkerBoard, twin: OpenedTwin, views: Sights, cameras: float, progress: Progress) -> BoardScale:
    """Finds a board on a twin's photos.

    Args:
        cameras: standard deviation of where cameras look, px.

    Raises:
        DgsError: it is not seen, on one photo only, or is not what was printed. Cancelled: the user asked to stop.
    """
    best: tuple[int, BoardScale] | None = None
    reasons = dict[str, DgsError]()
    for name in PICTURES:
        if name == "renders" and best is not None:
            break  # what a twin shows is itself made of the photos: only where these show nothing
        seen = _searched(board, name, twin, views, progress)
        if not seen:
            continue
        try:
            found = fitted(board, seen, views, cameras, views.blur)
        except DgsError as error:
            reasons[name] = error
            continue
        sightings = sum(len(one.corners) for one in seen.values())
        if best is None or sightings > best[0]:
            best = (sightings, replace(found, pictures=name))
    if best is None:
        raise _of_most_found(reasons)
    return best[1]


def _searched(
    board: MarkerBoard, kind: str, twin: OpenedTwin, views: Sights, progress: Progress
) -> dict[str, FoundCorners]:
    """What each photo shows of a board on pictures of one kind; empty where there are none of the kind."""
    found = dict[str, FoundCorners]()
    progress.stage("markers", len(views.views))
    for index, (name, grey) in enumerate(pictures_of(kind, twin, views)):
        if progress.cancelled():
            raise Cancelled(f"Stopped after {index} of {len(views.views)} photos; nothing was measured")
        found[name] = found_corners(board, grey)
        progress.advance(index + 1)
    return found


def _of_most_found(reasons: Mapping[str, DgsError]) -> DgsError:
    """Of why the kinds of pictures gave no scale: that of most that was found."""
    return max(reasons.values(), key=lambda error: getattr(error, "found", 0))


class _NoScale(DgsError):
    """Why a board gives no scale, and how many corners were found."""

    def __init__(self, found: int, what: str, way_out: str) -> None:
        super().__init__(what, way_out)
        self.found = found


def fitted(
    board: MarkerBoard, seen: Mapping[str, FoundCorners], views: Sights, cameras: float, blur: float
) -> BoardScale:
    """The scale of what photos show.

    Args:
        seen: by photo, px of the undistorted views.
        blur: px of it, which was inverted or not.

    Raises:
        DgsError: there is none, or what is seen contradicts the board.
    """
    marks = marks_of(seen)
    _check_seen(board, seen, marks)
    places, residual_px, dropped = placed(marks, views, cameras)
    if not places:
        raise _NoScale(
            len(marks),
            f"Rays to the corners of '{board.text}' meet nowhere",
            "Print each marker once, keep it still between photos, and take them from different sides",
        )
    groups = [group for group in _groups(board, places) if len(group.names) > 1]
    if not groups:
        raise _NoScale(1, f"No two corners of '{board.text}' are held by two photos", _MORE)
    fit = fit_size(groups)
    if fit is None:
        raise _NoScale(len(places), *_contradiction(board, groups))
    kept = {name for name, _ in fit.corners}
    photos = {photo for corner in fit.corners for photo in marks[corner]}
    _check_ratio(board, places, fit.units)
    pixel = float(np.median([places[name].pixel for name in fit.corners]))
    edges = 0.0 if board.is_chessboard else float(np.hypot(SETTINGS.edge, SETTINGS.edge_blur * blur))
    shares = (fit.deviation / fit.units, 2 * edges * pixel / (fit.units * board.side), board.deviation / board.size)
    size = 1.0 / fit.units
    markers = len({name for name, _ in places} - {CHESS}) if board.is_chessboard else len(kept)
    return BoardScale(
        board,
        size,
        size * float(np.linalg.norm(shares)),
        markers,
        len(fit.corners),
        len(photos),
        "photos",
        residual_px,
        fit.residual,
        dropped + fit.left_out,
    )


def _check_seen(
    board: MarkerBoard, seen: Mapping[str, FoundCorners], marks: Mapping[Corner, Mapping[str, Point]]
) -> None:
    """Raises DgsError where too little is seen."""
    twice = sorted({marker for found in seen.values() for marker in found.twice})
    if twice and not marks:
        raise _NoScale(1, f"Marker {twice[0]} is on one photo more than once", "Print each number once")
    if not marks:
        raise _NoScale(
            0,
            f"No marker of '{board.text}' is found on {len(seen)} photos",
            f"Check its dictionary ({board.dictionary}), take photos on which its cells cover 5 px and more, or give a"
            " known length",
        )
    photos = {photo for points in marks.values() for photo in points}
    if all(len(points) < 2 for points in marks.values()):
        raise _NoScale(
            len(marks),
            f"No marker of '{board.text}' is found on two photos, only on {len(photos)}, such as '{min(photos)}'",
            _MORE,
        )


def _groups(board: MarkerBoard, places: Mapping[Corner, SurfacePoint]) -> list[Group]:
    printed = _printed(board, {marker for marker, _ in places})
    by_marker = dict[int, list[Corner]]()
    for corner in places:
        if not board.is_chessboard or corner[0] == CHESS:
            by_marker.setdefault(corner[0], []).append(corner)
    return [
        Group(tuple(names), tuple(places[name] for name in names), np.stack([printed[name] for name in names]))
        for names in by_marker.values()
    ]


def _printed(board: MarkerBoard, markers: set[int]) -> dict[Corner, Array]:
    """[2] places of all corners on the print, in its unit."""
    four = marker_corners(board.side)
    printed = {(marker, index): four[index] for marker in markers for index in range(4)}
    if board.is_chessboard:
        corners = np.asarray(chessboard_of(board).getChessboardCorners(), np.float64)[:, :2]
        printed |= {(CHESS, index): place for index, place in enumerate(corners)}
    return printed


def _contradiction(board: MarkerBoard, groups: Sequence[Group]) -> tuple[str, str]:
    """What is seen of a print that is not as it was said to be."""
    if board.is_chessboard or len(groups) < 2:
        return f"What photos show is not '{board.text}': its corners are elsewhere", "Check what was printed"
    sizes = {group.names[0][0]: median_ratio([group]) for group in groups}
    largest, least = max(sizes, key=sizes.__getitem__), min(sizes, key=sizes.__getitem__)
    share = sizes[least] / sizes[largest]
    return (
        f"The markers of '{board.text}' are not of one size: number {least} is {share:.2f} of number {largest}",
        f"Name those of {board.side:g} {board.unit} alone: aruco:{board.dictionary},{board.side:g}{board.unit},"
        f"{largest}-{largest}",
    )


def _check_ratio(board: MarkerBoard, places: Mapping[Corner, SurfacePoint], units: float) -> None:
    """Raises DgsError where a chessboard's markers are not as large against its squares as was said."""
    if not board.is_chessboard:
        return
    inside = {corner: place for corner, place in places.items() if corner[0] != CHESS}
    loose = replace(board, columns=0, rows=0, square=0.0)
    groups = [group for group in _groups(loose, inside) if len(group.names) > 1]
    if not groups:
        return
    share = median_ratio(groups) / units
    if abs(share - 1.0) > SETTINGS.ratio:
        raise _NoScale(
            len(places),
            f"The markers of '{board.text}' are {share * board.side:.3g} {board.unit} large where its squares are"
            f" {board.square:g} {board.unit}",
            "Measure both on the print, and give them",
        )
