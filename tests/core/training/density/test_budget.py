"""How many Gaussians a set of photos can hold."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.background import Background
from dgs.core.training.density.budget import SETTINGS, supported_gaussians
from dgs.core.views import View
from dgs.tests.core.training.training_scenes import camera_at

FREE = replace(SETTINGS, unquestioned=0)


def photos(count, mask=None, alpha=None):
    photo = np.full((48, 64, 3), 100, np.uint8)
    return [View(camera_at(0.1 * i, 0.0, f"{i}.png", 64, 48), photo, mask=mask, alpha=alpha) for i in range(count)]


def test_so_many_values_for_each_parameter() -> None:
    for degree, parameters in ((0, 14), (1, 23), (3, 59)):
        expected = int(3 * 30 * 48 * 64 / (SETTINGS.values_for_one * parameters))
        assert supported_gaussians(photos(30), degree, FREE) == expected


def test_what_is_masked_or_empty_says_nothing() -> None:
    half = np.zeros((48, 64), bool)
    half[:, :32] = True
    whole = supported_gaussians(photos(30), 1, FREE)
    assert supported_gaussians(photos(30, mask=half), 1, FREE) == pytest.approx(whole / 2, abs=1)
    alpha = np.where(half, 255, 0).astype(np.uint8)
    transparent = [replace(v, background=Background((1.0, 1.0, 1.0), None)) for v in photos(30, alpha=alpha)]
    assert supported_gaussians(transparent, 1, FREE) == pytest.approx(whole / 2, abs=1)


def test_small_budgets_are_not_questioned() -> None:
    assert supported_gaussians(photos(2), 3) == SETTINGS.unquestioned


def test_some_photos_speak_for_all() -> None:
    assert supported_gaussians(photos(6), 1, FREE, photos=30) == supported_gaussians(photos(30), 1, FREE)
