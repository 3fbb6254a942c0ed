"""What the fit of the points' colours is taken for: a medium takes contrast away with the distance, and gives none."""

from types import SimpleNamespace

import numpy as np
import pytest
from dgs.core.effects.haze import inspect
from dgs.core.inspection.photometry import Photometry


def evidence(depth: float, error: float):
    """Of a fit that finds such an optical depth in all channels, with draws of that standard deviation."""
    draws = np.array([depth - error, depth + error])[:, None].repeat(3, axis=1)
    none = np.zeros((1, 3))
    fit = Photometry(
        none, np.zeros(3), np.full(3, depth), np.full(3, 0.5 * depth), none[None], none, draws, none, none, 0.05
    )
    photos = SimpleNamespace(photometry=fit, local_blur=None, sigma=0.0, motion=None, blurs=())
    return inspect(photos)


def test_a_clearly_negative_depth_is_no_haze():
    found = evidence(-0.69, 0.1)
    assert not found.needed and found.estimate["value"] is None and found.confidence == 0.0
    assert "as in no haze" in found.evidence


def test_a_depth_below_zero_within_its_error_is_zero():
    found = evidence(-0.05, 0.1)
    assert not found.needed and found.estimate["value"] == 0.0 and "100 %" in found.evidence


@pytest.mark.parametrize(("depth", "needed"), [(0.5, True), (0.02, False)])
def test_what_is_there_is_called(depth, needed):
    found = evidence(depth, 0.03)
    assert found.needed is needed and found.estimate["value"] == depth
