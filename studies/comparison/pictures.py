"""Pictures of a comparison: profile across the object, line widths from everywhere, crops, bands, turntables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...core.progress import Progress, Silent
from . import charts
from .charts import Picture
from .dataset import Dataset
from .measure import Measure, render_file
from .turntable import FRAMES, QUICK_FRAMES, ShownTwin, viewer_of, write_movies
from .viewpoints import widths_from_everywhere

#: Twins that a movie shows side by side.
_BESIDE = ("plain", "dgs", "oracle")
#: Side of a crop, and of what the bands show, as a share of the frame's height.
_CROP, _BAND_CROP = 0.35, 0.5


def shown_methods(summary: dict[str, Any]) -> list[str]:
    """The few methods that pictures show: one of each kind, the best Wiener and the best Richardson-Lucy."""
    picked = ["plain", summary["best_wiener"], summary["best_rl"], "paper", "dgs", "oracle"]
    return [method for method in picked if method and method in summary["each"]]


def write_pictures(
    out: Path, data: Dataset, measure: Measure, content: dict[str, Any], progress: Progress | None = None
) -> dict[str, str]:
    """Draws what the renders and twins on disk allow; returns title by file name, the most important first."""
    import matplotlib  # heavy: a second

    matplotlib.use("Agg")
    methods = shown_methods(content["methods"])
    twins = _twins(out, methods, content["rows"])
    frames = QUICK_FRAMES if content["facts"].get("quick", False) else FRAMES
    written = write_movies(out, twins, _BESIDE, data.cameras, frames) if twins else {}
    view = measure.held[len(measure.held) // 2] if measure.held else None
    if view is not None:
        written |= _of_one_view(out, data, measure, methods, view)
    viewers = {
        method: viewer_of(twins[method.split()[0]], data.cameras) for method in methods if method.split()[0] in twins
    }
    key = "-".join(row["key"] for row in content["rows"] if row["method"] in methods and row["seed"] == 0)
    found = widths_from_everywhere(out / "viewpoints.json", measure, viewers, key, progress or Silent())
    if found:
        charts.widths(out / "widths.png", found)
        written["widths.png"] = f"Width of the {found['line']} line from every viewpoint, with its uncertainty"
    return written


def _of_one_view(out: Path, data: Dataset, measure: Measure, methods: Sequence[str], view: str) -> dict[str, str]:
    truth = _unit(data.truth.pixels(view))
    photo = _unit(measure.by_name[view].pixels)
    renders = {name: p for name, p in _renders(out, methods, view).items() if p.shape == truth.shape}
    path = _across(measure, view, truth)
    middle = (path.start + path.end) / 2
    charts.crops(out / "crops.png", {"blurred": photo, **renders, "truth": truth}, middle, _CROP)
    charts.profile(out / "profile.png", {"truth": truth, **renders}, (path.start, path.end), path.colour)
    charts.bands(out / "bands.png", {"truth": truth, **renders}, middle, _BAND_CROP)
    return {
        "crops.png": f"The same crop of every method, held-out view {view}",
        "profile.png": f"Intensity along a line across {path.what}, held-out view {view}",
        "bands.png": "Only detail with periods of 14 to 10 and 10 to 7 px: what is the truth's, and what is invented",
    }


def _twins(out: Path, methods: Sequence[str], rows: Sequence[dict[str, Any]]) -> dict[str, ShownTwin]:
    """Those on disk, by kind of method."""
    found = {}
    for method in methods:
        row = next((row for row in rows if row["method"] == method and row["seed"] == 0), None)
        file = out / "twins" / f"{method.replace(' ', '_')}.ply"
        if row is not None and "background" in row and file.is_file():
            red, green, blue = row["background"]
            found[method.split()[0]] = ShownTwin(charts.title(method), file, (red, green, blue))
    return found


def _renders(out: Path, methods: Sequence[str], view: str) -> dict[str, Picture]:
    files = {method: out / "renders" / method.replace(" ", "_") / render_file(view) for method in methods}
    found = {}
    for method, file in files.items():
        if file.is_file():
            with Image.open(file) as picture:
                found[method] = np.asarray(picture) / 255.0
    return found


@dataclass(frozen=True)
class _ProfileLine:
    """Where the profile runs: ends [2] in px, which direction in colour space it shows, and what it crosses."""

    start: Picture
    end: Picture
    colour: Picture
    what: str


def _across(measure: Measure, view: str, truth: Picture) -> _ProfileLine:
    """Across the first painted line and on over the object, or through the frame's middle."""
    height, width = truth.shape[:2]
    for line, views in measure.true_widths.items():
        if view in views:
            places = views[view].places
            place = places[len(places) // 2]
            direction = place.direction if place.direction[0] > 0 else -place.direction
            ends = place.middle + np.outer([-0.3 * height, 0.3 * height], direction)
            ends = np.clip(ends, 1, [width - 1, height - 1])
            return _ProfileLine(ends[0], ends[1], views[view].direction, f"the {line} line")
    middle = [np.array([share * width, height / 2]) for share in (0.25, 0.75)]
    return _ProfileLine(middle[0], middle[1], np.full(3, 1 / 3), "the middle")


def _unit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> Picture:
    return pixels.astype(np.float64) / np.iinfo(pixels.dtype).max
