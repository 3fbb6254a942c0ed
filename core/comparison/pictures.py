"""Pictures of a comparison: profile across the object, line widths per view, crops side by side, turntables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..evaluation.profiles import Sampler, intensity_profile
from ..files import replacing
from .dataset import Dataset
from .measure import Measure, render_file
from .turntable import FRAMES, QUICK_FRAMES, write_movies

Picture = NDArray[np.float64]

#: Colour and name of what pictures show, in this order.
_LOOKS = {"truth": "black", "plain": "tab:orange", "wiener": "tab:green", "rl": "tab:olive", "paper": "tab:purple",
          "dgs": "tab:blue", "oracle": "tab:gray"}  # fmt: skip
#: What movies call the methods, and which of them are shown side by side.
_TITLES = {"plain": "plain GS", "wiener": "Wiener, then GS", "rl": "Richardson-Lucy, then GS",
           "paper": "the paper's loss", "dgs": "DGS", "oracle": "GS of sharp photos"}  # fmt: skip
_BESIDE = ("plain", "dgs", "oracle")
#: Side of a crop as a share of the frame's height.
_CROP = 0.35


def shown_methods(summary: dict[str, Any]) -> list[str]:
    """The few methods that pictures show: one of each kind, the best Wiener and the best Richardson-Lucy."""
    picked = ["plain", summary["best_wiener"], summary["best_rl"], "paper", "dgs", "oracle"]
    return [method for method in picked if method and method in summary["each"]]


def write_pictures(out: Path, data: Dataset, measure: Measure, content: dict[str, Any]) -> dict[str, str]:
    """Draws what the renders on disk allow; returns title by file name."""
    import matplotlib

    matplotlib.use("Agg")
    summary, rows = content["methods"], content["rows"]
    methods = shown_methods(summary)
    written: dict[str, str] = {}
    view = measure.held[len(measure.held) // 2] if measure.held else None
    if view is not None:
        renders = _renders(out, methods, view)
        truth = _unit(data.truth.pixels(view))
        photo = _unit(measure.by_name[view].pixels)
        renders = {name: picture for name, picture in renders.items() if picture.shape == truth.shape}
        path = _across(measure, view, truth)
        _profile(out / "profile.png", truth, renders, path)
        written["profile.png"] = f"Intensity along a line across {path.what}, view {view}"
        _crops(out / "crops.png", {"blurred": photo, **renders, "truth": truth}, (path.start + path.end) / 2)
        written["crops.png"] = f"The same crop of every method, view {view}"
    for line in measure.true_widths:
        file = f"widths_{line.replace(' ', '_')}.png"
        if _widths(out / file, rows, methods, line):
            written[file] = f"Width of the {line} line from every measured viewpoint"
    return {**_movies(out, data, rows, methods, content["facts"].get("quick", False)), **written}


def _movies(
    out: Path, data: Dataset, rows: Sequence[dict[str, Any]], methods: Sequence[str], quick: bool
) -> dict[str, str]:
    """Turntables of the twins on disk; title by file name."""
    twins: dict[str, tuple[str, Path, Sequence[float]]] = {}
    for method in methods:
        row = next((row for row in rows if row["method"] == method and row["seed"] == 0), None)
        file = out / "twins" / f"{method.replace(' ', '_')}.ply"
        if row is not None and "background" in row and file.is_file():
            kind = method.split()[0]
            twins[kind] = (_TITLES.get(kind, method), file, row["background"])
    return write_movies(out, twins, _BESIDE, data.cameras, QUICK_FRAMES if quick else FRAMES) if twins else {}


def _renders(out: Path, methods: Sequence[str], view: str) -> dict[str, Picture]:
    files = {method: out / "renders" / method.replace(" ", "_") / render_file(view) for method in methods}
    found = {}
    for method, file in files.items():
        if file.is_file():
            with Image.open(file) as picture:
                found[method] = np.asarray(picture) / 255.0
    return found


@dataclass(frozen=True)
class _Path:
    """Where the profile runs: ends [2] in px, which direction in colour space it shows, and what it crosses."""

    start: Picture
    end: Picture
    colour: Picture
    what: str


def _across(measure: Measure, view: str, truth: Picture) -> _Path:
    """Across the first painted line and on over the object, or through the frame's middle."""
    height, width = truth.shape[:2]
    for line, views in measure.true_widths.items():
        if view in views:
            places = views[view].places
            place = places[len(places) // 2]
            direction = place.direction if place.direction[0] > 0 else -place.direction
            ends = place.middle + np.outer([-0.3 * height, 0.3 * height], direction)
            ends = np.clip(ends, 1, [width - 1, height - 1])
            return _Path(ends[0], ends[1], views[view].direction, f"the {line} line")
    middle = [np.array([share * width, height / 2]) for share in (0.25, 0.75)]
    return _Path(middle[0], middle[1], np.full(3, 1 / 3), "the middle")


def _profile(path: Path, truth: Picture, renders: dict[str, Picture], across: _Path) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 3.6), layout="constrained")
    for name, picture in {"truth": truth, **renders}.items():
        positions, values = intensity_profile(Sampler.of(picture), across.start, across.end, 0.5, breadth=3)
        thick = 1.8 if name in ("truth", "dgs") else 1.0
        axes.plot(positions, values @ across.colour, color=_colour(name), label=name, lw=thick)
    shares = ", ".join(f"{share:+.2f}" for share in across.colour)
    axes.set(xlabel="px", ylabel=f"sRGB values x ({shares})", title=f"Profile across {across.what}")
    axes.legend(fontsize=8, ncols=2)
    _save(figure, path)


