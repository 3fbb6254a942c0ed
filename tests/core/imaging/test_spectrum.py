"""Noise and signal are read off blurred photos: against images whose spectra are known."""

import numpy as np
import pytest
from dgs.core.imaging.kernel_samples import disc as disc_of
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.spectrum import HIGHEST, frequencies, noise_to_signal, radial_power

SIZE = 256
CONTRAST = 0.15


def scenes(slope: float, sigma: float, noise: float, count: int = 4) -> tuple[list[np.ndarray], np.ndarray]:
    """Blurred noisy frames of random fields with power spectrum ~ f^-slope, and that spectrum."""
    random = np.random.default_rng(0)
    radius = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    amplitude = np.maximum(radius, 1 / SIZE) ** (-slope / 2)
    amplitude[0, 0] = 0
    blur = np.exp(-2 * np.pi**2 * sigma**2 * radius**2)
    whole = np.fft.irfft2(amplitude * np.fft.rfft2(random.normal(size=(SIZE, SIZE))))
    gain = CONTRAST / whole.std()
    frames = []
    for _ in range(count):
        planes = []
        for _ in range(3):
            spectrum = gain * amplitude * np.fft.rfft2(random.normal(size=(SIZE, SIZE)))
            planes.append(0.5 + np.fft.irfft2(spectrum * blur) + noise * random.normal(size=(SIZE, SIZE)))
        frames.append(np.stack(planes).astype(np.float32))
    f = frequencies()
    return frames, gain**2 * np.maximum(f, 1 / SIZE) ** -slope


def test_white_noise_has_its_variance_at_every_frequency():
    planes = np.random.default_rng(0).normal(scale=0.1, size=(2, 200, 240)).astype(np.float32)
    power = radial_power(planes)
    assert np.allclose(power[:, 4:60].mean(axis=1), 0.01, rtol=0.05)


@pytest.mark.parametrize("slope", [2.0, 3.0])
@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_noise_and_ratio_are_measured(slope, noise):
    frames, signal = scenes(slope, 4.0, noise)
    found = noise_to_signal(frames, PointSpread("gaussian", 4.0, 4.0), 0.0005)
    assert found.noise == pytest.approx(noise, rel=0.2)
    f = frequencies()
    wanted = (f > 0.02) & (f < 0.12)  # from within the clear band to well beyond it
    for table in (found.brightness, found.colour):
        error = np.log2(table[wanted] / (noise**2 / signal[wanted]))
        assert np.abs(error).max() < 1.0, "within a factor of two"


def test_rounding_is_the_least_noise_there_is():
    frames, _ = scenes(2.0, 4.0, 0.0)
    step = 1 / 255 / 12**0.5
    assert noise_to_signal(frames, PointSpread("gaussian", 4.0, 4.0), step).noise == pytest.approx(step)


def test_rounded_photos_show_the_noise_of_rounding():
    frames, _ = scenes(2.0, 4.0, 0.0)
    rounded = [np.round(frame * 255).astype(np.float32) / 255 for frame in frames]
    found = noise_to_signal(rounded, PointSpread("gaussian", 4.0, 4.0), 1e-6)
    assert found.noise == pytest.approx(1 / 255 / 12**0.5, rel=0.2)


def test_more_views_share_the_noise():
    frames, _ = scenes(2.0, 4.0, 0.005, 1)
    found = noise_to_signal(frames, PointSpread("gaussian", 4.0, 4.0), 0.001)
    shared = found.trusted(10.0)
    assert np.allclose(shared.brightness * 10, found.brightness) and shared.noise == found.noise
    assert np.allclose(found.trusted(0.2).colour, found.colour * 5.0)


def test_nothing_but_noise_is_not_believed():
    planes = 0.5 + np.random.default_rng(0).normal(scale=0.01, size=(3, 128, 128))
    found = noise_to_signal([planes.astype(np.float32)], PointSpread("gaussian", 4.0, 4.0), 0.001)
    assert np.isfinite(found.brightness).all() and (found.brightness > 0).all()
    assert found.brightness[frequencies() > 0.1].min() > 1.0
    assert frequencies()[-1] == pytest.approx(HIGHEST)


@pytest.mark.parametrize("slope", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("given", [3.2, 4.0])
def test_a_blur_given_rightly_or_too_narrow_is_not_contradicted(slope, given):
    frames, _ = scenes(slope, 4.0, 0.002)
    found = noise_to_signal(frames, PointSpread("gaussian", given, given), 0.0005)
    assert not found.contradicted and found.unexplained is None
    assert found.trusted(5.0).brightness == pytest.approx(found.brightness / 5.0)


@pytest.mark.parametrize("slope", [1.5, 2.0, 3.0])
def test_a_blur_given_too_wide_is_contradicted(slope):
    frames, _ = scenes(slope, 4.0, 0.002)
    found = noise_to_signal(frames, PointSpread("gaussian", 5.2, 5.2), 0.0005)
    assert found.contradicted
    assert 4.0 / 5.2 - 0.05 < found.widest < 0.95
    f = frequencies()
    fine = (f > 0.1) & (f < 0.2)  # more trust brings the noise down, never what contradicts
    assert (found.trusted(1e6).brightness[fine] > 100 * found.brightness[fine]).all()
    assert (found.trusted(1e6).brightness[f < 0.03] < 1e-3).all(), "what the blur lets pass is trusted still"


def test_a_disc_given_as_a_gaussian_is_contradicted():
    """Their variances are the same, but a disc's side lobes let fine detail through."""
    frames, _ = scenes(2.0, 0.0, 0.0)
    disc = PointSpread("file", samples=disc_of(8.0))
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    transfer = disc.mtf(f.ravel(), 0.0).reshape(f.shape)
    noise = np.random.default_rng(1)
    blurred = [
        (np.fft.irfft2(np.fft.rfft2(frame) * transfer) + noise.normal(scale=0.002, size=frame.shape)).astype(np.float32)
        for frame in frames
    ]
    assert noise_to_signal(blurred, PointSpread("gaussian", 4.0, 4.0), 0.0005).excess > 20
    assert not noise_to_signal(blurred, disc, 0.0005).contradicted
