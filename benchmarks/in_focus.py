"""Twins of photos whose focus moves, where held-out photos are in focus: no sharp truth is needed.

    python -m benchmarks.in_focus PHOTOS TWIN [TWIN ...]

Twice: where a held-out photo's fine detail (the rms of what a Gaussian of 1.5 px takes away, averaged over 8 px) is in
its upper third, which large letters are even out of focus; and where it is in focus by what no contrast feigns: among
the half with more texture (1 to 4 px), the third with most detail below 1 px for it. There the sharp render is compared
with it, each channel's gain matched, as exposures may differ.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

#: px of the photo: what is fine, and over what it is averaged; the share of px that count as in focus.
FINE, AROUND, SHARE = 1.5, 8.0, 1 / 3
#: px, standard deviations between which texture lies.
TEXTURE = (1.0, 4.0)


def in_focus(photo: np.ndarray) -> np.ndarray:
    """[H, W] bool: where a photo [H, W, 3] shows fine detail."""
    grey = photo.mean(axis=2)
    fine = np.square(grey - ndimage.gaussian_filter(grey, FINE))
    detail = ndimage.gaussian_filter(fine, AROUND)
    return np.asarray(detail > np.quantile(detail, 1 - SHARE))


def in_focus_by_ratio(photo: np.ndarray) -> np.ndarray:
    """[H, W] bool: where the texture of a photo [H, W, 3] goes on to the finest detail."""
    grey = photo.mean(axis=2)
    soft, softer = (ndimage.gaussian_filter(grey, width) for width in TEXTURE)
    finest, texture = (ndimage.gaussian_filter(band**2, AROUND) for band in (grey - soft, soft - softer))
    ratio, textured = finest / (texture + 1e-5), texture > np.median(texture)
    return np.asarray(textured & (ratio > np.quantile(ratio[textured], 1 - SHARE)))


def score(twin: Path, photos: Path, chosen: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """PSNR (dB) in focus, and the share of the photos' fine detail (rms) that the renders have there."""
    errors, detail = [], []
    for file in sorted((twin / "renders").glob("*.png")):
        shown = Image.open(file).convert("RGB")
        photo = Image.open(photos / file.name).convert("RGB")
        wanted = np.asarray(photo.resize(shown.size, Image.Resampling.BOX)) / 255.0
        render, where = np.asarray(shown) / 255.0, chosen(wanted)
        x, y = render[where], wanted[where]
        errors.append(float(np.square(x * (x * y).sum(axis=0) / np.square(x).sum(axis=0) - y).mean()))
        fine = [np.square(p - ndimage.gaussian_filter(p, (FINE, FINE, 0)))[where].mean() for p in (render, wanted)]
        detail.append(np.sqrt(fine[0] / fine[1]))
    return -10 * float(np.log10(np.mean(errors))), float(np.mean(detail))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", type=Path)
    parser.add_argument("twins", type=Path, nargs="+")
    options = parser.parse_args()
    for twin in options.twins:
        for words, chosen in (("fine detail", in_focus), ("in focus", in_focus_by_ratio)):
            psnr, detail = score(twin, options.photos, chosen)
            print(f"{twin}: {psnr:.2f} dB {words}, {detail:.2f} of the photos' fine detail")


if __name__ == "__main__":
    main()
