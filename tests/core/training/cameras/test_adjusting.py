"""Cameras that were found wrong, adjusted by what drawn photos show beside a twin that is bent alike."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from dgs.core.evaluation.poses import align_similarity
from dgs.core.forward import sharp_view
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.cameras.adjusting import SETTINGS, Adjust, adjusted_cameras, contradicted, due
from dgs.core.training.cameras.moving import adjust_cameras
from dgs.core.training.cameras.twin_tracks import LaidBeside, Sighting, carried, observed, sighted, tracks_through
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import checkpoint_of, counts_of, restore
from dgs.core.training.origin import cameras_of, origin
from dgs.core.training.paths.camera_paths import CameraPaths
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.moved_photos import off, shaken, truly_moved
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene

DRAWN = RasterSettings(depth=True)


@pytest.fixture(scope="module")
def scene():
    return blurred_scene(sigma=0.0)


def sighting(scene, camera, photo):
    """What a photo shows beside the true scene, seen from where the camera is thought to be."""
    with torch.no_grad():
        seen = sharp_view(scene.truth, camera, DRAWN)
    return sighted(LaidBeside(camera, seen.image.numpy(), photo, seen.mean_depth.numpy()))


def beside(first, cameras, points) -> float:
    """px^2, mean, by which the first cameras see points beside where others see them."""

    def seen(camera):
        local = points @ camera.rotation.T + camera.translation
        return local[:, :2] / local[:, 2:] * camera.fx

    return float(np.mean([np.square(seen(a) - seen(b)).sum(1).mean() for a, b in zip(first, cameras, strict=True)]))


def test_adjustments_are_due_at_their_shares():
    assert due(0.0) == 0
    assert [due(at) for at in SETTINGS.shares] == list(range(1, len(SETTINGS.shares) + 1))
    assert due(1.0) == len(SETTINGS.shares)


def test_cameras_are_found_where_photos_show_the_twin_elsewhere(scene):
    random = np.random.default_rng(0)
    true = [view.camera for view in scene.views]
    wrong = [shaken(camera, random, 0.004) for camera in true]
    seen = [sighting(scene, c, scene.sharp[c.name]) for c in wrong]
    found = adjusted_cameras(seen[:-2], seen[-2:], wrong[:-2], np.random.default_rng(1))
    assert found is not None
    assert off(wrong[:-2], true[:-2]) > 0.008
    assert off(found.cameras[:-2], true[:-2]) < 0.5 * off(wrong[:-2], true[:-2])
    still = align_similarity({c.name: c for c in found.cameras[:-2]}, {c.name: c for c in true})
    for camera, before, at in zip(found.cameras[-2:], wrong[-2:], true[-2:], strict=True):
        beside = np.linalg.norm(still.camera(camera).centre - at.centre)
        assert beside < 0.7 * np.linalg.norm(before.centre - at.centre), "a held-out one is placed as well"


def test_the_world_stays_where_the_first_cameras_see_it(scene):
    """Whoever looks from them sees the surface nearer to its place than where it is laid by the cameras' centres."""
    wrong = [shaken(view.camera, np.random.default_rng(5), 0.004) for view in scene.views]
    seen = [sighting(scene, c, scene.sharp[c.name]) for c in wrong]
    found = adjusted_cameras(seen, [], wrong, np.random.default_rng(1))
    by_centres = align_similarity({c.name: c for c in found.cameras}, {c.name: c for c in wrong})
    moved = [by_centres.camera(camera) for camera in found.cameras]
    kept, laid = beside(wrong, found.cameras, found.after), beside(wrong, moved, by_centres.points(found.after))
    assert kept < 0.2 * laid


def test_held_out_photos_move_nothing_else(scene):
    wrong = [shaken(view.camera, np.random.default_rng(2), 0.004) for view in scene.views]
    seen = [sighting(scene, c, scene.sharp[c.name]) for c in wrong]
    alone = adjusted_cameras(seen[:-2], [], wrong[:-2], np.random.default_rng(1))
    beside = adjusted_cameras(seen[:-2], seen[-2:], wrong[:-2], np.random.default_rng(1))
    assert (alone.after == beside.after).all()
    assert all((a.rotation == b.rotation).all() for a, b in zip(alone.cameras, beside.cameras, strict=False))


def test_photos_that_show_nothing_move_nothing(scene):
    camera = scene.views[0].camera
    whole = np.ones((camera.height, camera.width), np.float32)
    blind = Sighting(camera, np.stack([whole, whole]), 9.0 * whole, whole)
    assert tracks_through([blind] * 4, np.random.default_rng(0)) is None
    assert adjusted_cameras([blind] * 4, [], [camera] * 4, np.random.default_rng(0)) is None
    assert adjusted_cameras([], [], [], np.random.default_rng(0)) is None


