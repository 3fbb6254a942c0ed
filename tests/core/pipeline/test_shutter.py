"""A rolling shutter in the row of stages: given, decided by trials, and refused where nothing moves."""

import numpy as np
import pytest
from dgs.core.errors import DgsError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.pipeline.effects.ablation import Ablation, Arm, Comparison
from dgs.core.pipeline.effects.choose import Chosen
from dgs.core.pipeline.shutter import SETTINGS, best_readout, check_shutter, with_shutter
from dgs.core.pipeline.simulated import SimulatedEffects
from dgs.core.progress import Silent
from dgs.core.shutter import ShutterRequest
from dgs.core.training.settings import TrainingSettings
from dgs.tests.core.training.training_scenes import blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene(12)


def asked(scene, request, *effects):
    simulated = SimulatedEffects(Chosen(Formation(effects)), Medium(), scene.views, [])
    return simulated, with_shutter(simulated, request, scene.points, TrainingSettings(), Silent())


def paths(scene):
    return straight_paths({view.name: (0.02, 0.0) for view in scene.views}, 1)


def gains(*values):
    return Comparison(np.array(values), least=0.1)


def test_a_given_readout_is_simulated(scene):
    before, found = asked(scene, ShutterRequest(1.5), paths(scene))
    assert found.chosen.formation.motion.readout == 1.5 and before.chosen.formation.motion.readout == 0.0


def test_nothing_changes_without_motion_or_readout(scene):
    for request, effects in ((ShutterRequest(1.5), ()), (ShutterRequest(0.0), (paths(scene),))):
        before, found = asked(scene, request, *effects)
        assert found is before
    with pytest.raises(DgsError, match="Add --effects motion"):
        check_shutter(ShutterRequest(1.0), motion=False)
    check_shutter(None, motion=False)


@pytest.mark.parametrize("right", [None, 1.0])
def test_held_out_photos_decide(scene, right, monkeypatch):
    """The one that gains most beyond chance; none where all gain by chance or lose."""

    def compare(self, without, with_it):
        assert without.formation.motion.readout == 0.0
        readout = with_it.formation.motion.readout
        return gains(2.0, 2.1, 1.9, 2.0, 2.0) if readout == right else gains(1.0, -1.2, 0.8, -0.9, 0.6)

    monkeypatch.setattr(Ablation, "compare", compare)
    before, found = asked(scene, ShutterRequest(), paths(scene))
    assert (found is before) == (right is None)
    assert found.chosen.formation.motion.readout == (right or 0.0)
    assert all(readout > 0 for readout in SETTINGS.readouts), "read from below, the same photos"


def test_the_better_of_two_is_taken():
    sure = gains(1.0, 1.1, 0.9, 1.0, 1.0)
    assert best_readout({0.5: sure, 1.0: gains(2.0, 2.1, 1.9, 2.0, 2.0), 2.0: gains(0.01, 0.0, 0.02, 0.0, 0.01)}) == 1.0
    assert best_readout({0.5: gains(0.05, 0.06, 0.05, 0.05, 0.05)}) is None, "less than what confirms"


def test_trials_of_readouts_are_apart_and_of_the_middle_of_photos(scene, monkeypatch):
    trials, seen = Ablation(scene.views, scene.points, Medium(), TrainingSettings()), []

    def of_pair(self, views, formation, medium, pair):
        seen.append(formation.motion.readout)
        return [20.0 + 2.0 * formation.motion.readout + 0.01 * i for i in self.judged(pair)]

    monkeypatch.setattr(Ablation, "_of_pair", of_pair)
    plain, share = Formation([paths(scene)]), 0.5
    found = trials.compare(Arm(plain), Arm(Formation([paths(scene).rolling(1.0)])))
    assert found.mean == pytest.approx(2.0) and found.confirms and set(seen) == {0.0, 1.0}
    assert paths(scene).rolling(1.0).read_in(share).readout == 0.5
