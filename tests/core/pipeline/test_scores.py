"""Held-out views are rendered from where their cameras were."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.cloud import GaussianCloud
from dgs.core.forward import medium_of
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import CameraMotion
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.lens import Lens
from dgs.core.photos.load import Photo
from dgs.core.pipeline import views
from dgs.core.pipeline.scores import ViewScorer
from dgs.core.pipeline.views import Viewer
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Figures, Reconstruction
from dgs.core.training.scale import scene_scale
from dgs.core.views import SparsePoints

LENS = Lens("PINHOLE", 96, 80, (110.0, 110.0, 48.0, 40.0))
POSE = Pose(np.eye(3), np.zeros(3))


def _viewer() -> tuple[Viewer, SparsePoints]:
    random, count = np.random.default_rng(3), 300
    cloud = GaussianCloud(
        (random.uniform(-1.3, 1.3, (count, 3)) + [0, 0, 5]).astype(np.float32),
        np.log(random.uniform(0.03, 0.3, (count, 3))).astype(np.float32),
        random.normal(size=(count, 4)).astype(np.float32),
        random.uniform(-2.0, 3.0, count).astype(np.float32),
        random.normal(size=(count, 1, 3)).astype(np.float32),
    )
    points = SparsePoints(cloud.means.astype(np.float64), np.zeros(cloud.means.shape, np.uint8))
    camera = Camera("a.png", 96, 80, 110.0, 110.0, 48.0, 40.0, POSE.rotation, POSE.translation)
    return Viewer(Gaussians.from_cloud(cloud), scene_scale([camera], points), "cpu"), points


def test_a_camera_that_was_found_stands_where_its_path_was_and_a_given_one_stays():
    viewer, points = _viewer()
    twists = torch.zeros(1, 2, 6)
    twists[0, 0, 4] = 3.0 / 110.0  # it turned away by 3 px before the exposure began
    formation = Formation([CameraMotion(["a.png"], twists)])
    pixels = np.zeros((80, 96, 3), np.uint8)
    cameras = Reconstruction({"a.png": POSE}, {"a.png": LENS}, points, Figures("sfm", 1, 1, 110.0, 0.5, 20.0, 1.0))
    photo = Photo("a.png", Path("a.png"), pixels)
    shown, moved = {}, {}
    for found in (False, True):
        scorer = ViewScorer(viewer, cameras, Medium(None), None, 2.0, Silent(), formation, found)
        kept: list[np.ndarray] = []
        scores, _ = scorer.score(photo, True, kept.append)
        shown[found], moved[found] = kept[0].astype(float), scores.moved
    assert moved[False] is None and abs(moved[True] - 3.0) < 1e-5
    as_found = viewer.sharp(LENS, POSE).transpose(1, 2, 0) * 255
    there = CameraMotion(["a.png"], twists).mean_pose("a.png", POSE, 110.0)
    assert np.abs(shown[False] - np.clip(as_found, 0, 255)).max() < 0.51
    assert np.abs(shown[True] - np.clip(viewer.sharp(LENS, there).transpose(1, 2, 0) * 255, 0, 255)).max() < 0.51
    assert np.abs(shown[True] - shown[False]).mean() > 1.0


def test_photos_that_share_their_blur_share_one_medium(monkeypatch):
    made = []

    def counted(psf, *rest):
        made.append(psf)
        return medium_of(psf, *rest)

    monkeypatch.setattr(views, "medium_of", counted)
    viewer, _ = _viewer()
    shared, own = PointSpread("gaussian", 1.0, 1.0), PointSpread("gaussian", 2.0, 2.0)
    medium = Medium(shared, per_view={"own": own})
    before = viewer.degraded(LENS, POSE, medium, "a")
    with ThreadPoolExecutor(4) as pool:
        for again in pool.map(lambda name: viewer.degraded(LENS, POSE, medium, name), "abcd"):
            np.testing.assert_array_equal(again, before)
    assert made == [shared]
    assert not np.array_equal(viewer.degraded(LENS, POSE, medium, "own"), before)
    assert made == [shared, own] and viewer._kept is not None
