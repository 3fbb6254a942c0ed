"""Whole reconstructions with a card and without: from photos with cameras to the twin's folder, report and all.

python -m benchmarks.card_runs FOLDER                 # makes photos in FOLDER where there are none; a line a device
python -m benchmarks.card_runs FOLDER --devices gpu
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .card import THREADS, devices_here
from .speed import FULL, HERE

Row = dict[str, Any]


def write_set(folder: Path) -> None:
    """`folder`/photos and `folder`/model: the paper's case in numbers, of Gaussians instead of a ball: 76 photos along
    a rail, blurred by 5 px, with the noise of 8 bits, and points as structure from motion finds them."""
    import torch
    from dgs.core.formats.colmap import write_model
    from dgs.core.imaging.operator import BlurOperator
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.rasterizer import render
    from dgs.core.views import SparsePoints
    from PIL import Image

    from . import scene

    (width, height), random = FULL, np.random.default_rng(0)
    psf = PointSpread(sigma_x=5.0, sigma_y=5.0)
    margin, gaussians, cameras = max(psf.radius), scene.gaussians(100_000), {}
    blur = BlurOperator(psf, height, width, margin)
    (folder / "photos").mkdir(parents=True)
    for number, degrees in enumerate(np.linspace(-18.3, 18.3, 76)):
        name = f"photo_{number:02d}.jpg"
        cameras[name] = replace(scene.camera(width, height, float(degrees)), name=name)
        with torch.no_grad():
            image = blur(render(gaussians, cameras[name].with_margin(margin)).image).permute(1, 2, 0).numpy()
        pixels = np.round(255 * image + random.normal(size=image.shape)).clip(0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(folder / "photos" / name, quality=95)
    chosen = random.permutation(len(gaussians))[:5000]
    points = gaussians.means.numpy()[chosen].astype(np.float64)
    write_model(folder / "model", cameras, SparsePoints(points, np.full(points.shape, 128, np.uint8)))


def twins(folder: Path, devices: Sequence[str]) -> list[Row]:
    """A reconstruction on each device: seconds, and what it is worth."""
    if not (folder / "model").is_dir():
        write_set(folder)
    found = []
    for device in devices:
        out = folder / device
        words = ["photos", "--cameras", str(folder / "model"), "--psf", "gaussian:5", "--blur-space", "srgb"]
        words += ["--out", str(out), "--device", device, "--threads", str(THREADS), "--progress", "none"]
        begun = time.perf_counter()
        done = subprocess.run(
            [sys.executable, str(HERE.parent / "run_dgs.py"), "reconstruct", str(folder / words[0]), *words[1:]],
            capture_output=True,
            text=True,
        )
        spent = time.perf_counter() - begun
        if done.returncode:
            print(done.stdout[-1500:], done.stderr[-1500:])
            continue
        report = json.loads((out / "report.json").read_text("utf-8"))
        heldout = report["heldout"]["degraded"]["psnr"]
        row = {"device": device, "command_s": round(spent, 1), "seconds": report["seconds"], "heldout_psnr": heldout}
        found.append(row | {"steps": report["steps"], "gaussians": report["gaussians"]})
        print(json.dumps(found[-1]), flush=True)
    return found


def main() -> int:
    """Runs one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--devices", nargs="*", help="back ends; all that work here by default")
    asked = parser.parse_args()
    twins(asked.folder, asked.devices or [device for device in devices_here() if device != "gsplat"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
