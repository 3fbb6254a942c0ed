"""How fast one iteration is, against the reference back end in the same run.

    python -m benchmarks.speed            # table, and benchmarks/results.json

An iteration is what training repeats: render, blur, loss, backward pass, optimizer step. Every row
is measured in a process of its own, so that its peak memory is its own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent

RESULTS = HERE / "results.json"
SIGMA_PX = 5.0
FULL, HALF, SQUARE = (800, 533), (400, 266), (800, 800)
Row = dict[str, Any]


def rows_to_measure() -> list[Row]:
    """What is measured; `size` is [width, height]."""
    rows: list[Row] = []
    for size in (FULL, HALF):
        for count in (20_000, 100_000):
            for threads in (1, 2):
                rows.append({"backend": "cpu", "size": size, "gaussians": count, "threads": threads})
    rows.append({"backend": "cpu", "size": FULL, "gaussians": 20_000, "threads": 2, "sigma": 0.0})
    # What sharp photos all round an object ask for: `lego` with the preset `best`.
    rows.append({"backend": "cpu", "size": SQUARE, "gaussians": 100_000, "threads": 2, "sigma": 0.0, "sh_degree": 3})
    rows.append({"backend": "reference", "size": FULL, "gaussians": 20_000, "threads": 2})
    return [{"sh_degree": 1, "sigma": SIGMA_PX, **row} for row in rows]


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far."""
    import resource

    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes here
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def measure(row: Row) -> Row:
    """One row, in this process: medians of the stages of an iteration, in milliseconds."""

    import torch
    from dgs.core.devices import backend_named, tensors_on
    from dgs.core.imaging.operator import BlurOperator
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.machine import use_machine
    from dgs.core.rasterizer import render
    from dgs.core.training.optimizer import Adam

    from . import scene

    use_machine(row["threads"])
    backend_named(row["backend"]).check()
    device = tensors_on(row["backend"])
    width, height = row["size"]
    cameras = [scene.camera(width, height, degrees) for degrees in (-18.0, -6.0, 6.0, 18.0)]
    psf = PointSpread(sigma_x=row["sigma"], sigma_y=row["sigma"])
    margin = max(psf.radius) if row["sigma"] else 0
    cameras = [camera.with_margin(margin) for camera in cameras]
    blur = BlurOperator(psf, height, width, margin, device=device)
    optimizer = Adam(scene.gaussians(row["gaussians"], row["sh_degree"]).to(device=device))
    # The photo is a neighbouring view, so that the gradients are those of a scene half learned.
    with torch.no_grad():
        photo = blur(render(optimizer.gaussians, scene.camera(width, height, 1.0).with_margin(margin)).image)
    photo = photo.cpu()
    names = ("forward_ms", "psf_ms", "loss_ms", "backward_ms", "step_ms", "iteration_ms")
    samples: dict[str, list[float]] = {name: [] for name in names}
    evaluations = []

    slow = row["backend"] == "reference"
    until = time.perf_counter() + (14.0 if slow else 5.0)
    for iteration in range(3 if slow else 400):
        camera = cameras[iteration % 4]
        # The images of the round before stay in memory until here, as in a training: freed earlier, their memory would
        # go back to the system and be fetched anew in every stage.
        view, marks, _images = _one_iteration(row, optimizer, camera, blur, photo)
        spent = [later - earlier for earlier, later in itertools.pairwise(marks)]
        stages = (spent[0], spent[1] + spent[4], spent[2] + spent[3], spent[5], spent[6], marks[-1] - marks[0])
        # The first rounds plan, compile and fill caches.
        if iteration >= (1 if slow else 8):
            for name, stage in zip(names, stages, strict=True):
                samples[name].append(stage)
            evaluations.append(view.screen.evaluations / (cameras[0].width * cameras[0].height))
        if time.perf_counter() > until and len(evaluations) >= (1 if slow else 20):
            break
    return {
        **row,
        **{name: round(statistics.median(values), 3) for name, values in samples.items()},
        "evaluations_per_pixel": round(statistics.fmean(evaluations), 1),
        "psf_evaluation": blur.evaluation,
        "margin_px": margin,
        "iterations": len(evaluations),
        "peak_memory_mb": round(peak_memory_mb()),
    }


