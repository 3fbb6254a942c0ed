"""Media that Cycles renders, each against its formula, measured in tiny renders."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

import bpy
from dgs.core.camera import Camera
from dgs.core.errors import Cancelled, DgsError
from dgs.core.formats.cameras import read_cameras
from dgs.core.progress import Silent
from dgs.dgs_addon.laboratory import command
from dgs.dgs_addon.laboratory.dataset import synthesize
from dgs.dgs_addon.laboratory.media.frosted_glass import oblique
from dgs.dgs_addon.laboratory.media.medium import Views
from dgs.dgs_addon.laboratory.media.registry import medium_of
from dgs.dgs_addon.laboratory.settings import SynthesizeSettings
from dgs.tests.blender.laboratory.lamps import FOCAL, HEIGHT, WIDTH, edge, lamps, light, moments
from PIL import Image
from scipy.ndimage import shift

LEFT, RIGHT = np.s_[:, : WIDTH // 2], np.s_[:, WIDTH // 2 :]


def manifest(out: Path) -> dict:
    return json.loads((out / "manifest.json").read_text())


def place(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(column, row) at which a [3, 4] pose sees a point."""
    x, y, z = pose[:, :3] @ point + pose[:, 3]
    return np.array([FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2])


@pytest.mark.parametrize("medium", ["shake:10", "shake:8..11,0"])
def test_a_shaken_lamp_draws_the_path_of_the_manifest(medium: str, tmp_path: Path) -> None:
    """Two lamps at two depths in each photo: their streaks are the sharp lamp moved along its projected path."""
    squares = [(24.0, 32.0, 1.5, 4.0), (72.0, 32.0, 3.0, 4.0)]
    settings = lamps(tmp_path / "a.blend", squares, 0.9, media=(medium,), views=2, samples=400)
    synthesize(settings, tmp_path / "set")
    streaks = []
    for view, (name, truth) in enumerate(manifest(tmp_path / "set")["through"].items()):
        assert name == f"view_{view:03d}.png" and not truth["sharp"]
        poses = np.array(truth["shake"]["poses"])
        for half, (column, row, depth, _) in zip((LEFT, RIGHT), squares, strict=True):
            point = np.array([(column - WIDTH / 2) / FOCAL * depth, (row - HEIGHT / 2) / FOCAL * depth, depth])
            path, near = between(poses, point, 97)
            path -= [column, row]
            sharp, photo = light(tmp_path / "set", "sharp", view)[half], light(tmp_path / "set", view=view)[half]
            moved = np.mean([w * shift(sharp, (y, x), order=1) for (x, y), w in zip(path, near, strict=True)], axis=0)
            assert np.abs(moved - photo).sum() < 0.25 * photo.sum(), "the picture of the lamp is that of its path"
            (middle, spread), (start, still) = moments(photo), moments(sharp)
            assert middle - start == pytest.approx(np.average(path, axis=0, weights=near), abs=0.15)
            assert spread - still == pytest.approx(np.cov(path.T, aweights=near), rel=0.06, abs=0.5)
            streaks.append(path)
        assert np.abs(poses.mean(axis=0)[:, :3] - np.eye(3)).max() < 1e-3  # the sharp camera is the path's mean
    assert np.abs(streaks[0] - streaks[2]).max() > 2, "every photo has a path of its own"
    assert np.abs(streaks[0] - streaks[1]).max() > 1, "the camera moves, and does not only turn"
    bend = np.linalg.svd(streaks[0] - streaks[0].mean(axis=0))[1]
    assert (bend[1] < 0.03 * bend[0]) == medium.endswith(",0")


