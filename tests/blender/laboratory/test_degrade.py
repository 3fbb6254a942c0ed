"""The medium of the laboratory against closed forms."""

import numpy as np
import pytest
from dgs.core.errors import DgsError
from dgs.dgs_addon.laboratory import degrade
from dgs.dgs_addon.laboratory.contrast import curve_of
from scipy import special


def test_angle_turns_from_x_towards_y_down():
    kernel = degrade.kernel_of("gaussian:4,1,30")
    y, x = np.mgrid[: kernel.shape[0], : kernel.shape[1]] - kernel.shape[0] // 2
    slope = 0.5 * np.arctan2(2 * (kernel * x * y).sum(), (kernel * (x**2 - y**2)).sum())
    assert np.degrees(slope) == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_two_tone_edge_in_both_spaces(space):
    dark, bright = 0.05, 0.8
    linear = np.full((41, 81, 3), dark, dtype=np.float32)
    linear[:, 40:] = bright
    photo = (
        degrade.photograph(
            linear, degrade.kernel_of("gaussian:3"), degrade.Sensor(16), blur_space=space, margin=0, seed=(0, 0)
        )[20, :, 0]
        / 65535
    )
    # The sampled kernel adds whole pixels; integrated over a pixel it is the error function.
    share = special.ndtr((np.arange(81) + 0.5 - 40) / 3.0)
    if space == "linear":
        expected = degrade.encode(dark + (bright - dark) * share)
    else:
        low, high = degrade.encode(np.array([dark, bright]))
        expected = low + (high - low) * share
    np.testing.assert_allclose(photo, expected, atol=2e-3)


def test_no_psf_is_the_sharp_picture_to_the_bit():
    linear = np.random.default_rng(1).random((9, 11, 3), dtype=np.float32)
    options = {"sensor": degrade.Sensor(8), "blur_space": "srgb", "margin": 2, "seed": (0, 0)}
    sharp = degrade.quantise(degrade.encode(linear[2:-2, 2:-2].astype(np.float64)), 8)
    np.testing.assert_array_equal(degrade.photograph(linear, degrade.kernel_of("none"), **options), sharp)


def test_kernel_file(tmp_path):
    kernel = np.random.default_rng(0).random((5, 7))
    np.save(tmp_path / "kernel.npy", kernel)
    np.testing.assert_allclose(degrade.kernel_of(f"file:{tmp_path / 'kernel.npy'}"), kernel / kernel.sum())


def test_a_cameras_own_contrast_is_in_photos_and_sharp_pictures_alike():
    linear = np.random.default_rng(1).random((9, 11, 3), dtype=np.float32)
    options = {"blur_space": "linear", "margin": 0, "seed": (0, 0)}
    plain, film, s_shaped = (
        degrade.photograph(linear, np.ones((1, 1)), degrade.Sensor(16, contrast=text), **options) / 65535
        for text in ("", "film:1", "s:1.4")
    )
    # The light that a curve stored, by its inverse.
    np.testing.assert_allclose(-np.log(1 - film * (1 - np.exp(-1.0))), plain, atol=1e-4)
    odds = np.log(plain / (1 - plain))
    np.testing.assert_allclose(1 / (1 + np.exp(-1.4 * odds)), s_shaped, atol=1e-4)
    ends = degrade.curved(np.array([0.0, 1.0, 2.0, -1.0]), "film:1")
    np.testing.assert_allclose(ends, [0, 1, 1, 0], atol=1e-12)
    for text in ("film:0", "film:9", "s:0.1", "s:", "gamma:2", "s:nan"):
        with pytest.raises(DgsError, match="makes no sense"):
            curve_of(text)
