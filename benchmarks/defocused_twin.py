"""Photos through a lens before a twin of real photos: `python -m benchmarks.defocused_twin TWIN SET [--largest 10]`.

A twin of sharp real photos is the world (`benchmarks.twin_world`): each photo averages (linearly) what 64 pinholes see
that fill the lens's round hole, shifted so that what is at the focus stands still: no layers and no kernels.
Photos have a focus of their own each, drawn evenly in inverse depth. Views 0, 8, 16, ... are pinholes. SET gets what
`synthesize` writes: `photos`, `sharp`, `transforms.json` and `manifest.json`.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera

from .twin_world import SHARP, World, chosen_cameras, light, open_world, save_photo, write_truth

#: Pinholes that fill a lens; shares of the points' inverse depths that circles are largest at, and foci lie between.
PINHOLES, LARGEST_AT, FOCI = 64, (0.05, 0.95), (0.15, 0.85)


def inverse_depths(world: World, camera: Camera) -> np.ndarray:
    """[M] of the points that a camera sees."""
    seen = world.points @ camera.rotation.T + camera.translation
    depth = seen[:, 2]
    px = seen[:, :2] * [camera.fx, camera.fy] / np.where(depth > 0, depth, np.inf)[:, None] + [camera.cx, camera.cy]
    inside = (depth > 0) & ((px >= 0) & (px < [camera.width, camera.height])).all(axis=1)
    return 1.0 / depth[inside]


def pinholes(camera: Camera, aperture: float, focus: float) -> list[Camera]:
    """Cameras that fill a lens of a diameter (the world's unit), in focus at a depth."""
    at = np.arange(PINHOLES)
    radius, angle = 0.5 * aperture * np.sqrt((at + 0.5) / PINHOLES), at * np.pi * (3.0 - np.sqrt(5.0))
    return [
        replace(
            camera.moved(camera.rotation, camera.translation - [x, y, 0.0]),
            cx=camera.cx + camera.fx * x / focus,
            cy=camera.cy + camera.fy * y / focus,
        )
        for x, y in zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)
    ]


def write_set(world: World, folder: Path, cameras: list[Camera], largest: float, seed: int) -> None:
    """Photos, truth, cameras, and the manifest with each photo's focus; the lens is the same for all."""
    random = np.random.default_rng(seed)
    inverse = [inverse_depths(world, camera) for camera in cameras]
    spread = np.median([np.diff(np.quantile(some, LARGEST_AT)) for some in inverse])
    scale = largest / spread
    through: dict[str, object] = {}
    for index, camera in enumerate(cameras):
        focus = 1.0 / np.quantile(inverse[index], random.uniform(*FOCI))
        sharp = light(world, [camera])
        whole = index % SHARP == 0
        save_photo(
            folder, camera, sharp if whole else light(world, pinholes(camera, scale / camera.fx, focus)), sharp, random
        )
        lens = {"defocus": {"focus": focus, "aperture": scale / camera.fx, "scale": scale}}
        through[camera.name] = {"sharp": whole} | ({} if whole else lens)
    write_truth(folder, cameras, {"defocus": {"largest_px": largest}}, through)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("twin", type=Path, help="a twin's folder, of sharp photos")
    parser.add_argument("set", type=Path, help="folder to write")
    parser.add_argument("--views", type=int, default=30)
    parser.add_argument("--width", type=int, default=600, help="of the photos in px")
    parser.add_argument("--largest", type=float, default=10.0, metavar="PX", help="diameter of the largest circles")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    world = open_world(options.twin)
    cameras = chosen_cameras(world, options.views, options.width, np.random.default_rng(options.seed))
    write_set(world, options.set, cameras, options.largest, options.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
