"""Depth of field, motion and fog as Cycles renders them, against the thin lens, the shutter and Beer-Lambert."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.errors import DgsError  # noqa: E402
from dgs.core.photos.png16 import read_png16  # noqa: E402
from dgs.dgs_addon.laboratory import degrade  # noqa: E402
from dgs.dgs_addon.laboratory.dataset import synthesize  # noqa: E402
from dgs.dgs_addon.laboratory.jpeg import compressed  # noqa: E402
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings  # noqa: E402

WIDTH, HEIGHT, LENS = 96, 64, 80.0
FOCAL = WIDTH * LENS / 36  # px
DEPTH = 2.0
PLAIN = SynthesizeSettings(
    views=1, width=WIDTH, height=HEIGHT, psf="none", bits=16, samples=200, denoise=False, overscan=4
)


def patch(file: Path, depth: float = DEPTH, frames: int = 3) -> SynthesizeSettings:
    """A .blend with a glowing square, 30 px wide in the photo, in the dark; the camera moves 20 mm per frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=30 / FOCAL * depth, location=(0, depth, 0), rotation=(np.pi / 2, 0, 0))
    glow = bpy.data.materials.new("glow")
    if glow.node_tree is None:
        glow.use_nodes = True
    nodes = glow.node_tree.nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 1, 1, 1), 0.6
    glow.node_tree.links.new(emission.outputs[0], output.inputs[0])
    bpy.context.object.data.materials.append(glow)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.lens, eye.rotation_euler = LENS, (np.pi / 2, 0, 0)
    scene.collection.objects.link(eye)
    scene.camera, scene.frame_start, scene.frame_end = eye, 1, frames
    for frame in range(1, frames + 1):
        eye.location = (0.02 * (frame - (frames + 1) / 2), 0, 0)
        eye.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    return replace(PLAIN, scene=str(file), path="scene")


def light(out: Path, folder: str = "photos", view: int = 0) -> np.ndarray:
    """[H, W] linear."""
    return degrade.decode(read_png16(out / folder / f"view_{view:03d}.png")[..., 1] / 65535.0)


def spread(profile: np.ndarray) -> float:
    """Standard deviation (px) of the light's rise along a profile: of the line that the edge is blurred with."""
    rise = np.clip(np.gradient(profile), 0, None)
    rise[rise < 0.01 * rise.max()] = 0
    at = np.arange(len(rise))
    middle = (rise * at).sum() / rise.sum()
    return float(np.sqrt((rise * (at - middle) ** 2).sum() / rise.sum()))


def edges(image: np.ndarray) -> tuple[float, float]:
    """Spread of the square's left edge and of its upper edge."""
    return spread(image[26:38, :48].mean(0)), spread(image[:32, 42:54].mean(1))


def made(settings: SynthesizeSettings, out: Path) -> tuple[float, float]:
    """px^2 that the medium adds to the variance of the left and the upper edge of the middle view."""
    synthesize(settings, out)
    view = settings.views // 2
    photo, sharp = edges(light(out, "photos", view)), edges(light(out, "sharp", view))
    return photo[0] ** 2 - sharp[0] ** 2, photo[1] ** 2 - sharp[1] ** 2


@pytest.mark.parametrize("stop", [1.0, 2.0])
def test_an_edge_out_of_focus_is_as_wide_as_the_thin_lens_says(stop: float, tmp_path: Path) -> None:
    settings = replace(patch(tmp_path / "a.blend"), aperture=stop, focus=1.0)
    added = made(settings, tmp_path / "set")
    disc = LENS / 1000 / stop * FOCAL * abs(1 / 1.0 - 1 / DEPTH)  # px, diameter
    assert added == pytest.approx((disc**2 / 16, disc**2 / 16), rel=0.08)  # a disc's variance along one axis


def test_in_focus_nothing_is_lost_and_the_manifest_says_so(tmp_path: Path) -> None:
    settings = replace(patch(tmp_path / "a.blend"), aperture=1.0)  # focus: the object's middle
    assert made(settings, tmp_path / "set") == pytest.approx((0, 0), abs=0.03)
    written = json.loads((tmp_path / "set/manifest.json").read_text())["settings"]
    assert written["aperture"] == 1.0 and SynthesizeSettings.from_json(written) == settings


