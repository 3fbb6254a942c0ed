"""Sets of somebody's own mesh or .blend, spirals, animated cameras, drifting exposure, normals: all rendered."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.errors import DgsError, FormatError  # noqa: E402
from dgs.dgs_addon.axes import points_to_blender, points_to_engine  # noqa: E402
from dgs.dgs_addon.laboratory import degrade, rail  # noqa: E402
from dgs.dgs_addon.laboratory.dataset import synthesize  # noqa: E402
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings  # noqa: E402
from PIL import Image  # noqa: E402

TINY = SynthesizeSettings(
    views=3, width=48, height=32, psf="gaussian:1", overscan=6, samples=1, denoise=False, masks=True, depth=True
)
EXPORTS = {
    "obj": lambda path: bpy.ops.wm.obj_export(filepath=path),
    "ply": lambda path: bpy.ops.wm.ply_export(filepath=path),
    "stl": lambda path: bpy.ops.wm.stl_export(filepath=path),
    "glb": lambda path: bpy.ops.export_scene.gltf(filepath=path),
    "usdc": lambda path: bpy.ops.wm.usd_export(filepath=path),
    "fbx": lambda path: bpy.ops.export_scene.fbx(filepath=path),
}


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


def brick(size: tuple[float, float, float] = (2.0, 1.0, 0.5)) -> None:
    """A brick off the origin, and a lamp and a camera that a reader has to leave out."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(3, -2, 5))
    bpy.context.object.scale = size
    for kind, data in (("lamp", bpy.data.lights.new("lamp", "POINT")), ("eye", bpy.data.cameras.new("eye"))):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(kind, data))


