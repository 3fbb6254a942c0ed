"""Learned glass: what a step finds, where it stays, and what is kept of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.errors import CheckpointError
from dgs.core.forward import ForwardModel, medium_of
from dgs.core.frames import Frame
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.glass import FrostedGlass, GlassScene
from dgs.core.imaging.medium import Medium
from dgs.core.pipeline.glass import stands_of
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.optics.glass import SETTINGS, LearnedGlass
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.optics.test_focus import DIAGONAL, Photo, scene, through
from dgs.tests.core.training.training_scenes import FOCAL, SHORT

assert scene  # (the fixture: a slope, depths from 2 to 4.5)
LINEAR = Medium(None, "linear")
#: Depth of the glass; its angle blurs by 2 px at a depth of 3.
DISTANCE, MIDDLE = 1.5, 3.0


def glass(distance: float, px: float = 2.0, stands=None, **more) -> FrostedGlass:
    """So wide at the middle depth."""
    spread = px / (1 - distance / MIDDLE) / DIAGONAL
    geometry = GlassScene(FOCAL / DIAGONAL, DIAGONAL, 2.0, 4.5, stands)
    return FrostedGlass(torch.tensor(spread), torch.tensor(distance), geometry, **more)


def learned(distance: float, **more) -> FrostedGlass:
    return glass(distance, learned=frozenset({"distance"}), **more)


def follow(scene, views, start, sheet, times):
    """The sheet learns from the photos of a twin that is true."""
    truth = scene.truth.detached()
    truth.means, truth.log_scales = truth.means / MIDDLE, truth.log_scales - float(np.log(MIDDLE))
    for _ in range(times):
        for view in views:
            camera = view.camera.moved(view.camera.rotation, view.camera.translation / MIDDLE)
            frame = Frame(camera.height, camera.width, 0)
            settings = RasterSettings(low_pass=0.3, depth=True)
            model = ForwardModel(settings, lambda _, f=frame: medium_of(None, f), 0, Formation([start]))
            with torch.no_grad():
                exposed = model.expose(truth, Photo(camera))
            sheet.learn(view.name, exposed, torch.from_numpy(view.planes()), None, 0.5)


@pytest.mark.parametrize("free", [{"distance"}, {"distance", "spread"}])
def test_a_true_twin_says_distance_and_width_at_once(scene, free):
    views = through(scene, glass(DISTANCE))[:4]
    start = glass(1.1, px=2.0 if len(free) == 1 else 1.6, learned=frozenset(free)).scaled(1 / MIDDLE)
    sheet = LearnedGlass(start, replace(SETTINGS, part=1.0, ahead=0.0))
    follow(scene, views, start, sheet, 6)
    assert start.distance * MIDDLE == pytest.approx(DISTANCE, rel=0.03)
    assert start.sigma(1.0, DIAGONAL) == pytest.approx(2.0, rel=0.03)


def test_a_true_twin_says_how_the_glass_leans(scene):
    """From a glass that is thought to face the camera, and stands too near."""
    tilt = torch.tensor([0.35, -0.2])
    views = through(scene, glass(DISTANCE, tilt=tilt))[:4]
    free = frozenset({"distance", "tilt"})
    start = glass(1.1, learned=free, tilt=torch.zeros(2)).scaled(1 / MIDDLE)
    sheet = LearnedGlass(start, replace(SETTINGS, part=1.0, ahead=0.0))
    follow(scene, views, start, sheet, 30)
    assert start.distance * MIDDLE == pytest.approx(DISTANCE, rel=0.04)
    assert start.tilt == pytest.approx((0.35, -0.2), abs=0.05)
    assert 0 < max(start.tilt_errors) < 0.1


def test_a_true_twin_says_where_a_glass_stands_in_the_world(scene):
    """The cameras move before it: it is nearer to some, and leans towards them otherwise."""
    tilt, stands = torch.tensor([0.3, 0.1]), stands_of(scene.views)
    views = through(scene, glass(DISTANCE, tilt=tilt, stands=stands))[:4]
    start = glass(1.1, learned=frozenset({"distance", "tilt"}), tilt=torch.zeros(2), stands=stands).scaled(1 / MIDDLE)
    sheet = LearnedGlass(start, replace(SETTINGS, part=1.0, ahead=0.0))
    follow(scene, views, start, sheet, 30)
    assert start.distance * MIDDLE == pytest.approx(DISTANCE, rel=0.04)
    assert start.tilt == pytest.approx((0.3, 0.1), abs=0.05)


def test_it_stays_before_what_is_nearest_and_before_the_camera(scene):
    start = learned(1.1).scaled(1 / MIDDLE)
    sheet = LearnedGlass(start)
    for asked, stays in ((5.0, SETTINGS.nearest * 2.0 / MIDDLE), (-1.0, 0.0)):
        sheet._set(asked, float(np.log(sheet.middle)), 0.0, 0.0, errors=np.array([0.1, 0.0, 0.0, 0.0]))
        assert start.distance == pytest.approx(stays) and np.isfinite(start.spread)


def test_a_run_that_is_resumed_goes_on_to_the_bit(scene):
    views = through(scene, glass(DISTANCE))

    def trainer():
        return Trainer(views, [], scene.points, LINEAR, SHORT, Formation([learned(0.6)]))

    whole, first, again = trainer(), trainer(), trainer()
    for step in range(20):
        whole.advance(step / 25)
        if step < 12:
            first.advance(step / 25)
    restore(again, checkpoint_of(first, 0.0, []))
    for step in range(12, 20):
        again.advance(step / 25)
    a, b = (t.learned.formation.glass for t in (whole, again))
    assert a.distance == b.distance and a.spread == b.spread and a.errors == b.errors
    assert torch.equal(whole.optimizer.gaussians.means, again.optimizer.gaussians.means)
    state = checkpoint_of(first, 0.0, [])
    del state.arrays["glass"]
    with pytest.raises(CheckpointError, match="glass"):
        restore(trainer(), state)


def test_what_is_large_is_measured_on_the_scene_behind_the_glass(scene):
    """Not on its blurred photos: their differences are a fraction, and all that is inverted would pass for large."""
    sheet = glass(0.1, 3.0)
    views = through(scene, sheet)[:3]
    clear, behind = (
        Trainer(views, [], scene.points, LINEAR, SHORT, Formation(effects)).levels[-1].contrast
        for effects in ([], [sheet])
    )
    assert behind > 1.5 * clear
