"""Pictures of an inspection: where the photos are blurred, how their spectra fall, how they differ from one another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..files import make_folder, replacing
from .evidence import Evidence
from .photo_set import PhotoSet
from .spectra import RADII, bin_counts, middle_frequencies, polar_power

#: What is drawn, by name.
PICTURES = ("blur_map.png", "spectrum.png", "photos.png")


def draw_inspection(folder: Path, photos: PhotoSet, found: Sequence[Evidence]) -> list[Path]:
    """Writes blur_map.png, spectrum.png and photos.png; returns their paths.

    Raises:
        OutputError: they cannot be written.
    """
    make_folder(folder)
    drawn = []
    for name, draw in zip(PICTURES, (_blur_map, _spectrum, _per_photo), strict=True):
        figure = draw(photos, {e.name: e for e in found})
        if figure is None:
            continue
        with replacing(folder / name) as temporary:
            figure.savefig(temporary)
        drawn.append(folder / name)
    return drawn


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure  # heavy: only for pictures

    return Figure(figsize=(width, height), dpi=110, layout="constrained")


def _blur_map(photos: PhotoSet, found: dict[str, Evidence]) -> Any:
    """Median blur at every place of the frame, over all photos; and against depth."""
    tiles = photos.tiles
    if not len(tiles.variance):
        return None
    local = photos.local_blur
    by_depth = local is not None and local.by_depth
    figure = _figure(11.0 if by_depth else 6.0, 4.2)
    axes = figure.subplots(1, 2 if by_depth else 1, squeeze=False)[0]
    xs, ys = np.unique(tiles.x), np.unique(tiles.y)
    grid = np.full((len(ys), len(xs)), np.nan)
    for i, y in enumerate(ys):
        for j, x in enumerate(xs):
            here = tiles.variance[(tiles.x == x) & (tiles.y == y)]
            if len(here):
                grid[i, j] = math.sqrt(max(float(np.median(here)), 0.0))
    height, width = photos.greys[0].shape
    shown = axes[0].imshow(grid, cmap="viridis", extent=(0, width, height, 0), vmin=0)
    figure.colorbar(shown, ax=axes[0], label="sigma, px", shrink=0.8)
    axes[0].set(title="Blur over the frame, median of the photos", xlabel="px", ylabel="px")
    if by_depth and local is not None:
        sigma = np.sign(local.variances) * np.sqrt(np.abs(local.variances))
        axes[1].plot(local.depths, sigma, ".", markersize=3, alpha=0.35, label="tiles")
        axes[1].plot(local.curve[0], np.sqrt(np.maximum(local.curve[1], 0)), "C3", label="parabola in 1 / depth")
        axes[1].set(title="Blur against depth", xlabel="depth / median depth", ylabel="sigma, px")
        axes[1].legend(fontsize=8)
    return figure


def _spectrum(photos: PhotoSet, found: dict[str, Evidence]) -> Any:
    """Power against frequency of one photo of middling blur, with what was fitted."""
    measured = [(blur.variance, i) for i, blur in enumerate(photos.blurs) if blur is not None]
    if not measured:
        return None
    index = sorted(measured)[len(measured) // 2][1]
    grey, noise, blur = photos.greys[index], photos.grey_noise[index], photos.blurs[index]
    assert blur is not None
    power, counts = polar_power(grey), bin_counts(*grey.shape)
    radial = (power * counts).sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
    f = middle_frequencies(min(grey.shape))
    ok = counts.sum(axis=1) > 0
    figure = _figure(6.5, 4.4)
    axes = figure.subplots()
    axes.loglog(f[ok], radial[ok], "o", markersize=3, label=photos.looked_at[index].name)
    band = ok & (f <= blur.highest)
    law = -blur.slope * np.log(f) - 4 * np.pi**2 * blur.variance * f**2
    level = float(np.median(np.log(np.maximum(radial - noise**2, 1e-30))[band] - law[band]))
    axes.loglog(
        f,
        np.exp(law + level) + noise**2,
        "C3",
        label=f"f^-{blur.slope:.1f}, blurred by {math.sqrt(max(blur.variance, 0)):.2f} px, and noise",
    )
    axes.loglog(f, np.exp(-blur.slope * np.log(f) + level), "k:", linewidth=1, label="the scene without blur")
    axes.axhline(noise**2, color="grey", linewidth=0.8)
    axes.axvline(blur.highest, color="grey", linestyle="--", linewidth=0.8)
    low = 0.3 * min(noise**2, float(radial[ok].min()))
    axes.set(title="Spectrum", xlabel="cycles/px", ylabel="power", ylim=(low, 3 * float(radial[ok].max())))
    axes.legend(fontsize=8)
    assert len(radial) == RADII
    return figure


def _per_photo(photos: PhotoSet, found: dict[str, Evidence]) -> Any:
    """Blur, motion and gain of every photo."""
    rows: list[tuple[str, dict[str, Any]]] = []
    for name, key, title in (
        ("blur", "sigmas", "blur, px (sigma)"),
        ("motion", "lengths", "own path, px"),
        ("exposure", "gains", "gain"),
    ):
        values = found[name].plots.get(key) if name in found else None
        if values:
            rows.append((title, values))
    if not rows:
        return None
    names = [photo.name for photo in photos.photos]
    figure = _figure(max(7.0, min(16.0, 0.22 * len(names) + 2)), 1.9 * len(rows) + 0.8)
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (title, values) in zip(axes, rows, strict=True):
        place = [i for i, name in enumerate(names) if name in values]
        if title == "gain":
            for c, colour in enumerate(("C3", "C2", "C0")):
                ax.plot(place, [math.exp(values[names[i]][c]) for i in place], "o-", color=colour, markersize=3)
            ax.axhline(1.0, color="grey", linewidth=0.8)
        else:
            ax.bar(place, [values[names[i]] for i in place], color="C0")
        ax.set_ylabel(title)
    step = max(1, len(names) // 40)
    axes[-1].set_xticks(
        range(0, len(names), step), [names[i] for i in range(0, len(names), step)], rotation=90, fontsize=7
    )
    return figure
