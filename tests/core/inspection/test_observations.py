"""Looking points up in photos."""

from types import SimpleNamespace

import numpy as np
import pytest
from dgs.core.inspection.observations import _grey


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_grey_is_the_mean_to_the_bit(kind):
    pixels = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (90, 70, 3), kind, endpoint=True)
    found = _grey(SimpleNamespace(pixels=pixels))
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, pixels.mean(axis=2, dtype=np.float32) / np.float32(np.iinfo(kind).max))
