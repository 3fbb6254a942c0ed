"""Edges that stand alone keep their width; the flanks of thin lines do not count."""

import numpy as np
import pytest
from dgs.core.inspection.edges import find_edges
from dgs.core.inspection.lone_edges import SETTINGS, lone_edges
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.load import Photo
from scipy import ndimage


def photos(*greys, sigma=2.0):
    """8-bit photos of pictures [H, W] that are finer by 4, blurred by sigma px."""
    random, out = np.random.default_rng(0), []
    for i, grey in enumerate(greys):
        blurred = ndimage.gaussian_filter(grey.astype(float), 4 * sigma)
        h, w = (n // 4 for n in grey.shape)
        values = 255 * (0.2 + 0.6 * blurred.reshape(h, 4, w, 4).mean(axis=(1, 3)))
        values = values + 0.3 * random.standard_normal(values.shape)
        out.append(Photo(f"{i}.png", None, np.round(np.repeat(values[..., None], 3, 2)).astype(np.uint8)))
    return PhotoSet(out)


def bars(width, size=640):
    """Oblique bars, `width` px of the photo wide, 40 px apart."""
    y, x = np.mgrid[:size, :size] / 4.0
    return (0.8 * x + 0.6 * y) % 40.0 < width


def test_steps_are_as_wide_as_the_blur():
    found = lone_edges(photos(bars(20.0)))
    assert len(found) >= 10
    assert np.median(np.sqrt(found.variance)) == pytest.approx(2.0, rel=0.03)


def test_flanks_of_a_thin_line_are_no_edges():
    thin = photos(bars(4.0))
    flanks = find_edges(thin.greys[0], thin.grey_noise[0], SETTINGS.finest)
    assert len(flanks) > 10 and np.median(np.sqrt(flanks.variance)) < 1.8  # one step describes each, too narrow a one
    assert len(lone_edges(thin)) == 0


def test_photos_are_looked_at_until_there_are_enough():
    several = photos(*[bars(20.0, 260)] * 6)
    few = lone_edges(PhotoSet(several.photos[:1]))
    assert len(few) < SETTINGS.enough < len(few) * 6
    seen = np.unique(lone_edges(several).photo)
    assert 1 < len(seen) < 6 and seen[-1] == 4


def test_blank_photos_have_none():
    assert len(lone_edges(photos(np.zeros((320, 320))))) == 0
