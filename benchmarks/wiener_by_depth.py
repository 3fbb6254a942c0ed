"""Photos behind rough glass, deconvolved one by one with their true depth: what a twin through the glass must beat.

    python -m benchmarks.wiener_by_depth SET OUT [--noise 0.001 0.003 ...]

SET: made by `synthesize --medium frosted-glass:DISTANCE,ANGLE --depth`. Each px is taken from Wiener's filters of the
two widths next to its own, by its true depth and its angle off the axis, in linear light. Writes OUT/NOISE/*.png (to
be splatted as sharp photos) and prints how near they are to the sharp pictures, for each noise-to-signal ratio.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.evaluation.metrics import psnr
from dgs.core.formats.cameras import read_cameras
from dgs.core.imaging.formation.glass import oblique
from dgs.core.imaging.fourier import wiener_photo
from dgs.core.imaging.psf import PointSpread
from PIL import Image

#: px: widths of the filters.
RUNGS = 0.4 * 1.2 ** np.arange(16)
#: Noise-to-signal ratios that are tried.
NOISE = (0.001, 0.003, 0.01, 0.03, 0.1)


def widths(depth: np.ndarray, focal: float, glass: dict) -> np.ndarray:
    """[H, W] standard deviation in px of the blur of what lies at a depth (m; 0: nothing, taken as far away)."""
    height, width = depth.shape
    y, x = np.mgrid[:height, :width] + 0.5
    tangent2 = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / focal**2
    behind = 1.0 - glass["distance"] / np.where(depth > 0, depth, np.inf)
    wider = oblique(torch.from_numpy(tangent2)).numpy()
    return np.asarray(focal * glass["scattering_rad"] * np.clip(behind, 0.0, 1.0) * wider)


def deconvolved(photo: np.ndarray, sigma: np.ndarray, noise: float) -> np.ndarray:
    """[H, W, 3] in [0, 1] sRGB, of a photo in sRGB and the width of its blur at each px."""
    light = torch.from_numpy(srgb_to_linear(photo)).permute(2, 0, 1).float()
    spreads = [PointSpread(sigma_x=float(s), sigma_y=float(s)) for s in RUNGS]
    stack = np.stack([wiener_photo(light, spread, noise).permute(1, 2, 0).numpy() for spread in spreads])
    at = np.interp(np.log(np.maximum(sigma, RUNGS[0])), np.log(RUNGS), np.arange(len(RUNGS)))
    below = np.minimum(at.astype(int), len(RUNGS) - 2)
    share = (at - below)[..., None]
    rows, columns = np.indices(sigma.shape)
    mixed = (1 - share) * stack[below, rows, columns] + share * stack[below + 1, rows, columns]
    return np.asarray(linear_to_srgb(np.clip(mixed, 0.0, 1.0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--noise", type=float, nargs="+", default=NOISE)
    options = parser.parse_args()
    glass = json.loads((options.set / "manifest.json").read_text())["media"]["frosted-glass"]
    cameras = read_cameras(options.set / "transforms.json").pinholes()
    for noise in options.noise:
        folder = options.out / f"{noise:g}"
        folder.mkdir(parents=True, exist_ok=True)
        scores = []
        for name, camera in cameras.items():
            photo, sharp = (
                np.asarray(Image.open(options.set / part / name).convert("RGB"), np.float64) / 255.0
                for part in ("photos", "sharp")
            )
            depth = np.load(options.set / "depth" / f"{Path(name).stem}.npy")
            found = deconvolved(photo, widths(depth, camera.fx, glass), noise)
            scores.append(psnr(found, sharp))
            Image.fromarray(np.round(found * 255).astype(np.uint8)).save(folder / name)
        print(f"noise to signal {noise:g}: {np.mean(scores):.2f} dB against the sharp pictures ({len(scores)} photos)")


if __name__ == "__main__":
    main()
