"""Glass in the row of stages: what takes the place of the point spread, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from dgs.core.errors import PsfError
from dgs.core.glass import GlassRequest
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.glass import FrostedGlass, GlassScene
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.inspection.glass_by_points import Gain, GlassShown
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.pipeline import glass
from dgs.core.pipeline.effects.ablation import TrialTerms
from dgs.core.pipeline.effects.choose import Chosen, choose_effects
from dgs.core.pipeline.effects.decision import Decision
from dgs.core.pipeline.glass import depths_between, middle_camera, stands_of, with_glass
from dgs.core.pipeline.simulated import SimulatedEffects
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings
from dgs.core.training.settings import TrainingSettings
from dgs.tests.core.training.training_scenes import FOCAL, HEIGHT, WIDTH, blurred_scene

DIAGONAL = math.hypot(WIDTH, HEIGHT)
ROUND = Medium(PointSpread(sigma_x=2.0, sigma_y=2.0))


@pytest.fixture(scope="module")
def scene():
    return blurred_scene(4)


def before(scene, request, medium, source=None):
    effects = SimulatedEffects(Chosen(), medium, scene.views[:-1], scene.views[-1:])
    return with_glass(effects, request, scene.points, Silent(), source)


def test_a_given_width_is_that_of_the_middle_depth(scene):
    for distance in (0.5, 2.0):
        made = before(scene, GlassRequest(distance), ROUND)
        sheet = made.chosen.formation.glass
        assert made.sigma == pytest.approx(2.0, rel=1e-5) and not sheet.learned
        assert made.medium == Medium(None, "linear") and made.chosen.decisions[0].on
    near, far = depths_between(scene.views, scene.points)
    assert sheet.described()["width_nearest"] == pytest.approx(sheet.sigma(near, DIAGONAL), rel=1e-3)
    assert sheet.sigma(near, DIAGONAL) < 2.0 < sheet.sigma(far, DIAGONAL)


def test_an_angle_needs_no_width(scene):
    sheet = before(scene, GlassRequest(1.0, 0.02), Medium()).chosen.formation.glass
    assert sheet.angle == pytest.approx(0.02) and sheet.reach(DIAGONAL) == pytest.approx(FOCAL * 0.02, rel=1e-5)


def test_a_standing_glass_that_is_given_is_one_plane_for_all_photos(scene):
    """Where it is given without a tilt it faces the middle camera, and leans before the others."""
    made = before(scene, GlassRequest(1.0, 0.02, standing=True), Medium()).chosen
    sheet = made.formation.glass
    assert not sheet.learned and sheet.tilt == (0.0, 0.0) and "given" in made.decisions[0].why
    middle = middle_camera([view.camera for view in scene.views])
    still = np.append(middle.rotation[2], -1.0 - middle.rotation[2] @ middle.centre)  # normal . x = offset
    for view in scene.views:
        camera, stand = view.camera, sheet.scene.stands[view.name]
        plane = np.asarray(sheet._plane(sheet.parameters["distance"], sheet.parameters["tilt"], view.name))
        # v . (R x + t) = 1 is the same plane, whichever camera says it.
        world = np.append(plane @ camera.rotation, plane @ camera.translation - 1.0)
        assert world / np.linalg.norm(world[:3]) == pytest.approx(still, abs=1e-5)
        assert (camera is middle) == np.allclose(stand.moved, 0.0)


def test_without_a_distance_it_is_learned_and_sharp_photos_say_the_width_too(scene):
    assert before(scene, GlassRequest(), ROUND).chosen.formation.glass.learned == {"distance"}
    some = Medium(ROUND.psf, per_view={scene.views[0].name: None})
    sheet = before(scene, GlassRequest(), some).chosen.formation.glass
    assert sheet.learned == {"distance", "spread"} and sheet.clear == {scene.views[0].name}


@pytest.mark.parametrize(
    ("request_", "medium", "way_out"),
    [
        (GlassRequest(), Medium(), "--psf gaussian"),
        (GlassRequest(1.0), Medium(), "--psf gaussian"),
        (GlassRequest(3.2), ROUND, "--glass a distance below"),
        (GlassRequest(99.0, 0.01), Medium(), "--glass a distance below"),
    ],
)
def test_glass_that_says_too_little_or_stands_behind_the_object(scene, request_, medium, way_out):
    with pytest.raises(PsfError, match=way_out):
        before(scene, request_, medium)


def test_what_a_run_asks_for(tmp_path):
    run = lambda **words: ReconstructSettings(tmp_path, tmp_path, **words).split().glass  # noqa: E731
    assert run() is None and run(effects="auto") is None
    assert run(effects="exposure,glass") == run(glass="auto") == GlassRequest()
    assert run(glass="0.4") == GlassRequest(0.4)


def test_points_that_show_the_distance_spare_learning_it(scene, monkeypatch):
    source = PhotoSet([])
    seen = GlassShown(2.0, 0.0, 1.5, 0.02, 4.0, 3.0, 5.0, 1.0, 0.1, Gain(9.0, 1.0), Gain(9.0, 1.0), False, 2.3)
    for found, learned in (
        (seen, frozenset()),
        (replace(seen, distance_error=0.2), {"distance"}),
        (replace(seen, inside=True), {"distance"}),
        (None, {"distance"}),
    ):
        monkeypatch.setattr(glass, "glass_by_points", lambda *_, found=found: found)
        made = before(scene, GlassRequest(), ROUND, source).chosen
        assert made.formation.glass.learned == learned
        if not learned:
            assert made.formation.glass.described()["distance"] == 1.5
            assert made.formation.glass.described()["distance_error"] == pytest.approx(math.hypot(0.02, 0.15), rel=1e-4)
            assert "points" in made.decisions[0].why


def test_a_glass_that_was_chosen_takes_the_place_of_the_point_spread(scene):
    chosen = FrostedGlass.of(0.02, 1.0, GlassScene(FOCAL / DIAGONAL))
    chosen.errors = 0.0, 0.05
    line = Decision("glass", True, "confirmed: points", {"name": "glass"})
    effects = SimulatedEffects(Chosen(Formation([chosen]), decisions=[line]), Medium(), scene.views[:-1], [])
    request = glass.glass_shown(effects)
    assert request.distance == pytest.approx(1.0) and request.angle == pytest.approx(chosen.angle)
    made = with_glass(effects, request, scene.points, Silent()).chosen
    assert made.formation.names == ("glass",) and made.formation.glass.scene.nearest < math.inf
    assert made.formation.glass.errors == chosen.errors  # (how sure the points are of it goes along)
    assert made.decisions[0].why == line.why and made.decisions[0].evidence == line.evidence
    assert glass.glass_shown(replace(effects, medium=ROUND)).angle is None  # (a point spread that was given counts)
    # (but none that was read off the photos as if all were equally far)
    assert glass.glass_shown(replace(effects, medium=ROUND), estimated=True).angle == request.angle
    nothing = replace(effects, chosen=Chosen(Formation([FrostedGlass.of(0.0, 0.0, GlassScene(1.0))])))
    assert glass.glass_shown(nothing) is None


@pytest.mark.parametrize("standing", [False, True])
def test_a_glass_that_points_saw_lean_or_stand_is_trained_as_it_was_seen(scene, standing):
    stands = stands_of(scene.views) if standing else None
    chosen = FrostedGlass.of(0.02, 1.0, GlassScene(FOCAL / DIAGONAL, stands=stands), tilt=(0.3, -0.1))
    chosen.errors, chosen.tilt_errors = (0.0, 0.05), (0.02, 0.03)
    line = Decision("glass", True, "confirmed: points", {"name": "glass"})
    effects = SimulatedEffects(Chosen(Formation([chosen]), decisions=[line]), Medium(), scene.views[:-1], [])
    request = glass.glass_shown(effects)
    assert request.standing == standing and np.tan(request.tilt) == pytest.approx((0.3, -0.1))
    made = with_glass(effects, request, scene.points, Silent()).chosen.formation.glass
    assert made.tilt == pytest.approx((0.3, -0.1)) and not made.learned
    assert made.errors == chosen.errors and made.tilt_errors == chosen.tilt_errors
    # (the stands that it was seen with: all cameras were there then, and not all are fitted)
    assert made.scene.stands is stands


def test_only_its_name_or_its_evidence_switches_it_on(scene, tmp_path):
    """'all' leaves it out."""
    from dgs.core.effects.registry import switches

    assert [name for name, switch in switches().items() if switch.by_name_only] == ["glass", "kernels"]
    assert (
        choose_effects("none", [], None, scene.views, Medium(), TrialTerms(TrainingSettings()), Silent()).decisions
        == []
    )
    assert np.isfinite(depths_between(scene.views, scene.points)).all()
