"""The readout of a rolling shutter: its slope against differences of renders, and what photos say of it."""

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
from dgs.core.training.paths.coordinates import backwards
from dgs.core.training.paths.equations import PathEquations
from dgs.core.training.paths.readout import SETTINGS, LearnedReadout, slopes_in_readout, step_and_variance
from dgs.core.training.paths.slopes import Looked, Sampled
from dgs.core.training.run import train
from dgs.tests.core.training.moved_photos import exposed_by, truly_moved, turned_upright
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


@pytest.mark.parametrize(
    ("out_of_focus", "readout", "alike", "turned"),
    [
        (False, 0.0, 0.97, False),
        (False, 1.0, 0.95, False),
        (False, -0.7, 0.95, False),
        (True, 1.0, 0.9, False),
        (False, 1.0, 0.95, True),
        (True, 1.0, 0.9, True),
    ],
)
def test_the_slope_is_that_of_renders(scene, out_of_focus, readout, alike, turned):
    camera = turned_upright(scene.views[0].camera) if turned else scene.views[0].camera
    lens = [LensFocus([camera.name], torch.tensor([0.03]), torch.tensor([0.7]))] if out_of_focus else []
    motion = straight_paths({camera.name: (5.0 / camera.fx, 3.0 / camera.fx)}, 4).rolling(readout)
    every = Sampled(slice(0, camera.height), slice(0, camera.width))
    own = slopes_in_readout(Looked(exposed_by(scene, camera, motion, *lens), every), readout).reshape(2, -1)
    pair = [exposed_by(scene, camera, motion.rolling(readout + by), *lens).degraded for by in (0.2, -0.2)]
    true = ((pair[0] - pair[1]) / 0.4).reshape(-1)
    assert own.shape == (2, len(true))
    assert float(torch.corrcoef(torch.stack([own[0], true]))[0, 1]) > alike
    assert float((own[0] @ true) / (own[0] @ own[0])) == pytest.approx(1.0, abs=0.15)
    assert abs(float(torch.corrcoef(torch.stack([own[1], true]))[0, 1])) < 0.5, "columns are something else"


def found_by_training(scene, readout, given=None, steps=80):
    _, views = truly_moved(scene, px=7.0, readout=readout)
    start = straight_paths({view.name: (0.0, 0.0) for view in views}, 1)
    if given is not None:
        start = start.rolling(given)
        start.readout_given = True
    settings = replace(SHORT, steps=steps)
    return train(TrainingJob(views, [], scene.points, Medium(), settings, Formation([start])), Silent())


def test_a_training_finds_the_readout_with_its_error(scene):
    motion = found_by_training(scene, 1.0, steps=160).formation.motion
    assert motion.readout == pytest.approx(1.0, abs=0.15) and 0.0 < motion.readout_error < 0.1
    described = motion.described()
    assert described["readout"] == pytest.approx(motion.readout, rel=1e-4) and described["readout_error"] > 0


def test_rows_that_are_exposed_at_once_are_left_alone(scene):
    found, given = (found_by_training(scene, 0.0, given) for given in (None, 0.0))
    assert found.formation.motion.readout == 0.0 and found.formation.motion.readout_error is None
    assert torch.equal(found.gaussians.means, given.gaussians.means), "looking for it changes nothing"
    assert "readout_error" not in found.formation.motion.described()


def test_a_given_readout_stays(scene):
    motion = found_by_training(scene, 0.0, 0.5).formation.motion
    assert motion.readout == 0.5 and motion.readout_error is None


def test_a_path_run_backwards_leads_the_same_way():
    motion = straight_paths({"a": (0.1, 0.05)}, 4)
    motion.parameters["twists"] += 0.01 * torch.randn(1, 5, 6, generator=torch.Generator().manual_seed(1))
    way = motion.way("a", 80.0)
    motion.parameters["twists"].copy_(backwards(motion.parameters["twists"]))
    assert torch.allclose(motion.way("a", 80.0), way.flip(0), atol=1e-5)


def seen(learned, steps, columns=0.1, variance=0.01):
    for _ in range(SETTINGS.visits):
        for photo, step in enumerate(steps):
            learned.see(photo, (step, variance, columns, variance))


def test_the_readout_begins_whatever_directions_paths_have():
    learned = LearnedReadout(6)
    seen(learned, [0.4, -0.3, 0.35, -0.4, 0.3, 0.35])
    assert learned.due
    readout, turned = learned.moved(0.0)
    assert readout == pytest.approx(0.35) and turned.tolist() == [False, True, False, True, False, False]
    assert learned.error == pytest.approx(0.1 / np.sqrt(6)) and not learned.due
    seen(learned, [0.1] * 6)
    further, turned = learned.moved(readout)
    assert further == pytest.approx(0.35 + SETTINGS.faster * 0.1) and not turned.any()
    seen(learned, [-0.05] * 6)
    assert learned.moved(further)[0] == pytest.approx(further - 0.05), "behind it, it goes back at its own pace"


@pytest.mark.parametrize(
    ("steps", "columns", "why"),
    [
        ([0.1, -0.1, 0.1, -0.1, 0.1, -0.1], 0.05, "chance"),
        ([0.4, -0.3, 0.35, -0.4, 0.3, 0.35], 0.35, "as much with columns: no shutter"),
        ([0.4, -0.4, 0.4, -0.4], 0.0, "too few photos"),
        ([], 0.0, "none"),
    ],
)
def test_no_readout_without_evidence(steps, columns, why):
    learned = LearnedReadout(len(steps))
    seen(learned, steps, columns)
    readout, turned = learned.moved(0.0)
    assert readout == 0.0 and not turned.any() and learned.error is None, why


def test_a_readout_that_shrinks_to_nothing_is_none_and_a_long_one_ends():
    learned = LearnedReadout(5)
    seen(learned, [-0.2] * 5)
    assert learned.moved(0.1)[0] == 0.0 and learned.error is None
    seen(learned, [9.0] * 5)
    assert learned.moved(3.8)[0] == SETTINGS.longest


def test_photos_that_stood_still_say_nothing():
    learned = LearnedReadout(6)
    seen(learned, [0.4] * 5 + [0.0])
    learned.see_nothing(5)
    assert learned.due and learned.moved(0.0)[0] == pytest.approx(0.4)
    matrix, vector = torch.eye(2).double(), torch.zeros(2).double()
    own, wanted = torch.tensor([[0.0, 0.0], [0.0, 1.0]]).double(), torch.tensor([0.0, 2.0]).double()
    path = PathEquations(matrix, vector, torch.zeros(2, 2).double(), own, wanted)
    assert step_and_variance(path, slice(0, 1)) == (0.0, np.inf)
    assert step_and_variance(path, slice(1, 2)) == pytest.approx((2.0, 1.0))


def test_what_a_checkpoint_keeps_goes_on():
    learned, again = LearnedReadout(5), LearnedReadout(5)
    seen(learned, [0.4] * 5)
    learned.moved(0.0)
    learned.see(2, (0.1, 0.01, 0.0, 0.01))
    assert again.restore(learned.state())
    assert again.error == learned.error and not again.due
    for one in (learned, again):
        seen(one, [0.1] * 5)
    assert learned.moved(0.4)[0] == again.moved(0.4)[0]
    assert not LearnedReadout(6).restore(learned.state()) and not again.restore({})
