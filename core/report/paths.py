"""The camera's path in each photo, as the report draws it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..tone_curve import ToneCurve

#: Points of a path that are drawn, and the side of its picture in the units of its SVG.
POINTS, SIDE = 33, 64
#: Space around the longest path, in the same units.
EDGE = 6


@dataclass(frozen=True)
class DrawnPath:
    """One photo's path.

    Attributes:
        length: px of the photo, in its middle; svg: the path, all photos' on one scale.
    """

    length: float
    svg: Markup


def drawn_paths(report: Mapping[str, Any]) -> dict[str, DrawnPath]:
    """By photo, in the order of names; empty where none were learned."""
    parameters = _learned(report)
    return {} if parameters is None else _drawn(parameters, float(report["cameras"]["focal_px"]))


def shutter_said(report: Mapping[str, Any]) -> str:
    """How long a rolling shutter takes, in words; '' where all rows are exposed at once."""
    parameters = _learned(report) or {}
    if not parameters.get("readout"):
        return ""
    error = parameters.get("readout_error")
    how = "given" if error is None else f"found in these photos, standard error {error:.2g}"
    return (
        f"A rolling shutter: {abs(parameters['readout']):.2f} exposures pass from one end of the photo to the other "
        f"({how}). A path is of the whole photo, of which each row saw a part."
    )


def curve_said(report: Mapping[str, Any]) -> str:
    """The camera's own contrast, in words; '' where it is sRGB's."""
    parameters = _learned(report) or {}
    curve = ToneCurve(*parameters.get("curve", (0.0, 0.0)))
    if not curve.notable:
        return ""
    errors = parameters.get("curve_error")
    how = "" if errors is None else f" (standard errors {errors[0]:.2g} and {errors[1]:.2g})"
    return (
        f"The camera has a contrast of its own, by which light was added up: toe {curve.toe:.2f}, shoulder "
        f"{curve.shoulder:.2f}{how}; 0 and 0 are sRGB, and above them shadows or lights are pressed together."
    )


def _learned(report: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What was learned of the camera's motion."""
    for effect in report.get("effects", ()):
        if effect["name"] == "motion" and effect["on"] and "twists" in (effect["parameters"] or {}):
            found: Mapping[str, Any] = effect["parameters"]
            return found
    return None


def _drawn(parameters: Mapping[str, Any], focal: float) -> dict[str, DrawnPath]:
    ways = {name: way_of(twists, parameters["unit"], focal) for name, twists in sorted(parameters["twists"].items())}
    largest = max((float(np.abs(way - way.mean(axis=0)).max()) for way in ways.values()), default=0.0)
    scale = (SIDE / 2 - EDGE) / max(largest, 1.0)
    return {name: DrawnPath(_length(way), _svg((way - way.mean(axis=0)) * scale)) for name, way in ways.items()}


def way_of(twists: Any, unit: float, focal: float) -> NDArray[np.float64]:
    """[POINTS, 2] px along x and y where what is in the middle of the photo is led; see `CameraMotion`."""
    parts = np.asarray(twists, np.float64)
    twist = legendre.legval(np.linspace(-1.0, 1.0, POINTS), parts).T
    return np.asarray(focal * np.column_stack([twist[:, 0] / unit + twist[:, 4], twist[:, 1] / unit - twist[:, 3]]))


def _length(way: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def _svg(way: NDArray[np.float64]) -> Markup:
    points = " ".join(f"{SIDE / 2 + x:.1f},{SIDE / 2 + y:.1f}" for x, y in way)
    return Markup(
        f'<svg viewBox="0 0 {SIDE} {SIDE}" width="{SIDE}" height="{SIDE}" role="img" aria-label="path">'
        f'<polyline class="line l0" points="{points}"/></svg>'
    )
