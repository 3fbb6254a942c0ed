"""What a graphics card does in a step of training, beside the processor's back end and gsplat, in one run.

    python -m benchmarks.card                     # table, and benchmarks/card.json
    python -m benchmarks.card --profile           # and how long each shader takes on the card

A row is a whole step of `Trainer` (photo to the card, render, blur, objective, backward, Adam) on photos of Gaussians as
of a trained twin, from those Gaussians; and the rasterizer alone. Each back end is measured in a process of its own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .speed import FULL, HALF, HERE, SQUARE, machine

RESULTS = HERE / "card.json"
Row = dict[str, Any]
PHOTOS, WARM, STEPS, RENDERS = 8, 30, 100, 30
SIGMA_PX = 2.0

#: What is measured: size, Gaussians, degree of harmonics, blur in px.
CASES: tuple[Row, ...] = (
    {"size": FULL, "gaussians": 100_000, "sh_degree": 1, "sigma": 0.0},
    {"size": FULL, "gaussians": 100_000, "sh_degree": 1, "sigma": SIGMA_PX},
    {"size": FULL, "gaussians": 20_000, "sh_degree": 1, "sigma": 0.0},
    {"size": HALF, "gaussians": 20_000, "sh_degree": 1, "sigma": SIGMA_PX},
    {"size": SQUARE, "gaussians": 100_000, "sh_degree": 3, "sigma": 0.0},
    {"size": FULL, "gaussians": 1_000_000, "sh_degree": 3, "sigma": 0.0},
)
#: The processor is asked for these many threads, as the machine that everything else was measured on has.
THREADS = 2


def photographed(case: Row) -> list[Any]:
    """Photos of the case's Gaussians, rendered on the processor."""
    import torch
    from dgs.core.imaging.operator import BlurOperator
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.rasterizer import render
    from dgs.core.views import View

    from . import scene

    (width, height), sigma = case["size"], case["sigma"]
    psf = PointSpread(sigma_x=sigma, sigma_y=sigma)
    margin = max(psf.radius) if sigma else 0
    gaussians, views = scene.gaussians(case["gaussians"], case["sh_degree"]), []
    blur = BlurOperator(psf, height, width, margin) if sigma else None
    for degrees in np.linspace(-18.0, 18.0, PHOTOS):
        camera = scene.camera(width, height, float(degrees))
        with torch.no_grad():
            image = render(gaussians, camera.with_margin(margin)).image
            image = image if blur is None else blur(image)
        pixels = np.round(image.clamp(0, 1).permute(1, 2, 0).numpy() * 255).astype(np.uint8)
        views.append(View(camera, pixels))
    return views


def trainer_of(case: Row, device: str, photos: Path) -> Any:
    """A training that begins with the case's Gaussians, a little off."""
    import torch
    from dgs.core.imaging.medium import Medium
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.training.settings import TrainingSettings
    from dgs.core.training.trainer import Trainer
    from dgs.core.views import SparsePoints, View

    from . import scene

    width, height = case["size"]
    angles = [float(degrees) for degrees in np.linspace(-18.0, 18.0, PHOTOS)]
    cameras = [scene.camera(width, height, degrees) for degrees in angles]
    views = [View(camera, pixels) for camera, pixels in zip(cameras, np.load(photos), strict=True)]
    random = np.random.default_rng(0)
    places = scene.surface_points(5000, random)
    points = SparsePoints(places, random.integers(0, 256, (len(places), 3), dtype=np.uint8))
    start = scene.gaussians(case["gaussians"], case["sh_degree"])
    start.means += 0.002 * torch.from_numpy(random.standard_normal(start.means.shape).astype(np.float32))
    settings = TrainingSettings(
        device=device,
        sh_degree=case["sh_degree"],
        max_gaussians=case["gaussians"],
        coarse_share=0.0,
        density_every=10**9,
        grid_step=1,
    )
    medium = Medium(PointSpread(sigma_x=case["sigma"], sigma_y=case["sigma"]))
    return Trainer(views, [], points, medium, settings, start=start)


