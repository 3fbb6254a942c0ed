"""F12, animations and `blender -b` with the engine "Descatter" give what `run_dgs.py render` gives."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.command_line import run  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.ply import write_ply  # noqa: E402
from dgs.core.formats.transforms import write_transforms  # noqa: E402
from dgs.dgs_addon.axes import place_camera, read_camera  # noqa: E402
from dgs.dgs_addon.drawing import live, process  # noqa: E402
from dgs.dgs_addon.drawing.render_engine import ENGINE  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.crop import add_crop_box  # noqa: E402
from dgs.dgs_addon.scene.nodes import SIZE_INPUT, THRESHOLD_INPUT, set_splat_input, splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.tests.core.serving.test_pictures import crowd  # noqa: E402
from mathutils import Matrix  # noqa: E402

ROOT = Path(dgs.__path__[0])
CAMERA = Camera("view", 120, 90, 130.0, 130.0, 60.0, 45.0, np.eye(3), np.array([0.1, 0.0, 0.2]))


@pytest.fixture(scope="module", autouse=True)
def server() -> Iterator[None]:
    """One process for all tests: starting it takes seconds."""
    kept, process.stop = process.stop, lambda: None
    yield
    process.stop = kept
    process.stop()


@pytest.fixture
def scene() -> Iterator[Any]:
    dgs.register()
    scene = bpy.context.scene
    scene.render.engine = ENGINE
    scene.view_settings.view_transform, scene.render.dither_intensity = "Standard", 0.0
    scene.render.image_settings.file_format = "PNG"
    place_camera(new_camera("view", scene), CAMERA, scene.render)
    yield scene
    dgs.unregister()


def rendered(scene: Any, path: Path) -> np.ndarray:
    """[H, W, C] 8 bit as int."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.asarray(Image.open(path)).astype(int)


def by_command(cloud: GaussianCloud, camera: Camera, folder: Path, background: str = "black") -> np.ndarray:
    write_ply(folder / "twin.ply", cloud)
    write_transforms(folder / "transforms.json", {"view.png": camera})
    options = ["--cameras", folder / "transforms.json", "--out", folder / "out", "--overwrite"]
    command = ["render", folder / "twin.ply", *options, "--background", background, "--progress", "none"]
    assert run([str(word) for word in command]) == 0
    return np.asarray(Image.open(folder / "out" / "view.png")).astype(int)


def test_the_saved_picture_is_the_commands_to_one_step(scene: Any, tmp_path: Path) -> None:
    cloud = crowd()
    add_twin(cloud, "twin", scene.collection)
    seen = rendered(scene, tmp_path / "a.png")
    wanted = by_command(cloud, CAMERA, tmp_path)
    assert wanted.std() > 30 and np.abs(seen[..., :3] - wanted).max() <= 1
    assert live.wanted()
    scene.render.film_transparent = True
    scene.render.image_settings.color_mode = "RGBA"
    clear = rendered(scene, tmp_path / "b.png")
    straight = by_command(cloud, CAMERA, tmp_path, "transparent")
    assert np.abs(clear[..., 3] - straight[..., 3]).max() <= 1
    solid = straight[..., 3] > 64
    assert np.abs(clear - straight)[solid].max() <= 2  # (both round colours that were divided by alpha)
    scene.render.film_transparent, scene.dgs_background = False, (1.0, 1.0, 1.0)
    white = rendered(scene, tmp_path / "c.png")
    assert np.abs(white[..., :3] - by_command(cloud, CAMERA, tmp_path, "white")).max() <= 1


def test_twins_that_were_moved_cropped_and_limited(scene: Any, tmp_path: Path) -> None:
    """A twin that is moved together with the camera is the same picture; its limits are the ones of its modifier."""
    cloud = crowd()
    twin = add_twin(cloud, "twin", scene.collection)
    before = rendered(scene, tmp_path / "a.png")
    move = Matrix.Translation((3, 4, 5)) @ Matrix.Rotation(1.2, 4, (1, 2, 3)) @ Matrix.Scale(2.0, 4)
    twin.matrix_world = move @ twin.matrix_world
    scene.camera.matrix_world = move @ scene.camera.matrix_world
    assert np.abs(rendered(scene, tmp_path / "b.png") - before).max() <= 1
    modifier = splat_modifier(twin)
    for name, value in ((SIZE_INPUT, 0.4), (THRESHOLD_INPUT, 0.7)):
        set_splat_input(modifier, name, value)
        after = rendered(scene, tmp_path / "c.png")
        assert np.abs(after - before).max() > 60
        before = after
    box = add_crop_box(twin, scene.collection)
    box.scale = [0.5 * value for value in box.scale]
    cropped = rendered(scene, tmp_path / "d.png")
    assert (cropped[..., :3].max(axis=2) > 8).mean() < 0.8 * (before[..., :3].max(axis=2) > 8).mean()
    twin.hide_render = True
    assert not rendered(scene, tmp_path / "e.png")[..., :3].any()


