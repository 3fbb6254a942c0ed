"""Cameras that come without points: where the points of a run come from, and what a resumed run takes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.formats.colmap import CONFIDENCE, write_model
from dgs.core.formats.transforms import write_transforms
from dgs.core.imaging.medium import Medium
from dgs.core.photos.load import Photo
from dgs.core.pipeline.cameras import CameraSearch, FoundCameras, cameras_of, given_cameras
from dgs.core.progress import Silent
from dgs.core.sfm.settings import SfmSettings
from dgs.core.twin.folder import TwinFolder
from dgs.core.views import SparsePoints
from dgs.tests.core.surface.scenes import arc, drawn

SEARCH = CameraSearch(SfmSettings(threads=1), resume=False, held=frozenset({"photo 00.png"}))


class _Notes(Silent):
    def __init__(self) -> None:
        self.notes: list[str] = []
        self.stages: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)

    def stage(self, name: str, total: int | None = None) -> None:
        self.stages.append(name)


def _run(file: Path, photos: list[Photo], search: CameraSearch, folder: TwinFolder, progress: _Notes) -> FoundCameras:
    given = FoundCameras(given_cameras(file, photos, progress), "given", file)
    return cameras_of(given, photos, Medium(), search, folder, progress)


@pytest.fixture(scope="module")
def scene():
    return drawn(arc(6), (96, 72))


def test_points_of_surfaces_are_kept_and_taken_again(scene, tmp_path: Path) -> None:
    write_transforms(tmp_path / "transforms.json", scene.cameras.cameras())
    folder, heard = TwinFolder(tmp_path / "twin"), _Notes()
    found = _run(tmp_path / "transforms.json", scene.photos, SEARCH, folder, heard)
    points = found.reconstruction.points
    assert found.source == "given" and not found.reconstruction.figures.scattered
    assert points.confidence is not None and len(points.positions) > 1000
    assert "surface" in heard.stages and found.surface_seconds > 0
    assert [note for note in heard.notes if "came without points" in note and "on surfaces" in note]
    assert (folder.camera_folder / CONFIDENCE).is_file() and list(folder.sfm_folder.glob("*")) == []
    # A run that is resumed looks at no photo again.
    again = _Notes()
    resumed = replace(SEARCH, resume=True)
    found = _run(tmp_path / "transforms.json", scene.photos, resumed, folder, again)
    assert "surface" not in again.stages and again.notes == ["The points are those of the run that is resumed"]
    np.testing.assert_array_equal(found.reconstruction.points.positions, points.positions)
    np.testing.assert_array_equal(found.reconstruction.points.confidence, points.confidence)
    assert not found.reconstruction.figures.scattered


def test_where_photos_show_nothing_random_points_are_faint(tmp_path: Path) -> None:
    blank = drawn(arc(4), (48, 36), 50.0, ball=False, plain=True)
    write_transforms(tmp_path / "transforms.json", blank.cameras.cameras())
    folder, heard = TwinFolder(tmp_path / "twin"), _Notes()
    for search in (SEARCH, replace(SEARCH, resume=True)):
        found = _run(tmp_path / "transforms.json", blank.photos, search, folder, heard).reconstruction
        assert found.figures.scattered and found.points.confidence is not None
        assert found.points.confidence.max() < 0.1 and len(found.points.positions) > 1000
    assert "random ones" in heard.notes[0]


def test_given_points_stay_as_they_are(scene, tmp_path: Path) -> None:
    given = SparsePoints(np.random.default_rng(0).normal(size=(40, 3)), np.full((40, 3), 9, np.uint8))
    write_model(tmp_path / "model", scene.cameras.cameras(), given)
    heard = _Notes()
    folder = TwinFolder(tmp_path / "twin")
    cameras = _run(tmp_path / "model", scene.photos, SEARCH, folder, heard)
    found = cameras.reconstruction
    assert cameras.surface_seconds == 0
    np.testing.assert_array_equal(found.points.positions, given.positions)
    assert found.points.confidence is None and heard.notes == [] and heard.stages == []
