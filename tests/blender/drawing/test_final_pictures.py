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
from dgs.dgs_addon.drawing.render_engine import ENGINE, EXPECTED_ERROR  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.crop import add_crop_box  # noqa: E402
from dgs.dgs_addon.scene.known import KNOWN  # noqa: E402
from dgs.dgs_addon.scene.medium import FOCAL  # noqa: E402
from dgs.dgs_addon.scene.nodes import SIZE_INPUT, THRESHOLD_INPUT, set_splat_input, splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.tests.core.serving.test_pictures import crowd  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402

ROOT = Path(dgs.__path__[0])
pytestmark = pytest.mark.usefixtures("one_picture_server")
CAMERA = Camera("view", 120, 90, 130.0, 130.0, 60.0, 45.0, np.eye(3), np.array([0.1, 0.0, 0.2]))


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


def by_command(
    cloud: GaussianCloud, camera: Camera, folder: Path, background: str = "black", options: tuple[str, ...] = ()
) -> np.ndarray:
    write_ply(folder / "twin.ply", cloud)
    write_transforms(folder / "transforms.json", {"view.png": camera})
    options = (*options, "--cameras", folder / "transforms.json", "--out", folder / "out", "--overwrite")
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


def test_a_part_of_the_frame(scene: Any, tmp_path: Path) -> None:
    cloud = crowd()
    add_twin(cloud, "twin", scene.collection)
    whole = rendered(scene, tmp_path / "a.png")
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.2, 0.5
    part = rendered(scene, tmp_path / "b.png")
    assert part.shape[:2] == (27, 60) and np.abs(part - whole[45:72, 30:90]).max() <= 2


def passes(scene: Any, path: Path) -> dict[str, np.ndarray]:
    """[H, W] of each channel of a multilayer file, by the ends of their names: 'Depth.Z'."""
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # from Blender 5.0 on
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.exr_codec, settings.color_depth = "NONE", "32"
    if hasattr(settings, "use_exr_interleave"):  # all channels in one part, as Blender 4 has them
        settings.use_exr_interleave = True
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return read_exr(path)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """An uncompressed file of 32 bit floats, as openexr.com lays it out: attributes, offsets, rows of channels."""
    data, at, names, size = path.read_bytes(), 8, [], (0, 0)

    def text() -> str:
        nonlocal at
        end = data.index(b"\0", at)
        found, at = data[at:end].decode(), end + 1
        return found

    while (name := text()) != "":
        kind, length = text(), int.from_bytes(data[at : at + 4], "little")
        at, end = at + 4, at + 4 + length
        if kind == "chlist":
            while (channel := text()) != "":
                assert int.from_bytes(data[at : at + 4], "little") == 2, "32 bit"
                names.append(channel)
                at += 16
        elif name == "dataWindow":
            left, top, right, bottom = np.frombuffer(data, "<i4", 4, at)
            size = int(bottom - top + 1), int(right - left + 1)
        at = end
    height, width = size
    rows = np.frombuffer(data, "<u8", height, at)
    pixels = np.stack([np.frombuffer(data, "<f4", len(names) * width, int(row) + 8) for row in rows])
    return {channel.split(".", 1)[-1]: pixels[:, i * width : (i + 1) * width] for i, channel in enumerate(names)}


def test_depth_and_alpha_are_the_cameras(scene: Any, tmp_path: Path) -> None:
    add_twin(crowd(), "twin", scene.collection)
    layer = scene.view_layers[0]
    layer.use_pass_z, layer.pass_alpha_threshold, scene.render.film_transparent = True, 0.2, True
    found = passes(scene, tmp_path / "deep.exr")
    depth, alpha = found["Depth.Z"], found["Combined.A"]
    seen = alpha > 0.2
    assert 0.2 < seen.mean() < 1.0 and (depth[~seen] == 1e10).all()
    assert depth[seen].min() > 3.4 and depth[seen].max() < 6.8, "the crowd lies 3.7 to 6.3 before the origin"
    scene.camera.location -= scene.camera.matrix_world.to_3x3() @ Vector((0.0, 0.0, -2.0))
    farther = passes(scene, tmp_path / "farther.exr")["Depth.Z"]
    assert np.median(farther[farther < 1e9]) - np.median(depth[seen]) == pytest.approx(2.0, abs=0.3)
    assert (alpha[~seen] <= 0.2).all() and found["Combined.R"][alpha == 0].max(initial=0.0) == 0.0


