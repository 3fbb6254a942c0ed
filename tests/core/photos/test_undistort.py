from __future__ import annotations

import numpy as np
from dgs.core.lens import Lens
from dgs.core.photos.undistort import Undistortion
from scipy.ndimage import gaussian_filter

BENT = Lens("SIMPLE_RADIAL", 160, 120, (150.0, 80.0, 60.0, -0.12))


def pattern(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A smooth picture known between the pixels too."""
    return 0.5 + 0.2 * np.sin(u * 0.5) * np.cos(v * 0.4) + 0.2 * np.sin(0.3 * (u + v))


def grid(margin: int = 0) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.arange(-margin, 160 + margin) + 0.5, np.arange(-margin, 120 + margin) + 0.5)  # type: ignore[return-value]


def bent_photo() -> np.ndarray:
    """What the lens sees of the pattern painted on the pinhole's frame."""
    u, v = grid()
    straight = BENT.from_pixels(np.stack([u, v], -1)) * [BENT.fx, BENT.fy] + [BENT.cx, BENT.cy]
    return pattern(straight[..., 0], straight[..., 1])


def test_photo_becomes_the_pinholes_picture() -> None:
    photo = np.repeat((bent_photo() * 65535).astype(np.uint16)[:, :, None], 3, 2)
    straight, mask = Undistortion(BENT).photo(photo, None)
    inside = np.ones((120, 160), bool) if mask is None else mask
    inside[:3] = inside[-3:] = inside[:, :3] = inside[:, -3:] = False
    error = straight[..., 0] / 65535 - pattern(*grid())
    assert np.abs(error[inside]).max() < 2e-3


def test_render_lines_up_with_the_photo() -> None:
    way = Undistortion(BENT)
    margin = way.overscan + 3
    image = np.repeat(pattern(*grid(margin))[None].astype(np.float32), 3, 0)
    np.testing.assert_allclose(way.render(image, margin)[0][4:-4, 4:-4], bent_photo()[4:-4, 4:-4], atol=2e-3)


def test_sharpness_survives() -> None:
    """White noise low-passed to what a sharp photo holds keeps 97 % of its contrast both ways."""
    noise = gaussian_filter(np.random.default_rng(0).standard_normal((120, 160)), 0.7)
    photo = (noise / np.abs(noise).max() * 30000 + 32768).astype(np.uint16)
    way = Undistortion(BENT)
    straight, _ = way.photo(np.repeat(photo[:, :, None], 3, 2), None)
    back = way.render(straight.transpose(2, 0, 1).astype(np.float32), 0)[0]
    middle = np.s_[30:-30, 30:-30]
    assert np.std(back[middle]) > 0.97 * np.std(photo[middle].astype(float))
    assert np.corrcoef(back[middle].ravel(), photo[middle].ravel())[0, 1] > 0.99


def test_no_distortion_touches_no_bit() -> None:
    photo = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    for k in (0.0, 1e-6):
        way = Undistortion(Lens("SIMPLE_RADIAL", 160, 120, (150.0, 80.0, 60.0, k)))
        pixels, mask = way.photo(photo, None)
        assert pixels is photo and mask is None
        image = np.random.default_rng(1).random((3, 126, 166)).astype(np.float32)
        np.testing.assert_array_equal(way.render(image, 3), image[:, 3:-3, 3:-3])


def test_pixels_that_the_photo_did_not_see_do_not_count() -> None:
    pincushion = Lens("SIMPLE_RADIAL", 160, 120, (150.0, 80.0, 60.0, 0.12))
    photo = np.full((120, 160, 3), 200, np.uint8)
    straight, mask = Undistortion(pincushion).photo(photo, np.ones((120, 160), bool))
    assert mask is not None and not mask[0, 0] and mask[60, 80]
    assert (straight[mask] == round(200 / 255 * 65535)).all(), "a resampled photo has 16 bits"
