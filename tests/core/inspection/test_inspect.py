"""What the inspection finds in photos whose effects are known, and what it leaves alone."""

import json
from pathlib import Path

import numpy as np
import pytest
from dgs.core.effects.inspect import inspect_photos
from dgs.core.effects.registry import EFFECTS, effect_named
from dgs.core.inspection.evidence import judged
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.load import Photo
from dgs.core.progress import Silent
from PIL import Image


def found(photos, only=None):
    return {e.name: e for e in inspect_photos(photos, Silent(), only)}


def test_clean_photos_call_for_nothing(taken):
    evidence = found(taken())
    assert list(evidence) == [spec.name for spec in EFFECTS]
    assert [name for name, e in evidence.items() if e.needed] == []
    for name, e in evidence.items():
        if name == "kernels":  # (photos through them alone never show them)
            assert e.estimate["value"] is None and e.confidence == 0.0 and "Not measured" in e.evidence
            continue
        # (haze: 0.90 or 0.895, as processors round)
        assert e.estimate["value"] is not None and 0.88 < e.confidence <= 1.0, e
        assert e.evidence and e.seconds >= 0
        json.dumps(e.plain(), allow_nan=False)


@pytest.mark.parametrize(
    ("name", "effects", "truth", "within"),
    [
        ("blur", {"psf": (2.5, 2.5, 0.0), "space": "srgb"}, 2.5, 0.1),
        ("defocus", {"defocus": 3.0}, 2.2, 0.15),
        ("motion", {"motion": 8.0}, 7.7, 0.05),
        ("haze", {"haze": 0.4}, 0.4, 0.25),
        ("exposure", {"exposure": 0.1}, 0.1, 0.1),
        ("white_balance", {"white_balance": 0.06}, 0.06, 0.15),
        ("vignetting", {"vignetting": 0.25}, 0.25, 0.15),
        ("noise", {"noise": 4.0}, 4.0, 0.6),
    ],
)
def test_an_effect_is_found_with_its_size(taken, name, effects, truth, within):
    evidence = found(taken(**effects))
    assert evidence[name].needed and evidence[name].confidence > 0.9
    assert evidence[name].estimate["value"] == pytest.approx(truth, rel=within)
    brought = {"defocus": {"blur", "field_blur"}, "motion": {"blur"}}.get(name, set())
    assert {n for n, e in evidence.items() if e.needed} <= {name, *brought}


def test_clipped_px_are_counted(taken):
    photos = taken(saturation=0.02)
    truth = np.mean([(photo.pixels == 255).any(axis=2).mean() for photo in photos.photos])
    assert 0.02 < truth < 0.08  # 2 % of the channels' values
    evidence = found(photos)
    # One step below the top counts too: JPEG and demosaicking take clipped px there.
    assert truth <= evidence["saturation"].estimate["value"] < 1.1 * truth
    assert {n for n, e in evidence.items() if e.needed} == {"saturation"}


def test_px_clipped_by_hand_are_counted_to_the_px():
    pixels = np.full((40, 50, 3), 90, np.uint8)
    pixels[:4, :, 1] = 255  # a tenth, in one channel only
    pixels[4:8, :, 1] = 253
    mask = np.ones((40, 50), bool)
    mask[20:] = False  # of what is left, a fifth
    for mask_or_none, share in ((None, 0.1), (mask, 0.2)):
        photos = [Photo(f"{i}", Path("p"), pixels, mask=mask_or_none) for i in range(3)]
        estimate = effect_named("saturation").inspect(PhotoSet(photos)).estimate
        assert estimate["value"] == pytest.approx(share, rel=1e-3)


def test_two_widths_of_blur_and_their_direction(taken):
    estimate = found(taken(psf=(4.0, 2.0, 30.0), space="srgb"), ["blur"])["blur"].estimate
    assert estimate["sigma_x"] == pytest.approx(4.0, rel=0.15) and estimate["sigma_y"] == pytest.approx(2.0, rel=0.2)
    assert estimate["angle"] == pytest.approx(30.0, abs=8.0)


def test_without_cameras_it_says_so(taken):
    alone = PhotoSet(taken(exposure=0.1).photos, None, "no cameras were found")
    evidence = found(alone)
    assert not evidence["exposure"].needed and evidence["exposure"].confidence == 0.0
    assert evidence["exposure"].estimate["value"] is None and "no cameras" in evidence["exposure"].evidence
    assert evidence["blur"].estimate["value"] is not None


def test_the_decision_follows_value_and_error():
    assert judged("x", 2.0, 0.1, 1.0, "", "").needed and judged("x", 2.0, 0.1, 1.0, "", "").confidence > 0.99
    assert not judged("x", 0.0, 0.1, 1.0, "", "").needed and judged("x", 0.0, 0.1, 1.0, "", "").confidence > 0.99
    unsure = judged("x", 1.1, 1.0, 1.0, "", "")
    assert not unsure.needed and 0.4 < unsure.confidence < 0.5
    assert judged("x", float("nan"), 1.0, 1.0, "", "").estimate["value"] is None


def test_the_command_prints_a_table_and_json_and_draws(tmp_path, scene, capsys):
    from dgs.benchmarks.effect_scenes import Truth, degrade, write_set
    from dgs.command_line import run

    write_set(tmp_path / "set", scene, degrade(scene, Truth(exposure=0.15)))
    call = ["inspect", str(tmp_path / "set/photos"), "--threads", "1"]
    known = ["--cameras", str(tmp_path / "set/cameras")]
    assert run([*call, *known, "--json", "--out", str(tmp_path / "out")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content == json.loads((tmp_path / "out/inspection.json").read_text())
    first = next(e for e in content["effects"] if e["name"] == "exposure")
    assert set(first) == {"name", "needed", "estimate", "confidence", "evidence", "seconds"} and first["needed"]
    for name in ("blur_map", "spectrum", "photos"):
        assert np.asarray(Image.open(tmp_path / f"out/{name}.png")).std() > 5
    assert run([*call, "--without-cameras"]) == 0
    out = capsys.readouterr().out
    assert "not measured" in out and "cameras were not asked for" in out
    assert run([*call, "--cameras", str(tmp_path / "none")]) == 2
    assert "none" in capsys.readouterr().err
