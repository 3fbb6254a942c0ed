"""Learned camera paths against the true ones of a rendered set (`synthesize --medium shake:...`).

    python -m benchmarks.paths SET TWIN [TWIN ...]
    python -m benchmarks.paths SET TWIN --draw view_004.png --to PICTURE     # both paths of one photo

Nine points at the scene's distance are projected from 17 places along both paths, with the set's own cameras; the error
is their distance, root mean square over points and exposure, in px. Which way a path was run no photo says: the better
direction counts. Nor does a photo say in which order places were passed at all, only how long the camera was where. So
the same is said of places in any order: those of one path are matched with those of the other, one by one, so that they
lie as near each other as can be.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.formats.cameras import read_cameras
from dgs.core.imaging.formation.path_poses import poses_on
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

#: Tangents of the nine points' directions from the camera, and an error (px) that is small.
ACROSS, DOWN, SMALL = (-0.2, 0.0, 0.2), (-0.15, 0.0, 0.15), 0.5
#: Times of an exposure whose places are matched with each other.
PLACES = 129


def shown_at(camera: Camera, poses: np.ndarray, depth: float) -> np.ndarray:
    """[T, 9, 2] px at which nine points at a depth before the camera are seen from poses [T, 3, 4]."""
    seen = np.array([(x * depth, y * depth, depth) for x in ACROSS for y in DOWN])
    world = (seen - camera.translation) @ camera.rotation
    moved = np.einsum("tij,kj->tki", poses[:, :, :3], world) + poses[:, None, :, 3]
    return np.asarray(moved[..., :2] / moved[..., 2:] * camera.fx)


def in_order(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> float:
    """px rms between two paths [T, 9, 2], run in the better direction."""
    return min(float(np.sqrt(np.square(o - theirs).sum(axis=2).mean())) for o in (ours, ours[::-1]))


def in_any_order(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> float:
    """px rms between the places [T, 9, 2] of two paths that lie as near each other as can be."""
    squares = np.square(ours[:, None] - theirs[None]).sum(axis=3).mean(axis=2)
    return float(np.sqrt(squares[linear_sum_assignment(squares)].mean()))


def between(times: NDArray[np.float64], seen: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """[K, 9, 2] where a path [T, 9, 2] leads at other times."""
    flat = seen.reshape(len(seen), -1)
    return np.stack([np.interp(wanted, times, column) for column in flat.T], axis=1).reshape(-1, *seen.shape[1:])


@dataclass(frozen=True)
class BothPaths:
    """Where nine points are seen from a photo's places, px.

    Attributes:
        ours, true: [17, 9, 2] at the manifest's times.
        our_places, true_places: [PLACES, 9, 2] at times that lie evenly.
    """

    ours: NDArray[np.float64]
    true: NDArray[np.float64]
    our_places: NDArray[np.float64]
    true_places: NDArray[np.float64]

    @property
    def off(self) -> tuple[float, float]:
        """px, places in the order of time and in any order."""
        return in_order(self.ours, self.true), in_any_order(self.our_places, self.true_places)


def both_paths(folder: Path, twin: Path) -> dict[str, BothPaths]:
    """By name of the photos that were fitted."""
    manifest = json.loads((folder / "manifest.json").read_text())
    report = json.loads((twin / "report.json").read_text())
    learned = next(e["parameters"] for e in report["effects"] if e["name"] == "motion" and e["on"])
    times = torch.tensor(manifest["media"]["shake"]["times"], dtype=torch.float64)
    first, last = float(times[0]), float(times[-1])
    middles = torch.linspace(0.5 / PLACES, 1.0 - 0.5 / PLACES, PLACES, dtype=torch.float64) * (last - first) + first
    found = {}
    for camera in read_cameras(folder / "transforms.json").pinholes().values():
        if camera.name not in learned["twists"] or camera.name in manifest["held_out"]:
            continue
        still = np.column_stack([camera.rotation, camera.translation])
        shake, twist = manifest["through"][camera.name].get("shake"), torch.tensor(learned["twists"][camera.name])
        poses = np.array(shake["poses"]) if shake else np.repeat(still[None], len(times), axis=0)
        true = shown_at(camera, poses, learned["unit"])
        ours, places = (
            shown_at(camera, poses_on(twist.double(), camera, at).numpy(), learned["unit"]) for at in (times, middles)
        )
        found[camera.name] = BothPaths(ours, true, places, between(times.numpy(), true, middles.numpy()))
    return found


def draw(paths: BothPaths, name: str, picture: Path) -> None:
    """The middle point's way along both paths, the time as colour, and what a point of light leaves of each."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(7.0, 7.0), layout="constrained")
    ways = {"true path": paths.true_places[:, 4], "learned path": paths.our_places[:, 4]}
    middle = ways["true path"].mean(axis=0)
    reach = max(float(np.abs(way - middle).max()) for way in ways.values()) + 1.0
    grid = np.arange(-reach, reach, 0.1)
    for column, (title, way) in enumerate(ways.items()):
        x, y = (way - middle).T
        seen = axes[0, column].scatter(x, y, c=np.linspace(0, 1, len(x)), s=14, cmap="viridis")
        spots = [np.exp(-0.5 * ((grid[None] - at[:, None]) / 0.5) ** 2) for at in (x, y)]
        axes[1, column].imshow(spots[1].T @ spots[0], extent=(-reach, reach, reach, -reach), cmap="gray")
        axes[0, column].set(title=title, xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal")
        axes[1, column].set(title="a point of light", xlabel="px")
    figure.colorbar(seen, ax=axes[0, :], label="time in the exposure", shrink=0.8)
    figure.suptitle(f"{name}: off by {paths.off[0]:.2f} px in the order of time, by {paths.off[1]:.2f} px in any order")
    figure.savefig(picture, dpi=90)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("twins", type=Path, nargs="+")
    parser.add_argument("--draw", metavar="PHOTO", help="draw this photo's paths, as the first twin has them")
    parser.add_argument("--to", type=Path, default=Path("paths.png"), help="file of the picture")
    options = parser.parse_args()
    for twin in options.twins:
        found = {name: paths.off for name, paths in both_paths(options.set, twin).items()}
        print(f"{twin}: {len(found)} paths")
        for k, order in enumerate(("in the order of time", "in any order")):
            px, worst = np.array([both[k] for both in found.values()]), max(found, key=lambda name, k=k: found[name][k])
            print(
                f"  places {order}: median {np.median(px):.2f} px, within {SMALL} px {np.mean(px <= SMALL):.0%}, "
                f"worst {px.max():.2f} px ({worst})"
            )
    if options.draw:
        draw(both_paths(options.set, options.twins[0])[options.draw], options.draw, options.to)


if __name__ == "__main__":
    main()
