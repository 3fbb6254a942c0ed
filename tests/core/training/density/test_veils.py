"""Veils: what stands close before a camera, where features show nothing and hardly a photo could object."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.gaussians import Gaussians
from dgs.core.training.density.asking import ask_photos
from dgs.core.training.density.veils import VEILS, nearest_depth, veils
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, moved

#: A wall of features, 10 units before cameras that look along z.
WALL = np.stack([*np.meshgrid(np.linspace(-4, 4, 12), np.linspace(-3, 3, 12)), np.full((12, 12), 10.0)], -1).reshape(
    -1, 3
)


def cameras(count: int = 20, apart: float = 0.4) -> list[Camera]:
    """Side by side, all looking at the wall."""
    places = (np.arange(count) - (count - 1) / 2) * apart
    return [
        Camera(f"{i}", 80, 60, 80.0, 80.0, 40.0, 30.0, np.eye(3), np.array([-x, 0, 0])) for i, x in enumerate(places)
    ]


def before(camera: Camera, depth: float, right: float = 0.0) -> np.ndarray:
    """A place before a camera, [1, 3]."""
    return (camera.centre + np.array([right, 0.0, depth]))[None].astype(np.float32)


def test_what_one_photo_alone_has_close_before_it_is_a_veil():
    rig = cameras()
    assert veils(before(rig[7], 0.3), rig, WALL).tolist() == [True]


def test_what_many_photos_have_in_the_frame_is_none():
    rig = cameras()
    assert veils(before(rig[7], 6.0), rig, WALL).tolist() == [False]


def test_the_wall_itself_is_none():
    rig = cameras()
    assert not veils(WALL.astype(np.float32), rig, WALL).any()


@pytest.mark.parametrize("depth, veil", [(6.9, True), (7.1, False)])
def test_how_near_is_too_near(depth, veil):
    rig = cameras(count=3, apart=40.0)  # (no two of them see the same)
    wall = np.concatenate([WALL + camera.centre for camera in rig])
    assert veils(before(rig[1], depth), rig, wall).tolist() == [veil]


def test_what_stands_behind_a_camera_is_none():
    rig = cameras(count=3, apart=40.0)
    wall = np.concatenate([WALL + camera.centre for camera in rig])
    assert veils(before(rig[1], -3.0), rig, wall).tolist() == [False]


def test_splats_reach_into_the_frame_from_beside():
    rig = cameras(count=3, apart=40.0)
    wall = np.concatenate([WALL + camera.centre for camera in rig])
    places = [before(rig[1], 1.0, right) for right in (0.55, 0.65)]  # (half a frame is 0.5, a tenth of it 0.1)
    assert [veils(place, rig, wall)[0] for place in places] == [True, False]


def test_a_few_outliers_do_not_say_what_is_nearest():
    camera = cameras(1)[0]
    outlier = before(camera, 0.1).astype(np.float64)
    assert nearest_depth(camera, np.concatenate([outlier, WALL])) == pytest.approx(10.0)


def test_too_few_points_say_nothing():
    rig = cameras()
    few = WALL[np.linspace(0, len(WALL) - 1, VEILS.points - 1).astype(int)]
    assert nearest_depth(rig[0], few) == 0.0
    assert not veils(before(rig[7], 0.3), rig, few).any()
    assert not veils(before(rig[7], 0.3), rig, np.zeros((0, 3))).any()


def test_no_gaussians_are_no_veils():
    assert veils(np.zeros((0, 3), np.float32), cameras(), WALL).shape == (0,)


def test_a_run_goes_on_without_veils_in_any_world():
    scene = moved(blurred_scene(count=12, sigma=0.0), 40.0, np.array([300.0, -200.0, 100.0]))
    camera = scene.views[4].camera
    smoke = camera.centre + 0.2 * 40.0 * camera.rotation[2]  # (the plane is 3 x 40 before it)
    start = Gaussians(
        means=torch.tensor(np.concatenate([scene.points.positions, smoke[None]]), dtype=torch.float32),
        log_scales=torch.full((301, 3), float(np.log(0.05 * 40.0))),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(301, 1),
        opacity_logits=torch.full((301,), 1.0),
        sh=torch.zeros((301, 1, 3)),
    )
    trainer = Trainer(scene.views, [], scene.points, scene.medium, replace(SHORT, sh_degree=0), start=start)
    planted = trainer.optimizer.gaussians.means.detach()[-1].clone()
    ask_photos(trainer, 1.0)
    left = trainer.optimizer.gaussians.means.detach()
    assert len(left) > 100 and not torch.isclose(left, planted, atol=1e-3).all(dim=1).any()
