"""Edges tell the blur: single ones, scenes of them, and scenes that have none."""

import math

import numpy as np
import pytest
from dgs.core.inspection.blind_psf import blind_psf
from dgs.core.inspection.edge_blur import SETTINGS, edge_blur
from dgs.core.inspection.edges import find_edges
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.load import Photo
from scipy import ndimage
from scipy.special import ndtr


def one_edge(width, degrees, size=120):
    """A blurred straight step through the middle, [size, size] in [0, 1]."""
    y, x = np.mgrid[:size, :size] - size / 2 - 0.3
    u = x * math.cos(math.radians(degrees)) + y * math.sin(math.radians(degrees))
    return (0.2 + 0.5 * ndtr(u / width)).astype(np.float32)


def leaves(seed, size=(300, 400), finer=3):
    """Discs over one another, true steps, [H, W] in [0, 1]."""
    random = np.random.default_rng(seed)
    h, w = size[0] * finer, size[1] * finer
    picture = np.full((h, w), 0.4, np.float32)
    for radius in random.uniform(12, 90, 120) * finer:
        x, y = random.uniform(0, w), random.uniform(0, h)
        x0, x1, y0, y1 = (int(max(0, v)) for v in (x - radius, x + radius + 1, y - radius, y + radius + 1))
        yy, xx = np.mgrid[y0 : min(y1, h), x0 : min(x1, w)]
        part = picture[y0 : min(y1, h), x0 : min(x1, w)]
        part[(xx - x) ** 2 + (yy - y) ** 2 < radius**2] = random.uniform(0.08, 0.9)
    return picture.reshape(size[0], finer, size[1], finer).mean(axis=(1, 3))


@pytest.fixture(scope="module")
def scenes():
    return [leaves(seed) for seed in range(5)]


def photos(greys, blurred):
    """A set of 8-bit photos, `blurred` done to each."""
    random = np.random.default_rng(1)
    out = []
    for i, grey in enumerate(greys):
        values = blurred(grey) * 255 + 0.5 * random.standard_normal(grey.shape)
        pixels = np.round(np.repeat(values[..., None], 3, 2)).clip(0, 255).astype(np.uint8)
        out.append(Photo(f"{i}.png", None, pixels))
    return PhotoSet(out)


@pytest.mark.parametrize("width", [1.2, 2.4, 6.0])
@pytest.mark.parametrize("degrees", [0, 27, 225])
def test_one_edge_shows_its_width_and_direction(width, degrees):
    found = find_edges(one_edge(width, degrees), 1e-4, 1.15 * width)
    assert len(found) >= 5
    assert np.sqrt(np.median(found.variance)) == pytest.approx(width, rel=0.01)
    assert np.degrees(np.median(np.angle(np.exp(1j * (found.direction - math.radians(degrees)))))) == pytest.approx(
        0.0, abs=0.5
    )


def test_an_arc_is_no_wider_than_a_line():
    fine = np.hypot(*(np.mgrid[:640, :640] / 4 - 79.6)) < 24
    disc = ndimage.gaussian_filter(fine.astype(float), 12.0).reshape(160, 4, 160, 4).mean(axis=(1, 3))
    found = find_edges((0.2 + 0.5 * disc).astype(np.float32), 1e-4, 3.2)
    assert np.sqrt(np.median(found.variance) - 1 / 12) == pytest.approx(3.0, rel=0.01)


def test_what_is_white_or_hidden_is_no_edge():
    edge = one_edge(2.0, 10)
    assert len(find_edges(edge, 1e-3, 2.0, edge > 0.69)) == 0


@pytest.mark.parametrize("sigma", [1.5, 3.0, 5.0])
def test_scenes_of_steps_tell_their_blur(scenes, sigma):
    found = blind_psf(photos(scenes, lambda grey: ndimage.gaussian_filter(grey, sigma)))
    assert found.verdict == "estimated", found.text
    assert found.sigma == pytest.approx(sigma, rel=0.05) and found.low < sigma < found.high
    assert found.high - found.low < 0.25 * sigma


def test_a_wrong_guess_is_mended(scenes):
    blurred = photos(scenes, lambda grey: ndimage.gaussian_filter(grey, 4.0))
    found = edge_blur(blurred, np.array([0.5, 0.5, 0.0]))
    assert (
        found is not None
        and found.gain > SETTINGS.minimum_gain
        and math.sqrt(found.variance) == pytest.approx(4.0, rel=0.04)
    )


def test_soft_things_beside_sharp_ones_do_not_widen_it(scenes):
    def half_soft(grey):
        soft = ndimage.gaussian_filter(grey, 1.5)
        return ndimage.gaussian_filter(np.where(np.arange(grey.shape[1]) < 220, soft, grey), 2.0)

    found = blind_psf(photos(scenes, half_soft))
    assert found.verdict == "estimated" and found.sigma == pytest.approx(2.0, rel=0.05)


def test_blur_that_is_wider_along_one_direction(scenes):
    angle = math.radians(30)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    covariance = turn @ np.diag([3.0**2, 2.0**2]) @ turn.T

    def blurred(grey):
        fy, fx = np.fft.fftfreq(grey.shape[0])[:, None], np.fft.rfftfreq(grey.shape[1])[None]
        form = covariance[0, 0] * fx**2 + covariance[1, 1] * fy**2 + 2 * covariance[0, 1] * fx * fy
        return np.fft.irfft2(np.fft.rfft2(grey) * np.exp(-2 * np.pi**2 * form), s=grey.shape)

    found = blind_psf(photos(scenes, blurred))
    assert found.verdict == "estimated"
    assert (found.sigma_x, found.sigma_y) == pytest.approx((3.0, 2.0), rel=0.06)
    assert found.angle == pytest.approx(30.0, abs=6.0)


def test_clouds_give_a_bound_only():
    """Power falls as it does with edges, f^-2, and there is none."""

    def cloud(seed):
        spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((240, 320)))
        f = np.hypot(np.fft.fftfreq(240)[:, None], np.fft.rfftfreq(320)[None])
        grey = np.fft.irfft2(spectrum / np.maximum(f, 1 / 320), s=(240, 320))
        return 0.5 + 0.12 * (grey - grey.mean()) / grey.std()

    found = blind_psf(photos([cloud(s) for s in range(4)], lambda grey: ndimage.gaussian_filter(grey, 2.0)))
    assert found.verdict == "upper bound" and "no sharp edges" in found.text
    assert found.low == 0.0 and 2.0 < found.high < 3.0