def _one_iteration(row: Row, optimizer: Any, camera: Any, blur: Any, photo: Any) -> tuple[Any, list[float], Any]:
    """One step of training: what was rendered, the times (ms) between its stages, and its images."""
    import torch
    from dgs.core.devices import backend_named
    from dgs.core.rasterizer import render
    from dgs.core.training.loss.photometric import PhotometricLoss

    backend = backend_named(row["backend"])
    rates = dict.fromkeys([*(name for name, _ in optimizer.gaussians.named()), "sh_rest"], 1e-5)

    def now() -> float:
        backend.synchronize()
        return time.perf_counter() * 1e3

    marks = [now()]
    view = render(optimizer.gaussians, camera, backend=row["backend"])
    marks.append(now())
    blurred = blur(view.image)
    marks.append(now())
    # Training compares with another photo every time, so its statistics are part of the loss.
    loss = PhotometricLoss(photo)(blurred.cpu())
    marks.append(now())
    # In two steps, so that what the medium costs on the way back is counted as the medium's.
    gradient = torch.autograd.grad(loss, blurred)[0]
    marks.append(now())
    image_gradient = torch.autograd.grad(blurred, view.image, gradient)[0] if row["sigma"] else gradient
    marks.append(now())
    view.image.backward(image_gradient)
    marks.append(now())
    optimizer.step(rates)
    marks.append(now())
    return view, marks, (blurred, loss, gradient, image_gradient)


def compile_seconds(_: Row) -> Row:
    """Time until the first iteration's kernels are there, in this process."""

    import torch
    from dgs.core.imaging.operator import BlurOperator
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.rasterizer import render
    from dgs.core.training.loss.photometric import PhotometricLoss
    from dgs.core.training.optimizer import Adam

    from . import scene

    optimizer = Adam(scene.gaussians(500, 1))
    camera = scene.camera(64, 48)
    start = time.perf_counter()
    blurred = BlurOperator(PointSpread(sigma_x=2.0, sigma_y=2.0), 48, 64)(render(optimizer.gaussians, camera).image)
    PhotometricLoss(torch.zeros(3, 48, 64))(blurred).backward()
    optimizer.step(dict.fromkeys([*(name for name, _ in optimizer.gaussians.named()), "sh_rest"], 1e-5))
    return {"seconds": round(time.perf_counter() - start, 2)}


