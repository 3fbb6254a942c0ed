"""Defocus and field blur through the pipeline: their size, what confirms them, and what they give back to the twin."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import MARGIN, Truth, degrade, make_scene
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.effects.defocus import Defocus, inspect, shared_focus
from dgs.core.effects.depth_unit import depth_unit
from dgs.core.effects.registry import built
from dgs.core.errors import DgsError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.inspection import focus_by_points as by_points
from dgs.core.inspection.focus_by_points import focus_by_points
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects.ablation import Ablation, TrialTerms
from dgs.core.pipeline.effects.choose import _Trials, choose_effects
from dgs.core.pipeline.effects.confirmed import confirmed_by_points
from dgs.core.pipeline.views import Viewer
from dgs.core.progress import Silent
from dgs.core.training.job import TrainingJob
from dgs.core.training.run import train
from dgs.core.training.scale import scene_scale
from dgs.core.training.settings import TrainingSettings

SETTINGS = TrainingSettings(steps=80, max_gaussians=2000, sh_degree=0, threads=1)
#: Blur of the medium, and of the effects where they are largest, px.
SIGMA, PX = 1.0, 3.0
MEDIUM = Medium(parse_psf(f"gaussian:{SIGMA:g}"), "linear")


@pytest.fixture(scope="module")
def scene():
    return make_scene(3, width=192, height=128, views=12, finer=1)


@pytest.fixture(scope="module")
def sets(scene):
    kinds = {"clean": {}, "defocus": {"defocus": PX}, "field": {"field": PX}}
    return {
        kind: validation.photo_set(scene, degrade(scene, Truth(psf=(SIGMA, SIGMA, 0.0), **done), 1))
        for kind, done in kinds.items()
    }


@pytest.fixture(scope="module")
def true_defocus(scene):
    """As the trainer's units have it."""
    near, far = np.quantile(scene.depth, [0.02, 0.98])
    size = scene_scale(scene.cameras, scene.points).size
    strength = PX / ((1 / near - 1 / far) / 2) / size / np.hypot(192, 128)
    return Defocus(torch.tensor(strength), torch.tensor((1 / near + 1 / far) / 2 * size))


def test_their_size_is_given_in_the_trainer_s_units(sets, true_defocus):
    defocus = shared_focus(sets["defocus"])
    for name, tolerance in (("strength", 0.35), ("focus", 0.15)):
        assert float(defocus.parameters[name]) == pytest.approx(float(true_defocus.parameters[name]), rel=tolerance)
    corner = built("field_blur", sets["field"]).parameters["corner"]
    assert float(corner) == pytest.approx(PX / np.hypot(192, 128), rel=0.35)
    assert depth_unit(sets["clean"]) != pytest.approx(1.0, abs=1e-3)  # the two units do differ


def test_only_what_is_there_is_confirmed(sets):
    made = {"defocus": shared_focus(sets["defocus"]), "field_blur": built("field_blur", sets["field"])}
    for name, there in (("defocus", "defocus"), ("field_blur", "field")):
        for kind, photos in sets.items():
            confirmed = confirmed_by_points(made[name], photos)
            assert confirmed is not None and confirmed.confirms == (kind == there), (name, kind, confirmed)


def test_auto_simulates_what_is_confirmed(sets):
    photos = sets["field"]
    views = undistorted_views(list(photos.photos), photos.cameras)
    asked = "auto,-haze,-exposure,-vignetting,-saturation"
    short = replace(SETTINGS, steps=40)  # (of a trial of motion, which is none of it)
    chosen = choose_effects(asked, photos.photos, photos.cameras, views, MEDIUM, TrialTerms(short), Silent())
    assert chosen.formation.names == ("field_blur",)
    line = next(d for d in chosen.decisions if d.name == "field_blur")
    assert "same points" in line.why and line.parameters and line.evidence["needed"]


def test_a_size_that_cannot_be_estimated_is_said(sets):
    grey = [replace(p, pixels=np.full_like(p.pixels, 90)) for p in sets["clean"].photos[:4]]
    photos = PhotoSet(grey, sets["clean"].cameras)
    assert built("defocus", photos) is None and built("field_blur", photos) is None and shared_focus(photos) is None
    with pytest.raises(DgsError, match="defocus"):
        choose_effects("defocus", photos.photos, photos.cameras, [], MEDIUM, TrialTerms(SETTINGS), Silent())