@pytest.mark.parametrize(("way", "along"), [("camera", 0), ("object", 1)])
def test_motion_smears_along_itself_by_as_many_px_as_predicted(way: str, along: int, tmp_path: Path) -> None:
    moved = 60.0  # mm
    change = {"camera_motion": moved} if way == "camera" else {"object_motion": (0.0, 0.0, moved)}
    added = made(replace(patch(tmp_path / "a.blend"), views=3, **change), tmp_path / "set")
    smear = moved / 1000 / DEPTH * FOCAL  # px
    assert added[along] == pytest.approx(smear**2 / 12, rel=0.08)
    assert added[1 - along] == pytest.approx(0, abs=0.05)
    middle = np.argwhere(light(tmp_path / "set", "photos", 1) > 0.2).mean(axis=0)
    still = np.argwhere(light(tmp_path / "set", "sharp", 1) > 0.2).mean(axis=0)
    assert middle == pytest.approx(still, abs=0.5)  # the truth is half-way through the exposure


@pytest.mark.parametrize("depth", [1.0, 2.0])
def test_fog_takes_contrast_by_beer_and_lambert(depth: float, tmp_path: Path) -> None:
    settings = replace(patch(tmp_path / "a.blend", depth), fog=0.6, samples=50)
    synthesize(settings, tmp_path / "set")
    steps = []
    for folder in ("sharp", "photos"):
        row = light(tmp_path / "set", folder)[24:40].mean(0)
        steps.append(row[36:40].mean() - row[26:30].mean())
    assert steps[1] / steps[0] == pytest.approx(np.exp(-0.6 * depth), rel=0.05)
    dark = light(tmp_path / "set")[:, :20].mean()
    assert dark > light(tmp_path / "set", "sharp")[:, :20].mean() + 1e-3  # what was scattered is haze elsewhere


def test_the_truth_beside_them_is_the_set_without_them_and_the_bits_repeat(tmp_path: Path) -> None:
    plain = replace(patch(tmp_path / "a.blend"), views=2, samples=4, masks=True)
    both = replace(plain, aperture=1.4, focus=1.5, camera_motion=20.0, fog=0.3, fog_anisotropy=0.5, full_well=5e3)
    for name, settings in (("plain", plain), ("one", both), ("two", both)):
        synthesize(settings, tmp_path / name)
    for index in range(2):
        sharp, photo = f"sharp/view_{index:03d}.png", f"photos/view_{index:03d}.png"
        assert (tmp_path / "one" / sharp).read_bytes() == (tmp_path / "plain" / sharp).read_bytes()
        assert (tmp_path / "one" / photo).read_bytes() != (tmp_path / "plain" / photo).read_bytes()
        assert (tmp_path / "one" / photo).read_bytes() == (tmp_path / "two" / photo).read_bytes()
        mask = f"masks_ball/view_{index:03d}.png"  # geometry has no fog
        assert (tmp_path / "one" / mask).read_bytes() == (tmp_path / "plain" / mask).read_bytes()
    # The scene is left as it was: the next set is no foggier for it.
    synthesize(plain, tmp_path / "after")
    assert (tmp_path / "after" / photo).read_bytes() == (tmp_path / "plain" / photo).read_bytes()


def test_photons_are_counted() -> None:
    grey = np.full((200, 200, 3), 0.25, np.float32)
    counted, read = degrade.Sensor(16, full_well=2000), degrade.Sensor(16, full_well=2000, read_noise=12.0)
    options = {"blur_space": "linear", "margin": 0, "seed": (0, 0)}
    photo = degrade.photograph(grey, np.ones((1, 1)), read, **options) / 65535
    electrons = degrade.decode(photo) * 2000
    assert electrons.mean() == pytest.approx(500, rel=0.002)
    assert electrons.var() == pytest.approx(500 + 12**2, rel=0.03)
    bright = degrade.photograph(2 * grey, np.ones((1, 1)), counted, **options) / 65535
    assert (degrade.decode(bright) * 2000).var() == pytest.approx(1000, rel=0.03)
    again = degrade.photograph(grey, np.ones((1, 1)), read, **options) / 65535
    assert np.array_equal(again, photo)


def test_jpeg_costs_what_it_costs() -> None:
    y, x = np.mgrid[:64, :96]
    smooth = np.stack([127 + 100 * np.sin(x / 9), 127 + 100 * np.cos(y / 7), 127 + 50 * np.sin((x + y) / 11)], -1)
    pixels = np.rint(smooth).astype(np.uint8)
    good, poor = (np.abs(compressed(pixels, quality).astype(float) - pixels).mean() for quality in (95, 20))
    assert 0 < good < 2 < poor < 12


def test_senseless_media_are_refused() -> None:
    for wrong in ({"read_noise": 3.0}, {"jpeg": 90}, {"fog_anisotropy": 1.0}, {"aperture": -1.0}, {"jpeg": 101}):
        with pytest.raises(DgsError):
            replace(PLAIN, **wrong)
