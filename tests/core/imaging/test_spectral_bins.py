"""Power in bins of frequency: white noise, one wave, and what belongs to no bin."""

import numpy as np
import pytest
from dgs.core.imaging.spectral_bins import SpectralBins, polar_index

EDGES = np.array([0.05, 0.15, 0.25, 0.35])
DIRECTIONS = 4


def bins(h: int, w: int) -> SpectralBins:
    return SpectralBins((h, w), polar_index(h, w, EDGES, DIRECTIONS), 3 * DIRECTIONS)


@pytest.mark.parametrize("size", [(64, 96), (61, 33)])
def test_white_noise_has_its_variance_everywhere(size):
    random = np.random.default_rng(0)
    power = np.mean([bins(*size).power_of(random.normal(scale=0.3, size=size)) for _ in range(40)], axis=0)
    assert power == pytest.approx(0.09, rel=0.15)


@pytest.mark.parametrize(("frequency", "degrees", "expected"), [(0.1, 0, 0), (0.2, 45, 5), (0.3, 90, 10)])
def test_a_wave_lies_in_its_ring_and_direction(frequency, degrees, expected):
    y, x = np.mgrid[:80, :80]
    along = x * np.cos(np.radians(degrees)) + y * np.sin(np.radians(degrees))
    power = bins(80, 80).power_of(0.5 + np.sin(2 * np.pi * frequency * along))
    assert int(np.argmax(power)) == expected


def test_what_lies_outside_of_all_rings_counts_nowhere():
    index = polar_index(40, 50, EDGES, DIRECTIONS)
    assert index[0, 0] == -1 and index.max() < 3 * DIRECTIONS
    found = bins(40, 50)
    assert found.counts.sum() == (index >= 0).sum()
    assert bins(3, 3).power_of(np.ones((3, 3))).shape == (3 * DIRECTIONS,), "bins without a coefficient are 0"