def test_the_twin_is_sharper_with_it(sets, true_defocus):
    """Held-out views through the medium alone, against photos that were taken through it without defocus."""
    photos = sets["defocus"]
    views = undistorted_views(list(photos.photos), photos.cameras)
    held = list(range(1, 12, 4))
    fitted = [view for i, view in enumerate(views) if i not in held]
    points, scale = photos.cameras.points, scene_scale([v.camera for v in fitted], photos.cameras.points)
    found = []
    for formation in (Formation(), Formation([true_defocus])):
        trained = train(TrainingJob(fitted, [], points, MEDIUM, SETTINGS, formation), Silent())
        viewer = Viewer(trained.gaussians, scale, "cpu", trained.low_pass, trained.background)
        errors = []
        for i in held:
            lens, pose = photos.cameras.lenses[views[i].name], photos.cameras.poses[views[i].name]
            clear = sets["clean"].photos[i].pixels.transpose(2, 0, 1) / 255.0
            errors.append(np.square(viewer.degraded(lens, pose, MEDIUM, views[i].name) - clear).mean())
        found.append(-10 * np.log10(np.mean(errors)))
    assert found[1] > found[0] + 0.15, found


def with_a_focus_that_moves(scene, photos, strength):
    """Every second photo focused on the nearest, the others on the farthest."""
    moving = []
    near, far = np.quantile(scene.depth, [0.02, 0.98])
    for i, photo in enumerate(photos):
        depth = torch.from_numpy(np.ascontiguousarray(scene.depth[i][MARGIN:-MARGIN, MARGIN:-MARGIN], np.float32))
        one = LensFocus([photo.name], torch.tensor([strength * far]), torch.tensor([1 / near if i % 2 else 1 / far]))
        light = torch.from_numpy(srgb_to_linear(photo.pixels.transpose(2, 0, 1) / 255.0).astype(np.float32))
        shown = linear_to_srgb(one.forward(light, Shot(photo.name, *depth.shape, depth=depth))).numpy()
        pixels = np.round(shown.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)
        moving.append(replace(photo, pixels=np.ascontiguousarray(pixels)))
    return moving


def test_a_focus_that_moves_is_seen_and_none_where_there_is_none(scene, sets):
    clean = sets["clean"]
    moving = with_a_focus_that_moves(scene, clean.photos, 0.006)
    photos = PhotoSet(moving, clean.cameras)
    found = focus_by_points(photos)
    assert found is not None and found.certain, found
    near, far = np.quantile(scene.depth, [0.02, 0.98])
    for i, photo in enumerate(moving):
        off = found.foci[photo.name] / found.unit - (1 / near if i % 2 else 1 / far)
        assert abs(off) < 0.25 * (1 / near - 1 / far), photo.name
    assert found.strength * found.unit == pytest.approx(0.006 * far, rel=0.25)
    said = inspect(photos)
    assert said.needed and "focus of their own" in said.evidence and said.estimate["photos"] == len(moving)
    assert not inspect(clean).needed
    trials = _Trials.called_for([said], photos)
    assert trials.names[0] == LensFocus.name and LensFocus.name in trials.certain
    for kind in ("clean", "field"):  # (one focus for all is seen, too, as photos hold different depths)
        none = focus_by_points(sets[kind])
        assert none is not None and not none.clear, (kind, none)


def test_what_points_show_beyond_doubt_is_simulated_and_neither_it_nor_paths_are_tried(scene, sets, monkeypatch):
    """A short training is too soft to say anything of it, and would take lens's blur for a path's."""
    photos, cameras = with_a_focus_that_moves(scene, sets["clean"].photos, 0.006), sets["clean"].cameras
    assert focus_by_points(PhotoSet(photos, cameras)).certain
    monkeypatch.setattr(Ablation, "_scores", lambda *asked: pytest.fail("tried"))
    asked = "auto,-haze,-exposure,-vignetting,-saturation,-field_blur"
    views = undistorted_views(photos, cameras)
    chosen = choose_effects(asked, photos, cameras, views, MEDIUM, TrialTerms(SETTINGS), Silent())
    lines = {decision.name: decision for decision in chosen.decisions}
    assert chosen.formation.names == (LensFocus.name,) and not lines["motion"].on
    assert lines[LensFocus.name].on and "beyond doubt" in lines[LensFocus.name].why
    begun = chosen.formation.focus
    assert begun.shown and all(begun.of(name).strength > 0 for name in begun.shown)


@pytest.mark.parametrize(("gain", "simulated"), [(0.3, True), (0.0, False)])
def test_a_trial_decides_where_points_leave_a_doubt(scene, sets, monkeypatch, gain, simulated):
    photos, cameras = with_a_focus_that_moves(scene, sets["clean"].photos, 0.006), sets["clean"].cameras
    monkeypatch.setattr(by_points.FociOfPoints, "certain", False)

    def scores(self, arm, medium, pair):
        return np.full(6, 30.0 + gain * arm.formation.learns_focus) + 0.05 * np.arange(6) % 0.1

    monkeypatch.setattr(Ablation, "_scores", scores)
    asked = "auto,-haze,-exposure,-vignetting,-saturation,-field_blur,-motion"
    views = undistorted_views(photos, cameras)
    chosen = choose_effects(asked, photos, cameras, views, MEDIUM, TrialTerms(SETTINGS), Silent())
    line = next(d for d in chosen.decisions if d.name == LensFocus.name)
    assert chosen.formation.learns_focus is simulated and line.on is simulated, line
