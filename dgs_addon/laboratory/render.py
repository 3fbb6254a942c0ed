"""Cycles on the CPU: linear pictures, and depth with object index, of the current Blender file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import OutputError
from ..axes import place_camera, points_to_engine
from . import materials


def prepare(samples: int, denoise: bool, threads: int = 0, alone: bool = False) -> None:
    """Settings of all frames.

    Args:
        samples: paths per pixel.
        denoise: use OpenImageDenoise; switched off where the build lacks it (see `can_denoise`).
        threads: 0 takes all cores.
        alone: the world lights the object and is not seen; pictures have alpha.
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = denoise
    if denoise:
        scene.cycles.denoiser = "OPENIMAGEDENOISE"
        scene.cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
        scene.cycles.denoising_prefilter = "FAST"
        scene.cycles.denoising_quality = "FAST"
    scene.cycles.max_bounces = 3
    scene.cycles.diffuse_bounces = 2
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False
    scene.render.use_persistent_data = True
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.film_transparent = alone
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
    image = scene.render.image_settings
    image.file_format, image.color_mode = "OPEN_EXR", "RGBA" if alone else "RGB"
    image.color_depth, image.exr_codec = "32", "NONE"


def can_denoise() -> bool:
    """Whether this build of Blender carries OpenImageDenoise (Debian's do not)."""
    try:
        bpy.context.scene.cycles.denoiser = "OPENIMAGEDENOISE"
    except TypeError:  # build_options do not say it in every version; the list of denoisers does
        return False
    return True


def picture(camera: Camera, seed: int, scratch: Path) -> NDArray[np.float32]:
    """Renders one view: [H, W, 3] linear Rec. 709, not clipped; with alpha [H, W, 4], colours multiplied by it.

    A seed of its own for each view keeps the path tracer's error from standing still on the frame.
    """
    bpy.context.scene.cycles.seed = seed
    return _shoot(camera, scratch)


@contextmanager
def geometry_only(of: str = "depth and index") -> Iterator[None]:
    """Inside, `depth_and_index` works, or with 'normals' `surface_normals`.

    Entering costs a scene update, so do all views at once.
    """
    scene, layer = bpy.context.scene, bpy.context.view_layer
    cycles = scene.cycles
    kept = (cycles.samples, cycles.use_denoising, cycles.filter_width, scene.world)
    make = {"depth and index": materials.depth_and_index, "normals": materials.normals}[of]
    layer.material_override = bpy.data.materials.get(of) or make()
    scene.world = None
    # One sample through the middle of each pixel: nothing to average, nothing to denoise.
    cycles.samples, cycles.use_denoising, cycles.filter_width = 1, False, 0.01
    try:
        yield
    finally:
        layer.material_override = None
        cycles.samples, cycles.use_denoising, cycles.filter_width, scene.world = kept


def depth_and_index(camera: Camera, scratch: Path) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Depth along the camera's axis (metres, inf in the void) and object index, both [H, W]."""
    pixels = _shoot(camera, scratch)[..., :3]
    depth = np.where(pixels[..., 0] > 0, pixels[..., 0], np.float32(np.inf))
    return depth, np.rint(pixels[..., 1]).astype(np.int32)


def surface_normals(camera: Camera, scratch: Path) -> NDArray[np.float32]:
    """[H, W, 3] unit normals in the ENGINE's world, turned to the camera; 0 in the void."""
    pixels = _shoot(camera, scratch)[..., :3]
    void = ~pixels.any(axis=-1)
    turned = points_to_engine(2.0 * pixels - 1.0)
    turned /= np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-6)
    turned[void] = 0.0
    return turned.astype(np.float32)


def _shoot(camera: Camera, scratch: Path) -> NDArray[np.float32]:
    scene: Any = bpy.context.scene
    place_camera(scene.camera, camera, scene.render)
    file = scratch / "frame.exr"
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    if not file.is_file():
        raise OutputError(f"Blender wrote no frame to {file}", "Check the free space and the folder's permissions")
    image = bpy.data.images.load(str(file))
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        flat = np.empty(width * height * image.channels, dtype=np.float32)
        image.pixels.foreach_get(flat)
    finally:
        bpy.data.images.remove(image)
        file.unlink()
    # Blender's rows run upwards.
    channels = 4 if scene.render.film_transparent else 3
    return np.ascontiguousarray(flat.reshape(height, width, -1)[::-1, :, :channels])
