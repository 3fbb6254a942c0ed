"""The exposure of a photo that was held out: each half is judged by what the other half shows."""

import numpy as np
import pytest
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.evaluation.halves import exposed_by_halves
from dgs.core.evaluation.metrics import psnr


@pytest.fixture
def render():
    return np.random.default_rng(0).uniform(0.1, 0.7, (3, 40, 60))


def filed(render, gains, offset=0.0):
    light = srgb_to_linear(render) * np.reshape(gains, (3, 1, 1)) + offset
    return linear_to_srgb(light).clip(0, 1)


def test_gains_and_offsets_are_taken_from_the_other_half(render):
    photo = filed(render, [1.6, 0.7, 1.2], 0.01)
    assert np.abs(exposed_by_halves(render, photo) - photo).max() < 0.01
    assert psnr(exposed_by_halves(render, photo), photo) > 45 > psnr(render, photo)


def test_no_px_is_judged_by_itself(render):
    photo = filed(render, [1.0, 1.0, 1.0])
    photo[:, :, :30] = filed(render, [2.0, 2.0, 2.0])[:, :, :30]
    exposed = exposed_by_halves(render, photo)
    # Each half has the other's exposure, which is wrong: nothing was fitted where it is scored.
    assert np.abs(exposed[:, :, 30:] - filed(render, [2.0, 2.0, 2.0])[:, :, 30:]).mean() < 0.01
    assert np.abs(exposed[:, :, :30] - render[:, :, :30]).mean() < 0.01


def test_masked_clipped_and_empty_px_say_nothing(render):
    photo = filed(render, [1.5, 1.5, 1.5])
    truth = photo.copy()
    mask, present = np.ones((40, 60), bool), np.ones((40, 60))
    photo[:, :5], mask[:5] = 0.5, False
    photo[:, 5:9] = 1.0
    photo[:, 9:12], present[9:12] = 0.3, 0.0
    exposed = exposed_by_halves(render, photo, mask, present)
    assert np.abs(exposed - truth)[:, 12:].max() < 0.01
    assert np.array_equal(exposed[:, 9:12], render[:, 9:12])
    black = np.zeros_like(render)
    assert np.array_equal(exposed_by_halves(render, black), render)
