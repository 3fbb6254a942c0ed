"""A rolling shutter in the row of stages: given, left to the training, and refused where nothing moves."""

import pytest
from dgs.core.errors import DgsError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.pipeline.effects.choose import Chosen
from dgs.core.pipeline.shutter import check_shutter, curve_found, with_shutter
from dgs.core.pipeline.simulated import SimulatedEffects
from dgs.core.progress import Silent
from dgs.core.shutter import ShutterRequest
from dgs.core.tone_curve import ToneCurve
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


def test_a_curve_is_named_where_it_stands_out(scene):
    motion = paths(scene)
    motion.curve, motion.curve_error = ToneCurve(-0.24, 0.69), (0.02, 0.04)
    said = curve_found(Formation([motion]))
    assert "toe -0.24 +- 0.04" in said and "shoulder 0.69 +- 0.08" in said
    motion.curve = ToneCurve(0.08, 0.12)
    assert curve_found(Formation([motion])) == "", "sRGB renders come to as much"
    motion.curve, motion.curve_error = ToneCurve(0.5, 0.5), None
    assert curve_found(Formation([motion])) == curve_found(Formation()) == "", "none was sought"
