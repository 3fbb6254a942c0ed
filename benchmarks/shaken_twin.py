"""Photos shaken along a twin of real photos: `python -m benchmarks.shaken_twin TWIN SET [--views 30] [--path 4 20]`.

What path a real camera took nobody can say. So a twin of sharp real photos is the world here (`benchmarks.twin_world`):
its renders are the truth, and light is averaged (linearly) over the renders along a curved path in each exposure, 49.
Cameras are those of the twin, of which the nearest to their middle are taken, and, where these are too few, ones
between two neighbours. Noise and JPEG are added; views 0, 8, 16, ... stand still. SET gets what `synthesize` writes:
`photos`, `sharp`, `transforms.json` and `manifest.json`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import scene_depth
from scipy.spatial.transform import Rotation

from .twin_world import SHARP, World, chosen_cameras, light, open_world, save_photo, write_truth

#: Renders along a path.
RENDERS = 49
#: Every so many of them is in the manifest.
STORED = 3
#: Share of a path that comes of moving, beside turning.
MOVING = 0.5


def drawn_path(camera: Camera, depth: float, length: float, random: np.random.Generator) -> np.ndarray:
    """[RENDERS, 6] rotations and moves of the camera in its own axes, whose middle is none; `length` px at `depth`."""
    time = np.linspace(-0.5, 0.5, RENDERS)
    bends = np.stack([time, 1.2 * time**2 * random.normal(), 2.0 * time**3 * random.normal()], axis=1)
    weights = random.normal(size=(6, 3)) * np.array([1.0, 0.5, 0.5])
    weights[2] *= 0.6  # hands roll a camera, and move it towards what it sees, less than aside
    weights[5] *= 0.5
    path = bends @ weights.T
    path -= path.mean(axis=0)
    path[:, 3:] *= MOVING * depth
    aside = path[:, [1, 0]] * [1.0, -1.0] + path[:, 3:5] / depth
    return path * (length / (camera.fx * np.linalg.norm(np.diff(aside, axis=0), axis=1).sum()))


def poses_along(camera: Camera, path: np.ndarray) -> list[Camera]:
    """Where a camera is along a path [N, 6]."""
    turns = Rotation.from_rotvec(path[:, :3]).as_matrix()
    return [
        camera.moved(turn @ camera.rotation, turn @ camera.translation + move)
        for turn, move in zip(turns, path[:, 3:], strict=True)
    ]


def shake(camera: Camera, path: np.ndarray, length: float) -> dict[str, object]:
    """What the manifest says of a photo's path [RENDERS, 6], as `synthesize` does."""
    along = poses_along(camera, path)[::STORED]
    poses = [np.column_stack([there.rotation, there.translation]).tolist() for there in along]
    return {"shake": {"path_px": length, "poses": poses}}


def write_set(world: World, folder: Path, cameras: list[Camera], lengths: tuple[float, float], seed: int) -> None:
    """Photos, truth, cameras, and the manifest with each photo's path."""
    random = np.random.default_rng(seed)
    through = {}
    for index, camera in enumerate(cameras):
        depth, length = scene_depth(camera, world.points), random.uniform(*lengths)
        path = drawn_path(camera, depth, length, random)
        still = light(world, [camera])
        stands = index % SHARP == 0
        save_photo(folder, camera, still if stands else light(world, poses_along(camera, path)), still, random)
        through[camera.name] = {"sharp": stands, "depth": depth} | ({} if stands else shake(camera, path, length))
    media = {"shake": {"times": list(np.linspace(-0.5, 0.5, RENDERS)[::STORED]), "readout": 0.0}}
    write_truth(folder, cameras, media, through)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("twin", type=Path, help="a twin's folder, of sharp photos")
    parser.add_argument("set", type=Path, help="folder to write")
    parser.add_argument("--views", type=int, default=30)
    parser.add_argument("--width", type=int, default=600, help="of the photos in px")
    parser.add_argument("--path", type=float, nargs=2, default=(4.0, 20.0), metavar="PX", help="shortest, longest path")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    world = open_world(options.twin)
    cameras = chosen_cameras(world, options.views, options.width, np.random.default_rng(options.seed))
    write_set(world, options.set, cameras, tuple(options.path), options.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
