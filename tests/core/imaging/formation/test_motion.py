"""The camera's path in an exposure: polynomials, poses, lengths, and worlds of another size."""

import math

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import SETTINGS, CameraMotion, straight_paths
from dgs.core.imaging.formation.path_poses import middles, polynomials
from dgs.core.pose import Pose
from scipy.spatial.transform import Rotation

CAMERA = Camera("a", 64, 48, 80.0, 80.0, 32.0, 24.0, np.eye(3), np.array([0.1, -0.2, 0.3]))


def test_polynomials_are_orthogonal_and_bound_by_one():
    times = torch.linspace(-0.5, 0.5, 20_001, dtype=torch.float64)
    found = polynomials(times, 4)
    products = found.T @ found / len(times)
    assert torch.allclose(products, torch.diag(1.0 / (2.0 * torch.arange(5, dtype=torch.float64) + 1)), atol=2e-4)
    assert float(found.abs().max()) == pytest.approx(1.0)
    assert torch.equal(polynomials(times, 0), torch.ones(len(times), 1, dtype=torch.float64))


def test_frames_lie_in_the_middle_of_equal_parts():
    assert middles(4).tolist() == pytest.approx([-0.375, -0.125, 0.125, 0.375]) and middles(1).tolist() == [0.0]


def test_a_straight_turn_moves_the_middle_of_the_photo_as_far_as_it_says():
    motion = straight_paths({"a": (6.0 / 80.0, 0.0), "b": (0.0, 3.0 / 80.0)}, 2)
    assert motion.order == 2 and motion.length("a", 80.0) == pytest.approx(6.0) and motion.length("c", 80.0) == 0.0
    far = np.array([0.0, 0.0, 50.0])
    for name, expected in (("a", (6.0, 0.0)), ("b", (0.0, 3.0))):
        still = Camera(name, 64, 48, 80.0, 80.0, 32.0, 24.0, np.eye(3), np.zeros(3))
        ends = motion.poses(name, still, torch.tensor([-0.5, 0.5])).numpy()
        seen = [(pose[:, :3] @ far + pose[:, 3]) for pose in ends]
        seen = [80.0 * point[:2] / point[2] for point in seen]
        assert seen[1] - seen[0] == pytest.approx(expected, abs=0.02)
    assert motion.poses("c", CAMERA) is None and motion.way("c", 80.0) is None


@pytest.mark.parametrize(
    ("px", "frames"), [(0.5, 1), (1.0, 3), (3.0, 4), (4.0, 5), (6.0, 5), (6.5, 6), (9.0, 7), (90.0, SETTINGS.most)]
)
def test_frames_lie_a_px_apart_until_a_path_can_be_bent_and_farther_beyond(px, frames):
    motion = straight_paths({"a": (px / 80.0, 0.0)}, 1)
    assert motion.frames("a", CAMERA) == frames
    seen = motion.poses("a", CAMERA)
    assert seen is not None and len(seen) == frames
    coarse = Camera("a", 32, 24, 40.0, 40.0, 16.0, 12.0, np.eye(3), np.zeros(3))
    halved = straight_paths({"a": (px / 160.0, 0.0)}, 1)
    assert motion.frames("a", coarse) == halved.frames("a", CAMERA)


def test_paths_follow_the_world_s_size_and_know_their_photos():
    twists = torch.randn(2, 3, 6, generator=torch.Generator().manual_seed(0))
    chain = Formation([CameraMotion(("a", "b"), twists)])
    large = chain.scaled(10.0).motion.parameters["twists"]
    assert torch.allclose(large[..., :3], 10.0 * twists[..., :3]) and torch.equal(large[..., 3:], twists[..., 3:])
    only = chain.motion.for_photos(["b", "z"])
    assert only.names == ("b",) and torch.equal(only.parameters["twists"][0], twists[1])
    assert chain.scaled(10.0).motion.length("a", 80.0) == pytest.approx(chain.motion.length("a", 80.0), rel=1e-5)
    described = chain.scaled(10.0).motion.described()
    assert described["unit"] == 10.0 and set(described["twists"]) == {"a", "b"}
    assert np.shape(described["twists"]["a"]) == (3, 6)
    assert described["twists"]["b"][2][5] == pytest.approx(float(twists[1, 2, 5]), rel=1e-4)


