"""What a graphics card does in a step of training, beside the processor's back end and gsplat, in one run.

    python -m benchmarks.card                     # table, and benchmarks/card.json
    python -m benchmarks.card --profile           # and how long each shader takes on the card

A row is a whole step of `Trainer` (photo to the card, render, blur, objective, backward, Adam) on photos of Gaussians
as of a trained twin, from those Gaussians; and the rasterizer alone. Each back end is measured in a process of its own.
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
WARM, STEPS, RENDERS = 30, 100, 30
#: Where its photos are taken from, along the rail (degrees).
ANGLES = [float(degrees) for degrees in np.linspace(-18.0, 18.0, 8)]
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
    for degrees in ANGLES:
        camera = scene.camera(width, height, degrees)
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
    cameras = [scene.camera(width, height, degrees) for degrees in ANGLES]
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
    losses, computed, marks = [], time.thread_time(), [time.perf_counter()]
    for _ in range(12 if slow else STEPS):
        losses.append(trainer.advance(0.5))
        marks.append(time.perf_counter())
    backend.synchronize()
    count, whole = len(losses), time.perf_counter() - marks[0]
    host = 1e3 * (time.thread_time() - computed) / len(losses)
    steps = [later - earlier for earlier, later in itertools.pairwise(marks)]
    made: Row = {
        **case,
        "device": device,
        "step_ms": round(1e3 * statistics.median(steps), 3),
        "mean_step_ms": round(1e3 * whole / count, 3),
        "host_ms": round(host, 3),
        "loss": round(statistics.fmean(map(float, losses)), 6),
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
def timed_orders(most: int = 4096) -> Iterator[dict[str, list[float]]]:
    """The card itself writes down when every order begins and ends: milliseconds by shader, after the block."""
    from dgs.core.backends.gpu.card import Card, card

    found: dict[str, list[float]] = {}
    plain, device, names = Card.run, card(), []
    ffi, begin_pass = device._native._ffi, device._native._plain.wgpuCommandEncoderBeginComputePass
    driver: Any = device._device
    queries = driver.create_query_set(type="timestamp", count=most)

    def run(self: Any, kernel: str, *arguments: Any) -> None:
        if 2 * len(names) + 2 > most:
            return plain(self, kernel, *arguments)
        writes, asked = ffi.new("WGPUPassTimestampWrites *"), ffi.new("WGPUComputePassDescriptor *")
        writes.querySet, asked.timestampWrites = queries._internal, writes
        writes.beginningOfPassWriteIndex, writes.endOfPassWriteIndex = 2 * len(names), 2 * len(names) + 1
        self._end_pass()
        self._pass = begin_pass(self._recording(), asked)
        names.append(kernel)
        plain(self, kernel, *arguments)
        return self._end_pass()

    Card.run = run  # type: ignore[method-assign, assignment]
    try:
        yield found
    finally:
        Card.run = plain  # type: ignore[method-assign]
    device.wait()
    times = driver.create_buffer(size=16 * len(names), usage="QUERY_RESOLVE|COPY_SRC")
    encoder = driver.create_command_encoder()
    encoder.resolve_query_set(queries, 0, 2 * len(names), times, 0)
    driver.queue.submit([encoder.finish()])
    stamps = np.frombuffer(driver.queue.read_buffer(times, 0), np.uint64).reshape(-1, 2).astype(np.float64)
    for name, (begun, ended) in zip(names, stamps, strict=True):
        found.setdefault(name, []).append(1e-6 * (ended - begun))  # (nanoseconds on the cards that we saw)


def profile(case: Row, photos: Path, steps: int = 10) -> Row:
    """Milliseconds of a step by shader, as the card counts them, and how many orders of each."""
    from dgs.core.backends.gpu.adapter import adapters
    from dgs.core.backends.gpu.card import card
    from dgs.core.machine import use_machine

    use_machine(THREADS)
    best = adapters()[0]
    opened = best.request_device_sync
    best.request_device_sync = lambda **asked: opened(required_features=["timestamp-query"], **asked)
    trainer = trainer_of(case, "gpu", photos)
    for _ in range(WARM):
        trainer.advance(0.5)
    card().wait()
    with timed_orders() as found:
        for _ in range(steps):
            trainer.advance(0.5)
    shaders = {
        name: [round(sum(spent) / steps, 4), len(spent) // steps]
        for name, spent in sorted(found.items(), key=lambda item: -sum(item[1]))
    }
    return {**case, "card_ms": round(sum(ms for ms, _ in shaders.values()), 3), "shaders_ms_and_orders": shaders}


def devices_here() -> list[str]:
    """The processor, and every card's back end that works on this machine."""
    from dgs.core.devices import backend_named
    from dgs.core.errors import DeviceError

    from . import card_gsplat

    found = ["cpu"]
    try:
        backend_named("gpu").check()
        found.append("gpu")
    except DeviceError as error:
        print(error)
    return [*found, "gsplat"] if card_gsplat.available() else found


