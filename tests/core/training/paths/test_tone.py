"""A camera's own curve: its slope against differences of what is filed, and what photos say of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.tone_curve import ToneCurve
from dgs.core.training.job import TrainingJob
from dgs.core.training.paths.slopes import Looked, Sampled
from dgs.core.training.paths.tone import SETTINGS, LearnedTone, slopes_in_curve
from dgs.core.training.run import train
from dgs.tests.core.training.moved_photos import exposed_by, truly_moved
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


def filed(scene, camera, motion, curve):
    motion.curve = curve
    return exposed_by(scene, camera, motion)


@pytest.mark.parametrize("curve", [ToneCurve(), ToneCurve(0.4, 0.3)])
@pytest.mark.parametrize("readout", [0.0, 1.0])
def test_the_slopes_are_those_of_what_is_filed(scene, curve, readout):
    camera = scene.views[0].camera
    motion = straight_paths({camera.name: (6.0 / camera.fx, 3.0 / camera.fx)}, 4).rolling(readout)
    every = Sampled(slice(0, camera.height), slice(0, camera.width))
    exposed = filed(scene, camera, motion, curve)
    rows = motion.row_weights(len(exposed.frames), camera.height, camera.width)
    own = slopes_in_curve(Looked(exposed, every), rows).reshape(2, -1)
    for k, name in enumerate(("toe", "shoulder")):
        pair = [replace(curve, **{name: getattr(curve, name) + by}) for by in (0.02, -0.02)]
        up, down = (filed(scene, camera, motion, other).degraded for other in pair)
        true = ((up - down) / 0.04).reshape(-1)
        assert float(true.abs().max()) > 1e-3
        assert torch.allclose(own[k], true, atol=0.02 * float(true.abs().max()))


def found_by_training(scene, curve):
    """What a training finds of the curve that all photos were filed by."""
    motion, _ = truly_moved(scene, px=8.0)
    photos = [filed(scene, view.camera, motion, curve).degraded.numpy().clip(0, 1) for view in scene.views]
    pixels = [np.round(photo * 255).astype(np.uint8).transpose(1, 2, 0).copy() for photo in photos]
    views = [replace(view, photo=photo) for view, photo in zip(scene.views, pixels, strict=True)]
    start = straight_paths({view.name: (0.0, 0.0) for view in views}, 1)
    job = TrainingJob(views, [], scene.points, Medium(), replace(SHORT, steps=200), Formation([start]))
    return train(job, Silent()).formation.motion


@pytest.mark.parametrize("curve", [ToneCurve(), ToneCurve(0.5, 0.6)])
def test_a_training_finds_the_curve_with_its_error(scene, curve):
    """Nine small photos say it to about 0.2; toe and shoulder together better than each of them."""
    motion = found_by_training(scene, curve)
    assert motion.curve.toe == pytest.approx(curve.toe, abs=0.35)
    assert motion.curve.shoulder == pytest.approx(curve.shoulder, abs=0.35)
    both = motion.curve.toe + motion.curve.shoulder
    assert both == pytest.approx(curve.toe + curve.shoulder, abs=0.3)
    assert all(0.0 < error < 0.2 for error in motion.curve_error)
    described = motion.described()
    assert described["curve"] == pytest.approx([motion.curve.toe, motion.curve.shoulder], rel=1e-3, abs=1e-4)
    assert len(described["curve_error"]) == 2


def seen(learned, step, precision=1e4):
    for _ in range(SETTINGS.visits):
        for photo in range(len(learned._latest)):
            learned.see(photo, precision * np.eye(2), precision * np.array(step))


def test_the_curve_moves_by_the_photos_step():
    learned = LearnedTone(6)
    seen(learned, (0.1, -0.05))
    assert learned.due
    learned.move()
    assert (learned.curve.toe, learned.curve.shoulder) == pytest.approx((0.1, -0.05), rel=1e-3) and not learned.due
    # (standard errors of 1 / sqrt(6e4) by chance, and what is off whatever that is)
    assert learned.error == pytest.approx((np.hypot(1 / np.sqrt(6e4), SETTINGS.off),) * 2, rel=1e-4)
    seen(learned, (-0.02, 0.01))
    learned.move()
    assert (learned.curve.toe, learned.curve.shoulder) == pytest.approx((0.08, -0.04), rel=1e-2)
    seen(learned, (0.9, 0.0))
    learned.move()
    assert learned.curve.toe == pytest.approx(0.08 + SETTINGS.longest_step, rel=1e-2), "not too far at once"


def test_the_curve_always_rises():
    learned = LearnedTone(6, ToneCurve(0.95, -0.45))
    seen(learned, (9.0, -9.0))
    learned.move()
    assert learned.curve == ToneCurve(SETTINGS.highest, SETTINGS.lowest)
    values = torch.linspace(0, 1, 500)
    for toe in (SETTINGS.lowest, SETTINGS.highest):
        for shoulder in (SETTINGS.lowest, SETTINGS.highest):
            assert float(ToneCurve(toe, shoulder).slope(values).min()) > 0.2


def test_photos_that_stood_still_or_are_too_few_say_nothing():
    learned = LearnedTone(6, ToneCurve(0.1, 0.0))
    seen(learned, (0.3, 0.3))
    for photo in range(2):
        learned.see_nothing(photo)
    assert learned.due
    learned.move()
    assert learned.curve == ToneCurve(0.1, 0.0) and learned.error is None
    assert not LearnedTone(0).due


def test_a_checkpoint_goes_on_where_it_was():
    learned, other = LearnedTone(6), LearnedTone(6)
    seen(learned, (0.1, -0.05))
    learned.move()
    assert other.restore(learned.state()) and other.error == learned.error and other.curve == learned.curve
    for one in (learned, other):
        seen(one, (0.1, -0.05))
        one.move()
    assert learned.curve == other.curve
    assert not LearnedTone(5).restore(learned.state()) and not other.restore({})
    assert not other.restore({**learned.state(), "tone.curve": np.full(4, np.nan)})
