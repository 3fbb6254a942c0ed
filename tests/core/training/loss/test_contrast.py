"""The scene's contrast, estimated from its blurred photos."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.training.grid import GridView
from dgs.core.training.loss.contrast import MINIMUM_CONTRAST, scene_contrast
from dgs.core.views import View
from scipy.ndimage import gaussian_filter

SIDE = 256


def natural(seed: int = 0, contrast: float = 0.08) -> np.ndarray:
    """[SIDE, SIDE] random picture whose spectrum falls as 1/f, around mid grey."""
    random = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE)[None])
    frequency[0, 0] = 1.0
    picture = np.fft.irfft2(np.fft.rfft2(random.standard_normal((SIDE, SIDE))) / frequency, s=(SIDE, SIDE))
    return 0.5 + contrast * (picture - picture.mean()) / picture.std()


def view(picture: np.ndarray, psf: str | None, mask: np.ndarray | None = None) -> GridView:
    camera = Camera("a", SIDE, SIDE, SIDE, SIDE, SIDE / 2, SIDE / 2, np.eye(3), np.zeros(3))
    pixels = np.round(65535 * np.clip(picture, 0, 1)).astype(np.uint16)
    grey = np.repeat(pixels[..., None], 3, axis=2)
    return GridView(View(camera, grey, mask), camera, 1, parse_psf(psf) if psf else None, "srgb")


def test_blurred_photos_tell_the_contrast_of_the_sharp_scene():
    sharp = natural()
    truth = scene_contrast([view(sharp, None)])
    for sigma in (2.0, 4.0):
        blurred = gaussian_filter(sharp, sigma, mode="wrap")
        assert scene_contrast([view(blurred, f"gaussian:{sigma}")]) == pytest.approx(truth, rel=0.25)


def test_contrast_scales_with_the_scenes_and_hardly_with_noise():
    blurred = gaussian_filter(natural(), 3.0, mode="wrap")
    full = scene_contrast([view(blurred, "gaussian:3")])
    half = scene_contrast([view(0.5 + 0.5 * (blurred - 0.5), "gaussian:3")])
    assert half == pytest.approx(full / 2, rel=0.01)
    noisy = blurred + 0.01 * np.random.default_rng(1).standard_normal(blurred.shape)
    assert scene_contrast([view(noisy, "gaussian:3")]) == pytest.approx(full, rel=0.15)


def test_what_is_masked_does_not_count_and_grey_photos_have_the_least_contrast():
    picture, mask = natural(), np.zeros((SIDE, SIDE), bool)
    mask[:, : SIDE // 2] = True
    poisoned = picture.copy()
    poisoned[:, SIDE // 2 + 1 :] = np.random.default_rng(2).uniform(size=(SIDE, SIDE // 2 - 1))
    assert scene_contrast([view(poisoned, None, mask)]) == pytest.approx(
        scene_contrast([view(picture, None, mask)]), rel=1e-3
    )
    assert scene_contrast([view(np.full((SIDE, SIDE), 0.5), None)]) == MINIMUM_CONTRAST