def training_memory(row: Row) -> Row:
    """Peak memory of training itself, on photos of noise (memory does not care), in this process."""
    import numpy as np
    from dgs.core.imaging.medium import Medium
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.training.settings import TrainingSettings
    from dgs.core.training.trainer import Trainer
    from dgs.core.views import SparsePoints, View

    from . import scene

    random = np.random.default_rng(0)
    width, height = row["size"]
    views = [
        View(scene.camera(width, height, degrees), random.integers(0, 256, (height, width, 3), dtype=np.uint8))
        for degrees in np.linspace(-18.3, 18.3, row["photos"])
    ]
    points = scene.surface_points(5000, random)  # as many as structure from motion finds
    sparse = SparsePoints(points, random.integers(0, 256, (len(points), 3), dtype=np.uint8))
    # A sigma of 2 px keeps the photos' own grid, where memory is largest.
    # A fifth of the budget is left to density control, which comes later.
    settings = TrainingSettings(max_gaussians=row["gaussians"] * 5 // 4, sh_degree=row["sh_degree"])
    trainer = Trainer(views, [], sparse, Medium(PointSpread(sigma_x=2.0, sigma_y=2.0)), settings)
    prepared = peak_memory_mb()
    for _ in range(20):
        trainer.advance(0.5)
    return {
        **row,
        "gaussians": len(trainer.optimizer.gaussians),
        "prepared_mb": round(prepared),
        "peak_memory_mb": round(peak_memory_mb()),
    }


MEASUREMENTS: dict[str, Callable[[Row], Row]] = {"row": measure, "compile": compile_seconds, "memory": training_memory}


def in_own_process(what: str, row: Row, **environment: str) -> Row:
    """Runs one measurement in a fresh interpreter.

    Raises:
        subprocess.CalledProcessError: the measurement failed; its traceback is on stderr.
    """
    finished = subprocess.run(
        [sys.executable, "-m", "benchmarks.speed", "--measure", what, "--row", json.dumps(row)],
        stdout=subprocess.PIPE,
        check=True,
        text=True,
        cwd=HERE.parent,
        env={**os.environ, **environment},
    )
    result: Row = json.loads(finished.stdout.splitlines()[-1])
    return result


def machine() -> Row:
    """What the figures were measured on."""
    import numba
    import torch

    model = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        lines = [line for line in information.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "cpu": model,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numba": numba.__version__,
        "load_before": None if load is None else round(load, 2),
    }


def ratios(rows: list[Row]) -> Row:
    """The figures that the README quotes, from the rows of one run."""

    def iteration(backend: str, threads: int, sigma: float = SIGMA_PX) -> float:
        for row in rows:
            key = (row["backend"], tuple(row["size"]), row["gaussians"], row["threads"], row["sigma"])
            if key == (backend, FULL, 20_000, threads, sigma):
                return float(row["iteration_ms"])
        raise LookupError(f"no row for {backend} on {threads} threads")

    main = next(r for r in rows if r["backend"] == "cpu" and r["threads"] == 2 and r["gaussians"] == 20_000)
    return {
        "faster_than_reference": round(iteration("reference", 2) / iteration("cpu", 2), 1),
        "faster_on_two_threads": round(iteration("cpu", 1) / iteration("cpu", 2), 2),
        "psf_share": round(main["psf_ms"] / main["iteration_ms"], 3),
    }


COLUMNS = (
    ("backend", "backend", "{}"),
    ("size", "size", "{0[0]}x{0[1]}"),
    ("gaussians", "Gaussians", "{:,}"),
    ("sh_degree", "degree", "{}"),
    ("threads", "thr", "{}"),
    ("sigma", "PSF", "{:g}"),
    ("forward_ms", "forward", "{:.1f}"),
    ("psf_ms", "psf", "{:.1f}"),
    ("loss_ms", "loss", "{:.1f}"),
    ("backward_ms", "backward", "{:.1f}"),
    ("step_ms", "step", "{:.1f}"),
    ("iteration_ms", "iteration", "{:.1f}"),
    ("evaluations_per_pixel", "eval/px", "{:.0f}"),
    ("peak_memory_mb", "MB", "{}"),
)


def main() -> int:
    """Measures everything, prints the table, writes the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measure", choices=MEASUREMENTS, help=argparse.SUPPRESS)
    parser.add_argument("--row", type=json.loads, default={}, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(MEASUREMENTS[arguments.measure](arguments.row)))
        return 0

    result: Row = {"machine": machine(), "compile": {}, "rows": []}
    with tempfile.TemporaryDirectory() as folder:
        for state in ("cold", "warm"):
            seconds = in_own_process("compile", {}, NUMBA_CACHE_DIR=folder)["seconds"]
            result["compile"][f"{state}_s"] = seconds
            print(f"kernels ready after {seconds:.1f} s ({state} cache)", flush=True)
    print("milliseconds, medians")
    print("  ".join(f"{title:>9}" for _, title, _ in COLUMNS), flush=True)
    for row in rows_to_measure():
        measured = in_own_process("row", row)
        result["rows"].append(measured)
        print("  ".join(f"{form.format(measured[key]):>9}" for key, _, form in COLUMNS), flush=True)
    task = {"photos": 76, "size": FULL, "gaussians": 100_000, "sh_degree": 1}
    result["training_memory"] = memory = in_own_process("memory", task)
    print(
        f"training on {memory['photos']} photos with {memory['gaussians']:,} Gaussians: {memory['peak_memory_mb']} MB"
    )
    result["ratios"] = ratios(result["rows"])
    for name, value in result["ratios"].items():
        print(f"{name.replace('_', ' ')}: {value}")
    RESULTS.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(f"written: {RESULTS}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
