"""Transparent photos through the whole program: a twin, an update, what is known of it, an inspection, renders."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.command_line import run
from dgs.core.background import WHITE
from dgs.core.formats.colmap import write_model
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import render
from dgs.core.views import SparsePoints
from dgs.tests.command_line.scene import scene_cameras, scene_gaussians
from PIL import Image

QUIET = ("--progress", "none", "--threads", "2")


def part_of_the_sheet() -> Gaussians:
    sheet = scene_gaussians()
    near = torch.linalg.vector_norm(sheet.means[:, :2], dim=1) < 0.9
    return Gaussians(**{name: tensor[near] for name, tensor in sheet.named()})


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """photos/ and new/ as RGBA files whose colours under alpha 0 are green, sharp/ the same, model/."""
    folder, gaussians, cameras = tmp_path_factory.mktemp("transparent"), part_of_the_sheet(), scene_cameras()
    for name in ("photos", "new", "all"):
        (folder / name).mkdir()
    for index, camera in enumerate(cameras):
        seen = render(gaussians, camera)
        alpha = seen.alpha.detach().numpy()
        straight = np.where(alpha > 0, seen.image.detach().numpy() / np.maximum(alpha, 1e-6), 0).clip(0, 1)
        straight[:, alpha == 0] = np.array([0.0, 1.0, 0.0])[:, None]
        rgba = np.round(np.concatenate([straight, alpha[None]]) * 255).astype(np.uint8).transpose(1, 2, 0)
        for where in ("all", "new" if index == 5 else "photos"):
            Image.fromarray(rgba).save(folder / where / camera.name)
    positions = gaussians.means.double().numpy()
    points = SparsePoints(positions, np.full((len(positions), 3), 128, np.uint8))
    write_model(folder / "model", {camera.name: camera for camera in cameras}, points)
    return folder


@pytest.fixture(scope="module")
def twin(scene) -> Path:
    arguments = ["--cameras", scene / "model", "--preset", "draft", "--max-gaussians", "2000", "--holdout-every", "4"]
    arguments += ["--sh-degree", "0", "--truth", scene / "all"]
    assert run(["reconstruct", *map(str, [scene / "photos", "--out", scene / "twin", *arguments]), *QUIET]) == 0
    return scene / "twin"


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path)).astype(float) / 255


def test_the_report_says_what_is_behind_the_object(twin) -> None:
    report = json.loads((twin / "report.json").read_text("utf-8"))
    assert report["photos"]["background"] == "white" and report["photos"]["transparent"] == 8
    assert any("count as empty; they are shown over white" in note for note in report["notes"])
    assert "Empty space where the photos are transparent" in (twin / "report.html").read_text("utf-8")
    # Photos and truth over white are the same pictures here, and so are their scores.
    assert report["heldout"]["degraded"]["psnr"] > 24
    assert report["heldout"]["sharp"]["psnr"] == pytest.approx(report["heldout"]["degraded"]["psnr"], abs=0.2)
    for name in report["heldout"]["names"]:
        shown = pixels(twin / "renders" / name)
        np.testing.assert_allclose(shown[:8, :8], 1.0, atol=0.02)


def test_renders_over_a_colour_and_over_nothing(scene, twin, tmp_path) -> None:
    common = ["render", str(twin / "twin.ply"), "--cameras", str(twin / "cameras"), *QUIET]
    for background in ("black", "white", "#4080c0", "transparent"):
        assert run([*common, "--out", str(tmp_path / background), "--background", background]) == 0
    assert run([*common, "--out", str(tmp_path / "usual")]) == 0
    name = next((tmp_path / "usual").iterdir()).name
    black, white, blue, clear, usual = (
        pixels(tmp_path / which / name) for which in ("black", "white", "#4080c0", "transparent", "usual")
    )
    np.testing.assert_array_equal(black, usual)
    alpha = clear[:, :, 3:]
    assert clear.shape[2] == 4 and alpha[:8, :8].max() < 0.02 and alpha.max() > 0.9
    for colour, seen in (((0, 0, 0), black), (WHITE, white), ((0x40 / 255, 0x80 / 255, 0xC0 / 255), blue)):
        apart = np.abs(clear[:, :, :3] * alpha + (1 - alpha) * np.asarray(colour) - seen)
        assert np.quantile(apart, 0.999) < 2.1 / 255  # but for colours outside [0, 1], which files cut
    filed = pixels(scene / "all" / name)[:, :, 3]
    assert np.abs(alpha[:, :, 0] - filed).mean() < 0.1
    assert run([*common, "--out", str(tmp_path / "x"), "--background", "mauve"]) == 2


def test_new_photos_and_the_next_view(scene, twin) -> None:
    assert run(["update", str(twin), str(scene / "new"), "--cameras", str(scene / "model"), *QUIET]) == 0
    update = json.loads((twin / "update.json").read_text("utf-8"))
    assert update["psnr_new"][1] > 20 and update["psnr_old"][1] > 24
    assert run(["next-view", str(twin), "--samples", "2", *QUIET]) == 0


def test_an_inspection(scene, capsys) -> None:
    assert run(["inspect", str(scene / "photos"), "--cameras", str(scene / "model"), "--json", *QUIET]) == 0
    found = {effect["name"]: effect for effect in json.loads(capsys.readouterr().out)["effects"]}
    assert not found["saturation"]["needed"]  # white is put behind the object, and no clipped highlight
