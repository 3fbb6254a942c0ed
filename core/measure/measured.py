"""What was asked of a twin, measured: values with their intervals, in a unit or in px-equivalents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DgsError, FormatError
from ..progress import Progress
from ..twin.opened import OpenedTwin
from .by_board import BoardScale, board_scale
from .located import NothingThere, end_on_surface, located
from .places import PRECISION, SurfacePoint, seen_by
from .request import AskedMeasure, AskedPlace, MeasureRequest, Point
from .rows import NO_SCALE
from .sights import Sights, sights
from .values import DRAWS, WITHIN, Value, drawn, valued
from .widths import width_on

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """One measure.

    Attributes:
        name, kind, of: as asked.
        value, deviation, low, high: the value, its standard deviation, and its 95 % interval; None where there is none.
        unit: of them; power of a length for areas ('mm^2').
        photos: fewest photos that hold one of its places.
        reason: why it could not be measured; empty otherwise.
    """

    name: str
    kind: str
    of: tuple[str, ...]
    value: float | None
    deviation: float | None
    low: float | None
    high: float | None
    unit: str
    photos: int
    reason: str = ""

    def plain(self) -> dict[str, Any]:
        """For JSON and CSV."""
        found = {key: round(value, 9) if isinstance(value, float) else value for key, value in vars(self).items()}
        return {**found, "of": list(self.of)}


@dataclass(frozen=True)
class Findings:
    """All measures, and places in the twin's world.

    Attributes:
        measures: in the order that they were asked in.
        places: position, covariance (world units) and px-equivalent of each place that was found.
        noise: of the photos about the twin, sRGB in [0, 1].
        missing: why each of the other places was not found.
        scale: from printed markers, in the twin's world; None where it is another or there is none.
        said: what that rests on, for a terminal.
    """

    measures: tuple[Measured, ...]
    places: dict[str, dict[str, Any]]
    noise: float
    missing: dict[str, str]
    scale: dict[str, Any] | None = None
    said: str = ""


@dataclass(frozen=True)
class ValuedMeasures:
    """What was found, in the scene's own units.

    Attributes:
        places: by name; reasons: why each of the others was not found.
        values: by measure's name; a text says why there is none.
    """

    places: dict[str, SurfacePoint]
    reasons: dict[str, str]
    values: dict[str, Value | str]


def measure(twin: OpenedTwin, request: MeasureRequest, cameras: float, progress: Progress) -> Findings:
    """Measures what was asked.

    Args:
        cameras: standard deviation of where cameras look, px; 0 where they are known.

    Raises:
        FormatError: a photo is none of this twin. DgsError: the known length could not be measured, or the board not
            found. Cancelled: the user asked to stop.
    """
    check_photos(twin, request)
    views = sights(twin, request.photos, progress)
    board = None if request.board is None else board_scale(request.board, twin, views, cameras, progress)
    return measured(twin, views, request, cameras, progress, board)


def check_photos(twin: OpenedTwin, request: MeasureRequest) -> None:
    """Raises FormatError where something is marked on a photo that is none of the twin's."""
    names = {view.name for view in twin.views}
    strange = [photo for photo in request.photos if photo not in names]
    if strange:
        raise FormatError(f"'{strange[0]}' is no photo of this twin with a camera", f"Name one such as '{min(names)}'")


def measured(
    twin: OpenedTwin,
    views: Sights,
    request: MeasureRequest,
    cameras: float,
    progress: Progress,
    board: BoardScale | None = None,
) -> Findings:
    """As `measure`, of what the cameras see already.

    Args:
        views: hold each photo that something is marked on.
        board: what was found of the printed markers that the request names, if it names some.
    """
    generator = np.random.default_rng(0)
    found = valued_measures(twin, views, request, cameras, generator, progress)
    factor, unit = scale_of(request, found.values, views, generator, board)
    said = tuple(_said(one, found.values[one.name], factor, unit, found.places) for one in request.measures)
    places = {name: _plain(place, views) for name, place in found.places.items()}
    plain = None if board is None else board.plain(views.scale.size)
    return Findings(said, places, views.noise, found.reasons, plain, "" if board is None else board.sentence())


def valued_measures(
    twin: OpenedTwin,
    views: Sights,
    request: MeasureRequest,
    cameras: float,
    generator: np.random.Generator,
    progress: Progress,
) -> ValuedMeasures:
    """All places, and the values of all measures, in the scene's own units; notes what could not be found."""
    places, reasons = dict[str, SurfacePoint](), dict[str, str]()
    for name, asked in request.places.items():
        try:
            places[name] = located(asked, views, _undistorted(twin, asked), cameras)
        except DgsError as error:
            reasons[name] = str(error)
            progress.note(str(error))
    draws = {name: drawn(place, generator) for name, place in places.items()}
    values = dict[str, Value | str]()
    for one in request.measures:
        missing = next((reasons[name] for name in one.of if name in reasons), "")
        if missing:
            values[one.name] = missing
        elif one.kind == "width" and one.of:
            values[one.name] = _width_between(one, places, views, generator, progress)
        elif one.kind == "width":
            values[one.name] = _width(twin, views, one, cameras, generator, progress)
        else:
            values[one.name] = valued(one.kind, [places[n] for n in one.of], [draws[n] for n in one.of])
    return ValuedMeasures(places, reasons, values)


