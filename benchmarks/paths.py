"""Learned camera paths against the true ones of a rendered set (`synthesize --medium shake:...`).

    python -m benchmarks.paths SET TWIN [TWIN ...]

Nine points at the scene's distance are projected from 17 places along both paths, with the set's own cameras; the error
is their distance, root mean square over points and exposure, in px. Which way a path was run no photo says: the better
direction counts. Nor does a photo say in which order places were passed at all, only how long the camera was where. So
the same is said of places in any order: those of one path are matched with those of the other, one by one, so that they
lie as near each other as can be.
"""

from __future__ import annotations

import argparse
import json
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


def errors(folder: Path, twin: Path) -> dict[str, tuple[float, float]]:
    """px, places in the order of time and in any order, by name of the photos that were fitted."""
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
        ours = shown_at(camera, poses_on(twist.double(), camera, times).numpy(), learned["unit"])
        closely = shown_at(camera, poses_on(twist.double(), camera, middles).numpy(), learned["unit"])
        places = between(times.numpy(), true, middles.numpy())
        found[camera.name] = in_order(ours, true), in_any_order(closely, places)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("twins", type=Path, nargs="+")
    options = parser.parse_args()
    for twin in options.twins:
        found = errors(options.set, twin)
        print(f"{twin}: {len(found)} paths")
        for k, order in enumerate(("in the order of time", "in any order")):
            px, worst = np.array([both[k] for both in found.values()]), max(found, key=lambda name, k=k: found[name][k])
            print(
                f"  places {order}: median {np.median(px):.2f} px, within {SMALL} px {np.mean(px <= SMALL):.0%}, "
                f"worst {px.max():.2f} px ({worst})"
            )


if __name__ == "__main__":
    main()
