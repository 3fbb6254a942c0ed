"""A large set with its photos on disk against all of it in memory: peak memory, time per step, the twins' digests.

    python -m benchmarks.large_set FOLDER                  # 1,000 photos of 960 x 720 px are made there first (300 MB)
    python -m benchmarks.large_set FOLDER --steps 100      # only steps: one from memory, one from disk, in turns

Fifty views of the tests' scene are rendered, and repeated with new noise. Each run is a process of its own. Steps are
taken in one process, so that whoever else uses the machine slows both alike; the limit is so low there that pages are
given back all the time.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from dgs.core.formats.cameras import read_cameras
from dgs.core.formats.colmap import write_model
from dgs.core.imaging.medium import Medium
from dgs.core.photos.load import load_photo
from dgs.core.photos.store import PhotoStore
from dgs.core.rasterizer import render
from dgs.core.training.settings import TrainingSettings
from dgs.core.training.trainer import Trainer
from dgs.core.views import SparsePoints, View
from dgs.tests.command_line.scene import HEIGHT, WIDTH, scene_cameras, scene_gaussians
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
VIEWS, FINER, NOISE = 50, 6, 4.0  # renders; times the scene's px; standard deviation in steps of 8 bits


def make(folder: Path, photos: int) -> None:
    """Writes photos/ and model/."""
    (folder / "photos").mkdir(parents=True)
    truth, random, cameras = scene_gaussians(), np.random.default_rng(0), {}
    for index, small in enumerate(scene_cameras(VIEWS)):
        camera = small.resized(FINER * WIDTH, FINER * HEIGHT)
        with torch.no_grad():
            picture = render(truth, camera).image.clamp(0, 1).permute(1, 2, 0).numpy() * 255
        for again in range(photos // VIEWS):
            name = f"photo_{index:02d}_{again:03d}.jpg"
            noisy = picture + NOISE * random.standard_normal(picture.shape, np.float32)
            pixels = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
            Image.fromarray(pixels).save(folder / "photos" / name, quality=92)
            cameras[name] = replace(camera, name=name)
    points = truth.means.double().numpy()
    write_model(folder / "model", cameras, SparsePoints(points, np.full((len(points), 3), 128, np.uint8)))


def measured(folder: Path, name: str, words: list[str]) -> dict[str, object]:
    """One run: its peak memory, seconds per step, and its twin."""
    out = folder / name
    given = ["--cameras", str(folder / "model"), "--preset", "draft", "--holdout-every", "50", "--progress", "none"]
    command = [sys.executable, str(ROOT / "run_dgs.py"), "reconstruct", str(folder / "photos"), "--out", str(out)]
    subprocess.run([*command, *given, *words], check=True)
    report = json.loads((out / "report.json").read_text("utf-8"))
    return {
        "run": name,
        "peak_memory_mb": report["peak_memory_mb"],
        "ms_per_step": round(1000 * report["seconds"]["train"] / report["steps"], 1),
        "seconds": report["seconds"],
        "psnr": report["heldout"]["degraded"]["psnr"],
        "twin": hashlib.sha256((out / "twin.ply").read_bytes()).hexdigest()[:12],
    }


def steps(folder: Path, count: int, photos: int = 100) -> dict[str, float]:
    """Medians of a step's processor seconds and wall seconds (ms), and what the disk's are to the memory's."""
    model, found = read_cameras(folder / "model"), {}
    files = sorted((folder / "photos").iterdir())[:: max(1, len(list((folder / "photos").iterdir())) // photos)]
    cameras = model.pinholes()
    with tempfile.TemporaryDirectory(dir=folder) as place:
        store = PhotoStore(Path(place), limit=1)
        kinds = {"memory": lambda pixels: pixels, "disk": store.kept}
        settings = replace(TrainingSettings.preset("draft"), threads=1, seed=1)
        trainers = {
            name: Trainer(
                [View(cameras[file.name], keep(load_photo(file).pixels)) for file in files],
                [],
                model.points(),
                Medium(),
                settings,
            )
            for name, keep in kinds.items()
        }
        taken: dict[str, list[tuple[float, float]]] = {name: [] for name in kinds}
        for step in range(count):
            for name in sorted(kinds, reverse=bool(step % 2)):
                before = time.process_time(), time.perf_counter()
                trainers[name].advance(0.5)  # (the full grid)
                taken[name].append((time.process_time() - before[0], time.perf_counter() - before[1]))
    for name, rows in taken.items():
        for i, kind in enumerate(("processor", "wall")):
            found[f"{name} {kind} ms"] = round(1000 * statistics.median(row[i] for row in rows), 2)
    for kind in ("processor", "wall"):
        found[f"{kind} ratio"] = round(found[f"disk {kind} ms"] / found[f"memory {kind} ms"], 3)
    return found


def main() -> None:
    """Makes the set where it is not there, and runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photos", type=int, default=1000)
    parser.add_argument("--memory", default="4G")
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--only", choices=("stored", "memory"))
    options = parser.parse_args()
    if not (options.folder / "model").is_dir():
        make(options.folder, options.photos)
    if options.steps:
        print(json.dumps(steps(options.folder, options.steps)))
        return
    for name, words in (("stored", ["--memory", options.memory]), ("memory", [])):
        if options.only in (None, name):
            print(json.dumps(measured(options.folder, name, words)), flush=True)


if __name__ == "__main__":
    main()
