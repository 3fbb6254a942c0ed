"""Richardson-Lucy: its number of iterations is chosen by the photos' noise alone, and photos are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.errors import Cancelled
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.photos.load import Photo
from dgs.core.progress import Silent
from dgs.studies.comparison import deconvolution, degrade
from scipy.ndimage import gaussian_filter

SIGMA = 2.0


def photos(noise: float, count: int = 3) -> tuple[list[Photo], list[np.ndarray], Medium]:
    """Blurred photos of soft blots, and their sharp pictures."""
    generator = np.random.default_rng(4)
    made, truth = [], []
    for index in range(count):
        blots = gaussian_filter(generator.normal(size=(120, 140, 3)), (1.5, 1.5, 0))
        sharp = np.rint(np.clip(0.5 + 0.15 * blots / blots.std(), 0, 1) * 255).astype(np.uint8)
        pixels = degrade.photographed(sharp, degrade.gaussian(SIGMA), noise, seed=(index,))
        made.append(Photo(f"{index}.png", Path(f"{index}.png"), pixels))
        truth.append(sharp)
    return made, truth, Medium(parse_psf(f"gaussian:{SIGMA}"))


def error(deconvolved: list[Photo], truth: list[np.ndarray]) -> float:
    inside = slice(20, -20), slice(20, -20)
    differences = [p.pixels[inside] / 65535 - t[inside] / 255 for p, t in zip(deconvolved, truth, strict=True)]
    return float(np.sqrt(np.mean(np.square(differences))))


def test_noisier_photos_ask_for_fewer_iterations_and_near_the_best():
    chosen = []
    for noise in (0.03, 0.004):
        blurred, truth, medium = photos(noise)
        iterations, residual = deconvolution.lucy_iterations(blurred, medium)
        chosen.append(iterations)
        assert residual <= 1.1 or iterations == deconvolution.NUMBERS.iterations[-1]
        errors = {n: error(deconvolution.lucy(blurred, medium, n, Silent()), truth) for n in (10, 25, 50, 100, 200)}
        assert errors[iterations] <= 1.2 * min(errors.values()), "the truth, which it never saw, agrees"
    assert chosen[0] < chosen[1]


def test_two_threads_and_photos_that_are_kept_change_nothing(tmp_path):
    blurred, _, medium = photos(0.0, 2)
    plain = deconvolution.lucy(blurred, medium, 5, Silent())
    kept = deconvolution.lucy(blurred, medium, 5, Silent(), threads=2, folder=tmp_path)
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npy")}
    again = deconvolution.lucy(blurred, medium, 5, Silent(), folder=tmp_path)
    assert len(stamps) == 2 and {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npy")} == stamps
    for one, two, three in zip(plain, kept, again, strict=True):
        assert np.array_equal(one.pixels, two.pixels) and np.array_equal(two.pixels, three.pixels)


def test_a_stop_keeps_what_is_done(tmp_path):
    class After(Silent):
        done = 0

        def advance(self, done: int, **figures: float) -> None:
            self.done = done

        def cancelled(self) -> bool:
            return self.done >= 1

    blurred, _, medium = photos(0.0, 3)
    with pytest.raises(Cancelled, match="resume"):
        deconvolution.lucy(blurred, medium, 3, After(), folder=tmp_path)
    assert len(list(tmp_path.glob("*.npy"))) == 1
