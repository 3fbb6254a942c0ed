"""Frames along a path: projected once, they are those of one render each, values and gradients."""

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render, render_path
from dgs.core.rigid_motion import moved_pose

SETTINGS = RasterSettings(low_pass=0.5)
FOCAL, WIDTH, HEIGHT = 90.0, 112, 83


def camera() -> Camera:
    return Camera("photo", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.array([0.0, 0.0, 3.0]))


def gaussians(count: int = 600, seed: int = 0) -> Gaussians:
    random = torch.Generator().manual_seed(seed)
    draw = lambda *shape: torch.randn(*shape, generator=random)  # noqa: E731
    means = draw(count, 3) * torch.tensor([1.6, 1.2, 0.5])
    scales, sh = -3.3 + 0.6 * draw(count, 3), torch.cat([0.8 * draw(count, 1, 3), 0.1 * draw(count, 3, 3)], dim=1)
    return Gaussians(means, scales, draw(count, 4), 1.0 + draw(count), sh).requires_grad_()


def poses(px: float, count: int) -> torch.Tensor:
    """A bent path of about so many px, turns about the optical axis among them."""
    times = torch.linspace(-0.5, 0.5, count)[:, None]
    way = times * torch.tensor([[0.6, -0.2, 0.3, 0.3, 0.6, 0.2]]) + (times**2) * torch.tensor([[0, 0.5, 0, 0, 0, 0.3]])
    still = torch.tensor([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3]]).expand(count, 3, 4)
    return moved_pose(way * px / FOCAL, still)


def one_by_one(twin: Gaussians, path: torch.Tensor, background: torch.Tensor) -> torch.Tensor:
    return torch.stack([render(twin, camera(), background=background, pose=p, settings=SETTINGS).image for p in path])


@pytest.mark.parametrize("px", [4.0, 12.0])
def test_they_are_those_of_one_render_each(px: float) -> None:
    """Only what changes with the direction of view is shared: shapes and colours, by a hundredth of a turn or so."""
    twin, path, behind = gaussians(), poses(px, 7), torch.tensor([0.2, 0.4, 0.6])
    found, expected = (
        render_path(twin, camera(), path, background=behind, settings=SETTINGS),
        one_by_one(twin, path, behind),
    )
    error = (found.images - expected).detach().mul(255)
    assert float(error.square().mean().sqrt()) < 0.06 * px
    mean = error.mean(dim=0)
    assert float(mean.square().mean().sqrt()) < 0.04 * px and float((mean.abs() > 4).float().mean()) < 0.01
    middle = error[3].abs()  # (rounding decides whether an alpha of 1/255 counts)
    assert float(middle.max()) < 1.1 and float(middle.mean()) < 0.001, "the middle frame is its own render"


def test_gradients_are_those_of_one_render_each() -> None:
    twin, path, behind = gaussians(), poses(8.0, 7), torch.zeros(3)
    upstream = torch.randn(7, 3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(3))
    found = {}
    for name, draw in (
        ("one by one", lambda: one_by_one(twin, path, behind)),
        ("together", lambda: render_path(twin, camera(), path, background=behind, settings=SETTINGS).images),
    ):
        (draw() * upstream).sum().backward()
        found[name] = {n: tensor.grad.clone() for n, tensor in twin.named() if tensor.grad is not None}
        for _, tensor in twin.named():
            tensor.grad = None
    for name, expected in found["one by one"].items():
        own = found["together"][name]
        alike = float((own * expected).sum() / (own.norm() * expected.norm()))
        assert alike > 0.995, (name, alike)
        assert float(own.norm() / expected.norm()) == pytest.approx(1.0, abs=0.02), name


def test_statistics_are_of_all_frames() -> None:
    twin, path = gaussians(), poses(8.0, 5)
    found = render_path(twin, camera(), path, settings=SETTINGS)
    found.images.sum().backward()
    (screen,) = found.screens
    assert screen.mean_gradient is not None and screen.mean_gradient.shape == (len(twin), 2)
    assert screen.evaluations > 0 and 0 < int((screen.radius > 0).sum()) <= len(twin)
    seen = torch.zeros(len(twin), dtype=torch.bool)
    for pose in path:
        seen |= render(twin, camera(), pose=pose, settings=SETTINGS).screen.radius > 0
    assert not bool((seen & (screen.radius == 0)).any()), "what any frame shows has gradients"


def test_what_stands_behind_the_camera_in_some_frames_only_is_in_the_others() -> None:
    twin = gaussians(40)
    with torch.no_grad():
        twin.means[:] = torch.tensor([0.0, 0.0, -2.9])
    still = torch.tensor([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3]])
    path = torch.stack([still, still, still])
    path[:, 2, 3] += torch.tensor([-0.3, 0.1, 0.3])
    found = render_path(twin, camera(), path, settings=SETTINGS).images.detach()
    assert torch.isfinite(found).all()
    assert float(found[0].abs().max()) == 0.0 and float(found[1].abs().max()) > 0.0


def test_an_empty_twin_and_a_path_beside_the_frame() -> None:
    path = poses(4.0, 3)
    empty = Gaussians(**{name: tensor.detach()[:0] for name, tensor in gaussians().named()})
    behind = torch.tensor([0.1, 0.2, 0.3])
    found = render_path(empty, camera(), path, background=behind, settings=SETTINGS).images
    assert torch.allclose(found, behind[None, :, None, None].expand_as(found))
    away = path.clone()
    away[:, 0, 3] += 1e3
    found = render_path(gaussians(), camera(), away, background=behind, settings=SETTINGS).images
    assert torch.allclose(found, behind[None, :, None, None].expand_as(found))
