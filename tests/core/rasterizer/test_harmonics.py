"""The sixteen real harmonics against scipy's complex ones, and against literal numbers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from dgs.core.rasterizer.harmonics import basis
from scipy.special import sph_harm_y

#: Values at the direction (0.36, 0.48, 0.8), as scipy has them too.
LITERAL = (
    0.282094791774,
    -0.234529205713,
    0.390882009522,
    -0.175896904284,
    0.188792368806,
    -0.419538597347,
    0.290160240032,
    -0.314653948011,
    -0.055064440902,
    -0.044862194229,
    0.399598125831,
    -0.482640364234,
    0.059708213214,
    -0.361980273176,
    -0.116549453367,
    0.119292652837,
)


def test_all_sixteen_are_parts_of_scipys_complex_ones():
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    expected = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            scaled = value.real if order == 0 else np.sqrt(2) * (value.imag if order < 0 else value.real)
            expected.append(scaled)
    found = basis(torch.from_numpy(directions), 16).numpy()
    assert np.abs(found - np.stack(expected, axis=1)).max() < 1e-12


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_literal_values(coefficients):
    found = basis(torch.tensor([[0.36, 0.48, 0.8]], dtype=torch.float64), coefficients)[0].tolist()
    assert found == pytest.approx(LITERAL[:coefficients], abs=1e-11)
