"""Photos restored around a twin, and the runs that fit new Gaussians to them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.restored import start as start_module
from dgs.core.training.restored.course import COURSE, CourseSettings
from dgs.core.training.restored.photos import RestoredPhotos, WaysOf
from dgs.core.training.restored.start import restores
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.moved_photos import truly_moved
from dgs.tests.core.training.test_training_runs import Listens
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, psnr

#: Long enough for its paths to be known.
LONG = replace(SHORT, steps=240)


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


@pytest.fixture(scope="module")
def moved(scene):
    """Paths of 7 px, and their photos."""
    return truly_moved(scene, px=7.0)


def unknown_paths(views):
    return Formation([straight_paths({view.name: (0.0, 0.0) for view in views}, 1)])


def trainer(scene, views, settings=LONG, formation=None):
    made = Trainer(
        views, [], scene.points, Medium(), settings, unknown_paths(views) if formation is None else formation
    )
    made.restore = True
    return made


def test_along_true_paths_photos_come_back_sharper_than_twin_and_photo(scene, moved):
    motion, views = moved
    run = trainer(scene, views, formation=Formation([motion]))
    rough = scene.truth.detached()
    rough.log_scales = rough.log_scales + 0.5  # a twin that is too soft
    restored = RestoredPhotos(run.scale.to_unit(rough))
    gains = []
    shaken = [i for i in range(len(views)) if i % 4 != 3]
    for view, grid in ((views[i], run.levels[-1].views[i]) for i in shaken):
        found = restored.of(run, run.levels[-1], grid).planes.numpy()
        truth = scene.sharp[view.name]
        with torch.no_grad():
            run.optimizer.gaussians = restored.twin
            still = run.model(run.levels[-1]).sharp(restored.twin, grid.camera, run.background).image.numpy()
            margin = run.levels[-1].margin
            still = still[:, margin : still.shape[1] - margin, margin : still.shape[2] - margin]
        gains.append(psnr(found, truth) - max(psnr(still, truth), psnr(grid.planes(), truth)))
    assert np.median(gains) > 1.0 and min(gains) > -0.5, gains


def test_a_photo_is_restored_once(scene, moved):
    run = trainer(scene, moved[1])
    restored, level = RestoredPhotos(run.optimizer.gaussians), run.levels[-1]
    first = restored.of(run, level, level.views[0]).planes
    with torch.no_grad():
        run.optimizer.gaussians.means += 0.1  # what becomes of the twin changes nothing any more
    assert torch.equal(first, restored.of(run, level, level.views[0]).planes)


def test_a_photo_that_stood_still_stays_as_it_is(scene, moved):
    views = moved[1]
    run = trainer(scene, views, formation=unknown_paths(views[1:]))
    level = run.levels[-1]
    restored = RestoredPhotos(run.optimizer.gaussians).of(run, level, level.views[0])
    assert np.allclose(restored.planes.numpy(), level.views[0].planes(), atol=1e-3)


def test_ways_follow_the_depth_of_a_part(scene):
    """A camera that is shifted moves what is near twice as far as what lies at twice the depth."""
    camera = scene.views[0].camera
    depth = torch.full((camera.height, camera.width), 2.0)
    depth[:, camera.width // 2 :] = 4.0
    twists = torch.zeros(3, 6)
    twists[1, 0] = 0.1
    ways = WaysOf(twists, camera, depth)
    lengths = []
    for begin, end in ((0, 40), (60, 100)):
        weights = torch.zeros(camera.height, camera.width)
        weights[:, begin:end] = 1.0
        way = ways.of_part(weights)
        lengths.append(float((way[-1] - way[0]).norm()))
    assert lengths[0] == pytest.approx(0.2 / 2 * camera.fx, rel=1e-4) and lengths[1] == pytest.approx(lengths[0] / 2)


def test_a_run_fits_new_gaussians_on_its_way_and_says_so(scene, moved):
    views, heard = moved[1], Listens()
    job = TrainingJob(views, [], scene.points, Medium(), LONG, unknown_paths(views), restore=True)
    seen: list[tuple[bool, int]] = []
    trained = train(job, heard, watch=lambda run: seen.append((run.restored_around is not None, run.optimizer.steps)))
    restored = [within for within, _ in seen]
    assert restored == [COURSE.begin <= step / LONG.steps < COURSE.end for step in range(LONG.steps)]
    begun = restored.index(True)
    assert seen[begun][1] == COURSE.photos_at_a_step, "a new optimizer"
    assert sum("restored around the twin" in note for note in heard.notes) == 1
    marked = [COURSE.begin <= row["step"] / LONG.steps < COURSE.end for row in trained.history]
    assert [row.get("restored") == 1.0 for row in trained.history] == marked and any(marked)


def test_the_twin_is_sharper_for_it(scene, moved):
    views = moved[1]
    scores = []
    for restore_photos in (False, True):
        job = TrainingJob(
            views[:-2], views[-2:], scene.points, Medium(), LONG, unknown_paths(views), restore=restore_photos
        )
        found = train(job, Silent())
        scores.append(found.history[-1]["heldout_psnr"])
    assert scores[1] > scores[0], scores


def test_a_run_that_is_resumed_while_photos_are_restored_goes_on_to_the_bit(scene, moved):
    whole, first, again = (trainer(scene, moved[1], replace(SHORT, steps=240)) for _ in range(3))
    shares = [*np.linspace(0, 0.59, 10), *np.linspace(0.6, 0.84, 8), 0.9, 0.95]
    for step, share in enumerate(shares):
        whole.advance(share)
        if step < 14:
            first.advance(share)
    restore(again, checkpoint_of(first, 0.0, []))
    assert again.restored_around is not None
    for share in shares[14:]:
        again.advance(share)
    for (name, a), (_, b) in zip(whole.optimizer.gaussians.named(), again.optimizer.gaussians.named(), strict=True):
        assert torch.equal(a, b), name
    assert again.restored_around is None and "around.means" not in checkpoint_of(again, 0.0, []).arrays


def test_only_photos_that_motion_alone_blurs_are_restored(scene, moved, monkeypatch):
    motion, views = moved
    lens = LensFocus([views[0].name], torch.tensor([0.03]), torch.tensor([0.7]))
    transparent = [replace(view, alpha=np.full(view.photo.shape[:2], 255, np.uint8)) for view in views]
    assert restores(trainer(scene, views))
    assert not restores(trainer(scene, views, formation=Formation()))
    assert not restores(trainer(scene, views, formation=Formation([motion, lens])))
    assert not restores(trainer(scene, views, formation=Formation([motion.rolling(1.0)])))
    assert not restores(trainer(scene, views, replace(LONG, until="plateau")))
    assert not restores(Trainer(scene.views, [], scene.points, scene.medium, LONG, unknown_paths(views)))
    assert not restores(trainer(scene, transparent))
    few = int(COURSE.fewest_visits * len(views) / COURSE.begin)
    assert restores(trainer(scene, views, replace(LONG, steps=few + 1)))
    assert not restores(trainer(scene, views, replace(LONG, steps=few - 1)))
    monkeypatch.setattr(start_module, "COURSE", CourseSettings(most_px=1e5))
    assert not restores(trainer(scene, views))
