"""What a training begins with where cameras have points: surfaces around them, looked for once, and timed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.formats.colmap import CONFIDENCE, write_model
from dgs.core.imaging.medium import Medium
from dgs.core.photos.write import write_png
from dgs.core.pipeline.reconstruct import reconstruct
from dgs.core.pipeline.surface import with_samples
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from dgs.core.surface.stack import stack_views
from dgs.core.views import SparsePoints
from dgs.tests.core.surface.scenes import arc, drawn


class _Heard(Silent):
    def __init__(self) -> None:
        self.stages: list[str] = []

    def stage(self, name: str, total: int | None = None) -> None:
        self.stages.append(name)


@pytest.fixture(scope="module")
def scene():
    """A drawn scene whose cameras have true points."""
    found = drawn(arc(6), (96, 72))
    views = stack_views(found.photos, found.cameras, Medium())
    x, y = (plane.ravel() for plane in np.meshgrid(np.arange(4, 96, 11), np.arange(4, 72, 11)))
    lifted = views.lifted(2, np.stack([x, y], axis=1) + 0.5, found.depths[2][y, x])
    points = SparsePoints(lifted, np.full((len(lifted), 3), 99, np.uint8))
    return replace(found, cameras=replace(found.cameras, points=points))


def settings(scene, folder: Path, **changes) -> ReconstructSettings:
    photos = folder / "photos"
    if not photos.is_dir():
        photos.mkdir()
        for photo in scene.photos:
            write_png(photos / photo.name, photo.pixels)
        write_model(folder / "model", scene.cameras.cameras(), scene.cameras.points)
    asked = ReconstructSettings(
        photos, folder / "twin", cameras=folder / "model", preset="draft", max_gaussians=900, holdout_every=3, threads=1
    )
    return replace(asked, **changes)


def test_points_stay_and_samples_come_beside_them(scene):
    found = with_samples(scene.cameras, scene.photos, Medium(), Silent())
    assert found.confidence is None and found.samples is not None and found.samples.confidence is not None
    np.testing.assert_array_equal(found.positions, scene.cameras.points.positions)
    assert len(found.samples.positions) > 10 * len(found.positions)
    blank = drawn(arc(4), (48, 36), 50.0, ball=False, plain=True)
    cameras = replace(blank.cameras, points=scene.cameras.points)
    assert with_samples(cameras, blank.photos, Medium(), Silent()) is cameras.points


def test_a_run_looks_for_surfaces_once_and_says_how_long(scene, tmp_path: Path):
    heard = _Heard()
    report = reconstruct(settings(scene, tmp_path).split(), heard).report
    assert "surface" in heard.stages and heard.stages.index("surface") < heard.stages.index("train")
    assert report["seconds"]["surface"] > 0 and report["heldout"]["degraded"]["psnr"] > 14
    assert report["cameras"]["points"] == len(scene.cameras.points.positions)
    assert not (tmp_path / "twin" / "cameras" / CONFIDENCE).exists(), "the cameras keep their own points"
    # A training that goes on has its Gaussians.
    again = _Heard()
    resumed = reconstruct(settings(scene, tmp_path, resume=True).split(), again).report
    assert "surface" not in again.stages and resumed["seconds"]["surface"] is None
    assert resumed["steps"] == report["steps"]