@pytest.mark.parametrize("readout", [0.5, 2.0])
def test_rows_of_a_rolling_shutter_see_their_own_part_of_the_path(readout: float, tmp_path: Path) -> None:
    """A lamp in each corner, row by row, is the sharp lamp moved along what its row saw; the top row is first."""
    squares = [(column, row, 2.0, 4.0) for column in (24.0, 72.0) for row in (14.0, 50.0)]
    settings = lamps(tmp_path / "a.blend", squares, 0.9, media=(f"shake:14,0.5,{readout}",), views=2, samples=1000)
    synthesize(settings, tmp_path / "set")
    assert manifest(tmp_path / "set")["media"]["shake"]["readout"] == readout
    begins = -0.5 + (np.arange(HEIGHT) + 0.5) / HEIGHT * readout / (1 + readout)
    times = np.linspace(-0.5, 0.5, 193)
    seen = (times >= begins[:, None]) & (times <= begins[:, None] + 1 / (1 + readout))
    for view, truth in enumerate(manifest(tmp_path / "set")["through"].values()):
        poses = np.array(truth["shake"]["poses"])
        for half, (column, row, depth, _) in zip((LEFT, RIGHT), (squares[0], squares[2]), strict=True):
            for rows, at in ((np.s_[: HEIGHT // 2], row), (np.s_[HEIGHT // 2 :], 50.0)):
                point = np.array([(column - WIDTH / 2) / FOCAL * depth, (at - HEIGHT / 2) / FOCAL * depth, depth])
                path, near = between(poses, point, len(times))
                path -= [column, at]
                sharp, photo = np.zeros((HEIGHT, WIDTH // 2)), np.zeros((HEIGHT, WIDTH // 2))
                sharp[rows] = light(tmp_path / "set", "sharp", view)[half][rows]
                photo[rows] = light(tmp_path / "set", view=view)[half][rows]
                frames = np.array([w * shift(sharp, (y, x), order=1) for (x, y), w in zip(path, near, strict=True)])
                moved = np.einsum("rt,trc->rc", seen / seen.sum(axis=1, keepdims=True), frames)
                left = np.abs(moved - photo).sum()
                assert left < 0.25 * photo.sum()
                assert moments(photo)[0] == pytest.approx(moments(moved)[0], abs=0.15)
                assert np.abs(frames.mean(axis=0) - photo).sum() > 2 * left, "not what all rows at once would see"


def between(poses: np.ndarray, point: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places at `count` even times at which a point is seen, and how much larger it is than on average."""
    nodes, times = np.linspace(0, 1, len(poses)), np.linspace(0, 1, count)
    seen = np.array([place(pose, point) for pose in poses])
    size = np.array([(pose[2, :3] @ point + pose[2, 3]) ** -2 for pose in poses])
    path = np.stack([np.interp(times, nodes, seen[:, axis]) for axis in (0, 1)], axis=-1)
    sizes = np.interp(times, nodes, size)
    return path, sizes / sizes.mean()


def test_a_path_is_as_long_as_asked_and_stays_with_the_photo(tmp_path: Path) -> None:
    """Lengths fill the range; the paths of other photos, or of another seed, are others."""
    settings = lamps(tmp_path / "a.blend", [(48.0, 32.0, 2.0, 6.0)], media=("shake:4..16",), views=12, samples=1)
    synthesize(settings, tmp_path / "set")
    photos = manifest(tmp_path / "set")["through"]
    lengths = []
    for truth in photos.values():
        seen = np.array([place(np.array(pose), np.array([0, 0, 2.0])) for pose in truth["shake"]["poses"]])
        lengths.append(np.linalg.norm(np.diff(seen, axis=0), axis=1).sum())
        assert truth["shake"]["path_px"] == pytest.approx(lengths[-1], rel=1e-6)
    assert 4 <= min(lengths) < 7 and 13 < max(lengths) <= 16
    synthesize(replace(settings, seed=1, views=2), tmp_path / "other")
    assert manifest(tmp_path / "other")["through"]["view_001.png"] != photos["view_001.png"]


def test_a_camera_that_looks_away_shakes_before_what_it_sees() -> None:
    """And a path that no camera could take is refused."""
    camera = Camera("view_000.png", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
    wall = np.full((8, 12), 3.0, np.float32)
    views = Views([camera], np.array([0.0, 0.0, -2.0]), [False], 0, lambda: [wall])
    (truth,) = medium_of("shake:9").plan(views)
    seen = np.array([place(np.array(pose), np.array([0, 0, 3.0])) for pose in truth["poses"]])
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).sum() == pytest.approx(9, rel=0.01)
    with pytest.raises(DgsError, match="Give shake fewer px"):
        medium_of("shake:1e5").plan(views)


@pytest.mark.parametrize("depth", [1.0, 2.0])
def test_glass_blurs_by_the_distance_behind_it(depth: float, tmp_path: Path) -> None:
    """sigma = f s (1 - z_d / z), and no light is lost."""
    squares = [(48.0, 32.0, depth, 40.0)]
    settings = lamps(tmp_path / "a.blend", squares, media=("frosted-glass:0.5,1",))
    synthesize(settings, tmp_path / "set")
    photo, sharp = light(tmp_path / "set")[24:40], light(tmp_path / "set", "sharp")[24:40]
    added = np.sqrt(edge(photo[:, 8:48].mean(0)) ** 2 - edge(sharp[:, 8:48].mean(0)) ** 2)
    truth = manifest(tmp_path / "set")["media"]["frosted-glass"]
    assert truth["scattering_rad"] == pytest.approx(np.radians(1))
    assert added == pytest.approx(FOCAL * truth["scattering_rad"] * (1 - 0.5 / depth), rel=0.04)
    assert light(tmp_path / "set").sum() == pytest.approx(light(tmp_path / "set", "sharp").sum(), rel=0.01)


def test_tilted_glass_blurs_by_the_angle_that_light_meets_it_at(tmp_path: Path) -> None:
    """On the axis, along the tilt and across it; the manifest's plane says where the glass is."""
    squares = [(48.0, 32.0, 1.0, 6.0)]
    settings = lamps(tmp_path / "a.blend", squares, 0.9, media=("frosted-glass:0.5,0.8,35",))
    synthesize(settings, tmp_path / "set")
    added = moments(light(tmp_path / "set"))[1] - moments(light(tmp_path / "set", "sharp"))[1]
    truth = manifest(tmp_path / "set")["media"]["frosted-glass"]
    assert truth["offset"] / truth["normal"][2] == pytest.approx(0.5)
    along, across = oblique(truth["normal"][2])
    sigma = FOCAL * np.radians(0.8) * 0.5
    assert np.sqrt(np.diag(added)) == pytest.approx([sigma * along, sigma * across], rel=0.04)
    assert along > 1.3 and 1.1 < across < 1.2


def test_standing_glass_blurs_by_where_each_camera_looks_through_it(tmp_path: Path) -> None:
    """Two cameras at different distances and angles before one sheet, against the plane of the manifest."""
    settings = two_cameras(tmp_path / "a.blend", media=("standing-glass:0.5,0.8,20",))
    synthesize(settings, tmp_path / "set")
    written = manifest(tmp_path / "set")
    poses = read_cameras(tmp_path / "set/transforms.json").poses
    sigmas = []
    for view, pose in enumerate(poses[f"view_{index:03d}.png"] for index in range(2)):
        truth = written["through"][f"view_{view:03d}.png"]["standing-glass"]
        normal, offset = np.array(truth["normal"]), truth["offset"]
        assert np.array(truth["corners"]) @ normal == pytest.approx([offset] * 4)
        centre = -pose.rotation.T @ pose.translation
        cosine = normal @ pose.rotation[2]
        depth = float(np.linalg.norm(centre - [0.0, 0.0, 1.0]))
        glass = (offset - normal @ centre) / cosine
        added = moments(light(tmp_path / "set", view=view))[1] - moments(light(tmp_path / "set", "sharp", view))[1]
        sigma = FOCAL * written["media"]["standing-glass"]["scattering_rad"] * (1 - glass / depth)
        assert np.sqrt(np.diag(added)) == pytest.approx([sigma * more for more in oblique(cosine)], rel=0.05)
        sigmas.append(sigma)
    assert sigmas[1] > 1.15 * sigmas[0], "the sheet stands, so the nearer camera sees it nearer, and blurs more"


def two_cameras(file: Path, **changes: object) -> SynthesizeSettings:
    """A lamp at 1 m in the middle of two photos, from 1.16 m on the left and 0.86 m on the right."""
    settings = lamps(file, [(48.0, 32.0, 1.0, 6.0)], 0.9, views=2, **changes)
    eye = bpy.context.scene.camera
    for moment, aside, on in ((1, -0.15, -0.15), (2, 0.15, 0.15)):
        eye.location = aside, on, 0.0
        eye.rotation_euler = np.pi / 2, 0.0, np.arctan2(aside, 1.0 - on)
        for channel in ("location", "rotation_euler"):
            eye.keyframe_insert(channel, frame=moment)
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    return settings


def test_standing_glass_is_planned_at_one_place_for_all_cameras() -> None:
    """It is planned in the world, so a photo's own plan sets nothing that moves with the camera."""
    camera = Camera("view_000.png", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
    aside = camera.moved(np.eye(3), np.array([-0.3, 0.0, 0.0]))
    wall = np.full((8, 12), 3.0, np.float32)
    views = Views([camera, aside], np.array([0.0, 0.0, 3.0]), [False] * 2, 0, lambda: [wall, wall])
    first, second = medium_of("standing-glass:0.5,1").plan(views)
    assert first == second
    assert first["normal"] == pytest.approx([0, 0, 1]) and first["offset"] == pytest.approx(0.5)
    corners = np.array(first["corners"])
    frame = 0.5 * WIDTH / FOCAL * 0.5
    assert corners[:, 0].min() < -frame and corners[:, 0].max() > 0.3 + frame, "both look through it"


def looking(*ways: tuple[float, float, float]) -> Views:
    """Cameras at places along z and aside, turned by an angle about the vertical, before a wall at z = 2."""
    cameras = []
    for index, (aside, on, angle) in enumerate(ways):
        turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
        pinhole = FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2
        cameras.append(
            Camera(f"view_{index:03d}.png", WIDTH, HEIGHT, *pinhole, turn, -turn @ np.array([aside, 0.0, on]))
        )
    depths = [np.full((8, 12), 2.0 - on, np.float32) for _, on, _ in ways]
    return Views(cameras, np.array([0.0, 0.0, 2.0]), [False] * len(ways), 0, lambda: depths)


@pytest.mark.parametrize(
    ("views", "medium", "message"),
    [
        (looking((0, 0, 0), (0, 0.8, 0)), "0.1,1", r"before view_001.*between 0\.4 and 1\.6"),
        (looking((0, 0, 0), (0, 0.8, 0)), "1.7,1", r"behind what is nearest in view_00.*between 0\.4 and 1\.6"),
        (looking((0, 0, 0), (0, 0, np.pi)), "0.5,1", "all around.*--path front"),
        (looking((0, 0, 0), (0, 2.5, 0)), "0.5,1", "beyond what .* no sheet fits.*--path front"),
        (looking((0, 0, -1.3), (0, 0, 1.3)), "0.5,1", "along the glass.*--path front"),
    ],
)
def test_standing_glass_that_does_not_fit_is_refused_in_a_line(views: Views, medium: str, message: str) -> None:
    with pytest.raises(DgsError, match=message):
        medium_of(f"standing-glass:{medium}").plan(views)


@pytest.mark.parametrize("depth", [0.6, 2.0])
def test_a_lamp_out_of_focus_is_a_disc_as_large_as_the_formula_says(depth: float, tmp_path: Path) -> None:
    squares = [(48.0, 32.0, depth, 4.0)]
    settings = lamps(tmp_path / "a.blend", squares, media=("defocus:12,0.9..1.2",), views=2)
    synthesize(settings, tmp_path / "set")
    circles = []
    for view, truth in enumerate(manifest(tmp_path / "set")["through"].values()):
        lens = truth["defocus"]
        circles.append(lens["scale"] * abs(1 / lens["focus"] - 1 / depth))
        added = moments(light(tmp_path / "set", view=view))[1] - moments(light(tmp_path / "set", "sharp", view))[1]
        assert 4 * np.sqrt(np.diag(added)) == pytest.approx([circles[-1]] * 2, rel=0.03)  # variance d^2 / 16
        assert 0.9 <= lens["focus"] <= 1.2
        assert lens["scale"] == pytest.approx(lens["aperture"] * FOCAL)
    assert max(circles) == pytest.approx(12) and min(circles) < 11.5


@pytest.mark.parametrize("depth", [1.0, 2.0])
def test_fog_takes_contrast_by_the_way_through_it(depth: float, tmp_path: Path) -> None:
    squares = [(48.0, 32.0, depth, 30.0)]
    settings = lamps(tmp_path / "a.blend", squares, media=("fog:0.6",), samples=64, medium_samples=32)
    synthesize(settings, tmp_path / "set")
    steps = []
    for folder in ("sharp", "photos"):
        row = light(tmp_path / "set", folder)[24:40].mean(0)
        steps.append(row[36:40].mean() - row[26:30].mean())
    assert steps[1] / steps[0] == pytest.approx(np.exp(-0.6 * depth), rel=0.04)


def test_glass_moves_with_a_shaken_camera_and_stands_before_sharp_photos(tmp_path: Path) -> None:
    settings = lamps(
        tmp_path / "a.blend", [(48.0, 32.0, 1.0, 6.0)], 0.9,
        media=("shake:16,0", "frosted-glass:0.5,0.6"), views=2, holdout_every=2,
    )  # fmt: skip
    synthesize(settings, tmp_path / "set")
    photos = manifest(tmp_path / "set")["through"]
    assert list(photos["view_000.png"]) == ["sharp", "frosted-glass"] and not photos["view_000.png"]["sharp"]
    glass = (FOCAL * np.radians(0.6) * 0.5) ** 2
    poses = np.array(photos["view_001.png"]["shake"]["poses"])
    path = np.array([place(pose, np.array([0, 0, 1.0])) for pose in poses])
    for view, moved in ((0, np.zeros((2, 2))), (1, np.cov(path.T, ddof=0))):
        added = moments(light(tmp_path / "set", view=view))[1] - moments(light(tmp_path / "set", "sharp", view))[1]
        assert added == pytest.approx(moved + glass * np.eye(2), rel=0.15, abs=0.25)


class StopsAfter(Silent):
    """Asks to stop once `frames` frames are rendered."""

    def __init__(self, frames: int) -> None:
        self.frames, self.done = frames, 0

    def advance(self, done: int, **figures: float) -> None:
        self.done = done

    def cancelled(self) -> bool:
        return self.done >= self.frames


def test_held_out_and_some_other_photos_stay_sharp_and_the_bits_repeat(tmp_path: Path) -> None:
    plain = lamps(tmp_path / "a.blend", [(48.0, 32.0, 2.0, 20.0)], views=8, samples=2, width=48, height=32)
    mixed = replace(plain, media=("shake:9", "defocus:4,1..3"), holdout_every=4, sharp_share=0.5)
    synthesize(plain, tmp_path / "plain")
    synthesize(mixed, tmp_path / "one")
    with pytest.raises(Cancelled):
        synthesize(mixed, tmp_path / "two", StopsAfter(9))
    synthesize(mixed, tmp_path / "two")
    written = manifest(tmp_path / "one")
    assert SynthesizeSettings.from_json(written["settings"]) == mixed
    assert written["held_out"] == ["view_000.png", "view_004.png"]
    sharp = [name for name, truth in written["through"].items() if truth["sharp"]]
    assert len(sharp) == 2 + 3 and set(written["held_out"]) < set(sharp)
    for file in sorted((tmp_path / "plain/photos").iterdir()):
        photo = (tmp_path / "one/photos" / file.name).read_bytes()
        assert (tmp_path / "one/sharp" / file.name).read_bytes() == file.read_bytes()
        assert (photo == file.read_bytes()) == (file.name in sharp)
        assert (tmp_path / "two/photos" / file.name).read_bytes() == photo
    assert manifest(tmp_path / "two") == written
    synthesize(plain, tmp_path / "after")  # the scene is left as it was
    assert (tmp_path / "after/photos/view_001.png").read_bytes() == (
        tmp_path / "plain/photos/view_001.png"
    ).read_bytes()
    assert "held_out" not in manifest(tmp_path / "plain")


@pytest.mark.parametrize(
    ("media", "way_out"),
    [
        (("mist:3",), "Write shake:PX"),
        (("shake:",), "Write shake:PX"),
        (("shake:0",), "such as 4..16"),
        (("shake:9..4",), "smaller number first"),
        (("shake:9,-1",), "Give shake:8,0.5"),
        (("shake:9,0.5,-1",), "leave it out for all rows"),
        (("defocus:0",), "leave the medium out"),
        (("defocus:1e6",), "at most 1000 px"),
        (("defocus:9,-1..3",), "depths above 0"),
        (("frosted-glass:0.5",), "Write frosted-glass:DISTANCE"),
        (("frosted-glass:-0.5,1",), "distance of at least"),
        (("frosted-glass:0.5,-1",), "angle above 0"),
        (("frosted-glass:0.5,1,80",), "at most 45"),
        (("standing-glass:0.5",), "Write standing-glass:DISTANCE"),
        (("standing-glass:0.5,99",), "angle above 0"),
        (("fog:-1",), "leave the medium out"),
        (("fog:1,2",), "G from -0.99"),
        (("fog:nan",), "Write fog:PER_METRE"),
        (("shake:9", "shake:9"), "once"),
    ],
)
def test_what_makes_no_sense_is_said_in_a_line(media: tuple[str, ...], way_out: str) -> None:
    with pytest.raises(DgsError, match=way_out):
        SynthesizeSettings(media=media)


def test_a_rolling_shutter_reads_no_overscan() -> None:
    SynthesizeSettings(media=("shake:9,0.5,0",), overscan=8)
    with pytest.raises(DgsError, match="Leave out --overscan"):
        SynthesizeSettings(media=("shake:9,0.5,1",), overscan=8)


def test_the_command_line_leaves_photos_as_cycles_renders_them() -> None:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    given = "--out x --medium shake:8 --medium fog:1 --sharp-share 0.25 --holdout-every 4 --medium-samples 9".split()
    settings = command.settings_of(parser.parse_args(given))
    assert settings == SynthesizeSettings(
        psf="none", overscan=0, media=("shake:8", "fog:1"), sharp_share=0.25, holdout_every=4, medium_samples=9
    )
    both = command.settings_of(parser.parse_args([*given, "--psf", "gaussian:2", "--overscan", "12"]))
    assert (both.psf, both.overscan) == ("gaussian:2", 12)
    assert (settings.samples_through_media, SynthesizeSettings(samples=9).samples_through_media) == (9, 9)
    assert SynthesizeSettings(samples=9, media=("shake:8",)).samples_through_media == 128
    assert SynthesizeSettings(samples=200, media=("shake:8",)).samples_through_media == 200


def test_an_object_alone_keeps_its_alpha_behind_glass(tmp_path: Path) -> None:
    settings = SynthesizeSettings(
        views=1, width=48, height=32, psf="none", overscan=0, samples=16, denoise=False,
        background="transparent", media=("frosted-glass:0.3,1",),
    )  # fmt: skip
    synthesize(settings, tmp_path)
    sharp, photo = (
        np.asarray(Image.open(tmp_path / name / "view_000.png"))[..., 3] / 255 for name in ("sharp", "photos")
    )
    assert photo.mean() == pytest.approx(sharp.mean(), rel=0.03)
    assert ((photo > 0.1) & (photo < 0.9)).sum() > 1.3 * ((sharp > 0.1) & (sharp < 0.9)).sum() > 0


def test_media_fit_the_settings_and_the_scene(tmp_path: Path) -> None:
    with pytest.raises(DgsError, match="Give --medium, or"):
        SynthesizeSettings(media=("fog:1",), aperture=2.0)
    with pytest.raises(DgsError, match="Leave out --sharp-share"):
        SynthesizeSettings(media=("fog:1",), sharp_share=0.5)
    behind = lamps(tmp_path / "a.blend", [(48.0, 32.0, 2.0, 30.0)], samples=1, media=("frosted-glass:2.5,1",))
    with pytest.raises(DgsError, match=r"stands behind .*view_000.* below 1\.96"):
        synthesize(behind, tmp_path / "set")
    assert not (tmp_path / "set/photos").exists()
