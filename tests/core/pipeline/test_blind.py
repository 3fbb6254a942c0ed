"""Point spreads of a run: given, listed by photo, or estimated; and what cannot be meant."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.benchmarks.effects import photo_set
from dgs.core.errors import PsfError
from dgs.core.photos.load import Photo
from dgs.core.pipeline.blind import given_spreads, spreads_of
from dgs.core.pipeline.medium import medium_with
from dgs.core.run_settings import MediumSettings, ReconstructSettings


def photos(*names, scale=1.0):
    return [Photo(n, Path(n), np.zeros((32, 48, 3), np.uint8), scale=(scale, scale)) for n in names]


def listed(tmp_path, content, *names, scale=1.0, some=False):
    file = tmp_path / "spreads.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    settings = MediumSettings(f"per-photo:{file}")
    return spreads_of(given_spreads(settings.psf), photos(*names, scale=scale), settings, some)


def test_a_list_gives_each_photo_its_own(tmp_path):
    np.save(tmp_path / "k.npy", np.ones((3, 3)))
    content = {"a.png": "gaussian:3", "b.png": "k.npy", "c.png": "none", "*": "gaussian:2+path:6,30"}
    found = listed(tmp_path, content, "a.png", "b.png", "c.png", "d.png")
    assert found.source == "gaussian:2+path:6,30" and set(found.own) == {"a.png", "b.png", "c.png"}
    medium = medium_with(found, MediumSettings(), photos("a.png", "b.png", "c.png", "d.png"))
    assert medium.psf_for("a.png").sigma_x == 3.0 and medium.psf_for("c.png") is None
    assert medium.psf_for("b.png").kernel().shape == (3, 3) and medium.psf_for("d.png") is medium.psf
    # The list's own kernels are found from anywhere afterwards.
    assert given_spreads(found.own["b.png"].source).psf.kernel() == pytest.approx(medium.psf_for("b.png").kernel())


def test_without_a_default_the_middle_one_stands_for_all(tmp_path):
    found = listed(tmp_path, {"a": "gaussian:1", "b": "gaussian:4", "c": "gaussian:2"}, "a", "b", "c")
    assert found.psf.sigma_x == 2.0


def test_spreads_shrink_with_their_photos(tmp_path):
    found = listed(tmp_path, {"a": "gaussian:8", "*": "gaussian:4"}, "a", "b", scale=0.5)
    medium = medium_with(found, MediumSettings(), photos("a", "b", scale=0.5))
    assert medium.psf_for("a").sigma_x == pytest.approx(4.0, rel=0.02)
    mixed = [*photos("a", scale=0.5), *photos("b")]
    medium = medium_with(found, MediumSettings(), mixed)
    assert medium.psf_for("a").sigma_x == pytest.approx(4.0, rel=0.02) and medium.psf_for("b").sigma_x == 4.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "no JSON"),
        ("[]", "no object"),
        ({"a": 3}, "no object"),
        ({"a": "gauss:3", "*": "none"}, "'a'"),
        ({"a": "gaussian:3"}, "says nothing of 'b'"),
        ({"typo": "gaussian:3", "*": "none"}, "'typo'"),
        ({"a": "missing.npy", "*": "none"}, "missing.npy"),
    ],
)
def test_wrong_lists_are_explained(tmp_path, content, words):
    with pytest.raises(PsfError) as caught:
        listed(tmp_path, content, "a", "b")
    assert words in caught.value.what and caught.value.way_out and "spreads.json" in str(caught.value)


def test_a_list_of_more_photos_than_were_looked_at(tmp_path):
    found = listed(tmp_path, {"a": "gaussian:3", "later": "gaussian:1", "*": "none"}, "a", "b", some=True)
    assert set(found.own) == {"a"}
    with pytest.raises(PsfError, match="cannot be read"):
        given_spreads(f"per-photo:{tmp_path / 'none.json'}")
    assert given_spreads("auto") is None and given_spreads("auto-each") is None


@pytest.fixture(scope="module")
def shaken():
    """Photos that moved by about 8 px each while they were taken, and nothing else."""
    scene = make_scene(3, width=240, height=160, views=8, finer=2)
    return list(photo_set(scene, degrade(scene, Truth(motion=8.0), seed=1)).photos)


@pytest.fixture(scope="module")
def still():
    scene = make_scene(3, width=240, height=160, views=8, finer=2)
    return list(photo_set(scene, degrade(scene, Truth(), seed=1)).photos)


def asked(psf, effects="none"):
    asked = ReconstructSettings(Path("p"), Path("o"), psf=psf, blur_space="linear", effects=effects)
    return asked.split().medium


def said(photos, settings):
    """What the run says of the point spread: in notes, or as an error."""
    try:
        return " ".join(spreads_of(None, photos, settings).notes)
    except PsfError as error:
        return error.what


@pytest.mark.parametrize("psf", ["auto", "auto-each"])
def test_motion_is_seen_and_said(shaken, psf):
    text = said(shaken, asked(psf))
    shown = re.search(r"(\d+) of 8 photos moved .* paths of ([\d.]+) to ([\d.]+) px", text)
    assert shown is not None, text
    assert int(shown[1]) >= 7 and 2.0 < float(shown[2]) < 8.0 < float(shown[3]) < 16.0
    assert "--effects motion" in text
    assert "--effects decides" in said(shaken, asked(psf, "auto"))


def test_paths_are_in_px_of_the_files(shaken):
    halved = [replace(photo, scale=(0.5, 0.5)) for photo in shaken]
    full, half = (re.search(r"to ([\d.]+) px: a G", said(p, asked("auto")))[1] for p in (shaken, halved))
    assert float(half) == pytest.approx(2 * float(full), abs=0.11)


@pytest.mark.parametrize("psf", ["auto", "auto-each"])
def test_sharp_photos_are_said_to_be_sharp_and_still(still, psf):
    spreads = spreads_of(None, still, asked(psf))
    assert spreads.psf is None and not spreads.own and spreads.source == "none"
    text = " ".join(spreads.notes)
    assert "no blur beyond what sharp photos have" in text and "moved" not in text
    assert ("no photo gets a Gaussian of its own" in text) == (psf == "auto-each")


def test_photos_that_decide_on_effects_decide_on_the_blur_as_well(shaken, still):
    """Where nobody says what blurs them; a wall that shows nothing is no error then, and blur by paths none of all."""
    wall = [Photo(f"{i}.png", None, np.full((120, 160, 3), 128, np.uint8)) for i in range(3)]
    assert asked(None).psf == "none" and asked("none", "auto").psf == "none"
    unasked = asked(None, "auto,-haze")
    assert unasked.psf == "auto" and asked(None, "auto,kernels").psf == "none"
    for photos in (shaken, still, wall):
        assert spreads_of(None, photos, unasked).psf is None
    with pytest.raises(PsfError):
        spreads_of(None, wall, asked("auto"))


def test_blur_that_all_share_is_found_where_photos_decide():
    scene = make_scene(3, width=240, height=160, views=8, finer=2)
    photos = photo_set(scene, degrade(scene, Truth(psf=(2.0, 2.0, 0.0)), seed=1)).photos
    found = spreads_of(None, photos, asked(None, "auto")).psf
    assert found is not None and found.sigma_x == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize("glass, psf", [(None, "auto"), ("auto", "auto"), ("0.3", "auto"), ("0.3,0.8", "none")])
def test_glass_of_a_known_angle_needs_no_blur(glass, psf):
    asked = ReconstructSettings(Path("p"), Path("o"), effects="auto", glass=glass)
    assert asked.split().medium.psf == psf
