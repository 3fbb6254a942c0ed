"""The laboratory's other scenes and paths, objects alone before nothing or white: all rendered, tiny."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.background import Background  # noqa: E402
from dgs.core.compositing import under  # noqa: E402
from dgs.core.errors import DgsError  # noqa: E402
from dgs.dgs_addon.axes import points_to_blender  # noqa: E402
from dgs.dgs_addon.laboratory import degrade, rail  # noqa: E402
from dgs.dgs_addon.laboratory.dataset import synthesize  # noqa: E402
from dgs.dgs_addon.laboratory.scenes import SCENES, village  # noqa: E402
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings  # noqa: E402
from PIL import Image  # noqa: E402
from scipy.ndimage import gaussian_filter  # noqa: E402

TINY = SynthesizeSettings(
    views=2, width=40, height=30, psf="none", overscan=6, samples=2, denoise=False, depth=True, keep_linear=True
)
PATHS = {"orrery": "dome", "plant": "dome", "room": "inside", "shelf": "front", "village": "drone"}


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_every_scene_is_lit_textured_and_where_its_path_looks(scene: str, tmp_path: Path) -> None:
    alone = SCENES[scene].alone
    background = "transparent" if alone else "scene"
    synthesize(replace(TINY, scene=scene, path=PATHS[scene], background=background), tmp_path)
    for name in rail.names(2):
        photo = pixels(tmp_path / "photos" / name)
        depth = np.load(tmp_path / "depth" / f"{Path(name).stem}.npy")
        seen = np.isfinite(depth)
        assert photo.shape == (30, 40, 4 if alone else 3)
        assert (0.05 < seen.mean() < 0.6) if alone else seen.all(), "an object alone, or something everywhere"
        shown = photo[..., :3][seen]
        assert 25 < shown.mean() < 225 and shown.std() > 20, "neither dark nor burnt nor plain"
        assert (shown == 255).all(axis=-1).mean() < 0.15


def test_an_object_alone_has_alpha_and_over_white_it_is_the_white_set(tmp_path: Path) -> None:
    made = {kind: tmp_path / kind for kind in ("transparent", "white")}
    for kind, out in made.items():
        synthesize(replace(TINY, scene="plant", path="dome", background=kind, samples=8), out)
    assert not (made["transparent"] / "lines.json").exists()
    for name in rail.names(2):
        drawn, white = (pixels(made[kind] / "photos" / name) for kind in ("transparent", "white"))
        alpha = drawn[..., 3]
        assert (alpha == 0).mean() > 0.3 and (alpha == 255).mean() > 0.05
        assert (white[alpha == 0] == 255).all() and (white[alpha == 255] == drawn[..., :3][alpha == 255]).all()
        over = under(Background(space="linear"), drawn[..., :3], alpha)
        assert np.abs(over.astype(int) - white).max() <= 2  # both are rounded to 8 bits


def test_a_blurred_photo_with_alpha_over_a_colour_is_the_blurred_photo_before_it() -> None:
    random = np.random.default_rng(0)
    alpha = gaussian_filter((random.random((60, 70)) > 0.7).astype(float), 2).clip(0, 1)[..., None]
    linear = np.concatenate([random.uniform(0, 0.9, (60, 70, 3)) * alpha, alpha], -1).astype(np.float32)
    options = {"margin": 12, "seed": (0, 0)}
    for space in ("srgb", "linear"):
        photo = degrade.photograph(
            linear, degrade.kernel_of("gaussian:2"), degrade.Sensor(16), blur_space=space, **options
        )
        assert photo.shape == (36, 46, 4)
        shown = under(Background((0.2, 0.6, 1.0), space), photo[..., :3], photo[..., 3]) / 65535
        straight = linear[..., :3] / np.maximum(alpha, 1e-9)
        colour = np.array([0.2, 0.6, 1.0])
        if space == "srgb":
            before = degrade.encode(straight) * alpha + (1 - alpha) * colour
            expected = gaussian_filter(before, (2, 2, 0), truncate=6, mode="nearest")
        else:
            before = linear[..., :3] + (1 - alpha) * degrade.decode(colour)
            expected = degrade.encode(gaussian_filter(before, (2, 2, 0), truncate=6, mode="nearest"))
        assert np.abs(shown - expected[12:-12, 12:-12]).max() < 1e-4


def test_another_background_needs_no_new_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dgs.dgs_addon.laboratory import render

    settings = replace(TINY, scene="orrery", path="dome", background="transparent", psf="gaussian:1")
    synthesize(settings, tmp_path)
    assert pixels(tmp_path / "photos" / "view_000.png").shape[2] == 4
    monkeypatch.setattr(render, "picture", None)  # nothing is rendered from here on
    synthesize(replace(settings, background="white"), tmp_path)
    assert pixels(tmp_path / "photos" / "view_000.png").shape[2] == 3


def test_no_table_is_seen_below_a_ball_alone(tmp_path: Path) -> None:
    synthesize(replace(TINY, path="orbit", background="transparent"), tmp_path)
    depth = np.load(tmp_path / "depth" / "view_000.npy")
    assert 0.03 < np.isfinite(depth).mean() < 0.5


def test_a_jpeg_has_no_alpha() -> None:
    with pytest.raises(DgsError, match="JPEG"):
        replace(TINY, background="transparent", jpeg=80)


def ways(path: str, views: int) -> tuple[np.ndarray, np.ndarray]:
    """[views, 3] places and unit directions in Blender's world, of a scene ten times the ball, around (1, 2, 3)."""
    found = rail.cameras(path, views, 80, 60, np.array([1.0, 2.0, 3.0]), 10.0)
    places = points_to_blender(np.array([camera.centre for camera in found]))
    ahead = points_to_blender(np.array([camera.centre + camera.rotation[2] for camera in found])) - places
    return places, ahead