def _undistorted(twin: OpenedTwin, asked: AskedPlace) -> dict[str, Point]:
    return {photo: _point(twin, photo, point) for photo, point in asked.marks.items()}


def _point(twin: OpenedTwin, photo: str, point: Point) -> Point:
    """From px of a photo's file to px of its undistorted view."""
    scale = next(one.scale for one in twin.photos if one.name == photo)
    lens = twin.reconstruction.lenses[photo]
    x, y = lens.from_pixels(np.array([[point[0] * scale[0], point[1] * scale[1]]]))[0]
    return float(x * lens.fx + lens.cx), float(y * lens.fy + lens.cy)


def _width(
    twin: OpenedTwin,
    views: Sights,
    asked: AskedMeasure,
    cameras: float,
    generator: np.random.Generator,
    progress: Progress,
) -> Value | str:
    assert asked.across is not None
    sight, called = views.views[asked.photo], f"An end of '{asked.name}' on '{asked.photo}'"
    across = float(np.hypot(PRECISION.click, cameras))
    try:
        points = (_point(twin, asked.photo, asked.across[0]), _point(twin, asked.photo, asked.across[1]))
        ends = [end_on_surface(views, sight, *pair, across, called) for pair in (points, points[::-1])]
        draws = generator.standard_normal(DRAWS)
        return width_on(sight, points, (ends[0], ends[1]), draws, asked.name, views.blur_is)
    except DgsError as error:
        progress.note(str(error))
        return str(error)


def _width_between(
    asked: AskedMeasure,
    places: Mapping[str, SurfacePoint],
    views: Sights,
    generator: np.random.Generator,
    progress: Progress,
) -> Value | str:
    """The width between two places, on the photo that has them farthest apart of those that see both."""
    ends = (places[asked.of[0]], places[asked.of[1]])
    best, apart, points = None, 0.0, None
    for sight in views.views.values():
        found = seen_by(sight, ends[0].position, ends[0].reach), seen_by(sight, ends[1].position, ends[1].reach)
        if found[0] is None or found[1] is None:
            continue
        length = float(np.hypot(found[1][0] - found[0][0], found[1][1] - found[0][1]))
        if length > apart:
            best, apart, points = sight, length, (found[0], found[1])
    try:
        if best is None or points is None:
            raise DgsError(f"No photo sees both ends of '{asked.name}'", "Set them where photos show both sides")
        return width_on(best, points, ends, generator.standard_normal(DRAWS), asked.name, views.blur_is)
    except DgsError as error:
        progress.note(str(error))
        return str(error)


def scale_of(
    request: MeasureRequest,
    values: Mapping[str, Value | str],
    views: Sights,
    generator: np.random.Generator,
    board: BoardScale | None = None,
) -> tuple[Array | None, str]:
    """Draws of the unit's size in the scene's own units, the best guess first; None where nothing is known."""
    if board is not None:
        return board.drawn(DRAWS, generator), board.board.unit
    known = request.scale
    if known is None:
        return None, NO_SCALE
    measured = values[known.measure]
    if isinstance(measured, str):
        raise NothingThere(f"The known length '{known.measure}' could not be measured: {measured.rstrip('.')}")
    truly = known.value + known.deviation * generator.standard_normal(len(measured.draws))
    spread = np.maximum(measured.draws, 1e-3 * measured.value)
    return np.concatenate([[known.value / measured.value], np.maximum(truly, 0.0) / spread]), known.unit


def _said(
    asked: AskedMeasure, value: Value | str, factor: Array | None, unit: str, places: Mapping[str, SurfacePoint]
) -> Measured:
    if isinstance(value, str):
        return Measured(asked.name, asked.kind, asked.of, None, None, None, None, unit, 0, value)
    if value.power == 0:
        best, draws, unit = value.value, value.draws, "deg"
    elif factor is None:
        best, draws = value.value / value.pixel**value.power, value.draws / value.pixel**value.power
    else:
        best, draws = value.value * factor[0] ** value.power, value.draws * factor[1:] ** value.power
    deviation = float(np.std(draws))
    low, high = max(0.0, best - WITHIN * deviation), best + WITHIN * deviation
    photos = min((places[name].seen for name in asked.of), default=1)
    named = unit if value.power < 2 else f"{unit}^2"
    return Measured(asked.name, asked.kind, asked.of, float(best), deviation, low, float(high), named, photos)


def _plain(place: SurfacePoint, views: Sights) -> dict[str, Any]:
    size = views.scale.size
    return {
        "position": (place.position * size + views.scale.origin).tolist(),
        "covariance": (place.covariance * size**2).tolist(),
        "pixel": place.pixel * size,
        "photos": place.seen,
    }