def measure(case: Row, device: str, photos: Path) -> Row:
    """One back end's row, in this process: medians in milliseconds."""
    from dgs.core.devices import backend_named
    from dgs.core.machine import use_machine

    use_machine(THREADS)
    backend = backend_named(device)
    backend.check()
    trainer = trainer_of(case, device, photos)
    slow = device == "cpu"
    for _ in range(3 if slow else WARM):
        trainer.advance(0.5)
    backend.synchronize()
    traffic = _traffic(device)
    losses, marks = [], [time.perf_counter()]
    for _ in range(12 if slow else STEPS):
        losses.append(trainer.advance(0.5))
        marks.append(time.perf_counter())
    backend.synchronize()
    count, whole = len(losses), time.perf_counter() - marks[0]
    steps = [later - earlier for earlier, later in itertools.pairwise(marks)]
    made: Row = {
        **case,
        "device": device,
        "step_ms": round(1e3 * statistics.median(steps), 3),
        "mean_step_ms": round(1e3 * whole / count, 3),
        "loss": round(statistics.fmean(losses), 6),
    }
    if traffic is not None:
        made["orders"], made["waits"] = traffic.orders // count, traffic.waits // count
    return made | rasterizer(case, device, 6 if slow else RENDERS)


def _traffic(device: str) -> Any:
    """What crosses the bus, counted from now on; None where there is none."""
    if device != "gpu":
        return None
    from dgs.core.backends.gpu.card import card

    found = card().traffic
    found.up = found.down = found.orders = found.waits = 0
    return found


def rasterizer(case: Row, device: str, rounds: int) -> Row:
    """Medians of the rasterizer alone, forward and backward, with gradients as of a photo's."""
    import torch
    from dgs.core.devices import backend_named
    from dgs.core.rasterizer import render

    from . import scene

    backend, (width, height) = backend_named(device), case["size"]
    gaussians = scene.gaussians(case["gaussians"], case["sh_degree"]).to(device=device)
    for _, tensor in gaussians.named():
        tensor.requires_grad_(True)
    seed = torch.Generator().manual_seed(0)
    upstream = torch.randn(3, height, width, generator=seed).to(device)
    forward, backward, pairs = [], [], 0
    for degrees in np.linspace(-18.0, 18.0, rounds + 3):
        camera = scene.camera(width, height, float(degrees))
        backend.synchronize()
        begun = time.perf_counter()
        view = render(gaussians, camera, backend=device)
        backend.synchronize()
        shown = time.perf_counter()
        view.image.backward(upstream)
        backend.synchronize()
        forward.append(shown - begun)
        backward.append(time.perf_counter() - shown)
        pairs = view.screen.evaluations // 256
        for _, tensor in gaussians.named():
            tensor.grad = None
    return {
        "forward_ms": round(1e3 * statistics.median(forward[3:]), 3),
        "backward_ms": round(1e3 * statistics.median(backward[3:]), 3),
        "pairs": pairs,
    }


@contextmanager
def timed_orders() -> Iterator[dict[str, list[float]]]:
    """Meanwhile every order of the card is timed by itself: milliseconds by shader. It waits after each one."""
    from dgs.core.backends.gpu.card import Card, card

    found: dict[str, list[float]] = {}
    plain, device = Card.run, card()

    def run(self: Any, kernel: str, *arguments: Any) -> None:
        device.wait()
        begun = time.perf_counter()
        plain(self, kernel, *arguments)
        device.wait()
        found.setdefault(kernel, []).append(1e3 * (time.perf_counter() - begun))

    Card.run = run  # type: ignore[method-assign]
    try:
        yield found
    finally:
        Card.run = plain  # type: ignore[method-assign]


