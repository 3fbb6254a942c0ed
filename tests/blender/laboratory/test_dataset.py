"""What goes with the photos of a data set: manifest, points, lines, and the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from dgs.core.errors import DgsError
from dgs.core.views import SparsePoints
from dgs.dgs_addon.laboratory import files, rail
from dgs.dgs_addon.laboratory.dataset import synthesize
from dgs.dgs_addon.laboratory.settings import OBJECT_INDEX, SynthesizeSettings
from skimage import io

pytest.importorskip("bpy")

TINY = SynthesizeSettings(
    views=2,
    width=32,
    height=24,
    psf="gaussian:1",
    overscan=6,
    samples=1,
    denoise=False,
    masks=True,
    depth=True,
    keep_linear=True,
    path="orbit",
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("laboratory") / "set"
    synthesize(TINY, out)
    return out


def test_the_manifest_holds_the_settings(made):
    assert SynthesizeSettings.from_json(json.loads((made / "manifest.json").read_text())["settings"]) == TINY


def test_a_finished_set_is_left_alone(made):
    stamps = {path: path.stat().st_mtime_ns for path in made.rglob("*")}
    synthesize(TINY, made)
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*")} == stamps


def test_a_lost_photo_is_made_again(made):
    photo = made / "photos" / "view_001.png"
    before = photo.read_bytes()
    photo.unlink()
    synthesize(TINY, made)
    assert photo.read_bytes() == before


def test_overscan_moves_no_pixel():
    """The principal point and focal length stay: depth through the same pixels is the same."""
    import tempfile
    from pathlib import Path

    from dgs.dgs_addon.laboratory import ball, render

    camera = rail.cameras("dome", 7, 40, 30)[2]
    ball.build(0, 40)
    render.prepare(1, denoise=False)
    with tempfile.TemporaryDirectory() as scratch, render.geometry_only():
        plain, objects = render.depth_and_index(camera, Path(scratch))
        wide, _ = render.depth_and_index(camera.with_margin(5), Path(scratch))
    assert (objects == OBJECT_INDEX).any() and (objects == 0).any()
    difference = np.abs(wide[5:-5, 5:-5] - plain)
    assert np.quantile(difference, 0.95) < 2e-4  # a hundredth of a pixel across pebbles and edges


def test_points_lie_on_the_rendered_ball(made):
    """The world of `cameras/` is the world that was rendered: points over the mask are on the ball."""
    import pycolmap
    from dgs.dgs_addon.axes import points_to_blender
    from dgs.dgs_addon.laboratory.shape import SHAPE, ball_pose

    model = pycolmap.Reconstruction(str(made / "cameras"))
    points = points_to_blender(np.array([point.xyz for point in model.points3D.values()]))
    local = (points - ball_pose()[:3, 3]) @ ball_pose()[:3, :3]
    radius = np.linalg.norm(local / [SHAPE.half_length, SHAPE.radius, SHAPE.radius], axis=1)
    on_ball = np.abs(radius - 1) < 0.03
    mask = io.imread(made / "masks_ball" / "view_000.png") > 0
    assert on_ball.mean() > 0.5 * mask.mean() > 0
    off = points[~on_ball]
    assert np.quantile(np.abs(off[:, 2]), 0.7) < 1e-4  # the rest is the table, at z = 0
    assert radius.min() > 0.95  # nothing inside the ball


def test_lines_are_where_they_are_painted(tmp_path):
    """The red line's points project onto red pixels of the sharp picture."""
    settings = SynthesizeSettings(views=1, width=160, height=107, overscan=0, psf="none", samples=4, denoise=False)
    synthesize(settings, tmp_path)
    sharp = io.imread(tmp_path / "sharp" / "view_000.png").astype(float)
    red = next(line for line in json.loads((tmp_path / "lines.json").read_text()) if line["name"] == "red")
    camera = rail.cameras("rail", 1, 160, 107)[0]
    points, normals = np.array(red["points"]), np.array(red["normals"])
    rays = camera.centre - points
    facing = np.sum(rays * normals, axis=1) > 0.4 * np.linalg.norm(rays, axis=1)
    beside = points + 2.5 * red["width_m"] * np.array(red["across"])

    def share_of_red(places):
        x, y, z = (places[facing] @ camera.rotation.T + camera.translation).T
        columns, rows = (camera.fx * x / z + camera.cx).astype(int), (camera.fy * y / z + camera.cy).astype(int)
        r, g, _ = sharp[rows, columns].T
        return np.mean((r > 2.5 * g) & (r > 120))

    assert facing.sum() > 20
    assert share_of_red(points) > 0.75  # white meridians cross it
    assert share_of_red(beside) < 0.25


def test_errors_name_the_way_out(tmp_path):
    for change in ({"views": 0}, {"bits": 12}, {"scene": "teapot"}, {"path": "scene"}, {"noise": float("nan")}):
        with pytest.raises(DgsError, match=r"Choose|Give"):
            replace(TINY, **change)
    (tmp_path / "file").write_text("")
    with pytest.raises(DgsError):
        synthesize(TINY, tmp_path / "file" / "set")


def test_command_line_covers_the_settings(tmp_path):
    import argparse

    from dgs.dgs_addon.laboratory import command

    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    assert command.settings_of(parser.parse_args(["--out", "x"])) == SynthesizeSettings()
    options = (
        "--out x --path dome --views 3 --size 64x48 --psf disk:2 --blur-space linear --bits 16 --noise 0.01 "
        "--overscan 4 --samples 2 --no-denoise --seed 5 --masks --depth --keep-linear"
    )
    assert command.settings_of(parser.parse_args(options.split())) == SynthesizeSettings(
        "rugby-ball", "dome", 3, 64, 48, "disk:2", "linear", 16, 0.01, 4, 2, False, 5, True, True, True
    )


def test_points_are_optional_in_the_model(tmp_path):
    empty = SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8))
    files.write_colmap_text(tmp_path, rail.cameras("rail", 1, 32, 24), empty)
    assert (tmp_path / "points3D.txt").read_text() == ""


def test_depth_masks_and_frames_are_added_to_a_set_that_is_there(made, tmp_path):
    """What stands beside the photos leaves them alone, and taking less asks for nothing."""
    bare = replace(TINY, masks=False, depth=False, keep_linear=False)
    synthesize(bare, tmp_path)
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "photos").iterdir()}
    synthesize(replace(bare, depth=True, masks=True), tmp_path)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "photos").iterdir()} == stamps
    synthesize(replace(TINY, normals=True), tmp_path)
    for name in ("photos/view_000.png", "masks_ball/view_001.png", "depth/view_001.npy", "linear/view_000.png.npy"):
        assert (tmp_path / name).read_bytes() == (made / name).read_bytes()
    assert json.loads((tmp_path / "manifest.json").read_text())["settings"]["normals"] is True
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    synthesize(bare, tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == stamps
    synthesize(replace(bare, psf="none"), tmp_path)
    assert not list((tmp_path / "depth").iterdir()), "another medium is another set"


def test_frames_of_another_version_of_the_scenes_are_not_taken_over(tmp_path, monkeypatch):
    from dgs.dgs_addon.laboratory import settings as module

    bare = replace(TINY, views=1, masks=False, depth=False, keep_linear=False)
    monkeypatch.setattr(module, "SCENE_VERSION", -1)
    synthesize(bare, tmp_path)
    photo = tmp_path / "photos" / "view_000.png"
    before = photo.stat().st_mtime_ns
    monkeypatch.undo()
    synthesize(replace(bare, masks=True), tmp_path)
    assert photo.stat().st_mtime_ns != before
