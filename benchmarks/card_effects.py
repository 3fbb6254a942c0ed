"""What a step of training takes on a graphics card and on the processor where more than Gaussians is learned.

python -m benchmarks.card_effects                        # a line for each effect and device
python -m benchmarks.card_effects --devices cpu --threads 16
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from .card import ANGLES, CASES, THREADS, devices_here, photographed, trainer_of

#: Steps before time counts (foci are searched in the first of them), and steps whose median counts.
WARM, STEPS = 16, 24


def formations(names: list[str]) -> dict[str, Any]:
    """Chains of one effect each, as a training begins to learn it."""
    import torch
    from dgs.core.imaging.formation.chain import Formation
    from dgs.core.imaging.formation.exposure import Exposure
    from dgs.core.imaging.formation.focus import LensFocus
    from dgs.core.imaging.formation.kernels import PhotoKernels
    from dgs.core.imaging.formation.motion import CameraMotion

    twists = torch.from_numpy(np.random.default_rng(0).normal(scale=0.004, size=(len(names), 3, 6)).astype(np.float32))
    return {
        "none": Formation(),
        "exposure": Formation([Exposure(names, torch.zeros(len(names), 3))]),
        "motion": Formation([CameraMotion(names, twists)]),
        "defocus": Formation([LensFocus.unknown(names)]),
        "kernels": Formation([PhotoKernels.sharp(names)]),
    }


def step_ms(effect: str, device: str, photos: Path) -> tuple[float, float]:
    """Median milliseconds of a step, and of the computer's memory crossing the bus in MB (0 without a card)."""
    from dgs.core.devices import backend_named
    from dgs.core.training.trainer import Trainer

    backend = backend_named(device)
    backend.check()
    plain = trainer_of(CASES[0], device, photos)
    names = [view.name for view in plain.views]
    start = plain.scale.to_world(plain.optimizer.gaussians.to("cpu").detached())
    trainer = Trainer(
        plain.views, [], plain.points, plain.medium, plain.settings, formations(names)[effect], start=start
    )
    for _ in range(WARM):
        trainer.advance(0.5)
    backend.synchronize()
    crossed = _crossed(device)
    marks = [time.perf_counter()]
    for _ in range(STEPS):
        trainer.advance(0.5)
        backend.synchronize()
        marks.append(time.perf_counter())
    return 1e3 * statistics.median(np.diff(marks)), (_crossed(device) - crossed) / STEPS / 1e6


def _crossed(device: str) -> float:
    if device != "gpu":
        return 0.0
    from dgs.core.backends.gpu.card import card

    return float(card().traffic.up + card().traffic.down)


def main() -> int:
    """Measures one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", nargs="*", help="back ends; all that work here by default")
    parser.add_argument("--threads", type=int, default=THREADS)
    parser.add_argument("--effects", nargs="*")
    asked = parser.parse_args()
    from dgs.core.machine import use_machine

    use_machine(asked.threads)
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder) / "photos.npy"
        np.save(photos, np.stack([view.photo for view in photographed(CASES[0])]))
        for effect in asked.effects or formations([str(number) for number, _ in enumerate(ANGLES)]):
            for device in asked.devices or [name for name in devices_here() if name != "gsplat"]:
                spent, crossed = step_ms(effect, device, photos)
                row = {"effect": effect, "device": device, "threads": asked.threads}
                print(json.dumps(row | {"step_ms": round(spent, 2), "bus_mb": round(crossed, 3)}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
