"""New photos against a twin whose view can be written down: changes, cameras, exposures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.errors import CameraError, Cancelled, FormatError
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.lens import Lens
from dgs.core.photos.load import Photo
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Figures, Reconstruction
from dgs.core.training.scale import SceneScale
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin import refine_cameras as refining
from dgs.core.twin import register as registering
from dgs.core.twin.changes import find_changes
from dgs.core.twin.exposures import learned_exposure, without_exposure
from dgs.core.twin.new_exposures import exposure_with
from dgs.core.twin.opened import OpenedTwin
from dgs.core.views import SparsePoints, View
from scipy.spatial.transform import Rotation

from .test_changes import wall

SIDE, FOCAL = 64, 64.0
GREY = 0.5  # of a Gaussian without harmonics, sRGB


def camera(name: str, x: float = 0.0) -> Camera:
    return Camera(name, SIDE, SIDE, FOCAL, FOCAL, SIDE / 2, SIDE / 2, np.eye(3), np.array([-x, 0.0, 0.0]))


def photo_of(name: str, planes: np.ndarray, **more: Any) -> View:
    """A view whose photo is [3, H, W] sRGB, in 16 bits."""
    pixels = np.round(planes.clip(0, 1) * 65535).astype(np.uint16).transpose(1, 2, 0)
    return View(camera(name), np.ascontiguousarray(pixels), **more)


def twin_of(views: list[View], medium: Medium = Medium(None), held: tuple[str, ...] = ()) -> OpenedTwin:
    """A closed grey wall before the cameras."""
    nothing: Any = None
    scale = SceneScale(np.zeros(3), 1.0)
    return OpenedTwin(Path("t"), nothing, [], nothing, medium, views, list(held), wall(), scale, torch.full((3,), GREY))


def shown(twin: OpenedTwin) -> np.ndarray:
    """[3, H, W] what the twin shows in the middle."""
    view = twin.on_grid([photo_of("any", np.zeros((3, SIDE, SIDE)))], 1)[0]
    with torch.no_grad():
        return twin.model().expose(twin.scale.to_unit(twin.gaussians), view, twin.background).degraded.numpy()


# --- changes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("by", "noise", "found"), [(0.2, 0.0, True), (0.02, 0.0, False), (0.2, 0.2, False)])
def test_a_px_has_changed_where_it_differs_by_enough_and_by_more_than_chance(
    by: float, noise: float, found: bool
) -> None:
    planes = shown(twin_of([photo_of("old", np.zeros((3, SIDE, SIDE)))]))
    old = photo_of("old", planes)
    new = planes + noise * np.random.default_rng(0).normal(size=planes.shape)
    new[:, 20:40, 24:44] -= by
    twin = twin_of([old])
    changes = find_changes(twin, twin.on_grid([photo_of("new", new)], 1), twin.medium)
    changed = changes.changed["new"]
    assert changed.any() == found and not changes.unseen["new"].any() and (changes.width, changes.gain) == (1.0, 0.0)
    assert changes.residuals["new"].shape == (SIDE, SIDE) and bool(changes.splats.any()) == found
    if found:
        assert changed[20:40, 24:44].mean() > 0.95 and changed.sum() < 1.7 * 20 * 20
        assert changes.residuals["new"][30, 30] == pytest.approx(-by, abs=2e-3)
        assert changes.residuals["new"][5, 5] == pytest.approx(0.0, abs=1e-4)


def test_masked_px_are_no_changes() -> None:
    planes = shown(twin_of([photo_of("old", np.zeros((3, SIDE, SIDE)))]))
    new, mask = planes.copy(), np.ones((SIDE, SIDE), bool)
    new[:, 20:40, 24:44] -= 0.3
    mask[15:45, 20:50] = False
    twin = twin_of([photo_of("old", planes)])
    changes = find_changes(twin, twin.on_grid([photo_of("new", new, mask=mask)], 1), twin.medium)
    assert not changes.changed["new"].any() and not changes.splats.any()


# --- the opened twin ---------------------------------------------------------------------------------------------


def test_what_an_opened_twin_says_of_its_grid() -> None:
    """The widest blur of any photo decides how far a render reaches; held-out photos are no part of its training."""
    views = [photo_of(name, np.zeros((3, SIDE, SIDE))) for name in "abc"]
    twin = twin_of(views, held=("b",))
    assert [view.name for view in twin.kept] == ["a", "c"] and twin.step == 1 and twin.margin(1) == 0
    narrow, wide = PointSpread("gaussian", 1.0, 2.0), PointSpread("gaussian", 1.0, 4.0)
    once, other = twin_of(views, Medium(narrow)), twin_of(views, Medium(narrow, per_view={"a": wide, "b": None}))
    assert once.margin(1) > 0 and other.margin(1) == 2 * once.margin(1) and other.margin(2) == once.margin(1)


# --- exposures ---------------------------------------------------------------------------------------------------


def test_a_photos_gain_is_the_median_ratio_to_what_the_twin_shows() -> None:
    planes = shown(twin_of([photo_of("old", np.zeros((3, SIDE, SIDE)))]))
    gains = np.array([1.3, 1.1, 0.8])
    filed = np.asarray(linear_to_srgb(srgb_to_linear(planes) * gains[:, None, None]))
    third = filed.copy()
    third[:, : SIDE // 3] = 0.6  # the lesser part is something else
    twin = twin_of([photo_of("old", planes)])
    known = Exposure(["old"], torch.zeros(1, 3))
    mask = np.zeros((SIDE, SIDE), bool)
    mask[:10, :10] = True
    less = mask.copy()
    less[0, 0] = False
    views = [
        photo_of("a", filed),
        photo_of("b", third),
        photo_of("few", filed, mask=less),
        photo_of("enough", filed, mask=mask),
        photo_of("white", np.full_like(planes, 0.98)),
        photo_of("black", np.full_like(planes, 0.04)),
    ]
    found = exposure_with(twin, known, [twin.views[0], *views])
    assert found.names == ("old", "a", "b", "few", "enough", "white", "black")
    rows = found.parameters["log_gains"].numpy()
    for row in (1, 2, 4):
        np.testing.assert_allclose(rows[row], np.log(gains), atol=2e-3)
    assert not rows[[0, 3, 5, 6]].any()
    assert exposure_with(twin, known, [twin.views[0]]) is known


def test_exposures_are_those_that_the_report_says_are_on() -> None:
    row = {"name": "exposure", "on": True, "parameters": {"a": [1.0, 2.0, 0.5], "b": [1, 1, 1]}}
    found = learned_exposure({"effects": ["?", {"name": "haze", "on": True}, row]})
    assert found is not None and found.names == ("a", "b")
    np.testing.assert_allclose(found.parameters["log_gains"].numpy(), np.log([[1.0, 2.0, 0.5], [1, 1, 1]]), atol=1e-6)
    for report in ({}, {"effects": []}, {"effects": [{**row, "on": False}]}, {"effects": [{"name": "haze", "on": 1}]}):
        assert learned_exposure(report) is None
    for wrong in ([1.0, 2.0], [1.0, 0.0, 1.0], [1.0, "2", 1.0]):
        with pytest.raises(FormatError, match=r"report\.json"):
            learned_exposure({"effects": [{**row, "parameters": {"a": wrong}}]})


def test_a_views_exposure_is_undone_in_sixteen_bits() -> None:
    light = np.full((3, SIDE, SIDE), 0.2)
    filed = np.asarray(linear_to_srgb(2.0 * light))
    pixels = np.ascontiguousarray(np.round(filed * 255).astype(np.uint8).transpose(1, 2, 0))
    alpha = np.full((SIDE, SIDE), 100, np.uint8)
    views = [View(camera("a"), pixels, alpha=alpha), View(camera("b"), pixels)]
    assert without_exposure(views, None) == views
    undone = without_exposure(views, Exposure(["a"], torch.full((1, 3), float(np.log(2.0)))))
    assert undone[1] is views[1] and undone[0].photo.dtype == np.uint16 and undone[0].levels == 255
    encoded = float(np.asarray(linear_to_srgb(light))[0, 0, 0])
    np.testing.assert_allclose(undone[0].photo / 65535, encoded, atol=3e-3)
    assert undone[0].alpha is not None and (undone[0].alpha == 100 * 257).all()
    # What was filed at the end of the range was brighter: it ends at white, not beyond.
    brighter = without_exposure(
        [View(camera("a"), np.full_like(pixels, 255))], Exposure(["a"], torch.full((1, 3), -1.0))
    )
    assert (brighter[0].photo == 65535).all()


# --- new cameras -------------------------------------------------------------------------------------------------

LENS = Lens("SIMPLE_PINHOLE", SIDE, SIDE, (FOCAL, SIDE / 2, SIDE / 2))


def world(count: int) -> dict[str, Pose]:
    random = np.random.default_rng(0)
    return {
        f"{i:02d}": Pose(Rotation.from_rotvec(random.normal(0, 0.3, 3)).as_matrix(), random.normal(0, 1, 3))
        for i in range(count)
    }


def elsewhere(pose: Pose) -> Pose:
    """The same camera in a world three times as large, turned and moved: x' = 3 R x + t."""
    turn, shift = Rotation.from_rotvec([0.2, -0.4, 0.3]).as_matrix(), np.array([5.0, -2.0, 1.0])
    rotation = pose.rotation @ turn.T
    centre = 3.0 * turn @ (-pose.rotation.T @ pose.translation) + shift
    return Pose(rotation, -rotation @ centre)