def test_the_expected_error_is_that_of_the_splats_one_sees(scene: Any, tmp_path: Path) -> None:
    """Where the nearer splats are known, what lies behind them hardly counts."""
    cloud = crowd()
    twin = add_twin(cloud, "twin", scene.collection)
    setattr(scene.view_layers[0], EXPECTED_ERROR, True)
    unknown = passes(scene, tmp_path / "unknown.exr")
    share, alpha = unknown["Expected Error.X"], unknown["Combined.A"]
    assert alpha.all() and share.max() == pytest.approx(1.0, abs=1e-3), "nobody asked"
    near = cloud.means[:, 2] < 5.0
    attribute = twin.data.attributes.new(KNOWN, "FLOAT", "POINT")
    means = []
    for known in (near, ~near):
        attribute.data.foreach_set("value", known.astype(np.float32))
        mixed = passes(scene, tmp_path / "mixed.exr")
        assert np.array_equal(mixed["Combined.R"], unknown["Combined.R"])
        means.append(mixed["Expected Error.X"][share > 0.5].mean())
    assert means[0] < 0.35 and sum(means) == pytest.approx(1.0, abs=1e-3)
    attribute.data.foreach_set("value", np.full(len(cloud), 0.75, np.float32))
    even = passes(scene, tmp_path / "even.exr")["Expected Error.X"]
    assert np.abs(even[share > 0.5] - 0.25).max() < 1e-3 and (even[share == 0] == 0).all()
    setattr(scene.view_layers[0], EXPECTED_ERROR, False)
    assert "Expected Error.X" not in passes(scene, tmp_path / "without.exr")


def test_through_the_medium_it_is_the_commands_blurred_picture(scene: Any, tmp_path: Path) -> None:
    """At the photos' size; at half of it, it is the same picture, smaller."""
    cloud = crowd()
    twin = add_twin(cloud, "twin", scene.collection)
    scene.camera[FOCAL] = CAMERA.fx
    settings = scene.dgs
    settings.medium, settings.sigma, settings.blur_space = "gaussian", 3.0, "linear"
    sharp = rendered(scene, tmp_path / "sharp.png")
    scene.dgs_through = True
    seen = rendered(scene, tmp_path / "a.png")
    wanted = by_command(cloud, CAMERA, tmp_path, options=("--psf", "gaussian:3", "--blur-space", "linear"))
    assert np.abs(seen[..., :3] - wanted).max() <= 1 and np.abs(seen - sharp).max() > 30
    settings.medium = "auto"
    assert np.array_equal(rendered(scene, tmp_path / "b.png"), sharp), "nothing was estimated"
    twin["dgs_psf"] = "gaussian:3"
    assert np.array_equal(rendered(scene, tmp_path / "c.png"), seen)
    scene.render.resolution_percentage = 50
    half = rendered(scene, tmp_path / "d.png")[..., :3]
    small = seen[..., :3].reshape(45, 2, 60, 2, 3).mean(axis=(1, 3))
    away = np.abs(half - small)[4:-4, 4:-4]  # (a wider low-pass of splats, for the same px)
    assert away.mean() < 3 and away.max() < 20
    settings.view_kind = "medium"
    assert bpy.ops.dgs.exact_view() == {"FINISHED"}
    exact = np.round(np.array(settings.exact_view.pixels).reshape(45, 60, 4)[::-1, :, :3] * 255)
    assert np.abs(exact - half).max() <= 1, "an exact view of this size, too"
    settings.medium, settings.psf_file = "file", str(tmp_path / "nowhere.npy")
    with pytest.raises(RuntimeError, match="point spread"):
        bpy.ops.render.render()


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
    for ask in (bpy.ops.render.render, bpy.ops.dgs.exact_view):
        with pytest.raises(RuntimeError, match="status 3: no such library"):
            ask()
    assert scene.dgs.exact_view is None
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
