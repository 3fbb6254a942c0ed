"""A .blend with glowing squares in the dark at known depths, and how wide their pictures are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from dgs.core.photos.png16 import read_png16
from dgs.dgs_addon.laboratory import degrade
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings

WIDTH, HEIGHT, LENS = 96, 64, 80.0
FOCAL = WIDTH * LENS / 36  # px

#: column, row (px), depth, side (px)
Lamp = tuple[float, float, float, float]


def lamps(file: Path, squares: Sequence[Lamp], strength: float = 0.6, **changes: object) -> SynthesizeSettings:
    """Settings of a set of `squares` seen by a camera at the origin that looks along the engine's z."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    glow = bpy.data.materials.new("glow")
    if glow.node_tree is None:
        glow.use_nodes = True
    nodes = glow.node_tree.nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 1, 1, 1), strength
    glow.node_tree.links.new(emission.outputs[0], output.inputs[0])
    for column, row, depth, side in squares:
        place = ((column - WIDTH / 2) / FOCAL * depth, depth, -(row - HEIGHT / 2) / FOCAL * depth)
        bpy.ops.mesh.primitive_plane_add(size=side / FOCAL * depth, location=place, rotation=(np.pi / 2, 0, 0))
        bpy.context.object.data.materials.append(glow)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.lens, eye.rotation_euler = LENS, (np.pi / 2, 0, 0)
    scene.collection.objects.link(eye)
    scene.camera, scene.frame_start, scene.frame_end = eye, 1, 2
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    usual: dict[str, object] = {
        "views": 1, "width": WIDTH, "height": HEIGHT, "psf": "none", "bits": 16, "samples": 256, "denoise": False,
        "overscan": 0, "scene": str(file), "path": "scene", "holdout_every": 0,
    }  # fmt: skip
    return SynthesizeSettings(**{**usual, **changes})  # type: ignore[arg-type]


def light(out: Path, folder: str = "photos", view: int = 0) -> np.ndarray:
    """[H, W] linear."""
    return degrade.decode(read_png16(out / folder / f"view_{view:03d}.png")[..., 1] / 65535.0)


def moments(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle (column, row) of the light, and its [2, 2] covariance in px^2."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    places = np.stack([columns.ravel(), rows.ravel()])
    weights = image.ravel() / image.sum()
    middle = places @ weights
    away = places - middle[:, None]
    return middle, (away * weights) @ away.T


def edge(profile: np.ndarray) -> float:
    """Standard deviation (px) of a Gaussian that a step has been blurred with, by fitting an error function."""
    from scipy.optimize import curve_fit
    from scipy.special import ndtr

    at = np.arange(len(profile), dtype=float)

    def step(x: np.ndarray, low: float, high: float, place: float, width: float) -> np.ndarray:
        return low + (high - low) * ndtr((x - place) / width)

    start = (profile[0], profile[-1], len(profile) / 2, 1.0)
    return float(abs(curve_fit(step, at, profile, start)[0][3]))