def save_scene(path: Path) -> None:
    """A .blend: a red ball of radius 2 around (10, 0, 0), a sun, and a camera that moves past it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_uv_sphere_add(radius=2, location=(10, 0, 0))
    red = bpy.data.materials.new("red")
    if red.node_tree is None:
        red.use_nodes = True
    surface = next(node for node in red.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (0.8, 0.02, 0.02, 1)
    bpy.context.object.data.materials.append(red)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 4.0, (0.9, 0.0, 0.3)
    scene.collection.objects.link(sun)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.lens, eye.data.dof.use_dof = 40.0, True
    eye.rotation_euler = (np.pi / 2, 0, 0)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.frame_start, scene.frame_end = 1, 21
    for frame, x in ((1, 9.0), (21, 11.0)):
        eye.location = (x, -9, 0)
        eye.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


@pytest.mark.parametrize("kind", sorted(EXPORTS))
def test_a_mesh_of_every_format_stands_on_the_table(kind: str, tmp_path: Path) -> None:
    brick()
    file = tmp_path / f"brick.{kind}"
    EXPORTS[kind](str(file))
    settings = replace(TINY, mesh=str(file), views=1)
    synthesize(settings, tmp_path / "set")
    camera = rail.cameras("rail", 1, 48, 32)[0]
    mask = pixels(tmp_path / "set/masks_ball/view_000.png") > 0
    depth = np.load(tmp_path / "set/depth/view_000.npy").astype(np.float64)
    rows, columns = np.mgrid[:32, :48] + 0.5
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones((32, 48))], -1)
    world = points_to_blender((rays * depth[..., None] - camera.translation) @ camera.rotation)
    assert 0.02 < mask.mean() < 0.6
    assert np.median(np.abs(world[~mask][:, 2])) < 1e-4  # the table
    low, high = world[mask].min(axis=0), world[mask].max(axis=0)
    assert low[2] > -1e-4 and high[2] > 0.05
    assert (np.abs(world[mask][:, :2]) < 0.142).all()
    assert not (tmp_path / "set/lines.json").exists()
    manifest = json.loads((tmp_path / "set/manifest.json").read_text())
    assert len(manifest["source_sha256"]) == 16
    assert SynthesizeSettings.from_json(manifest["settings"]) == settings


def test_another_mesh_under_the_same_name_is_another_set(tmp_path: Path) -> None:
    file = tmp_path / "brick.obj"
    settings = replace(TINY, mesh=str(file), views=1)
    pictures = []
    for size in ((2.0, 1.0, 0.5), (1.0, 1.0, 1.0)):
        brick(size)
        bpy.ops.wm.obj_export(filepath=str(file))
        synthesize(settings, tmp_path / "set")
        pictures.append((tmp_path / "set/photos/view_000.png").read_bytes())
    assert pictures[0] != pictures[1]


def test_the_scenes_own_camera_and_lights(tmp_path: Path) -> None:
    file = tmp_path / "own.blend"
    save_scene(file)
    settings = replace(TINY, scene=str(file), path="scene", normals=True)
    synthesize(settings, tmp_path / "set")
    model = json.loads((tmp_path / "set/transforms.json").read_text())
    assert len(model["frames"]) == 3
    for index, x in enumerate((9.0, 10.0, 11.0)):
        mask = pixels(tmp_path / f"set/masks_ball/view_{index:03d}.png") > 0
        # The ball stands at x = 10, nine units away; 40 mm on 36 mm make 48 px wide frames 53.3 px focal.
        middle = np.argwhere(mask).mean(axis=0) + 0.5
        assert middle[1] == pytest.approx(24 + (10 - x) / 9 * 48 * 40 / 36, abs=0.8)
        assert middle[0] == pytest.approx(16, abs=0.6)
        depth = np.load(tmp_path / f"set/depth/view_{index:03d}.npy")
        assert depth[mask].min() == pytest.approx(7.0, abs=0.15)
        sharp = pixels(tmp_path / f"set/sharp/view_{index:03d}.png").astype(float)
        lit = sharp[mask][sharp[mask].sum(1) > 100]
        assert len(lit) > 20 and (lit[:, 0] > 2 * lit[:, 1]).mean() > 0.9
        normals = np.load(tmp_path / f"set/normals/view_{index:03d}.npy")
        assert np.allclose(np.linalg.norm(normals[mask], axis=-1), 1, atol=1e-3)
        assert (normals[~mask] == 0).all()
    central = np.load(tmp_path / "set/normals/view_001.npy")[16, 24]
    assert np.allclose(central, points_to_engine([0, -1, 0]), atol=0.25)


def test_a_path_around_somebodys_own_object(tmp_path: Path) -> None:
    file = tmp_path / "own.blend"
    save_scene(file)
    synthesize(replace(TINY, scene=str(file), path="spiral"), tmp_path / "set")
    for index in range(3):
        mask = pixels(tmp_path / f"set/masks_ball/view_{index:03d}.png") > 0
        assert 0.05 < mask.mean() < 0.7
        assert np.argwhere(mask).mean(axis=0) == pytest.approx([15.5, 23.5], abs=1.5)


def test_a_spiral_climbs_around_the_ball() -> None:
    places = rail.spiral(40) - rail.TARGET
    assert np.allclose(np.linalg.norm(places, axis=1), rail.DISTANCE)
    assert (np.diff(places[:, 2]) > 0).all()
    turn = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    assert turn[-1] - turn[0] == pytest.approx(2 * np.pi * rail.SPIRAL_TURNS)


def test_exposure_drifts_by_what_was_asked_and_only_in_the_photos(tmp_path: Path) -> None:
    gains = degrade.exposures(30, 0.5, 3)
    assert np.abs(np.log2(gains)).max() == pytest.approx(0.5)
    assert np.abs(np.diff(np.log2(gains))).max() < 0.4  # smooth
    assert (degrade.exposures(30, 0.0, 3) == 1).all()
    settings = replace(TINY, psf="none", exposure_drift=0.8, masks=False, depth=False)
    synthesize(settings, tmp_path / "set")
    gains = json.loads((tmp_path / "set/manifest.json").read_text())["exposure_gains"]
    assert gains == pytest.approx(degrade.exposures(3, 0.8, 0).tolist(), abs=1e-5)
    for index, gain in enumerate(gains):
        sharp, photo = (pixels(tmp_path / f"set/{name}/view_{index:03d}.png") / 255.0 for name in ("sharp", "photos"))
        dark = (sharp > 0.15) & (sharp < 0.5)
        light = ((sharp[dark] + 0.055) / 1.055) ** 2.4 * gain
        assert np.abs(1.055 * light ** (1 / 2.4) - 0.055 - photo[dark]).max() < 0.012


def test_older_manifests_stay_valid() -> None:
    """Settings that came later leave no trace where they are not used."""
    assert not {"mesh", "exposure_drift", "normals"} & set(SynthesizeSettings().to_json())
    assert SynthesizeSettings().fingerprint() != replace(TINY, mesh="a.obj").fingerprint()


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="Check the path"):
        synthesize(replace(TINY, mesh=str(tmp_path / "gone.obj")), tmp_path / "set")
    (tmp_path / "notes.txt").write_text("no mesh")
    with pytest.raises(FormatError, match="Give one of"):
        synthesize(replace(TINY, mesh=str(tmp_path / "notes.txt")), tmp_path / "set")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(FormatError, match="no mesh with faces"):
        synthesize(replace(TINY, mesh=str(tmp_path / "empty.obj")), tmp_path / "set")
    (tmp_path / "broken.blend").write_text("no blend")
    with pytest.raises(FormatError, match="cannot open"):
        synthesize(replace(TINY, scene=str(tmp_path / "broken.blend")), tmp_path / "set")
    with pytest.raises(DgsError, match="not of both"):
        replace(TINY, scene="a.blend", mesh="b.obj")