def reconstruction(poses: dict[str, Pose], lens: Lens) -> Reconstruction:
    points = SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8))
    figures = Figures("sfm", len(poses), len(poses), FOCAL, 0.5, 5.0, 1.0)
    return Reconstruction(poses, dict.fromkeys(poses, lens), points, figures)


def photographs(names: list[str], height: int = SIDE) -> list[Photo]:
    return [Photo(name, Path(name), np.zeros((height, SIDE, 3), np.uint8)) for name in names]


def register(monkeypatch: pytest.MonkeyPatch, found: Reconstruction | None, new: list[Photo], asked: list[Any]) -> Any:
    """A search from scratch that finds `found`, for a twin of 30 photos of which one has no camera."""
    truth = world(30)
    own = reconstruction({name: pose for name, pose in truth.items() if name != "07"}, LENS)
    twin: Any = SimpleNamespace(
        photos=photographs(sorted(truth)), reconstruction=own, medium=Medium(PointSpread("gaussian", 2.0, 2.0))
    )
    monkeypatch.setattr(registering, "against_twin", lambda *given: None)
    monkeypatch.setattr(registering, "find_cameras", lambda *given: asked.append(given) or found)
    return registering.register(twin, new, None, 3, Silent(), Path("t/sfm/features.npz")), own


