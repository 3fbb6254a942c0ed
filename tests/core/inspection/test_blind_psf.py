"""The blur estimated from blurred photos alone, and plain words where they do not determine it."""

import numpy as np
import pytest
from dgs.core.errors import PsfError
from dgs.core.inspection.blind_psf import blind_psf
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.inspection.spectra import DIRECTIONS, RADII, fit_blur
from dgs.core.photos.load import Photo
from scipy import ndimage


@pytest.mark.parametrize("sigma", [1.5, 2.0])
def test_sharp_scenes_show_their_blur(taken, sigma):
    found = blind_psf(taken(psf=(sigma, sigma, 0.0), space="srgb"))
    assert found.verdict == "estimated" and found.sigma == pytest.approx(sigma, rel=0.08)
    assert found.low < sigma < found.high and found.high - found.low < 0.5 * sigma
    psf = found.point_spread()
    assert psf is not None and psf.sigma_x == pytest.approx(sigma, rel=0.08) and "interval" in psf.notes[0]


def test_too_few_lonely_edges_give_a_bound_that_holds(taken):
    """In photos of 240 px nothing is alone within 2.8 times 4 px."""
    found = blind_psf(taken(psf=(4.0, 4.0, 0.0), space="srgb"))
    assert found.verdict == "upper bound" and found.low == 0.0 and 4.0 < found.high < 5.5
    psf = found.point_spread()  # a guess on the safe side, and called one
    assert psf is not None and 2.5 < psf.sigma_x < 4.0 and psf.notes[0].startswith("only guessed")


def test_in_linear_light_if_the_medium_blurs_that(taken):
    photos = taken(psf=(2.5, 2.5, 0.0), space="linear")
    found = blind_psf(PhotoSet(photos.photos, linear=True))
    assert found.verdict == "estimated" and found.sigma == pytest.approx(2.5, rel=0.1)


def test_sharp_photos_need_none(taken):
    found = blind_psf(taken())
    assert found.verdict == "sharp" and found.point_spread() is None and found.high < 1.1


def plain(make):
    random = np.random.default_rng(0)
    return PhotoSet([Photo(f"{i}.png", None, make(random)) for i in range(6)])


def test_a_scene_without_edges_gives_a_bound_only():
    def clouds(random):
        """Power falling as f^-4.5: soft at every scale."""
        f = np.hypot(np.fft.fftfreq(160)[:, None], np.fft.rfftfreq(240)[None, :])
        spectrum = np.fft.rfft2(random.standard_normal((160, 240))) * np.maximum(f, 1 / 240) ** -2.25
        grey = np.fft.irfft2(spectrum, s=(160, 240))
        grey = ndimage.gaussian_filter(0.5 + 0.15 * (grey - grey.mean()) / grey.std(), 2.0)
        return np.round(np.repeat(grey[..., None], 3, 2).clip(0, 1) * 65535).astype(np.uint16)

    found = blind_psf(plain(clouds))
    assert found.verdict in ("upper bound", "not identifiable") and found.low == 0.0
    with pytest.raises(PsfError, match="measure-psf"):
        found.point_spread()


def test_a_blank_wall_determines_nothing():
    def wall(random):
        return np.round(128 + 3 * random.standard_normal((120, 160, 3))).astype(np.uint8)

    found = blind_psf(plain(wall))
    assert found.verdict == "not identifiable" and not np.isfinite(found.sigma)
    with pytest.raises(PsfError, match="not identifiable"):
        found.point_spread()


def test_texture_hardly_above_the_noise_is_no_estimate():
    """All bins stand clear of the noise and none does by much: nothing is left to fit."""
    power = np.full((RADII, DIRECTIONS), 0.5)
    power[:25] = 4.0
    assert fit_blur(power, (160, 160), 1.0) is None
