"""Cameras moved by the loss: one step on a known twin, and what a step must not do."""

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import align_similarity
from dgs.core.imaging.operator import BlurOperator
from dgs.core.rasterizer import render
from dgs.core.twin.pose_steps import equations, solved, twisted, without_gauge, zoomed
from dgs.tests.core.training.training_scenes import HEIGHT, WIDTH, blurred_scene, camera_at


def looker(scene):
    psf = scene.medium.psf
    margin = 0 if psf is None else max(psf.radius)
    blur = BlurOperator(psf, HEIGHT, WIDTH, margin)

    def look(camera: Camera) -> torch.Tensor:
        with torch.no_grad():
            return blur.apply(render(scene.truth, camera.with_margin(margin)).image)

    return look


def apart(a: Camera, b: Camera, points) -> float:
    """Median px between the two cameras' views of the points."""
    seen = []
    for camera in (a, b):
        local = points @ camera.rotation.T + camera.translation
        seen.append(local[:, :2] / local[:, 2:] * camera.fx)
    return float(np.median(np.linalg.norm(seen[0] - seen[1], axis=1)))


@pytest.mark.parametrize("sigma", [0.0, 2.0])
def test_steps_find_the_camera_of_a_photo(sigma):
    scene = blurred_scene(2, sigma)
    view, look = scene.views[1], looker(scene)
    px = 1 / view.camera.fx
    camera = twisted(view.camera, px * np.array([3.0, -2.0, 4.0, 0.8, 1.0, -1.2]))
    points = scene.points.positions
    before = apart(camera, view.camera, points)
    for smooth in (4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0):
        photo = torch.from_numpy(view.planes())
        pull = equations(camera, photo, None, look, with_focal=False, smooth=smooth)
        (twist,), share = solved([pull], False, [np.zeros(6)])
        assert share == 0.0
        camera = twisted(camera, twist)
    assert before > 1.0
    assert apart(camera, view.camera, points) < 0.08 * before


def test_the_focal_length_is_found_with_the_poses():
    scene = blurred_scene(4, 1.5)
    scene.truth.means[:, 2] *= 6  # relief: before a plane, focal length and distance are one
    look = looker(scene)
    photos = [look(v.camera) for v in scene.views]
    cameras = [zoomed(v.camera, 0.02) for v in scene.views]
    for smooth in (2.0, 1.0, 1.0, 0.5, 0.5, 0.0, 0.0, 0.0):
        pulls = [equations(c, photo, None, look, smooth=smooth) for c, photo in zip(cameras, photos, strict=True)]
        twists, share = solved(pulls, True, [np.zeros(6)] * len(cameras))
        cameras = [zoomed(twisted(c, t), share) for c, t in zip(cameras, twists, strict=True)]
    assert cameras[0].fx == pytest.approx(scene.views[0].camera.fx, rel=0.003)


def test_masked_px_do_not_pull():
    scene = blurred_scene(2, 0.0)
    view, look = scene.views[1], looker(scene)
    photo = torch.from_numpy(view.planes()).clone()
    photo[:, :, :40] = 1.0
    valid = torch.ones(photo.shape[1:], dtype=torch.bool)
    valid[:, :45] = False
    pull = equations(view.camera, photo, valid, look, with_focal=False)
    (twist,), _ = solved([pull], False, [np.zeros(6)])
    assert float(np.abs(twist / pull.units[:6]).max()) < 0.05


def test_the_world_keeps_its_place_turn_and_size():
    before = [camera_at(x, 0.3 * x, str(x)) for x in (-0.6, -0.1, 0.4, 0.7)]
    random = np.random.default_rng(0)
    after = [twisted(c, 0.01 * random.normal(size=6)) for c in before]
    turn = twisted(camera_at(0, 0, ""), np.array([0, 0, 0, 0.1, 0.2, -0.1])).rotation
    drifted = [
        c.moved(c.rotation @ turn.T, -c.rotation @ turn.T @ (1.7 * turn @ c.centre + np.array([3.0, -1.0, 2.0])))
        for c in after
    ]
    fixed = without_gauge(before, drifted)
    named = lambda cameras: {str(i): c for i, c in enumerate(cameras)}  # noqa: E731
    left = align_similarity(named(fixed), named(before))
    assert left.scale == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(left.rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(left.translation, 0.0, atol=1e-9)
