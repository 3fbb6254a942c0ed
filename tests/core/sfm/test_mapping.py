"""Grey photos for pycolmap, features in its database, and what verified pairs say about the motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from dgs.core.photos.load import Photo
from dgs.core.sfm import mapping
from dgs.core.sfm.features import Features, matched, read_features
from dgs.core.sfm.job import SfmJob, read_job, write_job
from dgs.core.sfm.keyframes import read_matches
from dgs.core.sfm.mapping import _matching, _turned, extract, filtered_greys, match, pair_geometry, write_images
from dgs.core.sfm.settings import FILTERED, PLAIN, SfmSettings
from dgs.core.sfm.sharpen import wiener
from PIL import Image
from scipy.ndimage import gaussian_filter

from .models import database_of, geometry_of


def noisy(seed: int, height: int = 90, width: int = 120) -> np.ndarray:
    grey = gaussian_filter(np.random.default_rng(seed).normal(size=(height, width)), 2.0)
    return np.clip(128 + grey / grey.std() * 50, 0, 255).astype(np.uint8)


def photo(name: str, grey: np.ndarray, focal: float | None = None, mask: np.ndarray | None = None) -> Photo:
    return Photo(name, Path(name), np.repeat(grey[:, :, None], 3, axis=2), mask, focal_px=focal)


def job_of(folder: Path, photos: list[Photo], kernel: np.ndarray | None = None, **settings: object) -> SfmJob:
    write_job(photos, kernel, SfmSettings(**settings), folder)
    return read_job(folder)


def test_greys_are_filtered_where_a_kernel_is_given(tmp_path: Path) -> None:
    kernel = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25])
    photos = [photo("a", noisy(0)), photo("b", noisy(1, 50, 60))]
    plain = filtered_greys(job_of(tmp_path / "p", photos), 3e-4)
    assert list(plain) == ["0/0000.png", "1/0001.png"] and plain["1/0001.png"].shape == (50, 60)
    np.testing.assert_allclose(plain["0/0000.png"], noisy(0) / 255.0, atol=1e-5)
    job = job_of(tmp_path / "k", photos, kernel)
    filtered = filtered_greys(job, 3e-4)["0/0000.png"]
    assert np.array_equal(filtered, wiener(plain["0/0000.png"], kernel, 3e-4))
    assert np.array_equal(filtered_greys(job, 0.0)["0/0000.png"], plain["0/0000.png"])


def test_images_are_written_as_grey_bytes(tmp_path: Path) -> None:
    write_images({"0/a.png": np.array([[0.0, 0.5, 1.0]], np.float32)}, tmp_path, 1)
    with Image.open(tmp_path / "0/a.png") as image:
        assert image.mode == "L" and np.array(image).tolist() == [[0, 128, 255]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[SfmJob, Path, Path]:
    """Four photos of one noise, moved by whole px, the last masked on its left half; two of them know their lens."""
    folder = tmp_path_factory.mktemp("mapping")
    noise = noisy(3, 200, 300)
    mask = np.ones((160, 220), bool)
    mask[:, :110] = False
    photos = [photo(f"{i}", noise[5 * i : 160 + 5 * i, 8 * i : 220 + 8 * i].copy()) for i in range(4)]
    photos[1], photos[2] = replace(photos[1], focal_px=300.0), replace(photos[2], focal_px=300.0)
    photos[3] = replace(photos[3], mask=mask)
    job = job_of(folder, photos)
    write_images(filtered_greys(job, 0.0), folder / "images", 2)
    database = folder / "d.db"
    extract(job, replace(PLAIN, max_features=200), database, folder / "images")
    return job, database, folder / "images"


def test_features_lie_in_the_database_by_the_job(made: tuple[SfmJob, Path, Path]) -> None:
    job, database, _ = made
    found = read_features(database)
    assert set(found) == set(job.images)
    assert all(len(one.positions) > 100 for name, one in found.items() if name != "0/0003.png")
    assert found["0/0003.png"].positions[:, 0].min() > 105 and len(found["0/0003.png"].positions) > 20
    with pycolmap.Database.open(database) as store:
        images = {image.name: image.camera_id for image in store.read_all_images()}
        cameras = {name: store.read_camera(number) for name, number in images.items()}
    assert images["0/0000.png"] == images["0/0003.png"] != images["1/0001.png"] == images["1/0002.png"]
    known, guessed = cameras["1/0001.png"], cameras["0/0000.png"]
    assert known.params[0] == 300.0 and known.has_prior_focal_length and known.model.name == "SIMPLE_RADIAL"
    assert guessed.params[0] == pytest.approx(1.2 * 220) and not guessed.has_prior_focal_length


def test_the_recipe_says_how_many_features_are_found(made: tuple[SfmJob, Path, Path], tmp_path: Path) -> None:
    job, database, images = made
    usual = sum(len(one.positions) for one in read_features(database).values())
    for index, (change, share) in enumerate(
        (({"max_features": 20}, 0.5), ({"peak_threshold": 0.06}, 0.8), ({"first_octave": 1}, 0.5))
    ):
        extract(job, replace(PLAIN, **{"max_features": 200, **change}), tmp_path / f"{index}.db", images)
        found = sum(len(one.positions) for one in read_features(tmp_path / f"{index}.db").values())
        assert 0 < found < share * usual, (change, found, usual)


def test_a_photo_of_nothing_has_no_features(tmp_path: Path) -> None:
    job = job_of(tmp_path, [photo("a", noisy(0)), photo("blank", np.full((90, 120), 90, np.uint8))])
    write_images(filtered_greys(job, 0.0), tmp_path / "images", 1)
    extract(job, PLAIN, tmp_path / "d.db", tmp_path / "images")
    found = read_features(tmp_path / "d.db")
    assert len(found["0/0000.png"].positions) > 20 and found["0/0001.png"].positions.shape == (0, 2)
    assert found["0/0001.png"].descriptors.shape == (0, 128)


def test_every_photo_may_have_a_lens_of_its_own(made: tuple[SfmJob, Path, Path], tmp_path: Path) -> None:
    job, _, images = made
    separate = replace(job, settings=replace(job.settings, one_lens=False, lens_model="PINHOLE"))
    extract(separate, replace(PLAIN, image_size=110), tmp_path / "d.db", images)
    with pycolmap.Database.open(tmp_path / "d.db") as store:
        cameras = [store.read_camera(image.camera_id) for image in store.read_all_images()]
    assert len({camera.camera_id for camera in cameras}) == 4 and {c.model.name for c in cameras} == {"PINHOLE"}
    assert sorted(tuple(c.params[:2]) for c in cameras)[-1] == (300.0, 300.0)
    smaller, usual = read_features(tmp_path / "d.db"), read_features(made[1])
    assert len(smaller["0/0000.png"].positions) < 0.7 * len(usual["0/0000.png"].positions)


def test_photos_of_one_plane_are_flat_and_matched(made: tuple[SfmJob, Path, Path]) -> None:
    job, database, _ = made
    match(job, replace(PLAIN, guided=False), database)
    geometry = pair_geometry(database)
    assert (geometry.images, geometry.verified, geometry.connected) == (4, 6, 4)
    assert geometry.flat == 1.0 and geometry.rotating > 0.0
    matches = read_matches(database)
    assert matches.names == {i + 1: name for i, name in enumerate(sorted(job.images))} and len(matches.pairs) == 6
    assert matches.cameras[1] == matches.cameras[2] != matches.cameras[3] == matches.cameras[4]
    found = matches.pairs[1, 3]
    off = matches.keypoints[1][found[:, 0]] - matches.keypoints[3][found[:, 1]]
    assert len(found) > 50 and np.median(np.abs(off - [8.0, 5.0]), axis=0).max() < 0.1


def test_many_photos_are_matched_as_chosen(made: tuple[SfmJob, Path, Path], tmp_path: Path) -> None:
    job, _, images = made
    settings = replace(job.settings, choose_pairs_from=4, partners=0)
    chosen = replace(job, folder=tmp_path, masked=False, settings=settings)
    extract(chosen, PLAIN, tmp_path / "d.db", images)
    match(chosen, PLAIN, tmp_path / "d.db")  # 5 of 6 pairs are more than 0.7 of them: all are matched
    assert not (tmp_path / "pairs.txt").exists() and pair_geometry(tmp_path / "d.db").verified == 6


def test_chosen_pairs_go_to_pycolmap(
    made: tuple[SfmJob, Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, _, images = made
    few = replace(job, folder=tmp_path, masked=False, settings=replace(job.settings, choose_pairs_from=4))
    extract(few, PLAIN, tmp_path / "d.db", images)
    monkeypatch.setattr("dgs.core.sfm.mapping.choose_pairs", lambda *_: [("0/0000.png", "1/0002.png")])
    match(few, PLAIN, tmp_path / "d.db")
    assert (tmp_path / "pairs.txt").read_text() == "0/0000.png 1/0002.png\n"
    found = read_matches(tmp_path / "d.db")
    assert [{found.names[n] for n in pair} for pair in found.pairs] == [{"0/0000.png", "1/0002.png"}]


def test_the_recipe_says_how_pairs_are_verified(tmp_path: Path) -> None:
    job = job_of(tmp_path, [photo("a", noisy(0))], threads=2)
    options, verification = _matching(job, replace(FILTERED, min_inliers=9, seed=4, trials=77))
    assert options.guided_matching and not options.use_gpu and options.num_threads == 2
    assert verification.min_num_inliers == 9
    assert (verification.ransac.random_seed, verification.ransac.max_num_trials) == (4, 77)
    assert not _matching(job, replace(FILTERED, guided=False))[0].guided_matching


# --- features ---------------------------------------------------------------------------------------------------------


def test_the_largest_features_are_kept(tmp_path: Path) -> None:
    """COLMAP writes keypoints as x, y, scale, angle, or as x, y and a 2 x 2 matrix."""
    described = np.arange(4)[:, None].repeat(128, axis=1)
    four = np.array([[1, 5, 2, 0], [2, 6, 9, 0], [3, 7, 1, 0], [4, 8, 5, 0]])
    six = np.array([[1, 5, 3, 9, 4, 0], [2, 6, 0, 0, 6, 0], [3, 7, 1, 0, 1, 0], [4, 8, 7, 0, 0, 9]])
    database_of(tmp_path / "d.db", {"four": (four, described), "six": (six, described)})
    found = read_features(tmp_path / "d.db", 3)
    assert found["four"].positions.tolist() == [[2, 6], [4, 8], [1, 5]]
    assert found["six"].positions.tolist() == [[4, 8], [2, 6], [1, 5]]
    assert found["six"].descriptors[:, 0].tolist() == [3, 1, 0] and found["six"].descriptors.dtype == np.uint8
    assert len(read_features(tmp_path / "d.db")["four"].positions) == 4


@pytest.mark.parametrize(("ratio", "count"), [(0.76, 1), (0.84, 0)])
def test_a_match_is_clearly_nearer_than_the_second_best(ratio: float, count: int) -> None:
    """Distances on the unit sphere: 2 sin(half the angle)."""

    def some(*angles: float) -> Features:
        vectors = np.zeros((len(angles) + 1, 128))
        for vector, angle in zip(vectors, angles, strict=False):
            vector[:8], vector[8:16] = 181 * np.cos(angle), 181 * np.sin(angle)  # (of length 512)
        vectors[-1, 16:24] = 181
        return Features(np.zeros((len(vectors), 2), np.float32), np.round(vectors).astype(np.uint8))

    far = 0.9
    near = 2 * np.arcsin(ratio * np.sin(far / 2))
    pairs = matched(some(0.0), some(near, far))
    assert [tuple(pair) for pair in pairs if pair[0] == 0] == [(0, 0)] * count


# --- motion -----------------------------------------------------------------------------------------------------------


def homography(angle: float, shift: tuple[float, float, float], focal: float = 400.0) -> np.ndarray:
    """Of the plane z = 1 between a camera at rest and one that is turned about y and moved."""
    lens = np.array([[focal, 0, 200.0], [0, focal, 150.0], [0, 0, 1.0]])
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return lens @ (turn + np.outer(shift, [0, 0, 1.0])) @ np.linalg.inv(lens)


CENTRES = np.array([[[200.0, 150.0]] * 2])


@pytest.mark.parametrize(
    ("angle", "shift", "turned"),
    [
        (0.1, (0.0, 0.0, 0.0), 1),
        (0.1, (0.0, 0.015, 0.0), 1),
        (0.1, (0.0, 0.03, 0.0), 0),
        (0.1, (0.0, 0.2, 0.0), 0),
        (-0.2, (0.0, 0.0, 0.0), 1),
    ],
)
def test_a_camera_that_only_turned(angle: float, shift: tuple[float, float, float], turned: int) -> None:
    for scale in (1.0, -3.0):  # a homography is known but for its scale
        matrix = scale * homography(angle, shift)
        assert _turned(matrix[None], CENTRES, 400.0) == turned


def test_photos_whose_centres_differ_may_have_turned() -> None:
    lenses = [np.array([[500.0, 0, 200.0], [0, 500.0, cy], [0, 0, 1]]) for cy in (150.0, 210.0)]
    turn = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
    matrix = lenses[1] @ turn @ np.linalg.inv(lenses[0])
    right = np.array([[[200.0, 150.0], [200.0, 210.0]]])
    assert _turned(matrix[None], right, 400.0) == 1 and _turned(matrix[None], right[:, ::-1], 400.0) == 0


def test_one_focal_length_for_all() -> None:
    """Pairs that turned with lenses of two focal lengths: one length explains the more frequent one only."""
    angles = (0.3, 0.35, 0.4)
    mixed = [homography(a, (0, 0, 0), 400.0) for a in angles] + [homography(0.5, (0, 0, 0), 1200.0)]
    assert _turned(np.array(mixed), CENTRES.repeat(4, axis=0), 400.0) == 3


@pytest.mark.parametrize(("focal", "exact"), [(160.0, True), (1600.0, True), (150.0, False), (1700.0, False)])
def test_lenses_from_four_tenths_of_a_photo_to_four_are_tried(
    focal: float, exact: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mapping, "SETTINGS", replace(mapping.SETTINGS, still=1e-9))
    assert _turned(homography(0.3, (0, 0, 0), focal)[None], CENTRES, 400.0) == exact


def test_no_homographies_say_nothing() -> None:
    assert _turned(np.zeros((0, 3, 3)), np.zeros((0, 2, 2)), 1.0) == 0
    assert _turned(np.full((1, 3, 3), np.nan), CENTRES, 400.0) == 0
    assert _turned(np.zeros((1, 3, 3)), CENTRES, 400.0) == 0


def test_shares_of_pairs(tmp_path: Path) -> None:
    features = {name: (np.ones((4, 4)), np.zeros((4, 128))) for name in "abcdef"}
    some = [(0, 1), (2, 3)]
    shift = np.array([[1, 0, -100.0], [0, 1, -70.0], [0, 0, 1]])  # to photos of 200 x 160 px
    turned, moved = (shift @ homography(*a) @ np.linalg.inv(shift) for a in ((0.3, (0, 0, 0)), (0.1, (0.5, 0, 0))))
    pairs = {
        ("a", "b"): geometry_of(some, "PANORAMIC", turned),
        ("a", "c"): geometry_of(some, "PLANAR", moved),
        ("b", "c"): geometry_of(some, "CALIBRATED"),
        ("c", "d"): geometry_of(some, "PLANAR_OR_PANORAMIC", turned),
        ("d", "e"): geometry_of(some, "UNCALIBRATED"),
        ("e", "f"): geometry_of([], "PLANAR", moved),
    }
    database_of(tmp_path / "d.db", features, pairs)
    found = pair_geometry(tmp_path / "d.db")
    assert (found.images, found.verified, found.connected) == (6, 5, 5)
    assert found.flat == pytest.approx(3 / 5) and found.rotating == pytest.approx(2 / 5)
    database_of(tmp_path / "none.db", {})
    assert pair_geometry(tmp_path / "none.db").rotating == 0.0 == pair_geometry(tmp_path / "none.db").flat
