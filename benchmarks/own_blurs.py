"""How well each photo shows its own motion path and its own width of blur: synthetic sets, known truth.

    python -m benchmarks.own_blurs [--scenes 6]

Prints two tables in Markdown: errors of lengths and directions, and of sigmas with and without shrinkage.
"""

from __future__ import annotations

import argparse

import numpy as np
from dgs.core.inspection.blind_psf import blind_psf
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.inspection.psf_per_photo import psf_per_photo

from .effect_scenes import Truth, degrade, kept_scene, own_paths, own_sigmas
from .effects import KEPT, photo_set

#: Sets whose photos moved: mean length (px), and the blur besides.
MOVED = ((0.0, 0.0), (0.0, 2.0), (3.0, 0.0), (6.0, 0.0), (12.0, 0.0), (6.0, 2.0), (12.0, 2.0), (6.0, 4.0), (12.0, 4.0))
#: Sets whose photos have a sigma each, uniform between these, px.
WIDTHS = ((2.0, 4.0), (2.5, 3.5), (2.8, 3.2), (3.0, 3.0))


def spread(values: list[float], digits: int = 2) -> str:
    """Median and ninth decile."""
    return f"{np.median(values):.{digits}f} / {np.quantile(values, 0.9):.{digits}f}" if values else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=6)
    scenes = range(parser.parse_args().scenes)
    print("| path, px (mean) | blur besides, px | photos found to move | length, relative error | direction, degrees |")
    print("|---|---|---|---|---|")
    for length, sigma in MOVED:
        truth, found, relative, turned = Truth(motion=length, psf=(sigma, sigma, 0.0)), [], [], []
        for seed in scenes:
            scene = kept_scene(seed, KEPT)
            photos = photo_set(scene, degrade(scene, truth, seed))
            paths = photos.motion_paths
            for photo, (true, angle) in zip(photos.photos, own_paths(truth, scene, seed), strict=True):
                path = paths[photo.name]
                found.append(path.length > 0)
                if path.length and length:
                    relative.append(abs(path.length / true - 1))
                    turned.append(abs((path.angle - angle + 90) % 180 - 90))
        print(
            f"| {length:g} | {sigma:g} | {sum(found)} of {len(found)} | {spread(relative, 3)} | {spread(turned, 1)} |",
            flush=True,
        )
    print("\n| sigma of the photos, px | sets found to differ | all as shared | each alone | each, shrunk |")
    print("|---|---|---|---|---|")
    for low, high in WIDTHS:
        differ, errors = 0, ([], [], [])
        for seed in scenes:
            scene, truth = kept_scene(seed, KEPT), Truth(own=(low, high))
            photos = photo_set(scene, degrade(scene, truth, seed)).photos
            shared = blind_psf(PhotoSet(photos, linear=True)).point_spread()
            own = psf_per_photo(photos, shared, linear=True)
            differ += bool(own.spreads)
            for photo, true in zip(photos, own_sigmas(truth, len(photos), seed), strict=True):
                sigmas = shared.sigma_x, own.alone[photo.name], own.shrunk[photo.name]
                for kept, sigma in zip(errors, sigmas, strict=True):
                    kept.append(abs(sigma - true))
        cells = " | ".join(spread(kept) for kept in errors)
        print(f"| {low:g} to {high:g} | {differ} of {len(scenes)} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
