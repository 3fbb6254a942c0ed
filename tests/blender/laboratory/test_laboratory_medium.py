"""The laboratory's own blur against scipy's, and what a camera stores."""

from __future__ import annotations

import argparse

import numpy as np
import pytest
from dgs.core.errors import DgsError, PsfError
from dgs.dgs_addon.laboratory import degrade
from dgs.dgs_addon.laboratory.command import add_arguments, settings_of
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings
from scipy.ndimage import gaussian_filter


def _light(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(0.0, 1.2, (height, width, 3)).astype(np.float32)


def _photo(linear: np.ndarray, space: str, bits: int = 16, noise: float = 0.0, view: int = 0) -> np.ndarray:
    return degrade.photograph(
        linear,
        degrade.kernel_of("gaussian:2"),
        degrade.Sensor(bits, noise),
        blur_space=space,
        margin=12,
        seed=(0, view),
    )


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_photo_is_scipys_blur_of_the_unrounded_overscan_frame(space: str) -> None:
    linear = _light(50, 60)
    light = linear.astype(np.float64)

    def smooth(values: np.ndarray) -> np.ndarray:
        return gaussian_filter(values, (2, 2, 0), truncate=6, mode="nearest")

    expected = smooth(degrade.encode(light)) if space == "srgb" else degrade.encode(smooth(light))
    photo = _photo(linear, space)
    assert photo.shape == (26, 36, 3)
    assert np.abs(photo / 65535 - expected[12:-12, 12:-12]).max() <= 0.51 / 65535


def test_both_blur_spaces_differ() -> None:
    linear = _light(50, 60)
    assert np.abs(_photo(linear, "srgb") / 65535 - _photo(linear, "linear") / 65535).max() > 0.01


def test_light_beyond_the_frame_reaches_into_the_photo() -> None:
    dark = np.zeros((50, 60, 3), np.float32)
    lit = dark.copy()
    lit[:12] = 1.0
    assert _photo(dark, "srgb", bits=8).max() == 0
    assert _photo(lit, "srgb", bits=8)[0].min() > 80


def test_noise_has_the_asked_spread_and_is_another_for_each_view() -> None:
    grey = np.full((224, 224, 3), 0.2, np.float32)
    first, second = (_photo(grey, "srgb", noise=0.02, view=view) / 65535 for view in (0, 1))
    assert first.std() == pytest.approx(0.02, rel=0.02)
    assert (first - second).std() == pytest.approx(0.02 * np.sqrt(2), rel=0.02)


def test_tilted_gaussian_has_the_covariance_it_says() -> None:
    kernel = degrade.kernel_of("gaussian:4,2,30")
    y, x = np.mgrid[: kernel.shape[0], : kernel.shape[1]] - np.array(kernel.shape)[:, None, None] // 2
    axes = np.array([[np.cos(np.pi / 6), -np.sin(np.pi / 6)], [np.sin(np.pi / 6), np.cos(np.pi / 6)]])
    expected = axes @ np.diag([16.0, 4.0]) @ axes.T
    measured = [[(kernel * a * b).sum() for b in (x, y)] for a in (x, y)]
    assert np.allclose(measured, expected, atol=1e-4)


@pytest.mark.parametrize(
    "psf",
    ["gaussian", "gaussian:-1", "gaussian:nan", "gaussian:1,2", "cone:3", "disk:x", "", "gaussian:1e9", "disk:1e300"],
)
def test_senseless_spreads_are_refused(psf: str) -> None:
    with pytest.raises(PsfError):
        degrade.kernel_of(psf)


@pytest.mark.parametrize(
    "wrong", [{"views": 0}, {"width": 2}, {"bits": 12}, {"path": "moon"}, {"noise": -0.1}, {"focus": np.inf}]
)
def test_senseless_settings_are_refused(wrong: dict) -> None:
    with pytest.raises(DgsError):
        SynthesizeSettings(**wrong)


def test_command_line_says_the_same_as_the_settings() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert settings_of(parser.parse_args(["--out", "x"])) == SynthesizeSettings()
    words = "--out x --path orbit --views 9 --size 64x48 --psf gaussian:3 --blur-space linear --bits 16 --masks"
    assert settings_of(parser.parse_args(words.split())) == SynthesizeSettings(
        path="orbit", views=9, width=64, height=48, psf="gaussian:3", blur_space="linear", bits=16, masks=True
    )
