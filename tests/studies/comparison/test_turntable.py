"""The movies' camera path: smooth, closed, no further than the photos; and the files."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.sfm.given import load_cameras
from dgs.studies.comparison import turntable
from PIL import Image


def looking(place, target=(0.0, 0.0, 0.0)):
    forward = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ np.asarray(place)


class Cameras:
    """As much of a `Reconstruction` as a path needs."""

    def __init__(self, places):
        from dgs.core.pose import Pose
        from dgs.core.views import SparsePoints

        self.poses = {f"{i}.png": Pose(*looking(place)) for i, place in enumerate(places)}
        points = np.random.default_rng(0).normal(0, 0.3, (200, 3)) + [0.0, 0.2, 0.0]
        self.points = SparsePoints(points, np.zeros((200, 3), np.uint8))


def places(path):
    return np.array([pose.centre for pose in path.poses])


def test_a_rail_is_swung_to_and_fro_along_itself():
    rail = [(x, -0.5, -1.0) for x in np.linspace(-0.4, 0.4, 25)]
    path = turntable.camera_path(Cameras(rail), 40)
    seen = places(path)
    assert path.degrees == pytest.approx(2 * np.degrees(np.arctan(0.4 / np.hypot(0.5, 1.0))), rel=0.06)
    assert np.abs(seen[:, 1:] - [-0.5, -1.0]).max() < 0.02  # on the rail's own line
    assert np.abs(seen[:, 0]).max() < 0.41
    steps = np.linalg.norm(np.diff(np.vstack([seen, seen[:1]]), axis=0), axis=1)
    assert steps.max() < 2 * np.pi / 40 * 0.42  # no jump, where it closes either
    for pose in path.poses:  # all look at what the cameras look at
        sight = pose.rotation @ np.zeros(3) + pose.translation
        assert np.abs(sight[:2] / sight[2]).max() < 0.01


def test_cameras_all_around_give_a_full_turn_at_their_height():
    angles = np.arange(16) * 2 * np.pi / 16
    path = turntable.camera_path(Cameras([(np.sin(a), -0.6, np.cos(a)) for a in angles]), 24)
    seen = places(path)
    assert path.degrees == 360.0
    assert np.allclose(seen[:, 1], -0.6, atol=0.02) and np.allclose(np.hypot(seen[:, 0], seen[:, 2]), 1, atol=0.02)
    turned = np.unwrap(np.arctan2(seen[:, 0], seen[:, 2]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi * 23 / 24, abs=1e-3)


def test_parallel_axes_still_have_something_to_look_at():
    cameras = Cameras([(0.0, 0.0, -1.0)])
    pose = cameras.poses["0.png"]
    centres = [np.array([x, y, -1.0]) for x in (-0.2, 0, 0.2) for y in (0, 0.1)]
    moved = [type(pose)(pose.rotation, -pose.rotation @ centre) for centre in centres]
    cameras.poses = {str(i): one for i, one in enumerate(moved)}
    seen = places(turntable.camera_path(cameras, 12))
    assert np.isfinite(seen).all() and np.abs(seen[:, 2] + 1).max() < 0.1


def test_movies_are_what_was_drawn(tmp_path):
    generator = np.random.default_rng(1)
    frames = [Image.fromarray(np.full((41, 61, 3), 40 + 20 * i, np.uint8)) for i in range(6)]
    turntable.write_gif(tmp_path / "a.gif", frames)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 6 and gif.size == (61, 41)
        gif.seek(3)
        assert np.abs(np.asarray(gif.convert("RGB")).astype(int) - 100).max() < 6
    av = pytest.importorskip("av")
    assert turntable.write_mp4(tmp_path / "a.mp4", frames, turns=2)
    with av.open(str(tmp_path / "a.mp4")) as film:
        shown = [np.asarray(frame.to_image()) for frame in film.decode(video=0)]
        assert film.streams.video[0].codec_context.name == "h264"
    assert len(shown) == 12 and shown[0].shape == (40, 60, 3)
    assert np.abs(shown[9].astype(int) - 100).max() < 8
    noise = [Image.fromarray(generator.integers(0, 255, (200, 300, 3)).astype(np.uint8)) for _ in range(4)]
    turntable.write_gif(tmp_path / "b.gif", noise, most=60_000)
    assert (tmp_path / "b.gif").stat().st_size < 60_000


def test_a_twin_is_rendered_as_the_trainer_saw_it(rendered_set, tmp_path):
    """A twin of the wall's own colours shows the wall from the path's middle."""
    from dgs.core.cloud import GaussianCloud
    from dgs.core.formats.ply import write_ply
    from dgs.core.photos.load import load_photos
    from dgs.core.progress import Silent
    from dgs.tests.studies.conftest import wall

    photos = load_photos(rendered_set / "sharp", None, Silent())
    cameras = load_cameras(rendered_set / "cameras", photos)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.9, 1.9, 120), np.linspace(-1.9, 1.9, 120)))
    colours = wall()[((y + 2) * 100).astype(int), ((x + 2) * 100).astype(int)]
    count = len(x)
    cloud = GaussianCloud(
        np.stack([x, y, 0 * x], -1).astype(np.float32),
        np.full((count, 3), np.log(0.02), np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        np.full(count, 3.0, np.float32),
        ((colours[:, None, :] - 0.5) / 0.28209479).astype(np.float32),
    )
    write_ply(tmp_path / "twin.ply", cloud)
    path = turntable.camera_path(cameras, 8)
    drawn = turntable.frames_of(turntable.ShownTwin("twin", tmp_path / "twin.ply", (0.5, 0.5, 0.5)), cameras, path)
    assert len(drawn) == 8 and drawn[0].size == (96, 80)
    assert np.array_equal(np.asarray(drawn[1]), np.asarray(drawn[3]))  # to and fro
    middle = np.asarray(drawn[0]).astype(float)[30:50]
    red = middle[..., 0] - middle[..., 1]
    assert red[:, 46:50].mean() > 100 > 60 > red[:, 10:30].mean()  # the line in the middle of the wall
