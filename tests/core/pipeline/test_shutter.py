"""A rolling shutter in the row of stages: given, left to the training, and refused where nothing moves."""

import pytest
from dgs.core.errors import DgsError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.pipeline.effects.choose import Chosen
from dgs.core.pipeline.shutter import check_shutter, with_shutter
from dgs.core.pipeline.simulated import SimulatedEffects
from dgs.core.progress import Silent
from dgs.core.shutter import ShutterRequest
from dgs.tests.core.training.training_scenes import blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene(12)


def asked(scene, request, *effects):
    simulated = SimulatedEffects(Chosen(Formation(effects)), Medium(), scene.views, [])
    return simulated, with_shutter(simulated, request, Silent())


def paths(scene):
    return straight_paths({view.name: (0.02, 0.0) for view in scene.views}, 1)


@pytest.mark.parametrize("readout", [0.0, 1.5])
def test_a_given_readout_is_simulated_and_stays(scene, readout):
    before, found = asked(scene, ShutterRequest(readout), paths(scene))
    given, motion = found.chosen.formation.motion, before.chosen.formation.motion
    assert given.readout == readout and given.readout_given
    assert motion.readout == 0.0 and not motion.readout_given


def test_nothing_changes_without_motion_or_readout(scene):
    for request, effects in ((ShutterRequest(1.5), ()), (ShutterRequest(), (paths(scene),)), (None, (paths(scene),))):
        before, found = asked(scene, request, *effects)
        assert found is before
    with pytest.raises(DgsError, match="Add --effects motion"):
        check_shutter(ShutterRequest(1.0), motion=False)
    check_shutter(None, motion=False)
