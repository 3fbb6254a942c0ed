"""New photos find their place against a real twin, without structure from motion."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.errors import Cancelled
from dgs.core.formats.colmap import write_lenses
from dgs.core.lens import Lens
from dgs.core.photos.load import load_photos
from dgs.core.pipeline.update import UpdateSettings, update
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.sfm.features import FEATURES, load_features, save_features
from dgs.core.twin import placing
from dgs.core.twin import register as module
from dgs.core.twin.opened import OpenedTwin, open_twin
from dgs.core.views import SparsePoints
from dgs.tests.core.sfm.test_find_cameras import FOCAL, HEIGHT, SIGMA, WIDTH, cameras, photographed, texture
from PIL import Image
from scipy.ndimage import gaussian_filter

COUNT, NEW = 9, (3, 6)
WRITE = placing.write_job


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """photos/ with a twin in out/; new/ with two photos more."""
    folder = tmp_path_factory.mktemp("register")
    for name in ("photos", "new"):
        (folder / name).mkdir()
    textures, truth = [texture(1), texture(2)], cameras(COUNT)
    lens = Lens("SIMPLE_PINHOLE", WIDTH, HEIGHT, (FOCAL, WIDTH / 2, HEIGHT / 2))
    poses = {}
    for index, (name, camera) in enumerate(truth.items()):
        grey = gaussian_filter(photographed(camera, textures), SIGMA, truncate=5)
        target = folder / ("new" if index in NEW else "photos") / name
        Image.fromarray(np.clip(grey * 255 + 0.5, 0, 255).astype(np.uint8)).convert("RGB").save(target)
        if index not in NEW:
            poses[name] = Pose(camera.rotation, camera.translation)
    on_walls = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 2))
    points = np.stack([on_walls[:, 0], on_walls[:, 1], -np.abs(on_walls[:, 0])], axis=1)
    sparse = SparsePoints(points, np.full((400, 3), 128, np.uint8))
    write_lenses(folder / "model", dict.fromkeys(poses, lens), poses, sparse)
    words = [
        "--psf",
        f"gaussian:{SIGMA}",
        "--cameras",
        str(folder / "model"),
        "--preset",
        "draft",
        "--max-gaussians",
        "5000",
        "--holdout-every",
        "0",
        "--threads",
        "2",
        "--progress",
        "none",
    ]
    assert run(["reconstruct", str(folder / "photos"), "--out", str(folder / "out"), *words]) == 0
    return folder


@pytest.fixture
def twin(made: Path) -> OpenedTwin:
    return open_twin(made / "out", Silent())


def test_new_photos_are_placed_by_the_twins_surface(
    made: Path, twin: OpenedTwin, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find_cameras", None)  # not needed
    photos = load_photos(made / "new", None, Silent(), None, minimum=1)
    found, exact = module.register(twin, photos, None, 2, Silent(), made / "out" / "sfm" / FEATURES)
    assert exact and set(found.poses) == {photo.name for photo in photos}
    truth = cameras(COUNT)
    for name, camera in found.cameras().items():
        off = np.linalg.norm(camera.centre - truth[name].centre) / 4.0 * FOCAL
        assert off < 1.0, (name, off)
    assert not list((made / "out").glob(".place-*")), "nothing is left behind"


def test_old_photos_are_looked_through_once(made: Path, twin: OpenedTwin, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = made / "out" / "sfm" / FEATURES  # (the twin's cameras were given: nothing was kept when it was made)
    photos = load_photos(made / "new", None, Silent(), None, minimum=1)
    counts = []
    monkeypatch.setattr(placing, "write_job", lambda *a: counts.append(len(a[0])) or WRITE(*a))
    kept.unlink(missing_ok=True)
    first = module.against_twin(twin, photos, 2, Silent(), kept)
    again = module.against_twin(twin, photos, 2, Silent(), kept)
    assert counts == [COUNT, len(NEW)], "the second time only the new photos"
    assert first is not None and again is not None
    for name, camera in first.cameras().items():
        assert np.linalg.norm(camera.centre - again.cameras()[name].centre) / 4.0 * FOCAL < 0.3
    kept.write_bytes(b"damaged")
    assert module.against_twin(twin, photos, 2, Silent(), kept) is not None and counts[2:] == [COUNT]


def test_features_of_another_photo_under_the_same_name_are_not_believed(
    made: Path, twin: OpenedTwin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, photos = made / "out" / "sfm" / FEATURES, load_photos(made / "new", None, Silent(), None, minimum=1)
    counts = []
    monkeypatch.setattr(placing, "write_job", lambda *a: counts.append(len(a[0])) or WRITE(*a))
    assert module.against_twin(twin, photos, 2, Silent(), kept) is not None
    held = load_features(kept)
    assert held is not None and {one.content for one in held[0].values()} >= {p.content for p in twin.photos}
    save_features(kept, {name: replace(one, content="another") for name, one in held[0].items()}, held[1])
    counts.clear()
    assert module.against_twin(twin, photos, 2, Silent(), tmp_path / "kept") is not None
    assert counts == [COUNT], "all photos are looked through again"
    again = load_features(tmp_path / "kept")
    assert again is not None and "another" not in {one.content for one in again[0].values()}


class Stopping(Silent):
    """Stops an update when the photos have their places."""

    def stage(self, name: str, total: int | None = None) -> None:
        if name == "changes":
            raise Cancelled("Stopped")


def test_an_update_that_is_cut_off_leaves_the_features_as_they_were(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    shutil.copytree(made / "out", folder)
    settings = UpdateSettings(folder, made / "new", None, 0.1, 2)

    def state() -> dict[str, bytes]:
        return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}

    shutil.rmtree(folder / "sfm", ignore_errors=True)
    before = state()
    with pytest.raises(Cancelled):
        update(settings, Stopping())
    assert state() == before, "nothing was there, and nothing is"
    (folder / ".place-killed").mkdir()
    assert update(settings, Silent())["photos"]
    held = load_features(folder / "sfm" / FEATURES)
    assert held is not None and len(held[0]) == COUNT
    assert [p.name for p in (folder / "sfm").iterdir()] == [FEATURES] and not list(folder.glob(".place-*"))
    before = state()
    extra = tmp_path / "extra"
    shutil.copytree(made / "new", extra)
    for path in extra.iterdir():
        Image.open(path).point(lambda value: max(value - 2, 0)).save(path)
    with pytest.raises(Cancelled):
        update(replace(settings, photos=extra), Stopping())
    assert state() == before, "features of photos that the twin never got are not in it"


def test_photos_of_another_size_go_the_long_way(made: Path, twin: OpenedTwin) -> None:
    photos = load_photos(made / "new", None, Silent(), None, minimum=1)
    smaller = [replace(photo, pixels=photo.pixels[:, :-2].copy()) for photo in photos]
    assert module.against_twin(twin, smaller, 2, Silent(), made / "features.npz") is None


def test_a_place_where_the_twin_shows_something_else_is_not_believed(
    made: Path, twin: OpenedTwin, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos = load_photos(made / "new", None, Silent(), None, minimum=1)
    usual = placing.talk

    def misled(*given: Any) -> Any:
        attempts, done = usual(*given)
        for pose in done["poses"].values():
            pose["translation"][0] += 0.1  # a dozen px
        return attempts, done

    monkeypatch.setattr(placing, "talk", misled)
    assert module.against_twin(twin, photos, 2, Silent(), made / "features.npz") is None


def test_a_search_that_has_begun_is_used(
    made: Path, twin: OpenedTwin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos = load_photos(made / "new", None, Silent(), None, minimum=1)
    module.against_twin(twin, photos, 2, Silent(), made / "out" / "sfm" / FEATURES)  # keeps features
    begun: list[dict[str, bool]] = []
    usual = module.Placing.begin
    monkeypatch.setattr(module.Placing, "begin", lambda *a, **k: begun.append(k) or usual(*a, **k))
    early = module.Placing.begin(twin, photos, 2, kept=True)
    assert early is not None
    assert module.against_twin(twin, photos, 2, Silent(), tmp_path / "kept", early) is not None
    assert begun == [{"kept": True}], "no second one"
