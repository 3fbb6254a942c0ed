"""How wide painted lines appear, view by view, and how far that is from the truth.

A line is given in the world: points along its middle, unit vectors across it, normals of the surface.
It is projected with the true camera; at several stations along it a profile is read across it and both
flanks are fitted (`edges`). Truth and twin are read at the same stations, with the same instrument, and
along the same direction in colour space (from the line's colour to its surroundings' in the truth).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import FormatError
from ..files import read_json
from ..numbers import number
from .edges import Width, fit_width
from .profiles import Sampler, intensity_profile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineSettings:
    """Where painted lines are read."""

    facing: float = number(
        0.45, "cosine", "stations whose surface is turned away further are too foreshortened to be read"
    )
    reach: float = number(9.0, "px", "that a profile goes beyond the line's own edges on each side")
    reach_share: float = number(0.75, "share of the line's width", "or by this, where it is more")
    breadth: float = number(6.0, "px", "along the line that one station averages: pebbles and noise even out")
    step: float = number(0.4, "px", "between the samples of a profile")
    maximum_stations: int = number(
        60,
        "count",
        "per view, spread evenly over what is seen: about as many as are independent of each other along a line that"
        " crosses the picture. With 16, one width was uncertain by 0.3 px, and a concordance above 50 was chance",
        "the ball's lines (rendered)",
    )
    minimum_stations: int = number(3, "count", "with fewer no width is reported")


SETTINGS = LineSettings()


@dataclass(frozen=True)
class PaintedLine:
    """One line of a given scene, in the world of the true cameras.

    Attributes:
        name: as reports call it.
        width: world units, in the plane tangent to the surface.
        points, across, normals: [n, 3] middle of the line, unit vectors across it and out of the surface.
    """

    name: str
    width: float
    points: Array = field(repr=False)
    across: Array = field(repr=False)
    normals: Array = field(repr=False)


@dataclass(frozen=True)
class Station:
    """Where one profile is read.

    Attributes:
        middle: [2] px.
        direction: [2] unit vector across the line.
        width: px that the line's true width projects to.
    """

    middle: Array
    direction: Array
    width: float


@dataclass(frozen=True)
class LineWidth:
    """Width of one line in one view.

    Attributes:
        value: median over the stations, px; NaN where the line cannot be found.
        uncertainty: standard error of `value` over the stations (robust), at least what the fits tell, px.
        stations: how many were read.
        blur: median blur of the edges, px.
    """

    value: float
    uncertainty: float
    stations: int
    blur: float


def read_lines(path: Path) -> list[PaintedLine]:
    """The lines of a data set's lines.json.

    Raises:
        FormatError: the file does not hold lines.
    """
    try:
        entries = read_json(path)
        return [
            PaintedLine(
                str(entry["name"]),
                float(entry["width_m"]),
                *(np.array(entry[key], np.float64).reshape(-1, 3) for key in ("points", "across", "normals")),
            )
            for entry in entries
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"'{path}' holds no lines: {error}", "Make the data set again with synthesize") from error


def stations(line: PaintedLine, camera: Camera, others: Sequence[PaintedLine] = ()) -> list[Station]:
    """Where the line is well seen: turned to the camera, inside the frame, clear of other lines."""
    points, across = _refined(line.points), _refined(line.across)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normals = _refined(line.normals)
    rays = camera.centre - points
    cosine = np.sum(rays * normals, axis=1) / (np.linalg.norm(rays, axis=1) * np.linalg.norm(normals, axis=1))
    edges = [camera.projected(points + sign * line.width / 2 * across)[0] for sign in (-1.0, 1.0)]
    spans = edges[1] - edges[0]
    widths = np.linalg.norm(spans, axis=1)
    good = (cosine > SETTINGS.facing) & (widths > 0.5) & np.isfinite(widths)
    metre = line.width / np.maximum(widths, 1e-9)  # world units per px
    for other in others:
        if other is line:
            continue
        gap = np.min(np.linalg.norm(points[:, None] - _refined(other.points)[None], axis=2), axis=1)
        clearance = line.width / 2 + other.width / 2 + np.maximum(SETTINGS.reach, SETTINGS.reach_share * widths) * metre
        good &= gap > clearance
    found = []
    for index in np.flatnonzero(good):
        middle, direction = (edges[0][index] + edges[1][index]) / 2, spans[index] / widths[index]
        half = _half_length(float(widths[index])) + SETTINGS.breadth
        if (middle - half >= 0).all() and (middle + half <= [camera.width, camera.height]).all():
            found.append(Station(middle, direction, float(widths[index])))
    picked = np.linspace(0, len(found) - 1, min(SETTINGS.maximum_stations, len(found))).round().astype(int)
    return [found[i] for i in dict.fromkeys(picked.tolist())]


def contrast_direction(sampler: Sampler, read_at: Sequence[Station]) -> Array:
    """[C] unit vector in colour space from the surroundings to the line, as the given picture shows it."""
    inner, outer = [], []
    for station in read_at:
        inner.append(sampler.at(station.middle))
        away = (station.width / 2 + 0.8 * SETTINGS.reach) * station.direction
        outer += [sampler.at(station.middle + away), sampler.at(station.middle - away)]
    difference = np.median(inner, axis=0) - np.median(outer, axis=0)
    return difference / max(float(np.linalg.norm(difference)), 1e-12)


def station_profile(sampler: Sampler, station: Station, direction: Array) -> tuple[Array, Array]:
    """[n] px from the line's middle, and [n] intensities along `direction` in colour space."""
    half = _half_length(station.width)
    offset = half * station.direction
    distances, values = intensity_profile(
        sampler, station.middle - offset, station.middle + offset, SETTINGS.step, SETTINGS.breadth
    )
    return distances - half, values @ direction


