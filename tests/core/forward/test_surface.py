"""The depth that effects follow: of the surface, not of the mean of what shows through it."""

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.forward import SubFrame
from dgs.core.forward.surface import SURFACE_DEPTH, surface_depth, where_they_agree
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render

DEPTH = RasterSettings(depth=True)
CAMERA = Camera("a", 32, 24, 40.0, 40.0, 16.0, 12.0, np.eye(3), np.zeros(3))


def sheets(*layers: tuple[float, float]) -> Gaussians:
    """Wide flat splats, each at a depth with an opacity."""
    count = len(layers)
    means = torch.tensor([[0.0, 0.0, depth] for depth, _ in layers])
    flat = torch.tensor([[3.0, 3.0, -5.0]]).repeat(count, 1)
    upright = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(count, 1)
    opacity = torch.logit(torch.tensor([opacity for _, opacity in layers]))
    return Gaussians(means, flat, upright, opacity, torch.zeros(count, 1, 3))


def depths(twin: Gaussians, frame: SubFrame = SubFrame(CAMERA)):
    rendered = render(twin, frame.camera, pose=frame.pose, settings=DEPTH)
    return surface_depth(twin, frame, DEPTH, rendered), rendered


def test_what_shows_through_a_surface_does_not_move_it():
    found, rendered = depths(sheets((1.0, 0.8), (5.0, 0.99)))
    assert float((found - 1.0).abs().max()) < 1e-5
    assert float(rendered.mean_depth.min()) > 1.7
    assert surface_depth(sheets((1.0, 0.8)), SubFrame(CAMERA), DEPTH, render(sheets((1.0, 0.8)), CAMERA)) is None


def test_where_too_little_is_held_back_it_is_the_mean():
    found, rendered = depths(sheets((1.0, 0.2), (3.0, 0.2)))
    assert torch.equal(found, rendered.mean_depth) and 1.5 < float(found.mean()) < 2.5


def test_a_gradient_goes_where_mean_and_surface_are_the_same_place():
    pulled = torch.ones(24, 32)
    for back, passes in ((5.0, 0.0), (1.0 + 0.5 * SURFACE_DEPTH.agreeing, 1.0)):
        found, rendered = depths(sheets((1.0, 0.8), (back, 0.99)))
        assert float(where_they_agree(pulled, found, rendered).mean()) == passes


def test_each_frame_of_an_exposure_has_its_own():
    nearer = torch.from_numpy(np.hstack([np.eye(3), [[0.0], [0.0], [0.5]]])).float().requires_grad_()
    found, rendered = depths(sheets((1.0, 0.9)), SubFrame(CAMERA, nearer))
    assert not found.requires_grad and float(found.mean()) == pytest.approx(1.5, abs=1e-5)
    assert float(rendered.mean_depth.mean()) == pytest.approx(1.5, abs=1e-5)


def test_tensors_of_other_kinds_are_answered_in_theirs():
    twin = sheets((1.0, 0.8), (5.0, 0.99)).to(torch.float64)
    rendered = render(twin, CAMERA, settings=DEPTH, backend="reference")
    found = surface_depth(twin, SubFrame(CAMERA), DEPTH, rendered)
    assert found.dtype == rendered.mean_depth.dtype == torch.float64 and float((found - 1.0).abs().max()) < 1e-5
