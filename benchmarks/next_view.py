"""How many photos reach an accuracy, by the way the next one is chosen: `python benchmarks/next_view.py`.

A textured globe in a room, seen through a blur by small cameras on a dome; candidates stand at different distances,
as they do in a room. Every way starts from the same three neighbouring photos and adds one at a time; after each,
a twin is trained from nothing and compared with the sharp truth from 16 other places. Rows are appended
to next_view.jsonl as they come, and what is there is not computed again.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import run_dgs

run_dgs.mount_package()

import numpy as np  # noqa: E402
import torch  # noqa: E402
from dgs.core import compiled  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.constants import SH_C0  # noqa: E402
from dgs.core.gaussians import Gaussians  # noqa: E402
from dgs.core.imaging.medium import Medium  # noqa: E402
from dgs.core.imaging.operator import BlurOperator  # noqa: E402
from dgs.core.imaging.psf import PointSpread  # noqa: E402
from dgs.core.knowledge.candidates import looking_at  # noqa: E402
from dgs.core.knowledge.coverage import Coverage  # noqa: E402
from dgs.core.knowledge.gain import gain_of, opened, spread  # noqa: E402
from dgs.core.knowledge.looks import Looks, Place  # noqa: E402
from dgs.core.knowledge.posterior import sample_posterior  # noqa: E402
from dgs.core.rasterizer import RasterSettings, render  # noqa: E402
from dgs.core.training.settings import TrainingSettings  # noqa: E402
from dgs.core.training.trainer import Trainer  # noqa: E402
from dgs.core.views import SparsePoints, View  # noqa: E402

WIDTH, HEIGHT, FOCAL, SIGMA = 72, 54, 80.0, 1.5
PSF = PointSpread("gaussian", SIGMA, SIGMA)
MARGIN = 6
CANDIDATES, TESTS, FIRST, MOST = 36, 16, 3, 12
#: Splats of the object and of the room around it.
GLOBE, ROOM = 1400, 700
WAYS = ("coverage through the blur", "fall through the blur", "bits through the blur",
        "random", "uniform", "farthest", "fisher without blur")
UP = np.array([0.0, -1.0, 0.0])


def room(seed: int) -> Gaussians:
    """700 large opaque splats far around: what stands before nothing gets its surroundings invented by any training."""
    random = np.random.default_rng([seed, 9])
    direction = ring(ROOM)
    phase, wave = random.uniform(0, 6.28, 3), 5 * random.normal(size=(3, 3))
    colours = np.clip(0.45 + 0.3 * np.sin(direction @ wave + phase), 0.05, 0.95)
    return splats(6.0 * direction, 0.45, 4.0, colours)


def ring(count: int) -> np.ndarray:
    """[count, 3] directions, evenly over the sphere."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * np.pi * (3 - 5**0.5)
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), z, flat * np.sin(turn)], axis=1)


def splats(means: np.ndarray, size: float, opacity: float, colours: np.ndarray) -> Gaussians:
    """Round ones."""
    n = len(means)
    return Gaussians(
        torch.tensor(means, dtype=torch.float32), torch.full((n, 3), float(np.log(size))),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1), torch.full((n,), opacity),
        torch.tensor(((colours - 0.5) / SH_C0)[:, None, :], dtype=torch.float32),
    )  # fmt: skip


def globe(seed: int) -> Gaussians:
    """1400 opaque splats on a bumpy ball of radius 0.5; one half carries fine detail, the other broad patches."""
    random = np.random.default_rng([seed, 0])
    direction = ring(GLOBE)
    turn, flat = np.arange(GLOBE) * np.pi * (3 - 5**0.5), np.sqrt(1 - direction[:, 1] ** 2)
    radius = 0.5 + 0.03 * np.sin(5 * turn) * flat
    phase = random.uniform(0, 6.28, (3, 3))
    broad = np.stack([np.sin(direction @ (4 * random.normal(size=3)) + phase[0, c]) for c in range(3)], axis=1)
    fine = random.choice([-1.0, 1.0], (GLOBE, 1)) * (direction[:, :1] > 0) * np.ones(3)
    colours = np.clip(0.5 + 0.2 * broad + 0.2 * fine, 0.05, 0.95)
    return splats(direction * radius[:, None], 0.028, 3.0, colours)


