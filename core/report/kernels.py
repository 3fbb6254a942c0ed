"""The free kernel of each photo, as the report draws it."""

from __future__ import annotations

import math
from collections.abc import Mapping
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


@dataclass(frozen=True)
class DrawnKernel:
    """One photo's kernel.

    Attributes:
        width: root mean square radius along one axis, px of the photo; svg: the light of a point.
    """

    width: float
    svg: Markup


def drawn_kernels(report: Mapping[str, Any]) -> dict[str, DrawnKernel]:
    """By photo, in the order of names; empty where none were learned."""
    for effect in report.get("effects", ()):
        if effect["name"] == "kernels" and effect["on"] and "photos" in (effect["parameters"] or {}):
            pitch = float(effect["parameters"]["pitch"]) * math.hypot(*report["photos"]["size"])
            rows = sorted(effect["parameters"]["photos"].items())
            return {name: _drawn(np.asarray(weights, float), pitch) for name, weights in rows}
    return {}


def _drawn(weights: NDArray[np.float64], pitch: float) -> DrawnKernel:
    side = math.isqrt(len(weights) - 1)
    squares = weights[1:].reshape(side, side).copy()
    squares[side // 2, side // 2] += weights[0]
    line = np.arange(side) - side // 2
    total = max(float(squares.sum()), 1e-12)
    across, down = squares.sum(axis=0) / total, squares.sum(axis=1) / total
    variance = sum(float(one @ line**2) - float(one @ line) ** 2 for one in (across, down)) / 2.0
    return DrawnKernel(pitch * math.sqrt(max(variance, 0.0)), _svg(squares))


def _svg(squares: NDArray[np.float64]) -> Markup:
    side = len(squares)
    step, most = SIDE / side, max(float(squares.max()), 1e-12)
    drawn = "".join(
        f'<rect x="{column * step:.1f}" y="{row * step:.1f}" width="{step:.1f}" height="{step:.1f}" '
        f'fill="currentColor" fill-opacity="{(value / most) ** ROOT:.2f}"/>'
        for (row, column), value in np.ndenumerate(squares)
        if value > FAINTEST * most
    )
    border = f'<rect width="{SIDE}" height="{SIDE}" fill="none" stroke="currentColor" stroke-opacity="0.25"/>'
    size = f'viewBox="0 0 {SIDE} {SIDE}" width="{SIDE}" height="{SIDE}"'
    return Markup(f'<svg {size} role="img" aria-label="kernel">{border}{drawn}</svg>')
