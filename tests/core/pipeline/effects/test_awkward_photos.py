"""Photos that say little or nothing: inspection and choice go on, say so, and switch nothing on."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.core.effects.inspect import inspect_photos
from dgs.core.effects.registry import EFFECTS, switches
from dgs.core.imaging.medium import Medium
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects.ablation import TrialTerms
from dgs.core.pipeline.effects.choose import choose_effects
from dgs.core.progress import Silent
from dgs.core.reconstruction import Reconstruction
from dgs.core.training.settings import TrainingSettings

SETTINGS = TrainingSettings(steps=20, max_gaussians=1000, sh_degree=0, threads=1)


@pytest.fixture(scope="module")
def twelve():
    scene = make_scene(4, width=160, height=112, views=12, finer=1)
    return validation.photo_set(scene, degrade(scene, Truth(exposure=0.2), seed=1))


def four(given):
    """A third of the photos: too few to tell or to try much."""
    photos = given.photos[::3]
    cameras = given.cameras
    poses = {photo.name: cameras.poses[photo.name] for photo in photos}
    lenses = {photo.name: cameras.lenses[photo.name] for photo in photos}
    return PhotoSet(photos, Reconstruction(poses, lenses, cameras.points, cameras.figures))


def black(given):
    return PhotoSet([replace(p, pixels=np.zeros_like(p.pixels)) for p in given.photos], given.cameras)


def white(given):
    return PhotoSet([replace(p, pixels=np.full_like(p.pixels, 255)) for p in given.photos], given.cameras)


def of_two_sizes(given):
    """Every second photo cut at the right and at the bottom."""
    photos, lenses = list(given.photos), dict(given.cameras.lenses)
    for i in range(0, len(photos), 2):
        photos[i] = replace(photos[i], pixels=np.ascontiguousarray(photos[i].pixels[:-16, :-24]))
        lenses[photos[i].name] = replace(lenses[photos[i].name], width=136, height=96)
    return PhotoSet(photos, Reconstruction(given.cameras.poses, lenses, given.cameras.points, given.cameras.figures))


def without_cameras(given):
    return PhotoSet(given.photos, why="no cameras were found")


@pytest.mark.parametrize("change", [four, black, white, of_two_sizes, without_cameras])
def test_inspection_goes_on(twelve, change):
    found = inspect_photos(change(twelve), Silent())
    assert [e.name for e in found] == [spec.name for spec in EFFECTS]
    for evidence in found:
        value = evidence.estimate["value"]
        assert value is None or np.isfinite(value)
        assert value is not None or (not evidence.needed and evidence.confidence == 0.0 and evidence.evidence)


@pytest.mark.parametrize("change", [four, black, white, of_two_sizes])
def test_auto_goes_on(twelve, change):
    photos = change(twelve)
    views = undistorted_views(list(photos.photos), photos.cameras)
    chosen = choose_effects("auto", photos.photos, photos.cameras, views, Medium(), TrialTerms(SETTINGS), Silent())
    assert [d.name for d in chosen.decisions] == list(switches())
    if change is four:  # too few for a trial: exposures, which do differ, are learned as an ordinary run learns them
        assert chosen.formation.names == ("exposure",) and not chosen.masked
    elif change is not of_two_sizes:
        assert not chosen.formation and not chosen.masked
    else:
        exposure = next(d for d in chosen.decisions if d.name == "exposure")
        assert exposure.gain_db is not None and exposure.gain_db > 0


def test_black_photos_are_not_measured(twelve):
    found = {e.name: e for e in inspect_photos(black(twelve), Silent())}
    for name in ("blur", "haze", "exposure", "vignetting", "defocus"):
        assert found[name].estimate["value"] is None, found[name]