def line_width(sampler: Sampler, read_at: Sequence[Station], direction: Array) -> LineWidth:
    """Measures a line at the given stations.

    Args:
        sampler: of the picture, truth or twin.
        read_at: from `stations`.
        direction: from `contrast_direction` of the TRUE picture.
    """
    widths: list[Width] = []
    for station in read_at:
        width = fit_width(*station_profile(sampler, station, direction))
        if width is not None and width.value > 0:
            widths.append(width)
    if len(widths) < SETTINGS.minimum_stations:
        return LineWidth(float("nan"), float("nan"), len(widths), float("nan"))
    values = np.array([width.value for width in widths])
    middle = float(np.median(values))
    # 1.4826 MAD is a normal distribution's standard deviation; a median's own is 1.2533 times a mean's.
    scatter = 1.2533 * 1.4826 * float(np.median(np.abs(values - middle))) / np.sqrt(len(values))
    fits = float(np.median([width.uncertainty for width in widths])) / np.sqrt(len(values))
    return LineWidth(middle, max(scatter, fits), len(values), float(np.median([width.blur for width in widths])))


def concordance(true_widths: Sequence[float], rendered_widths: Sequence[float]) -> float:
    """Mean true width / mean |rendered width - true width| over the views; NaN without a common view.

    The paper gives a 'concordance ratio' without its definition; this is ours (26.3 is then a mean
    error of 3.8 %). A line that cannot be found in the render counts as width 0, an error of 100 %.
    """
    pairs = [
        (true, rendered if np.isfinite(rendered) else 0.0)
        for true, rendered in zip(true_widths, rendered_widths, strict=True)
        if np.isfinite(true)
    ]
    if not pairs:
        return float("nan")
    true, rendered = np.array(pairs).T
    return float(true.mean() / max(float(np.abs(rendered - true).mean()), 1e-9))


def _half_length(width: float) -> float:
    return width / 2 + max(SETTINGS.reach, SETTINGS.reach_share * width)


def _refined(values: Array, times: int = 3) -> Array:
    """Intermediate points between the file's, linear; [times (n - 1) + 1, 3]."""
    steps = np.linspace(0, len(values) - 1, times * (len(values) - 1) + 1)
    return np.stack([np.interp(steps, np.arange(len(values)), column) for column in values.T], -1)