def test_a_part_of_the_frame_and_depth(scene: Any, tmp_path: Path) -> None:
    cloud = crowd()
    add_twin(cloud, "twin", scene.collection)
    whole = rendered(scene, tmp_path / "a.png")
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.2, 0.5
    part = rendered(scene, tmp_path / "b.png")
    assert part.shape[:2] == (27, 60) and np.abs(part - whole[45:72, 30:90]).max() <= 2
    render.use_border = False
    scene.view_layers[0].use_pass_z = True
    if hasattr(render.image_settings, "media_type"):  # from Blender 5.0 on
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    render.filepath = str(tmp_path / "deep.exr")
    bpy.ops.render.render(write_still=True)
    assert b"Depth" in (tmp_path / "deep.exr").read_bytes()[:4096]


def test_without_perspective_and_without_a_way(scene: Any, tmp_path: Path) -> None:
    cloud = crowd()
    add_twin(cloud, "twin", scene.collection)
    whole = rendered(scene, tmp_path / "a.png")
    camera = scene.camera.data
    camera.type, camera.ortho_scale = "ORTHO", 120 / 130 * 5.2
    flat = rendered(scene, tmp_path / "b.png")
    assert 4 < np.abs(flat - whole).mean() < 40, "alike where the distance is that of the scale, no more"
    camera.type = "PANO"
    with pytest.raises(RuntimeError, match="no panoramas"):
        bpy.ops.render.render()
    scene.camera = None
    with pytest.raises(RuntimeError, match="camera"):
        bpy.ops.render.render()


def test_a_killed_server_is_started_again(scene: Any, tmp_path: Path) -> None:
    add_twin(crowd(), "twin", scene.collection)
    before = rendered(scene, tmp_path / "a.png")
    server = process.picture_server()
    assert server.pid is not None
    pid, starts = server.pid, server.starts
    os.kill(pid, signal.SIGKILL)
    assert (rendered(scene, tmp_path / "b.png") == before).all()
    assert server.pid != pid and server.starts == starts + 1


def test_an_engine_that_cannot_start_is_said(scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add_twin(crowd(), "twin", scene.collection)
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho 'no such library' >&2\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setenv("DGS_ENGINE_PYTHON", str(broken))
    monkeypatch.setattr(process, "_server", None)  # (the tests' own goes on)
    with pytest.raises(RuntimeError, match="status 3: no such library"):
        bpy.ops.render.render()
    assert not live.wanted(), "twins keep their balls where nobody draws their splats"


#: A Blender that renders once and waits to be killed.
BLENDER = """
import sys, time, run_dgs; run_dgs.mount_package()
import bpy, dgs
dgs.register()
from dgs.dgs_addon.drawing import process
from dgs.dgs_addon.scene.twin import add_twin
from dgs.tests.core.serving.test_pictures import crowd
scene = bpy.context.scene
scene.render.engine, scene.render.resolution_percentage = "DESCATTER", 5
add_twin(crowd(), "twin", scene.collection)
bpy.ops.render.render()
print("rendered", process.picture_server().pid, flush=True)
time.sleep(60)
"""


def test_it_ends_with_blender_however_that_ends() -> None:
    blender = subprocess.Popen([sys.executable, "-c", BLENDER], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert blender.stdout is not None
    said = next(line for line in blender.stdout if line.startswith("rendered"))
    pid = int(said.split()[1])
    assert Path(f"/proc/{pid}").exists()
    os.kill(blender.pid, signal.SIGKILL)
    blender.wait(10)
    end = time.monotonic() + 10
    while Path(f"/proc/{pid}/cmdline").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}/cmdline").exists()


def test_the_pictures_camera_is_the_one_that_was_placed(scene: Any) -> None:
    assert np.allclose(read_camera(scene.camera, scene.render, "view").rotation, CAMERA.rotation, atol=1e-6)
