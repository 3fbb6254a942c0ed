"""Cycles shows splats as the engine's reference rasterizer does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

bpy = pytest.importorskip("bpy")

from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.gaussians import Gaussians  # noqa: E402
from dgs.core.rasterizer import RasterSettings, render  # noqa: E402
from dgs.dgs_addon.axes import place_camera  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.material import prepare_scene  # noqa: E402
from dgs.dgs_addon.scene.nodes import FACE_INPUT, set_splat_input, splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

_CAMERA = Camera("view", 96, 96, 130.0, 130.0, 48.0, 48.0, np.eye(3), np.zeros(3))


def _cycles(tmp_path: Path, as_trained: bool = False, samples: int = 24) -> NDArray[np.float64]:
    """[H, W, 4] linear light, premultiplied, rows downwards."""
    scene = bpy.context.scene
    place_camera(new_camera("view", scene), _CAMERA, scene.render)
    prepare_scene(scene, as_trained)
    scene.cycles.samples, scene.cycles.use_denoising, scene.render.film_transparent = samples, False, True
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(tmp_path / "view.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(tmp_path / "view.exr"))
    width, height = image.size
    pixels = np.array(image.pixels[:], np.float64).reshape(height, width, 4)
    bpy.data.images.remove(image)
    return pixels[::-1]


def _linear(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def _reference(cloud: GaussianCloud, **options: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Colour [H, W, 3] (sRGB, premultiplied) and opacity [H, W]."""
    gaussians = Gaussians.from_cloud(cloud, dtype=torch.float64)
    rendered = render(gaussians, _CAMERA, settings=RasterSettings(**options), backend="reference")
    return rendered.image.numpy().transpose(1, 2, 0), rendered.alpha.numpy()


def test_apart_splats_have_the_references_shape_and_colour(cloud: GaussianCloud, tmp_path: Path) -> None:
    add_twin(cloud, "twin", bpy.context.scene.collection)
    seen = _cycles(tmp_path)
    image, alpha = _reference(cloud, low_pass=0.0, alpha_minimum=0.0)
    assert alpha.max() > 0.8
    assert np.abs(seen[..., 3] - alpha).max() < 0.02
    assert np.abs(seen[..., 3] - alpha).mean() < 0.001
    solid = alpha > 0.3
    colour = image[solid] / alpha[solid, None]
    shown = seen[solid, :3] / seen[solid, 3:]
    assert np.abs(shown - _linear(colour)).max() < 0.005


def test_balls_for_any_direction_come_close(cloud: GaussianCloud, tmp_path: Path) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    set_splat_input(splat_modifier(twin), FACE_INPUT, False)
    seen = _cycles(tmp_path)
    image, alpha = _reference(cloud, low_pass=0.0, alpha_minimum=0.0)
    assert np.abs(seen[..., 3] - alpha).max() < 0.04
    solid = alpha > 0.3
    colour = image[solid] / alpha[solid, None]
    # The reference looks along the ray to each centre, a ball along the pixel's own ray.
    assert np.abs(seen[solid, :3] / seen[solid, 3:] - _linear(colour)).max() < 0.02


def test_a_crowd_blended_as_trained_is_the_engines_picture(tmp_path: Path) -> None:
    generator = np.random.default_rng(2)
    count = 300
    crowd = GaussianCloud(
        means=(generator.uniform(-1.2, 1.2, (count, 3)) + [0, 0, 5]).astype(np.float32),
        log_scales=np.log(generator.uniform(0.03, 0.35, (count, 3))).astype(np.float32),
        quaternions=generator.normal(size=(count, 4)).astype(np.float32),
        opacity_logits=generator.uniform(-2.0, 3.0, count).astype(np.float32),
        sh=(generator.uniform(-1, 1, (count, 4, 3)) * np.array([1.7, 0.3, 0.3, 0.3])[:, None]).astype(np.float32),
    )
    add_twin(crowd, "crowd", bpy.context.scene.collection)
    seen = _cycles(tmp_path, as_trained=True, samples=8)
    image, alpha = _reference(crowd, low_pass=0.0)
    assert np.abs(seen[..., :3] - image).mean() < 0.003
    assert np.abs(seen[..., :3] - image).max() < 0.06
    assert np.abs(seen[..., 3] - alpha).mean() < 0.003


def test_gloss_turns_with_the_twin(cloud: GaussianCloud, tmp_path: Path) -> None:
    cloud.sh[:, 1:] = 0.0
    cloud.sh[:, 2, 0] = 1.0  # red: along the engine's +z, away from the camera
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    ahead = _cycles(tmp_path)[..., 0].sum()
    centre = twin.matrix_world @ Vector((0.0, 0.0, 5.0))
    turn = Matrix.Translation(centre) @ Matrix.Rotation(np.pi, 4, "Z") @ Matrix.Translation(-centre)
    twin.matrix_world = turn @ twin.matrix_world
    bpy.context.view_layer.update()
    behind = _cycles(tmp_path)[..., 0].sum()
    assert behind < 0.6 * ahead


def test_the_nearer_of_two_covers_the_other(cloud: GaussianCloud, tmp_path: Path) -> None:
    two = GaussianCloud(
        means=np.array([[0, 0, 6], [0, 0, 4]], np.float32),
        log_scales=np.full((2, 3), -1.6, np.float32),
        quaternions=np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1)),
        opacity_logits=np.array([4.0, 1.0], np.float32),
        sh=np.array([[[1.7, -1.7, -1.7]], [[-1.7, 1.7, -1.7]]], np.float32),
    )
    add_twin(two, "two", bpy.context.scene.collection)
    red, green, _, alpha = _cycles(tmp_path)[46:50, 46:50].mean(axis=(0, 1))
    near, far = 1 / (1 + np.exp(-1.0)), 1 / (1 + np.exp(-4.0))
    assert green == pytest.approx(near * _linear(np.array(0.5 + 0.28209 * 1.7)), abs=0.03)
    assert red == pytest.approx((1 - near) * far * _linear(np.array(0.5 + 0.28209 * 1.7)), abs=0.03)
    assert alpha == pytest.approx(1 - (1 - near) * (1 - far), abs=0.02)
