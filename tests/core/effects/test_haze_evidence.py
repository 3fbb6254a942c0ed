"""What the fit of the points' colours is taken for: a medium takes contrast away with the distance, and adds light."""

from types import SimpleNamespace

import numpy as np
import pytest
from dgs.core.effects.haze import inspect
from dgs.core.inspection.haze_fit import HazeFit


def evidence(depth: float, error: float, added: float, added_error: float = 0.005):
    """Of a fit that finds such an attenuation and such a backscatter in all channels."""
    fit = HazeFit(np.full(3, depth), np.full(3, added), error, added_error)
    return inspect(SimpleNamespace(haze=fit, local_blur=None, sigma=0.0, motion=None, blurs=()))


def test_a_clearly_negative_depth_is_no_haze():
    found = evidence(-0.69, 0.1, 0.0)
    assert not found.needed and found.estimate["value"] is None and found.confidence == 0.0
    assert "as in no haze" in found.evidence


def test_a_depth_below_zero_within_its_error_is_zero():
    found = evidence(-0.05, 0.1, 0.0)
    assert not found.needed and found.estimate["value"] == 0.0 and "100 %" in found.evidence


@pytest.mark.parametrize(("depth", "needed"), [(0.5, True), (0.02, False)])
def test_what_is_there_is_called(depth, needed):
    found = evidence(depth, 0.03, 0.6 * depth)
    assert found.needed is needed and found.estimate["value"] == depth


@pytest.mark.parametrize("added", [0.0, 0.01, -0.2])
def test_contrast_that_is_lost_without_light_that_is_added_is_no_haze(added):
    found = evidence(0.5, 0.03, added)
    assert not found.needed and found.confidence > 0.9
    assert "no haze adds so little" in found.evidence


def test_light_that_is_added_beyond_doubt_only_counts():
    assert not evidence(0.5, 0.03, 0.3, 0.15).needed


def test_a_medium_takes_as_much_as_it_adds_at_least():
    found = evidence(0.05, 0.03, 0.2)
    assert found.needed and found.estimate["value"] == pytest.approx(0.2)
