"""From photos and known cameras to points, in a real child process; and what is said where cameras are wrong."""

import re
from dataclasses import replace

import numpy as np
import pytest
from dgs.core.errors import Cancelled
from dgs.core.imaging.medium import Medium
from dgs.core.photos.load import Photo
from dgs.core.photos.scale import resized
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.sfm.settings import SfmSettings
from dgs.core.sfm.triangulate import triangulate
from dgs.core.surface.depths import KnownScene, found_features
from dgs.core.surface.find import SurfaceSettings, surface_points
from dgs.core.surface.hull import carved_hull
from dgs.core.surface.smaller import SmallerSettings
from dgs.core.surface.stack import stack_views
from dgs.tests.core.surface.scenes import BEHIND, RADIUS, arc, around, drawn, texture
from scipy.ndimage import shift


class _Stages(Silent):
    def __init__(self) -> None:
        self.stages: list[tuple[str, int | None]] = []

    def stage(self, name: str, total: int | None = None) -> None:
        self.stages.append((name, total))


class _Stopped(Silent):
    def cancelled(self) -> bool:
        return True


@pytest.fixture(scope="module")
def scene():
    """Large enough for features."""
    return drawn(arc(6), (240, 180), 250.0)


def _off(positions: np.ndarray) -> np.ndarray:
    """[N] distance of points from the nearer of ball and plane."""
    return np.minimum(np.abs(np.linalg.norm(positions, axis=1) - RADIUS), np.abs(positions[:, 2] - BEHIND))


def _pairs(scene):
    names = [photo.name for photo in scene.photos]
    return [(a, b) for i, a in enumerate(names) for b in names[i + 1 : i + 3]]


def test_features_at_known_poses_lie_on_the_surfaces(scene, tmp_path):
    found = triangulate(
        scene.photos, scene.cameras, _pairs(scene), None, SfmSettings(threads=1), tmp_path / "work", Silent()
    )
    assert len(found.positions) > 100 and found.on_lines > 0.7 and not found.contradicts
    assert found.reprojection_px < 1.0 and np.median(_off(found.positions)) < 0.02
    assert set(found.names) == {photo.name for photo in scene.photos}
    point, view = found.observations[0]
    camera = scene.cameras.cameras()[found.names[view]]
    p = camera.rotation @ found.positions[point] + camera.translation
    assert p[2] > 0 and 0 < p[0] / p[2] * camera.fx + camera.cx < camera.width
    assert list(tmp_path.iterdir()) == []


def test_cameras_of_other_photos_are_noticed(scene, tmp_path):
    """Each photo gets the camera of the next one."""
    names = sorted(scene.cameras.poses)
    poses = {name: scene.cameras.poses[names[(i + 2) % len(names)]] for i, name in enumerate(names)}
    turned = Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    poses = {n: Pose(turned.rotation @ p.rotation, turned.rotation @ p.translation) for n, p in poses.items()}
    wrong = replace(scene.cameras, poses=poses)
    views = stack_views(scene.photos, wrong, Medium())
    found, warning = found_features(KnownScene(scene.photos, wrong, Medium(), views, None), tmp_path, 1, Silent())
    assert found is not None and found.contradicts and "may not be those of the photos" in warning


def test_surfaces_in_front_of_a_wall(tmp_path):
    """Every point has a confidence; those that are sure lie on ball or wall, and nothing floats before the cameras."""
    scene = drawn(arc(6), (128, 96), 133.0)
    found = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, Silent())
    points = found.points
    assert found.warnings == () and "points on surfaces" in found.words
    assert len(points.positions) > 5000 and points.confidence is not None
    assert (points.confidence > 0).all() and (points.confidence <= 1).all()
    sure = points.confidence > 0.5
    assert sure.mean() > 0.3 and (_off(points.positions[sure]) < 0.06).mean() > 0.95
    assert (_off(points.positions) < 0.3).mean() > 0.95
    assert points.positions[:, 2].min() > -1.3


def test_photos_that_were_shaken_are_compared_on_smaller_views(tmp_path):
    """Each is blurred along a way of its own: half the size agrees on more, as exactly; sharp ones keep their size."""
    scene = drawn(arc(9), (320, 240), 333.0)
    sharp, way = list(scene.photos), np.random.default_rng(2)
    for at, photo in enumerate(sharp):
        turn, length = way.uniform(0, np.pi), way.uniform(12.0, 20.0)
        steps = length * np.linspace(-0.5, 0.5, 21)[:, None] * [np.sin(turn), np.cos(turn)]
        smeared = [shift(photo.pixels.astype(np.float32), (*step, 0), order=1, mode="nearest") for step in steps]
        scene.photos[at] = replace(photo, pixels=np.mean(smeared, axis=0).round().astype(np.uint8))
    off, share = [], []
    for doubtful in (0.0, 1.0):
        settings = SurfaceSettings(smaller=SmallerSettings(doubtful=doubtful))
        found = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 2, Silent(), settings)
        sure = found.points.confidence > 0.15
        off.append(np.median(_off(found.points.positions[sure])))
        share.append(float(re.findall(r"(\d+)%", found.words)[0]))
    assert share[1] > 1.4 * share[0] and off[1] < 1.3 * off[0]
    asked = (SurfaceSettings(smaller=SmallerSettings(doubtful=doubtful)) for doubtful in (0.0, 1.0))
    words = [surface_points(sharp, scene.cameras, Medium(), tmp_path, 2, Silent(), one).words for one in asked]
    assert words[0] == words[1]


