"""Learned camera paths: their slope against differences of renders, what they find, and what is kept of them."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.errors import CheckpointError
from dgs.core.forward import sharp_view
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.cameras.beside import laid_beside
from dgs.core.training.following import follow_path
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.paths.camera_paths import CameraPaths, Visit
from dgs.core.training.paths.coordinates import common_to, px_units
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.moved_photos import SETTINGS, exposed_by, truly_moved, turned_upright
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


@pytest.mark.parametrize(
    ("out_of_focus", "readout", "alike", "turned"),
    [
        (False, 0.0, 0.92, False),
        (True, 0.0, 0.75, False),
        (False, 1.5, 0.92, False),
        (True, -1.5, 0.75, False),
        (False, 1.5, 0.92, True),
    ],
)
def test_the_slope_in_every_coefficient_is_that_of_the_renders(scene, out_of_focus, readout, alike, turned):
    """No view is rendered for it; differences of renders say the same wherever depth is smooth.

    Out of focus a px shows what lies beside it, which flows otherwise: frame by frame they are no more alike (0.84).
    Differences of renders hold what changes its place in the order of depth of the path's middle, too.
    """
    camera = turned_upright(scene.views[0].camera) if turned else scene.views[0].camera
    lens = [LensFocus([camera.name], torch.tensor([0.03]), torch.tensor([0.7]))] if out_of_focus else []
    start = straight_paths({camera.name: (6.0 / camera.fx, 3.0 / camera.fx)}, 4).rolling(readout)
    paths = CameraPaths(start, {camera.name: camera}, [camera.name], 1, 0)
    assert paths.motion.readout == readout
    exposed = exposed_by(scene, camera, paths.motion, *lens)
    with torch.no_grad():
        drawn = sharp_view(scene.truth, camera, replace(SETTINGS, depth=True)).mean_depth
    paths.see_depth(camera.name, drawn)
    photo = torch.zeros(3, camera.height, camera.width)
    visit = Visit(0, camera.name, camera, photo, None)
    jacobian = paths._seen(visit, paths._looked(visit, exposed)).by_path().reshape(30, -1)
    units = torch.from_numpy(px_units(camera)).float()
    twists = paths.motion.parameters["twists"]
    for part, axis in ((0, 0), (0, 4), (1, 3), (1, 5), (2, 4), (3, 1)):
        pair = []
        for sign in (1, -1):
            twists[0, part, axis] += sign * 0.25 * units[axis]
            pair.append(exposed_by(scene, camera, paths.motion, *lens).degraded)
            twists[0, part, axis] -= sign * 0.25 * units[axis]
        true = ((pair[0] - pair[1]) / 0.5)[:, 1 : camera.height - 1, 1 : camera.width - 1]
        own = jacobian[part * 6 + axis]
        assert len(own) == true.numel()
        assert float(torch.corrcoef(torch.stack([own, true.reshape(-1)]))[0, 1]) > alike, (part, axis)
        assert float((own @ true.reshape(-1)) / (own @ own)) == pytest.approx(1.0, abs=0.3), (part, axis)


def test_paths_are_found_and_the_twin_is_sharper_for_it(scene):
    motion, views = truly_moved(scene)
    fitted, held = views[:-2], views[-2:]
    settings = replace(SHORT, steps=240)
    scores = []
    for chain in (Formation(), Formation([straight_paths({v.name: (0.0, 0.0) for v in views}, 1)])):
        twin = train(TrainingJob(fitted, held, scene.points, Medium(), settings, chain), Silent())
        errors = []
        for view in held:
            with torch.no_grad():
                image = sharp_view(twin.gaussians, view.camera, RasterSettings(low_pass=twin.low_pass)).image
            errors.append(float(np.square(image.numpy() - scene.sharp[view.name]).mean()))
        scores.append(-10 * np.log10(np.mean(errors)))
    assert scores[1] > scores[0] + 0.4, scores
    found = twin.formation.motion
    assert set(found.names) == {v.name for v in views}, "held-out photos have paths of their own"
    focal = {v.name: v.camera.fx for v in views}
    moved = [n for n in motion.names if motion.length(n, focal[n]) > 1]
    still = [n for n in motion.names if motion.length(n, focal[n]) <= 1]
    assert np.median([found.length(n, focal[n]) for n in moved]) > 2.5
    assert np.median([found.length(n, focal[n]) for n in still]) < 2.0


def test_a_run_that_is_resumed_goes_on_to_the_bit(scene):
    _, views = truly_moved(scene)
    chain = Formation([straight_paths({v.name: (0.0, 0.0) for v in views}, 1)])

    def trainer():
        return Trainer(views, [], scene.points, Medium(), SHORT, chain)

    whole, first, again = trainer(), trainer(), trainer()
    for step in range(16):
        whole.advance(step / 40)
        if step < 8:
            first.advance(step / 40)
    restore(again, checkpoint_of(first, 0.0, []))
    for step in range(8, 16):
        again.advance(step / 40)
    a, b = (t.learned.paths.motion.parameters["twists"] for t in (whole, again))
    assert float(a.abs().max()) > 0 and torch.equal(a, b)
    assert torch.equal(whole.optimizer.gaussians.means, again.optimizer.gaussians.means)
    state = checkpoint_of(first, 0.0, [])
    del state.arrays["paths"]
    with pytest.raises(CheckpointError, match="camera paths"):
        restore(trainer(), state)


def test_a_photo_is_asked_beside_the_backward_pass_and_the_twin_is_the_same_to_the_bit(scene, monkeypatch):
    _, views = truly_moved(scene, px=7.0)
    start = straight_paths({view.name: (0.0, 0.0) for view in views}, 1)
    job = TrainingJob(views, [], scene.points, Medium(), replace(SHORT, steps=40, threads=2), Formation([start]))
    asked, asks = [], CameraPaths.ask
    thread = lambda *seen: asked.append(threading.current_thread().name) or asks(*seen)  # noqa: E731
    monkeypatch.setattr(CameraPaths, "ask", thread)
    beside = train(job, Silent())
    assert sum(name.startswith("dgs-beside") for name in asked) > len(asked) / 2
    asked.clear()
    monkeypatch.setattr("dgs.core.training.trainer.ask_path", lambda *seen: lambda: follow_path(*seen))
    after = train(job, Silent())
    assert {"MainThread"} == set(asked)
    for (name, one), (_, other) in zip(beside.gaussians.named(), after.gaussians.named(), strict=True):
        assert torch.equal(one, other), name
    paths = [trained.formation.motion.parameters["twists"] for trained in (beside, after)]
    assert torch.equal(*paths)


def test_offsets_of_all_photos_together_do_not_move_the_scene(scene):
    _, views = truly_moved(scene)
    trainer = Trainer(
        views, [], scene.points, Medium(), SHORT, Formation([straight_paths({v.name: (0.0, 0.0) for v in views}, 1)])
    )
    for step in range(24):
        trainer.advance(step / 40)
    offsets = trainer.learned.paths.motion.parameters["twists"][:, 0]
    assert float(offsets.abs().max()) > 0 and float(offsets.mean(dim=0).abs().max()) < 1e-6


def test_offsets_do_not_follow_the_places_of_cameras(scene):
    cameras = [view.camera for view in scene.views]
    count, random = len(cameras), np.random.default_rng(5)
    places = np.stack([camera.centre for camera in cameras])
    follows = torch.from_numpy(1.0 + places @ random.standard_normal((3, 6))).float()
    own = torch.from_numpy(random.standard_normal((count, 6))).float()
    taken = common_to(cameras, count // 4)
    assert torch.allclose(taken @ follows, follows, atol=1e-4)
    left = own - taken @ own
    assert torch.allclose(taken @ left, torch.zeros_like(left), atol=1e-5) and float(left.norm() / own.norm()) > 0.5
    mean = common_to(cameras, count // 4 + 1)  # too few photos to tell
    assert torch.allclose(mean @ own, own.mean(dim=0).expand_as(own), atol=1e-6)
    assert common_to([], 4).shape == (0, 0)


def test_a_path_in_a_wrong_direction_begins_anew(scene):
    camera = scene.views[0].camera
    true = straight_paths({camera.name: (8.0 / camera.fx, 3.0 / camera.fx)}, 4)
    photo = exposed_by(scene, camera, true).degraded
    still = exposed_by(scene, camera, straight_paths({}, 4)).degraded
    with torch.no_grad():
        depth = sharp_view(scene.truth, camera, replace(SETTINGS, depth=True)).mean_depth

    def looked_again(start):
        paths = CameraPaths(start, {camera.name: camera}, [camera.name], 1, 0)
        paths.see_depth(camera.name, depth)
        paths.look_again(camera.name, camera, photo, still, lambda: exposed_by(scene, camera, paths.motion))
        return paths.motion

    for wrong in ((-3.0, 8.0), (0.5, 0.5)):
        motion = looked_again(straight_paths({camera.name: (wrong[0] / camera.fx, wrong[1] / camera.fx)}, 4))
        way = motion.way(camera.name, camera.fx)
        found = (way[-1] - way[0]).numpy()
        found = found if found[0] > 0 else -found
        assert found == pytest.approx([8.0, 3.0], abs=1.6)
    moved = (looked_again(true).parameters["twists"] - true.parameters["twists"]).abs().max() * camera.fx
    assert float(moved) < 0.5, "a path that is right stays where it is, but for the steps of what is compared"


def test_paths_and_cameras_go_by_the_surface_and_not_by_what_shines_through(scene):
    """A fifth of the light passes to a wall ten times as far: the mean of all light lies far behind what is seen."""
    chain = Formation([straight_paths({v.name: (0.02, 0.0) for v in scene.views}, 1)])
    trainer = Trainer(scene.views, [], scene.points, Medium(), SHORT, chain)
    plane = trainer.scale.to_unit(scene.truth)
    wall = plane.detached()
    view, level = trainer.levels[-1].views[0], trainer.levels[-1]
    centre = torch.from_numpy(view.camera.centre).float()
    wall.means = centre + 10.0 * (wall.means - centre)
    wall.log_scales = wall.log_scales + math.log(15.0)
    plane.opacity_logits = plane.opacity_logits - 3.0
    both = {name: torch.cat([tensor, getattr(wall, name)]) for name, tensor in plane.named()}
    trainer.optimizer.gaussians = Gaussians(**both)
    settings = replace(trainer.raster_settings(level), depth=True)
    mean = sharp_view(trainer.optimizer.gaussians, view.camera, settings).mean_depth
    assert float(mean.median()) > 1.5
    trainer.learned.paths._visits[:] = 1
    exposed = trainer.exposed(level, view)
    follow_path(trainer, level, view, exposed, exposed.degraded, trainer.background)
    seen = trainer.learned.paths._depths[view.name].depth
    assert float(seen.median()) == pytest.approx(1.0, abs=0.1)
    beside = laid_beside(trainer, level, view).depth
    assert float(np.median(beside[beside > 0])) == pytest.approx(1.0, abs=0.1)
