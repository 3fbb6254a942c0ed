"""How many photos reach an accuracy, by the way the next one is chosen: `python -m benchmarks.next_view`.

Every way starts from the same three neighbouring photos of a scene of `view_scenes` and adds one at a time; after each,
a twin is trained from nothing and compared with the sharp truth from 16 other viewpoints. Rows are appended to
runs/next_view.jsonl as they come, and what is there is not computed again. `--oracle` tries every candidate and keeps
the one with which the trained twin is best by its truth: what choosing one after the other could reach at all, nearly.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from dgs.core import compiled
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.trainer import Trainer
from dgs.core.uncertainty.coverage import Coverage
from dgs.core.uncertainty.detail import Detail
from dgs.core.uncertainty.linear_model import LinearModel, Viewpoint

from .view_scenes import SCENES, Case, dome

FIRST_PHOTOS, LARGEST_COUNT = 3, 12
OURS = "detail through the blur"
WAYS = (OURS, "detail without blur", "random", "uniform", "farthest", "fisher without blur")
ORACLE = "oracle"
#: Uniform's counts of photos whose accuracy the others are to reach.
TARGETS = (8, 10, 12)


class Run:
    """One case, whose trainings are kept: ways often take the same first photos."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._trained: dict[tuple[int, ...], tuple[Trainer, float]] = {}

    def trained(self, taken: Sequence[int]) -> tuple[Trainer, float]:
        """A twin of these photos and its sharp PSNR (dB)."""
        key = tuple(taken)
        if key not in self._trained:
            trainer = self.case.train(list(taken))
            self._trained[key] = trainer, self.case.accuracy(trainer)
        return self._trained[key]

    def choose(self, way: str, taken: list[int], step: int) -> int:
        """The next candidate."""
        case = self.case
        left = [i for i in range(len(case.cameras)) if i not in taken]
        if way == "random":
            return left[int(np.random.default_rng([case.seed, 3, step]).integers(len(left)))]
        if way == "farthest":
            centres = np.array([c.centre for c in case.cameras])
            nearest = np.linalg.norm(centres[left][:, None] - centres[taken][None], axis=2).min(axis=1)
            return left[int(nearest.argmax())]
        if way == ORACLE:
            return max(left, key=lambda i: self.trained([*taken, i])[1])
        linear, viewpoints, noise = linear_model(self.trained(taken)[0], taken, case, "through the blur" in way)
        if way.startswith("detail"):
            seen = [viewpoints[i] for i in taken]
            coverage = Coverage(Detail(linear, noise, viewpoints, seen), viewpoints, seen)
            return left[int(np.argmax(coverage.scores([viewpoints[i] for i in left])))]
        generator = torch.Generator().manual_seed(step)
        information = 1.0 + linear.diagonal([viewpoints[i] for i in taken], generator) / noise**2
        return max(
            left, key=lambda i: float((linear.diagonal([viewpoints[i]], generator) / noise**2 / information).sum())
        )

    def curve(self, way: str, most: int) -> tuple[list[float], list[int]]:
        """Sharp PSNR after 3, 4, ... photos, and those taken."""
        taken, accuracies = list(self.case.first), []
        for count in range(FIRST_PHOTOS, most + 1):
            if way == "uniform":
                taken = evenly(self.case, count - FIRST_PHOTOS)
            accuracies.append(self.trained(taken)[1])
            if count < most and way != "uniform":
                taken = [*taken, self.choose(way, taken, count)]
        return accuracies, taken


def linear_model(
    trainer: Trainer, taken: Sequence[int], case: Case, blur: bool
) -> tuple[LinearModel, list[Viewpoint], float]:
    """The linear model at the trained twin, the candidates' viewpoints, and the rms residual of the photos taken."""
    viewpoints = [
        Viewpoint(trainer.scale.camera_to_unit(c), psf if blur else None)
        for c, psf in zip(case.cameras, case.spreads, strict=True)
    ]
    low_pass = trainer.raster_settings(trainer.levels[-1]).low_pass
    settings = RasterSettings(low_pass=low_pass)
    linear = LinearModel(trainer.optimizer.gaussians, viewpoints, case.margin, trainer.background, settings)
    errors = [
        float((linear.photo(Viewpoint(viewpoints[i].camera, case.spreads[i])) - case.planes(i)).square().mean())
        for i in taken
    ]
    return linear, viewpoints, max(float(np.sqrt(np.mean(errors))), 1 / 255 / 12**0.5)


