"""Learned camera paths against the true ones of a rendered set (`synthesize --medium shake:...`).

    python -m benchmarks.paths SET TWIN [TWIN ...]

Nine points at the scene's distance are projected from 17 places along both paths, with the set's own cameras; the error
is their distance, root mean square over points and exposure, in px. Which way a path was run no photo says: the better
direction counts.
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

#: Tangents of the nine points' directions from the camera, and an error (px) that is small.
ACROSS, DOWN, SMALL = (-0.2, 0.0, 0.2), (-0.15, 0.0, 0.15), 0.5


def shown_at(camera: Camera, poses: np.ndarray, depth: float) -> np.ndarray:
    """[T, 9, 2] px at which nine points at a depth before the camera are seen from poses [T, 3, 4]."""
    seen = np.array([(x * depth, y * depth, depth) for x in ACROSS for y in DOWN])
    world = (seen - camera.translation) @ camera.rotation
    moved = np.einsum("tij,kj->tki", poses[:, :, :3], world) + poses[:, None, :, 3]
    return np.asarray(moved[..., :2] / moved[..., 2:] * camera.fx)


def errors(folder: Path, twin: Path) -> dict[str, float]:
    """px, by name of the photos that were fitted."""
    manifest = json.loads((folder / "manifest.json").read_text())
    report = json.loads((twin / "report.json").read_text())
    learned = next(e["parameters"] for e in report["effects"] if e["name"] == "motion" and e["on"])
    times = torch.tensor(manifest["media"]["shake"]["times"])
    found = {}
    for camera in read_cameras(folder / "transforms.json").pinholes().values():
        if camera.name not in learned["twists"] or camera.name in manifest["held_out"]:
            continue
        still = np.column_stack([camera.rotation, camera.translation])
        shake = manifest["through"][camera.name].get("shake")
        true = np.array(shake["poses"]) if shake else np.repeat(still[None], len(times), axis=0)
        poses = poses_on(torch.tensor(learned["twists"][camera.name], dtype=torch.float64), camera, times.double())
        ours, theirs = (shown_at(camera, p, learned["unit"]) for p in (poses.numpy(), true))
        found[camera.name] = min(float(np.sqrt(np.square(o - theirs).sum(axis=2).mean())) for o in (ours, ours[::-1]))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("twins", type=Path, nargs="+")
    options = parser.parse_args()
    for twin in options.twins:
        found = errors(options.set, twin)
        px, worst = np.array(list(found.values())), max(found, key=lambda name: found[name])
        print(
            f"{twin}: {len(px)} paths, median {np.median(px):.2f} px, within {SMALL} px {np.mean(px <= SMALL):.0%}, "
            f"worst {px.max():.2f} px ({worst})"
        )


if __name__ == "__main__":
    main()
