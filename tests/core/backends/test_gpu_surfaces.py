"""Depths that effects follow, on a graphics card as by the processor's kernels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.devices import backend_named
from dgs.core.rasterizer import surface_of_centres
from dgs.tests.back_ends import brought_up, or_skip
from dgs.tests.core.rasterizer.test_frames_along_a_path import SETTINGS, camera, gaussians


@pytest.fixture
def card():
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    return card()


@pytest.mark.parametrize(("held", "count"), [(0.5, 600), (0.25, 600), (0.75, 6000), (0.5, 0)])
def test_a_surface_is_where_the_processor_finds_it(card, held, count):
    twin = gaussians(count).detached()
    expected = np.nan_to_num(surface_of_centres(twin, camera(), SETTINGS, held=held))
    found = backend_named("gpu").surface_of_centres(twin.to("gpu"), camera(), SETTINGS, held).cpu().numpy()
    assert found.shape == expected.shape
    # (rounding decides about a px whose light falls to the level exactly there)
    assert (np.abs(found - expected) < 1e-4).mean() > 0.999
    assert ((found > 0) == (expected > 0)).mean() > 0.999


def test_long_lists_are_read_to_where_every_pixel_has_its_surface(card):
    """Thousands of Gaussians before one px, more than a group of threads fetches at once, nearly transparent."""
    twin = gaussians(3000).detached()
    twin.means[:, :2] *= 0.05
    twin.opacity_logits[:] = -4.0
    expected = np.nan_to_num(surface_of_centres(twin, camera(), SETTINGS))
    found = backend_named("gpu").surface_of_centres(twin.to("gpu"), camera(), SETTINGS, 0.5).cpu().numpy()
    assert (expected > 0).any() and (np.abs(found - expected) < 1e-4).mean() > 0.999


def test_the_reference_answers_for_any_type():
    twin = gaussians().detached()
    found = backend_named("reference").surface_of_centres(twin.to(dtype=torch.float64), camera(), SETTINGS, 0.5)
    expected = np.nan_to_num(surface_of_centres(twin, camera(), replace(SETTINGS), held=0.5))
    assert found.dtype == torch.float64 and np.allclose(found.numpy(), expected)


@pytest.mark.parametrize("shape", [(7, 5), (2, 40, 30), (1, 1)])
def test_extremes_of_what_lies_on_the_card(card, shape):
    values = torch.randn(*shape, generator=torch.Generator().manual_seed(0))
    there = brought_up(values)
    card.traffic.down = 0
    lowest, highest = torch.aminmax(there)
    assert float(lowest) == float(values.min()) and float(highest) == float(values.max())
    assert card.traffic.down <= 2 * 4 * shape[-1], "no more than a row of each"
