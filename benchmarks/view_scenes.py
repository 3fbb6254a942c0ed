"""Scenes for benchmarks of the next view: what is looked at, from where photos can be taken, and through what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.constants import SH_C0
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import render
from dgs.core.training.settings import TrainingSettings
from dgs.core.training.trainer import Trainer
from dgs.core.uncertainty.candidates import looking_at
from dgs.core.views import SparsePoints, View

WIDTH, HEIGHT, FOCAL = 72, 54, 80.0
#: Splats of the object and of the room around it.
GLOBE, ROOM = 1400, 700
UP = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Scene:
    """What the benchmark runs on.

    Attributes:
        thing: 'globe', 'niche' or 'board'.
        contrast: of the room's colours.
        distances: nearest and farthest candidate; spread over the logarithm where `even_log`.
        sigmas: standard deviations of the blur, px; `clear` is the share of candidates that has the first.
    """

    thing: str
    contrast: float
    distances: tuple[float, float]
    even_log: bool = False
    sigmas: tuple[float, ...] = (1.5,)
    clear: float = 1.0


#: The first is the one that all earlier figures are of.
SCENES = {
    "uneven": Scene("globe", 0.3, (1.5, 3.4)),
    "panes": Scene("globe", 0.06, (1.6, 2.2), sigmas=(0.6, 3.0, 3.5, 4.0), clear=0.35),
    "niche": Scene("niche", 0.06, (1.6, 2.2), sigmas=(1.0,)),
    "depths": Scene("globe", 0.06, (1.3, 6.0), even_log=True, sigmas=(1.0,)),
}
#: Only for the reliability of the expected error: none of its constants were chosen on anything like it.
BOARD = Scene("board", 0.06, (1.6, 2.2), sigmas=(2.0,))


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
        torch.tensor(means, dtype=torch.float32),
        torch.full((n, 3), float(np.log(size))),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        torch.full((n,), opacity),
        torch.tensor(((colours - 0.5) / SH_C0)[:, None, :], dtype=torch.float32),
    )


def room(seed: int, contrast: float) -> Gaussians:
    """700 large opaque splats far around: what stands before nothing gets its surroundings invented by any training."""
    random = np.random.default_rng([seed, 9])
    direction = ring(ROOM)
    phase, wave = random.uniform(0, 6.28, 3), 5 * random.normal(size=(3, 3))
    colours = np.clip(0.45 + contrast * np.sin(direction @ wave + phase), 0.05, 0.95)
    return splats(6.0 * direction if contrast > 0.1 else 9.0 * direction, 0.45 if contrast > 0.1 else 0.7, 4.0, colours)


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


def niche(seed: int) -> Gaussians:
    """A bowl open to +x: plain outside, painted with fine detail inside, 1900 splats before the opening is cut."""
    random = np.random.default_rng([seed, 0])
    outside, inside = ring(1100), ring(800)
    opening = np.cos(np.radians(60.0))
    outside, inside = outside[outside[:, 0] < opening], inside[inside[:, 0] < opening]
    phase = random.uniform(0, 6.28, 3)
    plain = 0.5 + 0.08 * np.sin(outside @ (2 * random.normal(size=(3, 3))) + phase)
    spots = random.choice([-1.0, 1.0], (len(inside), 1)) * np.ones(3)
    painted = 0.5 + 0.15 * np.sin(inside @ (4 * random.normal(size=(3, 3))) + phase) + 0.25 * spots
    parts = splats(0.5 * outside, 0.032, 4.0, plain), splats(0.44 * inside, 0.03, 4.0, painted.clip(0.05, 0.95))
    return joined(*parts)


def board(seed: int) -> Gaussians:
    """A standing board of 1.2 x 0.8, a little warped, painted by noise whose amplitude falls like 1 / f."""
    random = np.random.default_rng([seed, 0])
    wide, high = 48, 32
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.6, 0.6, wide), np.linspace(-0.4, 0.4, high)))
    fx, fy = np.meshgrid(np.fft.fftfreq(wide), np.fft.fftfreq(high))
    fall = 1.0 / np.maximum(np.hypot(fx, fy), 1.0 / wide)
    noise = random.normal(size=(3, high, wide)) * 0.6 + random.normal(size=(1, high, wide))
    waves = np.fft.ifft2(np.fft.fft2(noise) * fall).real
    waves /= waves.std(axis=(1, 2), keepdims=True)
    colours = np.clip(0.5 + 0.2 * waves.reshape(3, -1).T, 0.05, 0.95)
    return splats(np.stack([x, y, 0.05 * np.sin(4 * x) * np.cos(3 * y)], axis=1), 0.018, 4.0, colours)


def joined(a: Gaussians, b: Gaussians) -> Gaussians:
    """Both."""
    pairs = zip(a.named(), b.named(), strict=True)
    return Gaussians(**{name: torch.cat([one, other]) for (name, one), (_, other) in pairs})


def dome(count: int, seed: int, distances: tuple[float, float], name: str, even_log: bool = False) -> list[Camera]:
    """Evenly over directions, turned by chance; distances by chance."""
    random = np.random.default_rng([seed, 1, count])
    angle = np.arange(count) * np.pi * (3 - 5**0.5) + random.uniform(0, 6.28)
    height = np.arcsin(-0.35 + 1.2 * (np.arange(count) + 0.5) / count)
    ray = np.stack([np.cos(height) * np.cos(angle), -np.sin(height), np.cos(height) * np.sin(angle)], axis=1)
    lens = Camera("", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
    far = np.exp(random.uniform(*np.log(distances), count)) if even_log else random.uniform(*distances, count)
    return [looking_at(lens, f"{name}{i:02d}", far[i] * ray[i], np.zeros(3), UP) for i in range(count)]


class Case:
    """One seed of a scene: object, candidates with their photos, test viewpoints.

    Args:
        steps: of a training; first: neighbouring photos that are there from the beginning.
    """

    def __init__(self, scene: Scene, seed: int, steps: int, count: int = 36, tests: int = 16, first: int = 3) -> None:
        self.scene, self.seed, self.steps = scene, seed, steps
        thing = {"globe": globe, "niche": niche, "board": board}[scene.thing](seed)
        self.thing, parts = len(thing), (thing, room(seed, scene.contrast))
        self.truth = joined(*parts)
        self.cameras = dome(count, seed, scene.distances, "c", scene.even_log)
        self.margin = int(np.ceil(4 * max(scene.sigmas)))
        random = np.random.default_rng([seed, 5])
        clear = random.permutation(count) < round(scene.clear * count)
        sigmas = [scene.sigmas[0] if c else float(random.choice(scene.sigmas[1:])) for c in clear]
        self.spreads = [PointSpread("gaussian", s, s) for s in sigmas]
        own = {c.name: p for c, p in zip(self.cameras, self.spreads, strict=True)} if len(scene.sigmas) > 1 else {}
        self.medium = Medium(self.spreads[0], per_view=own)
        self.photos = [self._photo(c, p) for c, p in zip(self.cameras, self.spreads, strict=True)]
        self.tests = dome(tests, seed + 1000, (1.7, 1.7), "t")
        self.directions = np.array([c.centre / np.linalg.norm(c.centre) for c in self.cameras])
        random = np.random.default_rng([seed, 2])
        start = int(random.integers(count))
        self.first = [int(i) for i in np.argsort(-self.directions @ self.directions[start])[:first]]
        chosen = np.concatenate([random.permutation(self.thing)[:500], self.thing + random.permutation(ROOM)[:350]])
        centres = self.truth.means.numpy()[chosen].astype(float)
        self.points = SparsePoints(centres, np.full((len(chosen), 3), 128, np.uint8))
        self.sharp = [self._sharp(c) for c in self.tests]

    def _photo(self, camera: Camera, psf: PointSpread) -> View:
        """8 bit, blurred."""
        with torch.no_grad():
            frame = render(self.truth, camera.with_margin(self.margin)).image
            planes = BlurOperator(psf, HEIGHT, WIDTH, self.margin).apply(frame).numpy()
        return View(camera, np.ascontiguousarray(np.round(planes.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)))

    def planes(self, index: int) -> torch.Tensor:
        """[3, H, W] a candidate's photo."""
        return torch.from_numpy(self.photos[index].planes())

    def _sharp(self, camera: Camera) -> torch.Tensor:
        with torch.no_grad():
            return render(self.truth, camera).image

    def train(self, taken: list[int], seed: int | None = None) -> Trainer:
        """A twin from nothing."""
        settings = TrainingSettings(
            steps=self.steps, max_gaussians=2600, sh_degree=0, seed=self.seed if seed is None else seed, threads=1
        )
        trainer = Trainer([self.photos[i] for i in taken], [], self.points, self.medium, settings)
        for step in range(self.steps):
            trainer.advance(step / self.steps)
        return trainer

    def view(self, trainer: Trainer, camera: Camera) -> torch.Tensor:
        """[3, H, W] what the twin shows, sharp."""
        with torch.no_grad():
            return render(
                trainer.optimizer.gaussians,
                trainer.scale.camera_to_unit(camera),
                background=trainer.background,
                settings=trainer.raster_settings(trainer.levels[-1]),
            ).image

    def accuracy(self, trainer: Trainer) -> float:
        """Sharp PSNR (dB) over all tests."""
        squares = [
            float((self.view(trainer, camera) - truth).square().mean())
            for camera, truth in zip(self.tests, self.sharp, strict=True)
        ]
        return -10 * float(np.log10(np.mean(squares)))