def _widths(path: Path, rows: Sequence[dict[str, Any]], methods: Sequence[str], line: str) -> bool:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 3.6), layout="constrained")
    drawn = False
    for method in methods:
        row = next((r for r in rows if r["method"] == method and line in r["lines"]), None)
        views = row["lines"][line]["views"] if row else []
        if not views:
            continue
        at = np.arange(len(views))
        if not drawn:
            true, sure = (np.array([v[key] for v in views], float) for key in ("true", "true_uncertainty"))
            axes.fill_between(at, true - sure, true + sure, color="0.8")
            axes.plot(at, true, color="black", label="truth")
            held = [i for i, v in enumerate(views) if v["heldout"]]
            axes.plot(held, true[held], "k|", ms=9, label="held out")
            drawn = True
        seen, sure = (np.array([np.nan if v[key] is None else v[key] for v in views], float)
                      for key in ("rendered", "uncertainty"))  # fmt: skip
        axes.errorbar(at, seen, sure, color=_colour(method), label=method, lw=1, marker=".", ms=4)
    if drawn:
        axes.set(xlabel="view", ylabel="width (px)", title=f"{line} line")
        axes.legend(fontsize=8, ncols=2)
        _save(figure, path)
    pyplot.close(figure)
    return drawn


def _crops(path: Path, pictures: dict[str, Picture], middle: NDArray[np.float64]) -> None:
    from matplotlib import pyplot

    height, width = next(iter(pictures.values())).shape[:2]
    side = int(_CROP * height)
    left = int(np.clip(middle[0] - side / 2, 0, width - side))
    top = int(np.clip(middle[1] - side / 2, 0, height - side))
    columns = 4
    lines = -(-len(pictures) // columns)
    figure, axes = pyplot.subplots(lines, columns, figsize=(2.4 * columns, 2.6 * lines), layout="constrained")
    for spot in np.ravel(axes):
        spot.axis("off")
    for spot, (name, picture) in zip(np.ravel(axes), pictures.items(), strict=False):
        spot.imshow(np.clip(picture[top : top + side, left : left + side], 0, 1), interpolation="nearest")
        spot.set_title(name, fontsize=9)
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    from matplotlib import pyplot

    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")
    pyplot.close(figure)


def _colour(name: str) -> str:
    return _LOOKS.get(name.split()[0], "tab:red")


def _unit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> Picture:
    return pixels.astype(np.float64) / np.iinfo(pixels.dtype).max