def test_the_mean_of_a_path_is_its_offset():
    twists = torch.zeros(1, 5, 6)
    twists[0, 1:] = 0.01 * torch.randn(4, 6, generator=torch.Generator().manual_seed(1))
    way = CameraMotion(("a",), twists).way("a", 80.0, 4001)
    assert way.mean(dim=0).tolist() == pytest.approx([0.0, 0.0], abs=1e-3) and math.isfinite(float(way.sum()))


def test_where_a_camera_was_on_average():
    motion = straight_paths({"a": (6.0 / 80.0, 0.0), "b": (0.0, 3.0 / 80.0)}, 2)
    motion.parameters["twists"][0, 0] = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])
    pose = Pose(CAMERA.rotation, CAMERA.translation)
    moved = motion.mean_pose("a", pose, 80.0)
    along = motion.poses("a", CAMERA, torch.linspace(-0.5, 0.5, 101)).double().mean(dim=0).numpy()
    assert moved.translation == pytest.approx(along[:, 3], abs=1e-3)
    assert moved.rotation == pytest.approx(along[:, :3], abs=1e-3)
    assert np.degrees(np.arccos((np.trace(moved.rotation) - 1) / 2)) == pytest.approx(math.degrees(0.05), rel=1e-4)
    assert motion.offset("a", 80.0) == pytest.approx(0.05 * 80.0) and motion.offset("b", 80.0) == 0.0
    assert motion.mean_pose("c", pose, 80.0) is pose and motion.offset("c", 80.0) is None


@pytest.mark.parametrize("px", [0.3, 2.0, 12.0])
def test_the_average_is_that_of_the_frames_which_the_photo_is_made_of(px: float):
    """Of a bent path three frames, or one, have another mean than the whole."""
    twists = torch.zeros(1, 5, 6)
    twists[0, 1, 4], twists[0, 2, 3], twists[0, 4, 3] = px / 160.0, px / 160.0, px / 320.0
    motion, pose = CameraMotion(("a",), twists), Pose(CAMERA.rotation, CAMERA.translation)
    frames = motion.poses("a", CAMERA).double().numpy()
    turned = np.mean([Rotation.from_matrix(frame[:, :3] @ pose.rotation.T).as_rotvec() for frame in frames], axis=0)
    found = Rotation.from_matrix(motion.mean_pose("a", pose, CAMERA.fx).rotation @ pose.rotation.T).as_rotvec()
    assert found == pytest.approx(turned, abs=1e-5)
    assert abs(turned[0]) * CAMERA.fx > 0.02


def test_paths_may_be_counted_from_where_cameras_were_on_average():
    twists = torch.zeros(1, 5, 6)
    twists[0, 0], twists[0, 1, 4], twists[0, 2, 3] = torch.tensor([0.02, 0.0, 0.01, 0.01, 0.03, 0.0]), 0.05, 0.02
    motion, pose = CameraMotion(("a",), twists), Pose(CAMERA.rotation, CAMERA.translation)
    there = motion.mean_pose("a", pose, CAMERA.fx)
    moved = motion.from_means({"a": CAMERA.fx})
    again = moved.mean_pose("a", there, CAMERA.fx)
    assert again.rotation == pytest.approx(there.rotation, abs=1e-6)
    before = motion.poses("a", CAMERA).numpy()
    after = moved.poses("a", CAMERA.moved(there.rotation, there.translation)).numpy()
    assert np.abs(before - after).max() < 1e-3, "to first order"
    assert motion.parameters["twists"][0, 0, 4] == pytest.approx(0.03), "the paths themselves stay as they are"
