"""What a step of training along a camera's path takes, beside a plain one.

    python -m benchmarks.path_step [--threads 2] [--rounds 5]

Photos of drawn Gaussians, smeared along straight paths of as many px as ask for a number of frames; paths and the
camera's curve are learned in each step. Plain steps and steps along paths take turns; of each the median of the
processor's time counts, all threads together, and the clock's beside it.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .card import ANGLES, Row, photographed, trainer_of

#: 400 x 300 px and as many Gaussians as a training of such photos ends with.
CASE: Row = {"size": (400, 300), "gaussians": 32_000, "sh_degree": 1, "sigma": 0.0}
#: Share of the run at which the steps are.
SHARE = 0.6
#: Steps of each kind before the next kind's turn: each photo twice.
TURN = 2 * len(ANGLES)


def along_paths(plain: Any, frames: int) -> Any:
    """The same training, its photos taken along paths of so many frames; 1 for photos that stood still."""
    import torch
    from dgs.core.imaging.formation.chain import Formation
    from dgs.core.imaging.formation.motion import SETTINGS, CameraMotion
    from dgs.core.training.trainer import Trainer

    names = [view.name for view in plain.views]
    start = plain.scale.to_world(plain.optimizer.gaussians.detached())

    def training(views: list[Any], formation: Formation) -> Any:
        return Trainer(views, [], plain.points, plain.medium, plain.settings, formation, start=start)

    if frames < 2:
        return training(plain.views, Formation())
    camera, twists = plain.levels[-1].views[0].camera, torch.zeros(len(names), 5, 6)  # (as many as trainings learn)
    twists[:, 1, 4] = 1.0
    px = (frames - 1.5) * (1.0 if frames <= SETTINGS.bent else SETTINGS.spacing)
    twists *= px / CameraMotion(names, twists).length(names[0], camera.fx)
    known = training(plain.views, Formation([CameraMotion(names, twists.clone())]))
    level = known.levels[-1]
    smeared = []
    for view, seen in zip(plain.views, level.views, strict=True):
        shown = known.exposed(level, seen).degraded.clamp(0, 1).permute(1, 2, 0).numpy()
        smeared.append(replace(view, photo=np.round(255 * shown).astype(np.uint8)))
    return training(smeared, Formation([CameraMotion(names, twists)]))


def measure(counts: list[int], rounds: int) -> dict[int, tuple[float, float]]:
    """Milliseconds of a step by number of frames: of all processors, and by the clock."""
    spent: dict[int, list[tuple[float, float]]] = {count: [] for count in counts}
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder) / "photos.npy"
        np.save(photos, np.stack([view.photo for view in photographed(CASE)]), allow_pickle=False)
        plain = trainer_of(CASE, "cpu", photos)
        for turn in range(rounds + 1):
            for count in counts:
                trainer = along_paths(plain, count)  # (anew: paths that are learned change their number of frames)
                for step in range(TURN + 2):
                    began = time.process_time(), time.perf_counter()
                    trainer.advance(SHARE)
                    if turn and step >= 2:  # (kernels are compiled, memory is at hand)
                        spent[count].append((time.process_time() - began[0], time.perf_counter() - began[1]))
    return {
        count: (1e3 * statistics.median(cpu for cpu, _ in all_), 1e3 * statistics.median(clock for _, clock in all_))
        for count, all_ in spent.items()
    }


def main() -> int:
    """Prints a line for each number of frames."""
    from dgs.core.machine import use_machine

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--frames", type=int, nargs="*", default=[4, 8])
    asked = parser.parse_args()
    use_machine(asked.threads)
    found = measure([1, *asked.frames], asked.rounds)
    for count, (cpu, clock) in found.items():
        times = f"{cpu / found[1][0]:.2f}, {clock / found[1][1]:.2f} times a plain one"
        print(f"{count} frames: {cpu:.1f} ms of processor time, {clock:.1f} ms by the clock; {times}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