def test_forward_facing_cameras_stand_in_a_plane_before_the_object() -> None:
    places, ahead = ways("front", 32)
    assert np.allclose(places[:, 1], 2.0 - 6.35) and (ahead[:, 1] > 0.95).all()
    assert np.ptp(places[:, 0]) == pytest.approx(2.8, rel=0.15) and np.ptp(places[:, 2]) == pytest.approx(1.6, rel=0.15)


def test_no_camera_stands_under_a_landscape() -> None:
    built = SCENES["village"]
    found = rail.cameras("front", 30, 80, 60, np.array(built.middle), built.size, built.ground)
    places = points_to_blender(np.array([camera.centre for camera in found]))
    assert (places[:, 2] >= built.ground).all() and len(np.unique(places.round(6), axis=0)) == 30
    assert (places[:, 2] > 1.0 + village._height(places[:, 0], places[:, 1])).all()


def test_cameras_inside_look_over_the_middle_and_at_the_near_wall() -> None:
    places, ahead = ways("inside", 48)
    outwards = (places - [1.0, 2.0, 3.0]) * [1, 1, 0]
    cosine = (ahead * outwards).sum(1) / np.linalg.norm(outwards, axis=1)
    assert (cosine[:24] < -0.9).all() and (cosine[24:] > 0.9).all()


def test_a_drone_flies_rows_and_looks_down_and_ahead() -> None:
    places, ahead = ways("drone", 48)
    assert np.allclose(places[:, 2], 3.0 + 6.35) and (ahead[:, 2] < -0.9).all()
    rows = np.unique(places[:, 1].round(6))
    assert len(rows) == 6 and all((places[:, 1].round(6) == row).sum() == 8 for row in rows)
    held = places[::8, 0] - 1.0
    assert (np.abs(held) < 0.5 * np.abs(places[:, 0] - 1.0).max()).all(), "what is held out ends no row"
    in_row = np.abs(np.diff(places[:, 1])) < 1e-6  # (the way from the last row to the first one is none)
    assert (np.sign(np.diff(places[:, 0])) == np.sign(ahead[:-1, 0]))[in_row].all()