def test_a_search_from_scratch_comes_back_to_the_twins_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """24 old photos go along, the first and the last among them; a new photo without a place is left out."""
    truth = {**world(32), "other": world(33)["32"]}
    other = Lens("SIMPLE_PINHOLE", SIDE, SIDE, (2 * FOCAL, SIDE / 2, SIDE / 2))
    found = reconstruction({n: elsewhere(p) for n, p in truth.items() if n not in ("03", "31")}, other)
    new = [*photographs(["30", "31"]), *photographs(["other"], SIDE + 8)]
    asked: list[Any] = []
    (made, exact), own = register(monkeypatch, found, new, asked)
    given, kernel, settings, folder, _ = asked[0]
    names = [photo.name for photo in given]
    assert len(names) == 24 + 3 and names[0] == "00" and names[23] == "29" and "07" not in names
    assert names[24:] == ["30", "31", "other"] and settings.threads == 3 and folder == Path("t/sfm")
    np.testing.assert_array_equal(kernel, PointSpread("gaussian", 2.0, 2.0).kernel())
    assert not exact and set(made.poses) == {"30", "other"} and made.points is own.points
    for name, pose in made.poses.items():
        np.testing.assert_allclose(pose.rotation, truth[name].rotation, atol=1e-9)
        np.testing.assert_allclose(pose.translation, truth[name].translation, atol=1e-9)
    assert made.lenses == {"30": LENS, "other": other}, "the twin's own lens, but for photos of another size"


def test_a_place_by_the_twins_surface_is_taken_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    twin: Any = SimpleNamespace()
    monkeypatch.setattr(registering, "against_twin", lambda *given: given)
    made, exact = registering.register(twin, [], None, 2, Silent(), Path("t/features.npz"))
    assert exact and made[0] is twin  # type: ignore[index]


@pytest.mark.parametrize(("kept", "said"), [(["00", "29", "30"], "tied"), (["00", "01", "29"], "None of the new")])
def test_new_photos_that_cannot_be_tied_are_refused(
    monkeypatch: pytest.MonkeyPatch, kept: list[str], said: str
) -> None:
    """Three old photos at least, and one of the new ones."""
    truth = world(31)
    found = reconstruction({name: elsewhere(truth[name]) for name in kept}, LENS)
    with pytest.raises(CameraError, match=said):
        register(monkeypatch, found, photographs(["30"]), [])