def dome(count: int, seed: int, distances: tuple[float, float], name: str) -> list[Camera]:
    """Evenly over directions, turned by chance; distances by chance."""
    random = np.random.default_rng([seed, 1, count])
    angle = np.arange(count) * np.pi * (3 - 5**0.5) + random.uniform(0, 6.28)
    height = np.arcsin(-0.35 + 1.2 * (np.arange(count) + 0.5) / count)
    ray = np.stack([np.cos(height) * np.cos(angle), -np.sin(height), np.cos(height) * np.sin(angle)], axis=1)
    lens = Camera("", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
    far = random.uniform(*distances, count)
    return [looking_at(lens, f"{name}{i:02d}", far[i] * ray[i], np.zeros(3), UP) for i in range(count)]


def photo(truth: Gaussians, camera: Camera) -> View:
    """8 bit, blurred."""
    with torch.no_grad():
        frame = render(truth, camera.with_margin(MARGIN)).image
        planes = BlurOperator(PSF, HEIGHT, WIDTH, MARGIN).apply(frame).numpy()
    return View(camera, np.ascontiguousarray(np.round(planes.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)))


class Case:
    """One seed: object, candidates, tests."""

    def __init__(self, seed: int, steps: int, distances: tuple[float, float]) -> None:
        self.seed, self.steps = seed, steps
        parts = globe(seed), room(seed)
        pairs = zip(*(part.named() for part in parts), strict=True)
        self.truth = Gaussians(**{name: torch.cat([a, b]) for (name, a), (_, b) in pairs})
        self.cameras = dome(CANDIDATES, seed, distances, "c")
        self.photos = [photo(self.truth, c) for c in self.cameras]
        self.tests = dome(TESTS, seed + 1000, (1.7, 1.7), "t")
        self.directions = np.array([c.centre / np.linalg.norm(c.centre) for c in self.cameras])
        random = np.random.default_rng([seed, 2])
        start = int(random.integers(CANDIDATES))
        self.first = [int(i) for i in np.argsort(-self.directions @ self.directions[start])[:FIRST]]
        chosen = np.concatenate([random.permutation(GLOBE)[:500], GLOBE + random.permutation(ROOM)[:350]])
        places = self.truth.means.numpy()[chosen].astype(float)
        self.points = SparsePoints(places, np.full((len(chosen), 3), 128, np.uint8))

    def train(self, taken: list[int]) -> Trainer:
        """A twin from nothing."""
        settings = TrainingSettings(steps=self.steps, max_gaussians=2600, sh_degree=0, seed=self.seed, threads=1)
        trainer = Trainer([self.photos[i] for i in taken], [], self.points, Medium(PSF), settings)
        for step in range(self.steps):
            trainer.advance(step / self.steps)
        return trainer

    def accuracy(self, trainer: Trainer) -> float:
        """Sharp PSNR (dB) over all tests."""
        squares, count = 0.0, 0
        for camera in self.tests:
            with torch.no_grad():
                truth = render(self.truth, camera)
                unit = trainer.scale.camera_to_unit(camera)
                twin = render(trainer.optimizer.gaussians, unit, background=trainer.background,
                              settings=trainer.raster_settings(trainer.levels[-1])).image  # fmt: skip
            squares += float((twin - truth.image).square().sum())
            count += truth.image.numel()
        return -10 * float(np.log10(squares / count))


def knowledge(trainer: Trainer, taken: list[int], case: Case, blur: bool) -> tuple[Looks, list[Place], float]:
    """Looks at the trained twin, and the residual."""
    def place(camera: Camera) -> Place:
        return Place(trainer.scale.camera_to_unit(camera), PSF if blur else None)

    places = [place(c) for c in case.cameras]
    low_pass = trainer.raster_settings(trainer.levels[-1]).low_pass
    looks = Looks(trainer.optimizer.gaussians, places, MARGIN, trainer.background, RasterSettings(low_pass=low_pass))
    through = [Place(places[i].camera, PSF) for i in taken]
    errors = [
        float((looks.photo(p) - torch.from_numpy(case.photos[i].planes())).square().mean())
        for p, i in zip(through, taken, strict=True)
    ]
    return looks, places, max(float(np.sqrt(np.mean(errors))), 1 / 255 / 12**0.5)


def choose(way: str, case: Case, trainer: Trainer, taken: list[int], step: int) -> int:
    """The next candidate."""
    left = [i for i in range(CANDIDATES) if i not in taken]
    if way == "random":
        return left[int(np.random.default_rng([case.seed, 3, step]).integers(len(left)))]
    if way == "farthest":
        centres = np.array([c.centre for c in case.cameras])
        nearest = np.linalg.norm(centres[left][:, None] - centres[taken][None], axis=2).min(axis=1)
        return left[int(nearest.argmax())]
    looks, places, noise = knowledge(trainer, taken, case, "through the blur" in way)
    if "through the blur" in way:
        seen = [places[i] for i in taken]
        if way.startswith("coverage"):
            coverage = Coverage(looks, noise, places, case.seed)
            for photo in seen:
                coverage.take(photo)
            return max(left, key=lambda i: coverage.gain(places[i]))
        posterior = sample_posterior(looks, seen, noise, 4, 6, case.seed)
        gains = {i: gain_of(looks, posterior, seen, places[i]) for i in left}
        return max(left, key=lambda i: gains[i].bits if way.startswith("bits") else gains[i].fall)
    generator = torch.Generator().manual_seed(step)
    known = 1.0 + looks.diagonal([places[i] for i in taken], generator) / noise**2
    return max(left, key=lambda i: float((looks.diagonal([places[i]], generator) / noise**2 / known).sum()))


def evenly(case: Case, count: int) -> list[int]:
    """`count` candidates nearest to even directions, besides the first ones."""
    taken = list(case.first)
    wanted = dome(count, case.seed, (1.0, 1.0), "u") if count else []
    for camera in wanted:
        order = np.argsort(-case.directions @ camera.centre)
        taken.append(next(int(i) for i in order if int(i) not in taken))
    return taken


def calibration(case: Case, trainer: Trainer, taken: list[int]) -> list[list[float]]:
    """Predicted and true rms error of sharp px in ten groups by prediction, over all tests."""
    looks, places, noise = knowledge(trainer, taken, case, True)
    seen = [places[i] for i in taken]
    posterior = sample_posterior(looks, seen, noise, 8, 10, case.seed)
    predicted, true = [], []
    for camera in case.tests:
        with torch.no_grad():
            truth = render(case.truth, camera)
        place = Place(trainer.scale.camera_to_unit(camera), PSF)
        m = MARGIN
        variance = spread(looks, opened(looks, posterior, seen, place), place)[1][:, m:-m, m:-m].mean(dim=0)
        error = (looks.unmoved(place)[:, m:-m, m:-m] - truth.image).square().mean(dim=0)
        inside = truth.alpha > 0.9
        predicted.append(variance[inside])
        true.append(error[inside])
    p, t = torch.cat(predicted).numpy(), torch.cat(true).numpy()
    groups = np.array_split(np.argsort(p), 10)
    return [[float(np.sqrt(p[g].mean())), float(np.sqrt(t[g].mean()))] for g in groups]


def main() -> None:
    """Runs what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--ways", nargs="+", default=WAYS)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--even", action="store_true", help="all candidates at one distance")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "runs" / "next_view.jsonl")
    options = parser.parse_args()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    scene = f"{'even' if options.even else 'uneven'} {options.steps}"
    for seed in range(options.seeds):
        case = Case(seed, options.steps, (1.9, 1.9) if options.even else (1.5, 3.4))
        for way in options.ways:
            key = {"scene": scene, "seed": seed, "way": way}
            if any(all(row[k] == v for k, v in key.items()) for row in rows):
                continue
            taken, accuracies = list(case.first), []
            for count in range(FIRST, MOST + 1):
                if way == "uniform":
                    taken = evenly(case, count - FIRST)
                trainer = case.train(taken)
                accuracies.append(case.accuracy(trainer))
                if count < MOST and way != "uniform":
                    taken.append(choose(way, case, trainer, taken, count))
            row = {**key, "psnr": accuracies, "taken": taken}
            if way.startswith("bits"):
                row["reliability"] = calibration(case, trainer, taken)
            rows.append(row)
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(seed, way, [round(a, 2) for a in accuracies], flush=True)
    report([row for row in rows if row["scene"] == scene])


def needed(psnr: list[float], target: float) -> float:
    """Photos to reach `target`, interpolated; NaN if never."""
    for i, value in enumerate(psnr):
        if value >= target:
            before = psnr[i - 1] if i else value
            return FIRST + i - (0.0 if i == 0 or value == before else (value - target) / (value - before))
    return float("nan")


def report(rows: list[dict]) -> None:
    """Photos that each way needs for what uniform placement reaches with 8."""
    print("\n| way | PSNR after 4, 6, 8 photos | photos for uniform's PSNR with 8 | share of uniform's | seeds |")
    print("|---|---|---|---|---|")
    uniform = {row["seed"]: row["psnr"] for row in rows if row["way"] == "uniform"}
    for way in WAYS:
        mine = [row for row in rows if row["way"] == way and row["seed"] in uniform]
        if not mine:
            continue
        mean = np.mean([row["psnr"] for row in mine], axis=0)
        counts = [needed(row["psnr"], uniform[row["seed"]][8 - FIRST]) for row in mine]
        own = [needed(uniform[row["seed"]], uniform[row["seed"]][8 - FIRST]) for row in mine]
        got = [c for c in counts if np.isfinite(c)]
        share = np.mean([c / o for c, o in zip(counts, own, strict=True) if np.isfinite(c)]) if got else float("nan")
        print(f"| {way} | {mean[1]:.2f}, {mean[3]:.2f}, {mean[5]:.2f} | "
              f"{np.mean(got) if got else float('nan'):.1f} (reached in {len(got)} of {len(mine)}) | "
              f"{100 * share:.0f} % | {len(mine)} |")  # fmt: skip
    curves = [row["reliability"] for row in rows if "reliability" in row]
    if curves:
        print("\npredicted and true rms error (8-bit steps), tenths of the px by prediction:")
        print(", ".join(f"{255 * p:.1f} -> {255 * t:.1f}" for p, t in np.mean(curves, axis=0)))


if __name__ == "__main__":
    main()
