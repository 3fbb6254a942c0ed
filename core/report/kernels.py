"""The free kernel of each photo, as the report draws it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

#: Side of a picture in the units of its SVG.
SIDE = 64
#: The light of a square is drawn by its root: faint arms of a kernel would not show beside its middle.
ROOT = 0.5
#: Squares that hold less of a kernel's brightest are left out.
FAINTEST = 0.01
#: A square that is less than so many standard errors above 0 is drawn as a frame: there may be no light.
SURE = 2.0
#: An interval of widths beyond this share of the widest kernel there can be says nothing of how wide it is.
DETERMINED = 0.5


@dataclass(frozen=True)
class DrawnKernel:
    """One photo's kernel.

    Attributes:
        width: root mean square radius along one axis, px of the photo.
        said: the same with its interval of 95 %, or why there is none.
        svg: the light of a point; what may be none is a frame.
    """

    width: float
    said: str
    svg: Markup


def drawn_kernels(report: Mapping[str, Any]) -> dict[str, DrawnKernel]:
    """By photo, in the order of names; empty where none were learned."""
    for effect in report.get("effects", ()):
        if effect["name"] == "kernels" and effect["on"] and "photos" in (effect["parameters"] or {}):
            parameters, diagonal = effect["parameters"], math.hypot(*report["photos"]["size"])
            errors, widths = parameters.get("errors", {}), parameters.get("widths", {})
            return {
                name: _drawn(weights, errors.get(name), widths.get(name), float(parameters["pitch"]), diagonal)
                for name, weights in sorted(parameters["photos"].items())
            }
    return {}


def _drawn(
    weights: Sequence[float],
    errors: Sequence[float] | None,
    ends: Sequence[float] | None,
    pitch: float,
    diagonal: float,
) -> DrawnKernel:
    """One of weights [1 + side^2] with their standard errors; ends: width, least and most, shares of the diagonal."""
    squares = _squares(np.asarray(weights, float))
    width = _width(squares) * pitch * diagonal
    if errors is None or ends is None:
        return DrawnKernel(width, f"{width:.1f} px", _svg(squares, np.zeros_like(squares)))
    widest = (len(squares) // 2) * pitch
    said = _said(*(end * diagonal for end in ends)) if ends[2] - ends[1] <= DETERMINED * widest else "not identifiable"
    return DrawnKernel(width, said, _svg(squares, SURE * np.sqrt(_squares(np.square(errors)))))


def _squares(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """[side, side] the tents, with the light as it is added to the one in the middle."""
    side = math.isqrt(len(weights) - 1)
    squares: NDArray[np.float64] = weights[1:].reshape(side, side).copy()
    squares[side // 2, side // 2] += weights[0]
    return squares


def _width(squares: NDArray[np.float64]) -> float:
    """Root mean square radius along one axis, in distances of tents."""
    line = np.arange(len(squares)) - len(squares) // 2
    total = max(float(squares.sum()), 1e-12)
    across, down = squares.sum(axis=0) / total, squares.sum(axis=1) / total
    variance = sum(float(one @ line**2) - float(one @ line) ** 2 for one in (across, down)) / 2.0
    return math.sqrt(max(variance, 0.0))


def _said(width: float, least: float, most: float) -> str:
    """A width and its interval, px; only the most where none at all lies within it."""
    return f"at most {most:.1f} px" if least <= 0.0 else f"{width:.1f} px ({least:.1f} to {most:.1f})"


def _svg(squares: NDArray[np.float64], doubtful: NDArray[np.float64]) -> Markup:
    """Squares [side, side]; those up to `doubtful` [side, side] are frames."""
    step, most = SIDE / len(squares), max(float(squares.max()), 1e-12)
    drawn = "".join(
        _square(column * step, row * step, step, float((value / most) ** ROOT), bool(value <= doubtful[row, column]))
        for (row, column), value in np.ndenumerate(squares)
        if value > FAINTEST * most
    )
    border = f'<rect width="{SIDE}" height="{SIDE}" fill="none" stroke="currentColor" stroke-opacity="0.25"/>'
    size = f'viewBox="0 0 {SIDE} {SIDE}" width="{SIDE}" height="{SIDE}"'
    return Markup(f'<svg {size} role="img" aria-label="kernel">{border}{drawn}</svg>')


def _square(x: float, y: float, step: float, strength: float, frame: bool) -> str:
    if frame:
        place = f'x="{x + 1:.1f}" y="{y + 1:.1f}" width="{step - 2:.1f}" height="{step - 2:.1f}"'
        return f'<rect {place} fill="none" stroke="currentColor" stroke-opacity="{strength:.2f}"/>'
    place = f'x="{x:.1f}" y="{y:.1f}" width="{step:.1f}" height="{step:.1f}"'
    return f'<rect {place} fill="currentColor" fill-opacity="{strength:.2f}"/>'
