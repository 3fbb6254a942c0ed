"""Line charts as inline SVG, coloured by the page's own CSS variables (so that dark mode works)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Axis:
    """One axis: its label, and whether it is logarithmic; bounds are the data's unless given."""

    label: str
    logarithmic: bool = False
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Marker:
    """A line across the chart at x or y with a text beside it."""

    text: str
    x: float | None = None
    y: float | None = None


#: Size of a chart in the units of its SVG.
WIDTH, HEIGHT = 520, 260
#: Space for labels, in the same units.
LEFT, RIGHT, TOP, BOTTOM = 58, 16, 16, 44


def line_chart(
    title: str, series: Sequence[tuple[str, Points]], x: Axis, y: Axis, markers: Sequence[Marker] = ()
) -> Markup:
    """A chart of one or more lines; empty if there are fewer than two finite points in all.

    Args:
        title: for screen readers.
        series: (name, points) each; points that are not finite, or not positive on a logarithmic
            axis, are left out.
    """
    kept = [(name, [p for p in points if _shows(p, x, y)]) for name, points in series]
    everything = [p for _, points in kept for p in points]
    if len(everything) < 2:
        return Markup("")
    across = _Scale(x, [p[0] for p in everything], LEFT, WIDTH - RIGHT)
    up = _Scale(y, [p[1] for p in everything], HEIGHT - BOTTOM, TOP)
    parts = [*_grid(across, up)]
    for marker in markers:
        parts.append(_marker(marker, across, up))
    for index, (name, points) in enumerate(kept):
        path = " ".join(f"{across(a):.1f},{up(b):.1f}" for a, b in _thinned(points))
        parts.append(f'<polyline class="line l{index}" points="{path}"><title>{escape(name)}</title></polyline>')
        if len(points) <= 40:
            for a, b in points:
                parts.append(
                    f'<circle class="dot l{index}" cx="{across(a):.1f}" cy="{up(b):.1f}" r="3">'
                    f"<title>{escape(name)}: {b:.4g} at {a:.4g}</title></circle>"
                )
    parts.append(
        f'<text class="label" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 8}" text-anchor="middle">'
        f"{escape(x.label)}</text>"
        f'<text class="label" transform="translate(13 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" '
        f'text-anchor="middle">{escape(y.label)}</text>'
    )
    return Markup(
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">'
        + "".join(parts)
        + "</svg>"
    )


def scatter_map(title: str, points: Sequence[tuple[str, float, float, bool]]) -> Markup:
    """Positions on one scale in both directions; (name, x, y, held out) each."""
    if len(points) < 2:
        return Markup("")
    width, height, border = 520, 220, 24
    xs, ys = [p[1] for p in points], [p[2] for p in points]
    span = max((max(xs) - min(xs)) / (width - 2 * border), (max(ys) - min(ys)) / (height - 2 * border), 1e-12)
    middle_x, middle_y = (max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2
    dots = "".join(
        f'<circle class="camera{" held" if held else ""}" r="5" cx="{width / 2 + (a - middle_x) / span:.1f}" '
        f'cy="{height / 2 + (b - middle_y) / span:.1f}"><title>{escape(name)}</title></circle>'
        for name, a, b, held in points
    )
    return Markup(
        f'<svg class="chart" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">{dots}</svg>'
    )


class _Scale:
    """From values to px along one axis, with round ticks."""

    def __init__(self, axis: Axis, values: Sequence[float], begin: float, end: float) -> None:
        self.axis, self._begin, self._end = axis, begin, end
        low = min(values) if axis.low is None else axis.low
        high = max(values) if axis.high is None else axis.high
        if axis.logarithmic:
            low, high = math.log10(low), math.log10(high)
        if high - low < 1e-9:
            low, high = low - 0.5, high + 0.5
        room = 0.05 * (high - low)
        self.low = low - room if axis.low is None else low
        self.high = high + room if axis.high is None else high

    def __call__(self, value: float) -> float:
        position = math.log10(value) if self.axis.logarithmic else value
        share = (position - self.low) / (self.high - self.low)
        return self._begin + min(1.0, max(0.0, share)) * (self._end - self._begin)

    def ticks(self) -> list[float]:
        if self.axis.logarithmic and self.high - self.low > 1:
            steps: tuple[int, ...] = (1,) if self.high - self.low > 3 else (1, 2, 5)
            powers = range(math.floor(self.low), math.ceil(self.high) + 1)
            candidates = [step * 10.0**power for power in powers for step in steps]
            return [c for c in candidates if self.low <= math.log10(c) <= self.high]
        low, high = (10**self.low, 10**self.high) if self.axis.logarithmic else (self.low, self.high)
        rough = (high - low) / 5
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s * power for s in (1, 2, 2.5, 5, 10) if s * power >= rough * 0.999)
        first = math.ceil(low / step - 1e-9)
        return [i * step for i in range(first, math.floor(high / step + 1e-9) + 1)]


def _grid(across: _Scale, up: _Scale) -> list[str]:
    parts = []
    for value in up.ticks():
        at = up(value)
        parts.append(
            f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
            f'<text class="tick" x="{LEFT - 7}" y="{at + 4:.1f}" text-anchor="end">{value:.4g}</text>'
        )
    for value in across.ticks():
        at = across(value)
        parts.append(
            f'<line class="grid faint" y1="{TOP}" y2="{HEIGHT - BOTTOM}" x1="{at:.1f}" x2="{at:.1f}"/>'
            f'<text class="tick" x="{at:.1f}" y="{HEIGHT - BOTTOM + 17}" text-anchor="middle">{value:.4g}</text>'
        )
    return parts


def _marker(marker: Marker, across: _Scale, up: _Scale) -> str:
    if marker.x is not None:
        at = across(marker.x)
        left = at > (LEFT + WIDTH) / 2
        return (
            f'<line class="marker" y1="{TOP}" y2="{HEIGHT - BOTTOM}" x1="{at:.1f}" x2="{at:.1f}"/>'
            f'<text class="note" x="{at + (-6 if left else 6):.1f}" y="{TOP + 12}" '
            f'text-anchor="{"end" if left else "start"}">{escape(marker.text)}</text>'
        )
    assert marker.y is not None
    at = up(marker.y)
    return (
        f'<line class="marker" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
        f'<text class="note" x="{WIDTH - RIGHT - 4}" y="{at - 5:.1f}" text-anchor="end">{escape(marker.text)}</text>'
    )


def _shows(point: tuple[float, float], x: Axis, y: Axis) -> bool:
    return all(
        math.isfinite(value) and (value > 0 or not axis.logarithmic) for value, axis in zip(point, (x, y), strict=True)
    )


def _thinned(points: list[tuple[float, float]], most: int = 500) -> list[tuple[float, float]]:
    """Means of neighbouring points, so that a long history stays a small file."""
    size = -(-len(points) // most)
    if size <= 1:
        return points
    groups = [points[i : i + size] for i in range(0, len(points), size)]
    return [(sum(p[0] for p in g) / len(g), sum(p[1] for p in g) / len(g)) for g in groups]
