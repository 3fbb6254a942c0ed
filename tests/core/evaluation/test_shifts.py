"""Shifts between two pictures of one view: what they are, how sure, and what they do not depend on."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.evaluation.shifts import SETTINGS as SHIFTS
from dgs.core.evaluation.shifts import shifts_between
from scipy.ndimage import gaussian_filter

HEIGHT, WIDTH = 96, 120


def textured(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(3, HEIGHT, WIDTH))
    return gaussian_filter(noise, (0, 3, 3)) * 2 + 0.5


def test_transposed_pictures_have_transposed_shifts() -> None:
    """Rows and columns are treated alike."""
    picture, photo = textured(0), textured(0) * 0.9 + 0.1 * textured(1)
    found = shifts_between(picture, photo)
    turned = shifts_between(picture.swapaxes(1, 2), photo.swapaxes(1, 2))
    np.testing.assert_allclose(turned.shift[::-1].swapaxes(1, 2), found.shift, atol=1e-7)
    np.testing.assert_allclose(turned.error.T, found.error, rtol=1e-5)


def test_pictures_that_are_the_same_have_no_shift_and_the_least_error() -> None:
    """A residual of nothing still counts as 1e-7, over how much detail there is; where there is none, without end."""
    picture = textured(0)
    found = shifts_between(picture, picture)
    assert np.abs(found.shift).max() < 1e-9
    np.testing.assert_allclose(found.error, np.sqrt(1e-7 / found.detail), rtol=1e-6)
    flat = shifts_between(np.full_like(picture, 0.5), np.full_like(picture, 0.5))
    np.testing.assert_allclose(flat.error, 10.0, rtol=1e-6)  # sqrt(1e-7 / 1e-9)
    stripes = np.broadcast_to(0.5 + 0.2 * np.sin(np.arange(WIDTH) / 4.0), picture.shape)
    assert np.median(shifts_between(stripes, stripes).error) > 5.0, "along the stripes no shift can be estimated"


def test_the_window_is_twice_its_half_and_the_middle() -> None:
    """Two px beside each other are all that counts: there is detail where a window holds both."""
    picture, valid = textured(4), np.zeros((HEIGHT, WIDTH), bool)
    valid[48, 47:49] = True
    for half in (3, 6):
        one = replace(SHIFTS, scales=((1.0, half),), steps=1)
        rows, columns = np.nonzero(shifts_between(picture, picture, valid, one).detail > 1e-9)
        assert (rows.min(), rows.max()) == (48 - half, 48 + half)
        assert (columns.min(), columns.max()) == (48 - half, 47 + half)


@pytest.mark.parametrize(("share", "explained"), [(0.98, True), (1.03, False)])
def test_contrast_may_differ_so_much(share: float, explained: bool) -> None:
    """A photo of less or more contrast leaves no residual up to the limit, and one beyond it."""
    picture = 0.5 + 0.2 * (textured(5) - 0.5)
    for factor in (SHIFTS.largest_gain * share, 1.0 / (SHIFTS.largest_gain * share)):
        found = shifts_between(picture, 0.5 + factor * (picture - 0.5))
        least = np.sqrt(1e-7 / found.detail)
        inner = (slice(30, -30), slice(30, -30))
        assert (found.error[inner] < 1.0001 * least[inner]).all() == explained
