"""Tiny data sets rendered for real: cameras, borders, repeatability, interruption."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.errors import Cancelled  # noqa: E402
from dgs.core.progress import Silent  # noqa: E402
from dgs.dgs_addon.axes import place_camera, points_to_engine  # noqa: E402
from dgs.dgs_addon.laboratory import rail  # noqa: E402
from dgs.dgs_addon.laboratory.dataset import synthesize  # noqa: E402
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings  # noqa: E402
from mathutils import Vector  # noqa: E402
from PIL import Image  # noqa: E402
from scipy.ndimage import gaussian_filter  # noqa: E402

TINY = SynthesizeSettings(
    views=3,
    width=32,
    height=24,
    psf="gaussian:1",
    overscan=6,
    samples=1,
    denoise=False,
    masks=True,
    depth=True,
    keep_linear=True,
)


class StopsAfter(Silent):
    """Asks to stop once `frames` frames are rendered."""

    def __init__(self, frames: int) -> None:
        self.frames, self.done = frames, 0

    def advance(self, done: int, **figures: float) -> None:
        self.done = done

    def cancelled(self) -> bool:
        return self.done >= self.frames


def _files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the frames that Cycles was asked for."""
    from dgs.dgs_addon.laboratory import render

    names: list[str] = []
    original = render.picture

    def counted(camera: Camera, seed: int, scratch: Path) -> np.ndarray:
        names.append(camera.name)
        return original(camera, seed, scratch)

    monkeypatch.setattr(render, "picture", counted)
    return names


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tiny")
    synthesize(TINY, out)
    return out


@pytest.mark.parametrize("path", ["rail", "orbit", "dome"])
def test_cameras_project_as_blender_does(path: str) -> None:
    scene = bpy.context.scene
    camera_object = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera_object)
    points = np.random.default_rng(0).uniform(-0.1, 0.15, (20, 3))
    for camera in rail.cameras(path, 5, 80, 53):
        wide = camera.with_margin(7)
        place_camera(camera_object, wide, scene.render)
        bpy.context.view_layer.update()
        local = points_to_engine(points) @ wide.rotation.T + wide.translation
        ours = local[:, :2] / local[:, 2:] * [wide.fx, wide.fy] + [wide.cx, wide.cy]
        seen = np.array([world_to_camera_view(scene, camera_object, Vector(point)) for point in points])
        theirs = np.stack([seen[:, 0] * wide.width, (1 - seen[:, 1]) * wide.height], axis=1)
        assert np.abs(ours - theirs).max() < 1e-3
        assert np.allclose(seen[:, 2], local[:, 2], atol=1e-5)


def test_rail_is_the_papers() -> None:
    centres = np.array([camera.centre for camera in rail.cameras("rail", 76, 800, 533)])
    assert np.linalg.norm(centres[-1] - centres[0]) == pytest.approx(0.42)
    to_ball = points_to_engine(rail.TARGET) - centres[[0, -1]]
    cosine = to_ball[0] @ to_ball[1] / np.prod(np.linalg.norm(to_ball, axis=1))
    assert np.degrees(np.arccos(cosine)) == pytest.approx(36.6, abs=0.1)


def test_photos_are_blurred_beyond_their_borders(tiny: Path) -> None:
    for camera in rail.cameras("rail", 3, 32, 24):
        light = np.load(tiny / "linear" / f"{camera.name}.npy").astype(np.float64).clip(0, 1)
        assert light.shape == (24 + 12, 32 + 12, 3)
        encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        photo = gaussian_filter(encoded, (1, 1, 0), truncate=6, mode="nearest")[6:-6, 6:-6] * 255
        assert np.abs(_pixels(tiny / "photos" / camera.name) - photo).max() <= 0.5001
        assert np.abs(_pixels(tiny / "sharp" / camera.name) - encoded[6:-6, 6:-6] * 255).max() <= 0.5001
        closed = gaussian_filter(encoded[6:-6, 6:-6], (1, 1, 0), mode="nearest") * 255
        assert np.abs(closed - photo)[0].max() > 2, "a border without overscan would pass as well"


def test_depth_puts_the_table_at_height_zero_and_the_mask_on_the_ball(tiny: Path) -> None:
    for camera in rail.cameras("rail", 3, 32, 24):
        depth = np.load(tiny / "depth" / f"{Path(camera.name).stem}.npy").astype(np.float64)
        mask = _pixels(tiny / "masks_ball" / camera.name) > 0
        rows, columns = np.mgrid[:24, :32] + 0.5
        rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones((24, 32))], -1)
        world = (rays * depth[..., None] - camera.translation) @ camera.rotation
        height = -world[..., 1]
        assert 0.1 < mask.mean() < 0.4
        assert np.median(np.abs(height[~mask])) < 1e-4
        assert height[mask].max() == pytest.approx(0.19, abs=0.02)
        assert np.linalg.norm(world[mask] - points_to_engine([0.0, 0.0, 0.095]), axis=1).max() < 0.15


def test_the_same_settings_give_the_same_bits(tiny: Path, tmp_path: Path) -> None:
    synthesize(TINY, tmp_path)
    assert _files(tmp_path) == _files(tiny)
    assert (tiny / "cameras" / "points3D.txt").is_file() and (tiny / "manifest.json").is_file()


def test_another_seed_gives_other_photos(tiny: Path, tmp_path: Path) -> None:
    synthesize(replace(TINY, seed=1, views=1), tmp_path)
    assert (tmp_path / "photos/view_000.png").read_bytes() != (tiny / "photos/view_000.png").read_bytes()


def test_an_interrupted_set_is_taken_up_again(tiny: Path, tmp_path: Path, rendered: list[str]) -> None:
    with pytest.raises(Cancelled):
        synthesize(TINY, tmp_path, StopsAfter(1))
    assert not (tmp_path / "manifest.json").exists()
    assert rendered == ["view_000.png"]
    synthesize(TINY, tmp_path)
    assert rendered == ["view_000.png", "view_001.png", "view_002.png"]
    assert _files(tmp_path) == _files(tiny)


def test_another_medium_reuses_the_frames(tmp_path: Path, rendered: list[str]) -> None:
    synthesize(TINY, tmp_path)
    sharp = (tmp_path / "sharp/view_000.png").read_bytes()
    blurred = (tmp_path / "photos/view_000.png").read_bytes()
    rendered.clear()
    synthesize(replace(TINY, psf="none"), tmp_path)
    assert rendered == []
    assert (tmp_path / "photos/view_000.png").read_bytes() == sharp != blurred


def test_frames_of_other_settings_do_not_stay(tmp_path: Path) -> None:
    synthesize(replace(TINY, views=2), tmp_path)
    synthesize(replace(TINY, views=1, seed=5), tmp_path)
    assert [p.name for p in (tmp_path / "photos").iterdir()] == ["view_000.png"]
    assert [p.name for p in (tmp_path / "linear").iterdir()] == ["view_000.png.npy"]