def in_own_process(what: str, device: str, cases: list[Row], photos: list[Path]) -> list[Row]:
    """Measurements in a fresh interpreter; none, with the reason printed, where it failed."""
    files = json.dumps([str(path) for path in photos])
    words = ["--measure", what, "--device", device, "--given", json.dumps(cases), "--photos", files]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.card", *words], capture_output=True, text=True, cwd=HERE.parent
    )
    if done.returncode:
        print(done.stderr[-2000:], flush=True)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def measured(asked: argparse.Namespace, case: Row, photos: Path) -> Row:
    """One measurement, in this process."""
    if asked.measure == "profile":
        return profile(case, photos)
    if asked.device == "gsplat":
        from . import card_gsplat

        return card_gsplat.measure(case, photos, ANGLES, WARM, STEPS)
    return measure(case, asked.device, photos)


def table_row(row: Row, cpu: Row) -> str:
    """A row of the table."""
    width, height = row["size"]
    case = f"{width}x{height} {row['gaussians']:>9,} degree {row['sh_degree']} blur {row['sigma']:g}"
    names = ("step", "forward", "backward", "host")
    times = "".join(f" {name} {row[f'{name}_ms']:8.2f}" for name in names if f"{name}_ms" in row)
    faster = f" {cpu['step_ms'] / row['step_ms']:6.1f} times" if cpu else ""
    bus = f" orders {row['orders']} waits {row['waits']}" if "orders" in row else ""
    return f"{case} {row['device']:>6}{times}{faster}{bus}"


def show(rows: list[Row], all_rows: list[Row]) -> None:
    """Rows of the table, beside the processor's of the same case where it was measured before."""
    for row in rows:
        same = (r for r in all_rows if r["device"] == "cpu" and all(r[key] == row[key] for key in CASES[0]))
        print(table_row(row, next(same, {})), flush=True)


def parsed() -> argparse.Namespace:
    """The command's words."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", action="store_true", help="how long each shader takes on the card")
    parser.add_argument("--cases", type=int, nargs="*", help="numbers of the cases, from 0; all of them by default")
    parser.add_argument("--devices", nargs="*", help="back ends; all that work here by default")
    parser.add_argument("--out", type=Path, default=RESULTS)
    for hidden in ("--measure", "--device"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    for hidden in ("--given", "--photos"):
        parser.add_argument(hidden, type=json.loads, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Measures, prints the table, writes the results."""
    asked = parsed()
    if asked.measure:
        for case, path in zip(asked.given, asked.photos, strict=True):
            print(json.dumps(measured(asked, case, Path(path))), flush=True)
        return 0
    result: Row = {"machine": machine(), "rows": [], "profiles": []}
    cases = [CASES[number] for number in asked.cases] if asked.cases else list(CASES)
    with tempfile.TemporaryDirectory() as folder:
        photos = [Path(folder) / f"{number}.npy" for number in range(len(cases))]
        for case, path in zip(cases, photos, strict=True):
            np.save(path, np.stack([view.photo for view in photographed(case)]))
        for device in asked.devices or devices_here():
            rows = in_own_process("row", device, cases, photos)
            result["rows"] += rows
            show(rows, result["rows"])
            asked.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        if asked.profile:
            result["profiles"] = in_own_process("profile", "gpu", cases, photos)
    for found in result["profiles"]:
        print(json.dumps(found))
    asked.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
