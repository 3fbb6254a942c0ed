"""Step 6's own data: a test set from the laboratory, and a finished twin measured against its sharp photos."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.dgs_addon.job.record import Record  # noqa: E402
from dgs.dgs_addon.job.steps import results  # noqa: E402
from dgs.dgs_addon.job.test_set import test_set_request as request_of  # noqa: E402
from dgs.operators import compare_truth  # noqa: E402


@pytest.fixture
def settings(monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    monkeypatch.setenv("DGS_ENGINE_PYTHON", sys.executable)
    dgs.register()
    yield bpy.context.scene.dgs
    dgs.unregister()


def refused(operator: str, words: str) -> None:
    with pytest.raises(RuntimeError, match=words):
        getattr(bpy.ops.dgs, operator)()


def test_buttons_say_what_is_missing(settings: object, tmp_path: Path) -> None:
    refused("make_test_set", "Choose a folder for the test set first")
    refused("compare_truth", "Choose the folder of photos first")
    settings.test_set, settings.medium = str(tmp_path / "set"), "file"
    refused("make_test_set", "point spread function is not there")
    for settings.medium in ("auto", "auto-each"):  # nothing to estimate it from yet: a Gaussian that is to be found
        arguments, settings.sigma = request_of(settings).arguments, 3.5
        assert arguments[arguments.index("--psf") + 1].startswith("gaussian:")
    assert "gaussian:3.5" in request_of(settings).arguments
    (tmp_path / "file").write_text("in the way", "utf-8")
    settings.test_set, settings.medium = str(tmp_path / "file" / "set"), "none"
    refused("make_test_set", "file")
    for name in "abc":
        (tmp_path / f"{name}.png").write_bytes(b"\x89PNG" + bytes(40))
    settings.photos = str(tmp_path)
    refused("compare_truth", "There is no finished run yet")


def test_a_set_through_what_cycles_renders(settings: object, tmp_path: Path) -> None:
    settings.test_set, settings.medium = str(tmp_path / "set"), "auto"
    settings.test_medium, settings.test_sharp = "shake", 0.25
    arguments = request_of(settings).arguments
    assert arguments[arguments.index("--medium") :][:4] == ["--medium", "shake:4..12", "--sharp-share", "0.25"]
    assert "--psf" not in arguments
    settings.test_medium, settings.test_values = "frosted-glass", " 0.4,1 "
    arguments = request_of(settings).arguments
    assert arguments[arguments.index("--medium") + 1] == "frosted-glass:0.4,1" and "--sharp-share" not in arguments
    settings.test_values = "0.4,-1"
    refused("make_test_set", "angle above 0")


def test_another_truth_takes_the_place_of_the_first(settings: object, tmp_path: Path) -> None:
    photos, out = tmp_path / "photos", tmp_path / "photos-twin"
    photos.mkdir()
    for name in "abc":
        (photos / f"{name}.png").write_bytes(b"\x89PNG" + bytes(12) + bytes((0, 0, 0, 8, 0, 0, 0, 8)))
    settings.photos, settings.truth = str(photos), str(photos)
    Record("reconstruct", str(photos), 3, {"seed": 1, "truth": "/old"}, phase="done").save(out)
    asked = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            compare_truth, "start_job", lambda _operator, _context, make: asked.append(make()) or {"FINISHED"}
        )
        assert bpy.ops.dgs.compare_truth() == {"FINISHED"}
    arguments = asked[0].arguments
    assert arguments.count("--truth") == 1 and arguments[arguments.index("--truth") + 1] == str(photos)
    assert arguments[:6] == ["reconstruct", str(photos), "--out", str(out), "--seed", "1"] and asked[0].resume


@pytest.mark.timeout(300)
def test_from_a_rendered_set_to_the_twins_score_against_the_truth(settings: object, tmp_path: Path) -> None:
    settings.test_set, settings.test_views, settings.test_width = str(tmp_path / "set"), 6, 96
    settings.medium, settings.sigma = "gaussian", 1.0
    assert bpy.ops.dgs.make_test_set() == {"FINISHED"}
    assert settings.photos == str(tmp_path / "set" / "photos") and settings.cameras == "model"
    for folder in ("photos", "sharp"):
        assert len(list((tmp_path / "set" / folder).glob("*.png"))) == 6
    truth, settings.truth = settings.truth, ""
    settings.preset, settings.max_gaussians, settings.holdout_every = "draft", 1000, 3
    settings.effects = "usual"  # trials take longer than these runs
    assert bpy.ops.dgs.optimize() == {"FINISHED"}
    assert results(bpy.context.scene).report["heldout"]["sharp"]["psnr"] is None
    refused("compare_truth", "Choose the folder of sharp photos first")
    settings.truth = str(tmp_path / "nowhere")
    refused("compare_truth", "The folder of sharp photos is not there")
    settings.truth = truth
    before = (tmp_path / "set" / "photos-twin" / "twin.ply").read_bytes()
    assert bpy.ops.dgs.compare_truth() == {"FINISHED"}
    held = results(bpy.context.scene).report["heldout"]
    assert held["sharp"]["psnr"] > 10 and held["bands"]
    assert (tmp_path / "set" / "photos-twin" / "twin.ply").read_bytes() == before  # nothing was optimized again
