"""A known length or a printed board, measured on a twin alone: how large the unit is that it is given in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import FormatError
from ..progress import Progress
from ..twin.folder import TwinFolder
from ..twin.opened import OpenedTwin
from .by_board import board_scale
from .measured import check_photos, scale_of, valued_measures
from .request import KnownLength, MeasureRequest, read_request
from .sights import sights
from .written import looking


@dataclass(frozen=True)
class LengthScale:
    """How many units a unit of a world is.

    Attributes:
        known: the length that says so; of a board, that of its squares or markers.
        size, deviation: units for each unit of the world, and its standard deviation: that of the length as it was
            given and that of its places.
    """

    known: KnownLength
    size: float
    deviation: float

    def in_world(self, factor: float) -> LengthScale:
        """The same in a world whose coordinates are `factor` times as large."""
        return replace(self, size=self.size / factor, deviation=self.deviation / factor)


def read_known_length(path: Path, scale: str | None) -> MeasureRequest:
    """The known length, or the board, of a file of measures, without the other measures and places.

    Args:
        scale: 'NAME=12.5mm' or 'NAME=12.5+-0.1mm', in the place of the file's.

    Raises:
        FormatError: as of `read_request`, or no length is known.
    """
    request = read_request(path, scale)
    if request.board is not None:
        return MeasureRequest({}, (), None, request.board)
    if request.scale is None:
        raise FormatError(f"'{path}' has no known length", "Give one of its lengths: --scale NAME=12mm")
    (measure,) = (one for one in request.measures if one.name == request.scale.measure)
    places = {name: place for name, place in request.places.items() if name in measure.of}
    return MeasureRequest(places, (measure,), request.scale)


def length_scale(twin: OpenedTwin, request: MeasureRequest, progress: Progress) -> LengthScale:
    """The scale of a twin's world, of a request as `read_known_length` makes it.

    Raises:
        FormatError: a photo is none of this twin. DgsError: the known length could not be measured, or the board not
            found. Cancelled: the user asked to stop.
    """
    check_photos(twin, request)
    views, generator = sights(twin, request.photos, progress), np.random.default_rng(0)
    cameras = looking(TwinFolder(twin.folder))
    if request.board is not None:
        board = request.board
        known = KnownLength(board.text, board.size, board.deviation, board.unit)
        one = board_scale(board, twin, views, cameras, progress)
        return LengthScale(known, one.size / views.scale.size, one.deviation / views.scale.size)
    found = valued_measures(twin, views, request, cameras, generator, progress)
    factors, _ = scale_of(request, found.values, views, generator)
    assert factors is not None and request.scale is not None
    size = views.scale.size
    return LengthScale(request.scale, float(factors[0]) / size, float(np.std(factors[1:])) / size)
