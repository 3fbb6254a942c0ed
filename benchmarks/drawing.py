"""Final pictures with the render engine "Descatter": seconds a picture and a turntable, difference from the command.

    python -m benchmarks.drawing TWIN.ply MODEL

in a Python with Blender's module; MODEL holds the cameras, of which three are used.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import run_dgs

run_dgs.mount_package()

import bpy  # noqa: E402
import dgs  # noqa: E402
from dgs.command_line import run  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.formats.cameras import read_cameras  # noqa: E402
from dgs.core.formats.gaussians import read_gaussians  # noqa: E402
from dgs.core.formats.transforms import write_transforms  # noqa: E402
from dgs.core.photos.undistort import Undistortion  # noqa: E402
from dgs.dgs_addon.axes import place_camera  # noqa: E402
from dgs.dgs_addon.drawing.render_engine import ENGINE  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from PIL import Image  # noqa: E402

#: Width of the pictures in px.
WIDTH = 800
FRAMES = 100


def three_cameras(model: Path) -> dict[str, Camera]:
    """The first, the middle and the last, `WIDTH` px wide."""
    found = read_cameras(model)
    names = sorted(found.poses)
    cameras = {}
    for number, name in enumerate((names[0], names[len(names) // 2], names[-1])):
        camera = Undistortion(found.lenses[name]).camera(f"{number}.png", found.poses[name])
        cameras[camera.name] = camera.resized(WIDTH, round(camera.height * WIDTH / camera.width))
    return cameras


def rendered(scene: Any, path: Path) -> np.ndarray:
    """[H, W, 3] 8 bit as int, without dither."""
    scene.render.filepath, scene.render.dither_intensity = str(path), 0.0
    bpy.ops.render.render(write_still=True)
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def turntable(scene: Any, twin: Any, folder: Path) -> float:
    """Seconds of `FRAMES` frames around the twin."""
    pivot = bpy.data.objects.new("pivot", None)
    scene.collection.objects.link(pivot)
    pivot.location = twin.matrix_world @ twin.data.vertices[0].co
    scene.camera.parent, scene.camera.matrix_parent_inverse = pivot, pivot.matrix_world.inverted()
    for frame, angle in ((1, 0.0), (FRAMES + 1, 2 * math.pi)):
        pivot.rotation_euler[2] = angle
        pivot.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, FRAMES, str(folder / "turn")
    began = time.perf_counter()
    bpy.ops.render.render(animation=True)
    return time.perf_counter() - began


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("twin", type=Path)
    parser.add_argument("cameras", type=Path)
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    dgs.register()
    cloud, cameras = read_gaussians(options.twin), three_cameras(options.cameras)
    scene = bpy.context.scene
    scene.render.engine, scene.view_settings.view_transform = ENGINE, "Standard"
    twin = add_twin(cloud, "twin", scene.collection)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        write_transforms(folder / "t.json", cameras)
        words = ["render", options.twin, "--cameras", folder / "t.json", "--out", folder / "out", "--progress", "none"]
        assert run([str(word) for word in words]) == 0
        for name, camera in cameras.items():
            place_camera(new_camera(name, scene), camera, scene.render)
            rendered(scene, folder / "warm.png")
            began = time.perf_counter()
            seen = rendered(scene, folder / "final.png")
            took = time.perf_counter() - began
            away = np.abs(seen - np.asarray(Image.open(folder / "out" / name)).astype(int))
            size = f"{camera.width} x {camera.height}"
            print(f"{len(cloud)} splats, {size}: {took:.2f} s, mean {away.mean():.4f}, largest {away.max()}")
        seconds = turntable(scene, twin, folder)
        print(f"{FRAMES} frames: {seconds:.1f} s at a load of {os.getloadavg()[0]:.1f}")
    dgs.unregister()


if __name__ == "__main__":
    main()
