"""The Medium step's questions to the engine: real photos, the real engine in its own process, real answers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.outputs import asks_to_overwrite  # noqa: E402
from dgs.tests.core.calibration import calibration_photos as photos  # noqa: E402


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    dgs.register()
    monkeypatch.setenv("DGS_PYTHON", sys.executable)
    yield
    dgs.unregister()


def test_a_photo_of_a_point_becomes_the_medium(tmp_path: Path) -> None:
    photo = photos.photo(tmp_path / "point.png", photos.point_light(100, (50.3, 49.8), 3.0), 0.002, 8)
    settings = bpy.context.scene.dgs
    settings.blur_space = "linear"
    assert bpy.ops.dgs.measure_psf(filepath=str(photo)) == {"FINISHED"}
    assert settings.medium == "file" and Path(settings.psf_file).is_file()
    from dgs.core.imaging.psf_text import parse_psf
    from dgs.dgs_addon.questions import inspection

    psf = parse_psf(f"file:{settings.psf_file}")
    assert psf is not None and np.sqrt(psf.covariance[0, 0]) == pytest.approx(3.0, rel=0.02)
    assert inspection.point_spread.answer["sigma"] == pytest.approx(3.0, rel=0.02)
    kernel = Path(settings.psf_file)
    kernel.write_bytes(b"the user's own by now")
    with pytest.raises(RuntimeError, match="not written by this program"):
        bpy.ops.dgs.measure_psf(filepath=str(photo))
    assert asks_to_overwrite(inspection.point_spread.error), "the panel shows a button then"
    assert kernel.read_bytes() == b"the user's own by now"
    assert bpy.ops.dgs.measure_psf(filepath=str(photo), replace=True) == {"FINISHED"}
    assert parse_psf(f"file:{kernel}") is not None


def test_a_photo_of_nothing_says_so(tmp_path: Path) -> None:
    photo = photos.photo(tmp_path / "dark.png", np.full((64, 64), 0.1), 0.001, 8)
    with pytest.raises(RuntimeError, match="stands out"):
        bpy.ops.dgs.measure_psf(filepath=str(photo))
    assert bpy.context.scene.dgs.medium == "auto"


def test_a_reason_longer_than_a_files_name_is_understood() -> None:
    from dgs.core.json_shape import check_shape
    from dgs.dgs_addon.job.state import JobState
    from dgs.dgs_addon.questions import inspection

    reason = "give --psf or --glass (measure-psf, measure-glass) if there is a glass; " * 5
    evidence = {"name": "glass", "needed": False, "evidence": reason, "estimate": {"value": 0.0}}
    check_shape({"effects": [evidence]}, inspection.effects.shape, "the engine's answer")
    state = JobState()
    state.apply({"event": "note", "text": reason})
    state.apply({"event": "error", "text": reason, "status": 2})
    assert state.error == reason


def test_photos_are_inspected(tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    random = np.random.default_rng(0)
    for i in range(5):
        blocks = np.kron(random.uniform(0, 1, (24, 32, 3)), np.ones((6, 6, 1)))
        Image.fromarray(np.round(blocks * 255).astype(np.uint8)).save(tmp_path / "set" / f"{i}.png")
    settings = bpy.context.scene.dgs
    settings.photos = str(tmp_path / "set")
    assert bpy.ops.dgs.inspect_photos() == {"FINISHED"}
    from dgs.dgs_addon.questions import inspection

    effects = {e["name"]: e for e in inspection.effects.answer["effects"]}
    assert effects["blur"]["estimate"]["value"] is not None and effects["exposure"]["estimate"]["value"] is None
    lines = inspection.sentences(inspection.effects.answer)
    assert any(text.startswith("Blur: ") for text, _ in lines) and not any("Not measured" in text for text, _ in lines)
    assert (tmp_path / "set-twin/inspection/inspection.json").is_file()