# --- cameras by the loss -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("worse", "kept"), [(0.0, True), (3.0, False)])
def test_refined_cameras_are_judged_by_photos_and_shifts(
    monkeypatch: pytest.MonkeyPatch, worse: float, kept: bool
) -> None:
    """Every eighth photo judges; the figures are those of the two trainings, in px and 8-bit steps."""
    views = [photo_of(f"{i:02d}", np.zeros((3, SIDE, SIDE))) for i in range(17)]
    trained: list[list[str]] = []

    def agreed(given: list[View], *_: Any) -> list[View]:
        # (To and fro: what all cameras share is the world's own move, and does not count.)
        moves = [np.array([0.5 if index % 2 else -0.5, 0, 0]) for index in range(len(given))]
        pairs = zip(given, moves, strict=True)
        return [replace(v, camera=replace(v.camera.moved(np.eye(3), move), fx=80.0)) for v, move in pairs]

    def training(given: list[View], _points: Any, _medium: Any, short: TrainingSettings, stage: str, _p: Any) -> Any:
        trained.append([view.name for view in given])
        assert (short.seed, short.time_limit, short.max_gaussians) == (7, None, 900)
        return SimpleNamespace(scale=SimpleNamespace(size=2.0), after="refined" in stage)

    losses = {"00": (9.0, 8.0), "08": (9.0, 9.0), "16": (9.0, 7.0)}

    class Judging:
        def __init__(self, trainer: Any) -> None:
            self.after = trainer.after

        def judged(self, view: View) -> tuple[float, Camera]:
            step = 1 / 255.0**2
            loss = losses[view.name][self.after] + (worse if self.after else 0.0)
            return loss * step, replace(view.camera, cx=40.0 if self.after else 32.0)

    monkeypatch.setattr(refining, "_agreed", agreed)
    monkeypatch.setattr(refining, "_trained", training)
    monkeypatch.setattr(refining, "ViewAligner", Judging)
    shifts = {False: np.array([0.8, 1.0, 1.2, 1.0]), True: np.array([0.4, 0.5, 0.6, 0.5])}
    monkeypatch.setattr(refining, "disagreement", lambda trainer: shifts[trainer.after])
    points = SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8))
    settings = TrainingSettings(seed=7, time_limit=9.0, max_gaussians=900)
    found = refining.refine_cameras(views, [], points, Medium(None), settings, Silent())
    assert found.judges == ("00", "08", "16") and trained == [[f"{i:02d}" for i in range(17) if i % 8]] * 2
    assert found.loss_before == pytest.approx(9.0) and found.loss_after == pytest.approx(8.0 + worse)
    assert found.error == pytest.approx(1.0 / 3**0.5) and found.kept == kept
    assert found.focal_change == pytest.approx(0.25)
    assert found.moved_px == pytest.approx(0.5 / 2.0 * FOCAL)
    assert (found.shift_before, found.shift_after) == (1.0, 0.5) and found.shift_change == pytest.approx(np.log(0.5))
    assert found.shift_error == pytest.approx(0.0, abs=1e-12)
    assert found.tried["08"].cx == 40.0 and found.tried["01"].fx == 80.0 and len(found.tried) == 17
    assert found.cameras == (found.tried if kept else {view.name: view.camera for view in views})
    assert not {"cameras", "tried"} & found.plain().keys() and found.plain()["kept"] == kept


def test_a_short_training_goes_through_all_its_steps_and_may_be_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    shares: list[float] = []
    monkeypatch.setattr(
        refining, "Trainer", lambda *given: SimpleNamespace(advance=shares.append, given=given), raising=True
    )

    class Hears(Silent):
        said: list[Any] = []
        left = 99

        def stage(self, name: str, total: int = 0) -> None:
            self.said.append((name, total))

        def advance(self, done: int, **values: Any) -> None:
            self.said.append(done)

        def cancelled(self) -> bool:
            self.left -= 1
            return self.left < 0

    heard = Hears()
    points = SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8))
    refining._trained([], points, Medium(None), TrainingSettings(steps=25), "x", heard)
    assert shares == [k / 25 for k in range(25)] and heard.said == [("x", 25), 0, 10, 20]
    heard.left = 1
    with pytest.raises(Cancelled):
        refining._trained([], points, Medium(None), TrainingSettings(steps=25), "x", heard)
    assert len(shares) == 25 + 11