def profile(case: Row, photos: Path, steps: int = 10) -> Row:
    """Milliseconds of a step by shader, less what waiting for an empty card takes; and the step's time on the host."""
    from dgs.core.backends.gpu.card import card
    from dgs.core.machine import use_machine

    use_machine(THREADS)
    trainer = trainer_of(case, "gpu", photos)
    for _ in range(WARM):
        trainer.advance(0.5)
    card().wait()
    empty = []
    for _ in range(50):
        begun = time.perf_counter()
        card().wait()
        empty.append(1e3 * (time.perf_counter() - begun))
    wait = statistics.median(empty)
    with timed_orders() as found:
        for _ in range(steps):
            trainer.advance(0.5)
    shaders = {
        name: [round(max(0.0, sum(spent) - wait * len(spent)) / steps, 3), len(spent) // steps]
        for name, spent in sorted(found.items(), key=lambda item: -sum(item[1]))
    }
    return {**case, "wait_ms": round(wait, 3), "shaders_ms_and_orders": shaders}


def devices_here() -> list[str]:
    """The processor, and every card's back end that works on this machine."""
    from dgs.core.devices import backend_named
    from dgs.core.errors import DeviceError
    from dgs.core.rasterizer.cuda import available

    found = ["cpu"]
    try:
        backend_named("gpu").check()
        found.append("gpu")
    except DeviceError as error:
        print(error)
    return [*found, "cuda"] if available() else found


def in_own_process(what: str, case: Row, device: str, photos: Path) -> Row:
    """One measurement in a fresh interpreter; {} with the reason printed where it failed."""
    words = ["--measure", what, "--case", json.dumps(case), "--device", device, "--photos", str(photos)]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.card", *words], capture_output=True, text=True, cwd=HERE.parent
    )
    if done.returncode:
        print(done.stderr[-2000:], flush=True)
        return {}
    made: Row = json.loads(done.stdout.splitlines()[-1])
    return made


def told(row: Row, cpu: Row) -> str:
    """A row of the table."""
    width, height = row["size"]
    case = f"{width}x{height} {row['gaussians']:>9,} degree {row['sh_degree']} blur {row['sigma']:g}"
    times = f"{row['device']:>5} step {row['step_ms']:8.2f} forward {row['forward_ms']:8.2f} backward {row['backward_ms']:8.2f}"
    faster = f" {cpu['step_ms'] / row['step_ms']:6.1f} times" if cpu else ""
    return f"{case} {times}{faster} loss {row['loss']:.5f} {row.get('orders', '')} {row.get('waits', '')}"


def parsed() -> argparse.Namespace:
    """The command's words."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", action="store_true", help="how long each shader takes on the card")
    parser.add_argument("--cases", type=int, nargs="*", help="numbers of the cases, from 0; all of them by default")
    parser.add_argument("--devices", nargs="*", help="back ends; all that work here by default")
    parser.add_argument("--out", type=Path, default=RESULTS)
    for hidden in ("--measure", "--device"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    parser.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    parser.add_argument("--photos", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Measures, prints the table, writes the results."""
    asked = parsed()
    if asked.measure:
        does = profile(asked.case, asked.photos) if asked.measure == "profile" else None
        print(json.dumps(does or measure(asked.case, asked.device, asked.photos)))
        return 0
    devices = asked.devices or devices_here()
    result: Row = {"machine": machine(), "rows": [], "profiles": []}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(len(CASES)) if asked.cases is None else asked.cases:
            case, photos = CASES[number], Path(folder) / f"{number}.npy"
            np.save(photos, np.stack([view.photo for view in photographed(case)]))
            rows = [row for device in devices if (row := in_own_process("row", case, device, photos))]
            cpu = next((row for row in rows if row["device"] == "cpu"), {})
            for row in rows:
                print(told(row, cpu), flush=True)
            result["rows"] += rows
            if asked.profile and "gpu" in devices:
                result["profiles"].append(in_own_process("profile", case, "gpu", photos))
                print(json.dumps(result["profiles"][-1]), flush=True)
            asked.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
