"""Charts and panels of a comparison, drawn by matplotlib; pictures are [H, W, 3] float64, sRGB in [0, 1]."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from ...core.evaluation.profiles import Sampler, intensity_profile
from ...core.files import replacing

Picture = NDArray[np.float64]

#: What pictures call the methods, by kind, and their colour.
TITLES = {
    "truth": "truth",
    "blurred": "blurred photo",
    "plain": "plain GS",
    "wiener": "Wiener, then GS",
    "rl": "Richardson-Lucy, then GS",
    "paper": "the paper's loss",
    "dgs": "DGS",
    "oracle": "GS of sharp photos",
}
_COLOURS = {
    "truth": "black",
    "plain": "tab:orange",
    "wiener": "tab:green",
    "rl": "tab:olive",
    "paper": "tab:purple",
    "dgs": "tab:blue",
    "oracle": "tab:gray",
}
#: What the profile's first panel shows: the paper's figure.
_FIRST = ("truth", "plain", "dgs")
#: Bands of periods (px) that are shown by themselves, and the grey level that full contrast stands for.
_BANDS = ((14.0, 10.0), (10.0, 7.0))
_CONTRAST = 3.0


def title(method: str) -> str:
    """What a picture calls a method."""
    return TITLES.get(method.split()[0], method)


def colour(method: str) -> str:
    """Of a method's lines."""
    return _COLOURS.get(method.split()[0], "tab:red")


def profile(path: Path, pictures: Mapping[str, Picture], ends: tuple[Picture, Picture], axis: Picture) -> None:
    """Values along a line: truth, plain splatting and DGS above, as the paper shows; the others below.

    Args:
        pictures: by method; 'truth' among them.
        ends: [2] px each.
        axis: [3] direction in colour space that is shown.
    """
    pyplot = _pyplot()

    figure, panels = pyplot.subplots(2, 1, figsize=(8, 6.2), layout="constrained", sharex=True, sharey=True)
    for name, picture in pictures.items():
        positions, values = intensity_profile(Sampler.of(picture), *ends, 0.5, breadth=3)
        for panel in panels:
            if name == "truth" or (name in _FIRST) == (panel is panels[0]):
                thick = 1.8 if name in _FIRST else 1.2
                panel.plot(positions, values @ axis, color=colour(name), label=title(name), lw=thick)
    for panel in panels:
        panel.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    shares = ", ".join(f"{share:+.2f}" for share in axis)
    panels[1].set(xlabel="px along the line")
    figure.supylabel(f"R, G, B x ({shares})", fontsize=9)
    save(figure, path)


def widths(path: Path, found: Mapping[str, Any]) -> None:
    """A line's width from every viewpoint, with uncertainties; see `viewpoints.widths_from_everywhere`."""
    pyplot = _pyplot()

    figure, axes = pyplot.subplots(figsize=(8, 4.2), layout="constrained")
    at = np.arange(len(found["views"]))
    true, sure = (np.array(found[key], float) for key in ("true", "true_uncertainty"))
    axes.fill_between(at, true - sure, true + sure, color="0.85")
    axes.plot(at, true, color="black", label="truth", lw=1.8)
    held = np.flatnonzero(found["heldout"])
    axes.plot(held, true[held], "kx", ms=6, label="held out")
    for method, one in found["methods"].items():
        values, spread = (np.array(one[key], float) for key in ("width", "uncertainty"))
        axes.errorbar(
            at, values, spread, color=colour(method), label=title(method), lw=1, marker=".", ms=4, elinewidth=0.6
        )
    axes.set(xlabel="viewpoint along the path", ylabel=f"width of the {found['line']} line (px)")
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(figure, path)


def crops(path: Path, pictures: Mapping[str, Picture], middle: Picture, share: float) -> None:
    """The same square of every picture; its side is `share` of the frame's height."""
    pyplot = _pyplot()

    window = _window(next(iter(pictures.values())), middle, share)
    columns = 4
    lines = -(-len(pictures) // columns)
    figure, axes = pyplot.subplots(lines, columns, figsize=(2.4 * columns, 2.6 * lines), layout="constrained")
    for spot in np.ravel(axes):
        spot.axis("off")
    for spot, (name, picture) in zip(np.ravel(axes), pictures.items(), strict=False):
        spot.imshow(np.clip(picture[window], 0, 1), interpolation="nearest")
        spot.set_title(title(name), fontsize=9)
    save(figure, path)


def bands(path: Path, pictures: Mapping[str, Picture], middle: Picture, share: float) -> None:
    """Only the detail of two bands of periods: what is there of the truth's, and what is invented.

    All panels of a band share one grey scale; brightness (the mean of R, G, B) is shown.
    """
    pyplot = _pyplot()

    window = _window(pictures["truth"], middle, share)
    size = (1.75 * len(pictures), 2.0 * len(_BANDS))
    figure, axes = pyplot.subplots(len(_BANDS), len(pictures), figsize=size, layout="constrained", squeeze=False)
    for number, (row, (coarsest, finest)) in enumerate(zip(axes, _BANDS, strict=True)):
        most = _CONTRAST * float(_only(pictures["truth"].mean(2), coarsest, finest)[window].std())
        for spot, (name, picture) in zip(row, pictures.items(), strict=True):
            detail = _only(picture.mean(2), coarsest, finest)[window]
            spot.imshow(detail, cmap="gray", vmin=-most, vmax=most, interpolation="nearest")
            spot.set(xticks=[], yticks=[])
            if number == 0:
                spot.set_title(title(name), fontsize=8)
        row[0].set_ylabel(f"{coarsest:g} to {finest:g} px", fontsize=9)
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Writes the figure whole or not at all, and forgets it."""
    pyplot = _pyplot()

    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110, format="png")
    pyplot.close(figure)


def _pyplot() -> Any:
    from matplotlib import pyplot  # heavy: matplotlib

    return pyplot


def _window(picture: Picture, middle: Picture, share: float) -> tuple[slice, slice]:
    height, width = picture.shape[:2]
    side = int(share * height)
    left = int(np.clip(middle[0] - side / 2, 0, width - side))
    top = int(np.clip(middle[1] - side / 2, 0, height - side))
    return slice(top, top + side), slice(left, left + side)


def _only(plane: Picture, coarsest: float, finest: float) -> Picture:
    """[H, W] without anything but periods between `coarsest` and `finest` px."""
    height, width = plane.shape
    radius = np.hypot(np.arange(height)[:, None] / (2 * height), np.arange(width)[None, :] / (2 * width))
    spectrum = dctn(plane, norm="ortho")
    spectrum[(radius < 1 / coarsest) | (radius >= 1 / finest)] = 0.0
    return np.asarray(idctn(spectrum, norm="ortho"))