def evenly(case: Case, count: int) -> list[int]:
    """`count` candidates nearest to even directions, besides the first ones."""
    taken = list(case.first)
    for camera in dome(count, case.seed, (1.0, 1.0), "u") if count else []:
        order = np.argsort(-case.directions @ camera.centre)
        taken.append(next(int(i) for i in order if int(i) not in taken))
    return taken


def main() -> None:
    """Runs what is missing and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--ways", nargs="+", default=WAYS)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--oracle", type=int, default=0, metavar="N", help="seeds for which the oracle runs, too")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "runs" / "next_view.jsonl")
    options = parser.parse_args()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    for seed in range(options.seeds):
        for name in options.scenes:
            run = None
            for way in [*options.ways, *([ORACLE] if seed < options.oracle else [])]:
                key = {"scene": f"{name} {options.steps}", "seed": seed, "way": way}
                if any(all(row[k] == v for k, v in key.items()) for row in rows):
                    continue
                run = run or Run(Case(SCENES[name], seed, options.steps))
                accuracies, taken = run.curve(way, 9 if way == ORACLE else LARGEST_COUNT)
                rows.append({**key, "psnr": accuracies, "taken": taken})
                with options.out.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
                print(name, seed, way, [round(a, 2) for a in accuracies], flush=True)
    for name in options.scenes:
        report(name, [row for row in rows if row["scene"] == f"{name} {options.steps}"])


def needed(psnr: Sequence[float], target: float) -> float:
    """Photos to reach `target`, interpolated; NaN if never."""
    for i, value in enumerate(psnr):
        if value >= target:
            before = psnr[i - 1] if i else value
            return FIRST_PHOTOS + i - (0.0 if i == 0 or value == before else (value - target) / (value - before))
    return float("nan")


def report(name: str, rows: list[dict[str, Any]]) -> None:
    """Photos that each way needs for what uniform placement reaches with 8, 10 and 12."""
    print(f"\n{name}: sharp PSNR (dB), and share of uniform's photos for uniform's PSNR\n")
    print(
        "| way | after 4, 6, 8, 10, 12 photos (sd over seeds at 8) | share at uniform's 8, 10, 12, mean curves | "
        "single seeds at 12: least to most (reached) | seeds |\n|---|---|---|---|---|"
    )
    uniform = {row["seed"]: row["psnr"] for row in rows if row["way"] == "uniform"}
    for way in dict.fromkeys([*WAYS, ORACLE, *(row["way"] for row in rows)]):
        mine = [row for row in rows if row["way"] == way and row["seed"] in uniform]
        if not mine:
            continue
        curves = np.array([row["psnr"] for row in mine])
        mean, even = curves.mean(axis=0), np.mean([uniform[row["seed"]] for row in mine], axis=0)
        shown = ", ".join(f"{mean[i]:.2f}" for i in (1, 3, 5, 7, 9) if i < len(mean))
        shares = [needed(mean, even[t - FIRST_PHOTOS]) / needed(even, even[t - FIRST_PHOTOS]) for t in TARGETS]
        single = [
            needed(row["psnr"], uniform[row["seed"]][-1]) / needed(uniform[row["seed"]], uniform[row["seed"]][-1])
            for row in mine
        ]
        got = [100 * s for s in single if np.isfinite(s)]
        spread = f"{min(got):.0f} to {max(got):.0f} % ({len(got)})" if got else "never"
        share = ", ".join("never" if np.isnan(s) else f"{100 * s:.0f} %" for s in shares)
        print(f"| {way} | {shown} ({curves[:, 5].std():.2f}) | {share} | {spread} | {len(mine)} |")


if __name__ == "__main__":
    main()