def test_an_object_seen_from_around(tmp_path):
    """Transparent photos: no point where a photo shows that nothing is there."""
    scene = drawn(around(20), plane=False)
    found = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, Silent())
    radius = np.linalg.norm(found.points.positions, axis=1)
    assert len(radius) > 2000 and np.median(np.abs(radius - RADIUS)) < 0.03 and radius.max() < 1.25 * RADIUS
    # All round: every octant has its share.
    octant = (found.points.positions > 0) @ [1, 2, 4]
    assert np.bincount(octant, minlength=8).min() > 0.05 * len(radius)


def _with_hoop(scene, hoop: np.ndarray) -> list[Photo]:
    """The photos with an opaque wire of 2 px through the points [N, 3] where the ball does not hide them."""
    colours, photos = (255 * texture(hoop, 5, finest=0.3)).astype(np.uint8), []
    for photo, depth in zip(scene.photos, scene.depths, strict=True):
        pose, lens = scene.cameras.poses[photo.name], scene.cameras.lenses[photo.name]
        pixels, alpha = photo.pixels.copy(), photo.alpha.copy()
        seen = hoop @ pose.rotation.T + pose.translation
        places = (seen[:, :2] / seen[:, 2:] * lens.fx + (lens.cx, lens.cy)).astype(int)
        for index in np.argsort(-seen[:, 2]):
            column, row = places[index]
            at = np.s_[row : row + 2, column : column + 2]
            if (depth[at] > seen[index, 2]).all():
                pixels[at], alpha[at] = colours[index], 255
        photos.append(replace(photo, pixels=pixels, alpha=alpha))
    return photos


def test_wires_are_believed_within_a_hull(tmp_path):
    """They are islands of a few px: hoops of an orrery never began where they were taken for speckles."""
    scene = drawn(around(20), (96, 72), 75.0, plane=False)
    turn = np.linspace(0, 2 * np.pi, 600, endpoint=False)
    hoop = 1.3 * np.stack([np.cos(turn), 0.3 * np.sin(turn), 0.95 * np.sin(turn)], axis=1)
    photos = _with_hoop(scene, hoop)
    hull = carved_hull(stack_views(photos, scene.cameras, Medium()))
    assert hull is not None and hull.bounded
    found = surface_points(photos, scene.cameras, Medium(), tmp_path, 1, Silent()).points
    near = np.linalg.norm(found.positions[:, None] - hoop[::10], axis=2) < 0.06
    assert near[found.confidence > 0.2].any(axis=0).mean() > 0.5  # 0.63; 0.38 without speckles


def test_in_a_hurry_views_are_smaller_and_none_is_left_out(tmp_path):
    scene, heard = drawn(around(16), (192, 144), 200.0, plane=False), _Stages()
    hurried = SurfaceSettings(hurried=True, hurried_side=48)
    found = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, heard, hurried)
    assert ("surface", 16) in heard.stages and 500 < len(found.points.positions) < 8000


def test_photos_that_show_nothing_give_no_points(tmp_path):
    scene = drawn(arc(4), (48, 36), 50.0, ball=False, plain=True)
    found = surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, Silent())
    assert len(found.points.positions) == 0 and found.words == ""


def test_photos_of_several_sizes_and_without_a_camera(tmp_path):
    scene = drawn(arc(7), (96, 72))
    half = replace(scene.photos[3], pixels=resized(scene.photos[3].pixels, 48, 36))
    photos = [*scene.photos[:3], half, *scene.photos[4:]]
    lenses = dict(scene.cameras.lenses)
    lenses[half.name] = lenses[half.name].resized(48, 36)
    poses = {name: pose for name, pose in scene.cameras.poses.items() if name != photos[0].name}
    cameras = replace(scene.cameras, lenses={n: lenses[n] for n in poses}, poses=poses)
    points = surface_points(photos, cameras, Medium(), tmp_path, 1, Silent()).points
    assert points.confidence is not None
    assert (_off(points.positions[points.confidence > 0.5]) < 0.1).mean() > 0.9


def test_whoever_cancels_is_heard(tmp_path):
    scene = drawn(arc(3), (48, 36), 50.0)
    with pytest.raises(Cancelled):
        surface_points(scene.photos, scene.cameras, Medium(), tmp_path, 1, _Stopped())
