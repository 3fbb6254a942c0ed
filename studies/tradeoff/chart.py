"""Accuracy over time with the front that nothing beats, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.files import replacing

Point = Mapping[str, Any]

_FRONT, _DOMINATED, _PRESET = "tab:blue", "0.62", "tab:red"
#: From so many points on, a line leads from a label to its dot.
FAR = 16
#: Where a label may stand, in points from its dot: (x, y, alignment).
_PLACES = tuple(
    (dx * reach, dy * reach, side)
    for reach in (1.0, 1.9, 3.2, 4.8, 6.8)
    for dx, dy, side in (
        (6, -2, "left"),
        (-6, -2, "right"),
        (0, 6, "center"),
        (0, -11, "center"),
        (5, 6, "left"),
        (-5, 6, "right"),
        (5, -10, "left"),
        (-5, -10, "right"),
    )
)


def draw(points: Sequence[Point], target: float | None, title: str, svg: Path, png: Path) -> None:
    """Writes the chart as `svg` and `png` (1600 px wide); points that were skipped are left out.

    Raises:
        OutputError: they cannot be written.
    """
    import matplotlib  # heavy: a second

    matplotlib.use("Agg")
    from matplotlib import pyplot  # heavy: matplotlib

    measured = [point for point in points if not point["skipped"]]
    with pyplot.rc_context({"svg.fonttype": "none", "svg.hashsalt": "tradeoff", "font.size": 9}):
        figure, axes = pyplot.subplots(figsize=(10.66, 7.2), layout="constrained")
        axes.set_xscale("log")
        _draw_front(axes, measured)
        for point in measured:
            _draw_dot(axes, point)
        if target is not None and measured:
            _draw_target(axes, target)
        _finish_axes(axes, title)
        _label(figure, axes, measured)
        with replacing(svg) as temporary:
            figure.savefig(temporary, format="svg", metadata={"Date": None})
        with replacing(png) as temporary:
            figure.savefig(temporary, format="png", dpi=150)
        pyplot.close(figure)


def _draw_front(axes: Any, points: Sequence[Point]) -> None:
    """Steps along the points that nothing beats, and what they are."""
    front = sorted((point for point in points if point["front"]), key=lambda point: point["seconds"])
    if front:
        label = "nothing is quicker and as exact"
        seconds, psnr = [p["seconds"] for p in front], [p["psnr"] for p in front]
        axes.step(seconds, psnr, where="post", color=_FRONT, lw=1.4, zorder=1, label=label)
        axes.legend(loc="lower right", frameon=False)


def _draw_dot(axes: Any, point: Point) -> None:
    """One point with its spread over the seeds; presets are diamonds."""
    colour = _FRONT if point["front"] else _DOMINATED
    preset = point["group"] == "preset"
    axes.errorbar(
        point["seconds"],
        point["psnr"],
        point["psnr_spread"] or None,
        point["seconds_spread"] or None,
        fmt="D" if preset else "o",
        ms=7 if preset else 4.5,
        color=colour,
        ecolor=colour,
        elinewidth=0.7,
        markeredgecolor=_PRESET if preset else colour,
        zorder=3 if point["front"] else 2,
    )


def _draw_target(axes: Any, target: float) -> None:
    axes.axhline(target, color="0.3", lw=0.8, ls=":")
    axes.annotate(
        f"target {target:g} dB",
        (0.995, target),
        xycoords=("axes fraction", "data"),
        fontsize=8,
        color="0.3",
        ha="right",
        va="bottom",
    )


def _finish_axes(axes: Any, title: str) -> None:
    from matplotlib.ticker import FuncFormatter  # heavy: matplotlib

    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(_minor))
    axes.tick_params(axis="x", which="minor", labelsize=7)
    axes.set(
        xlabel="seconds from photos to twin (scoring not counted)",
        ylabel="PSNR of held-out views in dB",
        title=f"{title}: what accuracy costs in time",
    )
    axes.margins(x=0.12, y=0.08)
    axes.grid(which="major", color="0.92", zorder=0)


def _minor(value: float, _position: int) -> str:
    """Only 2 and 5 of every decade are written."""
    digits = f"{value:.0e}"[0]
    return f"{value:g}" if digits in "25" else ""


def _label(figure: Any, axes: Any, points: Sequence[Point]) -> None:
    """Every point's name where it covers no dot and no other name; a thin line leads to names that stand far off."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    dots = [axes.transData.transform((p["seconds"], p["psnr"])) for p in points]
    taken: list[Any] = []
    for point, dot in sorted(zip(points, dots, strict=True), key=lambda pair: not pair[0]["front"]):
        text = axes.annotate(
            point["knob"],
            (point["seconds"], point["psnr"]),
            xytext=(0, 0),
            textcoords="offset points",
            fontsize=7.5,
            color="black" if point["front"] else "0.45",
            zorder=4,
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": "0.6", "shrinkA": 0, "shrinkB": 2},
        )
        text.set_in_layout(False)
        box, (dx, dy, side) = _free_place(axes, text.get_window_extent(renderer), dot, dots, taken)
        text.set_position((dx, dy))
        text.set_ha(side)
        text.arrow_patch.set_visible(abs(dx) + abs(dy) >= FAR)
        taken.append(box)


def _free_place(
    axes: Any, size: Any, dot: Any, dots: Sequence[Any], taken: Sequence[Any]
) -> tuple[Any, tuple[float, float, str]]:
    """The box of a label of this size and its place (of `_PLACES`): the first that covers nothing, else the least bad.

    Args:
        dot: what is labelled, and dots: all of them, in px of the figure; taken: boxes of other labels.
    """
    from matplotlib.transforms import Bbox  # heavy: matplotlib

    pixel, frame = axes.figure.dpi / 72.0, axes.bbox
    tried: list[tuple[float, Any, tuple[float, float, str]]] = []
    for dx, dy, side in _PLACES:
        left = dot[0] + pixel * dx - {"left": 0.0, "center": 0.5, "right": 1.0}[side] * size.width
        bottom = dot[1] + pixel * dy - 0.2 * size.height
        box = Bbox.from_bounds(left - 1, bottom - 1, size.width + 2, size.height + 2)
        covered = sum(box.overlaps(other) for other in taken) + sum(box.contains(*d) for d in dots)
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
        tried.append((covered + (0.0 if inside else 2.0), box, (dx, dy, side)))
        if tried[-1][0] == 0:
            break
    return min(tried, key=lambda one: one[0])[1:]


def front_names(points: Sequence[Point]) -> list[str]:
    """Knobs on the front, the quickest first."""
    on = sorted((p for p in points if not p["skipped"] and p["front"]), key=lambda p: float(p["seconds"]))
    return [p["knob"] for p in on]
