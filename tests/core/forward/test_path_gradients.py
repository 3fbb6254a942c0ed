"""A path's gradient in float64: from its coefficients through the frames to the light that the sensor collects."""

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.forward.collecting import collected
from dgs.core.imaging.formation.path_poses import middles, poses_on
from dgs.core.imaging.formation.row_windows import row_weights
from dgs.core.rasterizer import RasterSettings, render_path
from dgs.tests.core.rasterizer.rasterizer_scenes import make_camera, random_scene


def test_every_coefficient_of_a_path() -> None:
    camera: Camera = make_camera(19, 13, 20.0)
    scene = random_scene(4, 1, seed=1, dtype=torch.float64, size=-1.5)
    scene.means[:, :2] *= 0.4
    twists = torch.from_numpy(0.03 * np.random.default_rng(0).standard_normal((5, 6))).requires_grad_()
    settings = RasterSettings(alpha_minimum=0.0)

    def photo(path: torch.Tensor) -> torch.Tensor:
        poses = poses_on(path, camera, middles(4).double())
        frames = render_path(scene, camera, poses, settings=settings, backend="reference").images
        flat = linear_to_srgb(srgb_to_linear(frames + 0.2).mean(dim=0)).flatten()
        steps = torch.arange(flat.numel(), dtype=flat.dtype)
        return torch.stack([(flat * (1.7 * steps).sin()).sum(), (flat * (0.3 * steps).cos()).sum()])

    assert torch.autograd.gradcheck(photo, (twists,))


def test_every_coefficient_and_the_readout_where_the_shutter_rolls() -> None:
    """Through the rows' shares, as `core.forward.collecting` mixes frames."""
    camera: Camera = make_camera(19, 13, 20.0)
    scene = random_scene(4, 1, seed=1, dtype=torch.float64, size=-1.5)
    scene.means[:, :2] *= 0.4
    twists = torch.from_numpy(0.03 * np.random.default_rng(0).standard_normal((3, 6))).requires_grad_()
    readout = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)
    settings = RasterSettings(alpha_minimum=0.0)

    def photo(path: torch.Tensor, rolled: torch.Tensor) -> torch.Tensor:
        poses = poses_on(path, camera, middles(4).double())
        frames = render_path(scene, camera, poses, settings=settings, backend="reference").images
        flat = collected(list(frames + 0.2), row_weights(4, camera.height, rolled)[..., None], "linear").shown.flatten()
        steps = torch.arange(flat.numel(), dtype=flat.dtype)
        return torch.stack([(flat * (1.7 * steps).sin()).sum(), (flat * (0.3 * steps).cos()).sum()])

    assert torch.autograd.gradcheck(photo, (twists, readout))