def test_a_twin_that_asks_for_too_much_moves_nothing(scene):
    wrong = [shaken(view.camera, np.random.default_rng(3), 0.004) for view in scene.views]
    seen = [sighting(scene, camera, scene.sharp[camera.name]) for camera in wrong]
    assert adjusted_cameras(seen, [], wrong, np.random.default_rng(1), replace(SETTINGS, farthest=1e-4)) is None


def test_px_that_do_not_count_show_no_points(scene):
    camera = scene.views[0].camera
    counts = np.zeros((camera.height, camera.width), bool)
    counts[:, : camera.width // 2] = True
    masked = replace(sighting(scene, camera, scene.sharp[camera.name]), counts=counts)
    found = observed(scene.points.positions, [masked])
    assert len(found) > 0
    assert found.position[:, 0].max() + camera.cx < camera.width // 2 + 1


def test_gaussians_go_along_with_the_points_near_them():
    random = np.random.default_rng(0)
    before = random.uniform(-1, 1, (400, 3))
    means = random.uniform(-1, 1, (50, 3))
    assert np.allclose(carried(means, before, before + (0.1, 0.0, -0.2)), means + (0.1, 0.0, -0.2))
    broken = carried(np.array([[np.nan, 0.0, 0.0], [0.5, 0.0, 0.0]]), before, before + 0.1)
    assert np.isnan(broken[0, 0]) and np.allclose(broken[1], (0.6, 0.1, 0.1)), "what is not finite is the guard's"
    right = before[:, :1] > 0
    found = carried(means, before, before + right * (0.5, 0.0, 0.0)) - means
    far = np.abs(means[:, 0]) > 0.6
    assert np.allclose(found[far, 0], 0.5 * (means[far, 0] > 0))


def test_a_path_that_was_placed_keeps_its_place(scene):
    """What offsets share is taken from where they were placed, and its mean is there."""
    cameras = {view.name: view.camera for view in scene.views}
    start = straight_paths({name: (4.0 / camera.fx, 0.0) for name, camera in cameras.items()}, 4)
    paths = CameraPaths(start, cameras, list(cameras), 1, 0)
    where = {name: shaken(camera, np.random.default_rng(6), 0.01) for name, camera in cameras.items()}
    for name, camera in cameras.items():
        paths.place(camera, where[name])
    for index in range(len(cameras)):
        paths._settle(index)
    for name, camera in cameras.items():
        stands = paths.stands(camera)
        assert np.abs(stands.rotation - where[name].rotation).max() < 1e-5
        assert np.abs(stands.translation - where[name].translation).max() < 1e-5
    again = CameraPaths(start, cameras, list(cameras), 1, 0)
    assert again.restore(paths.state())
    assert (again._placed == paths._placed).all()
    older = {name: values for name, values in paths.state().items() if name != "paths.placed"}
    assert CameraPaths(start, cameras, list(cameras), 1, 0).restore(older)
    broken = {**paths.state(), "paths.placed": np.zeros((2, 6), np.float32)}
    assert not CameraPaths(start, cameras, list(cameras), 1, 0).restore(broken)


@pytest.fixture(scope="module")
def taken(scene):
    """Photos of cameras that moved."""
    return truly_moved(scene)[1]


def job(scene, views, adjust: Adjust, steps: int = 120) -> TrainingJob:
    wrong = [replace(v, camera=shaken(v.camera, np.random.default_rng(i), 0.004)) for i, v in enumerate(views)]
    chain = Formation([straight_paths({v.name: (0.0, 0.0) for v in wrong}, 1)])
    settings = replace(SHORT, steps=steps, max_gaussians=1500)
    return TrainingJob(wrong[:-2], wrong[-2:], scene.points, Medium(), settings, chain, adjust=adjust)


def trainer_of(one: TrainingJob) -> Trainer:
    trainer = Trainer(one.views, one.heldout, one.points, one.medium, one.settings, one.formation)
    trainer.adjust = one.adjust
    return trainer


@pytest.fixture(scope="module")
def advanced(scene, taken):
    """What a training leaves at six tenths of its course, no camera adjusted yet: all begin alike."""
    trainer = trainer_of(job(scene, taken, "never"))
    for step in range(72):
        trainer.advance(step / 120)
    return checkpoint_of(trainer, 0.0, [])


def test_only_cameras_that_were_found_are_adjusted(scene, taken, advanced):
    trainers = []
    for adjust in ("never", "always"):
        trainer = trainer_of(job(scene, taken, adjust))
        restore(trainer, advanced)
        adjust_cameras(trainer, 0.6)
        trainers.append(trainer)
    assert [trainer.asked["adjusted"] for trainer in trainers] == [0, due(0.6)]
    still, moved = trainers
    assert not (still.learned.paths._placed != 0).any()
    assert (moved.learned.paths._placed.abs().sum(dim=1) > 0).all(), "held-out ones as well"
    assert (still.optimizer.gaussians.means != moved.optimizer.gaussians.means).any()
    before = moved.optimizer.gaussians.means.clone()
    adjust_cameras(moved, 0.6)
    assert (before == moved.optimizer.gaussians.means).all(), "once at each share"


def test_cameras_that_were_given_are_moved_where_photos_contradict_them(scene):
    """True ones and wrong ones beside the true scene: what photos show of them differs many times over."""
    true = [view.camera for view in scene.views]
    wrong = [shaken(camera, np.random.default_rng(0), 0.004) for camera in true]
    for cameras, expected in ((true, False), (wrong, True)):
        seen = [sighting(scene, c, scene.sharp[c.name]) for c in cameras]
        assert contradicted(seen, np.random.default_rng(1)) == expected
    assert not contradicted(seen[:1], np.random.default_rng(1)), "one photo contradicts nothing"


@pytest.mark.parametrize(("doubt", "moves"), [(np.inf, False), (0.0, True)])
def test_a_run_asks_once_whether_given_cameras_are_contradicted(scene, taken, advanced, doubt, moves, monkeypatch):
    asked = partial(contradicted, settings=replace(SETTINGS, doubt=doubt))
    monkeypatch.setattr("dgs.core.training.cameras.moving.contradicted", asked)
    one = job(scene, taken, "contradicted")
    trainer = trainer_of(one)
    restore(trainer, advanced)
    adjust_cameras(trainer, 0.35)
    assert trainer.cameras_moved == moves == bool((trainer.learned.paths._placed != 0).any())
    assert ("cameras adjusted" in counts_of(trainer)) == moves
    before = trainer.optimizer.gaussians.means.clone()
    again = trainer_of(one)
    restore(again, checkpoint_of(trainer, 0.0, []))
    monkeypatch.setattr("dgs.core.training.cameras.moving.contradicted", pytest.fail)
    adjust_cameras(again, 0.95)
    assert torch.equal(before, again.optimizer.gaussians.means) != moves, "what was said first holds"


def test_sets_that_would_not_fit_into_memory_stay_as_they_are(scene, taken, monkeypatch):
    trainer = trainer_of(job(scene, taken, "always"))
    monkeypatch.setattr("dgs.core.training.cameras.moving.ADJUSTING", replace(SETTINGS, most_px=100_000))
    trainer.advance(0.6)
    before = trainer.optimizer.gaussians.means.clone()
    adjust_cameras(trainer, 0.6)
    assert torch.equal(before, trainer.optimizer.gaussians.means)
    assert not (trainer.learned.paths._placed != 0).any()
    assert "cameras adjusted" not in counts_of(trainer)


def test_a_run_that_is_resumed_goes_on_to_the_bit(scene, taken):
    """With what was adjusted, and no share twice."""
    one = job(scene, taken, "always")

    def go_on(trainer: Trainer, steps: range) -> None:
        for step in steps:
            trainer.advance(step / 60)
            adjust_cameras(trainer, step / 60)

    whole, again = trainer_of(one), trainer_of(one)
    go_on(whole, range(24))
    state = checkpoint_of(whole, 0.0, [])
    assert state.counters["asked.adjusted"] == due(23 / 60) > 0
    restore(again, state)
    for trainer in (whole, again):
        go_on(trainer, range(24, 36))
    assert whole.asked["adjusted"] == again.asked["adjusted"] == due(35 / 60)
    assert torch.equal(whole.optimizer.gaussians.means, again.optimizer.gaussians.means)
    assert torch.equal(whole.learned.paths._placed, again.learned.paths._placed)


def test_a_whole_run_adjusts_the_cameras_that_it_found(scene, taken):
    trained = [train(job(scene, taken, adjust, steps=80), Silent()) for adjust in ("always", "never")]
    placed = [one.formation.motion.parameters["twists"][:, 0] for one in trained]
    assert float((placed[0] - placed[1]).abs().max()) > 1e-4


def test_a_cancelled_adjustment_is_still_due(scene, taken):
    trainer = trainer_of(job(scene, taken, "always"))
    trainer.advance(0.6)
    before = trainer.optimizer.gaussians.means.clone()
    adjust_cameras(trainer, 0.6, lambda: True)
    assert torch.equal(before, trainer.optimizer.gaussians.means)
    assert trainer.asked["adjusted"] == 0


def test_a_checkpoint_says_by_which_cameras_it_was_made(scene):
    """Those in the folder may have been adjusted since; without its own values, or with broken ones, they are taken."""
    cameras = {view.name: view.camera for view in scene.views[:3]}
    kept = origin(scene.views[:3], [], scene.points)
    later = {name: shaken(camera, np.random.default_rng(0)) for name, camera in cameras.items()}
    for found, camera in zip(cameras_of(kept, later), cameras.values(), strict=True):
        assert found.rotation == pytest.approx(camera.rotation)
        assert found.translation == pytest.approx(camera.translation)
    first = next(iter(later))
    for values in ("?", [1.0, 2.0], [np.nan] * 19):
        assert cameras_of({"cameras": {first: values}}, later) == list(later.values())
    assert cameras_of({}, later) == list(later.values())
