from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from dgs.core import conventions
from dgs.core.camera import Camera
from dgs.core.errors import CameraError, FormatError
from dgs.core.formats import colmap
from dgs.core.formats.cameras import brings_points, read_cameras
from dgs.core.formats.colmap import read_colmap_cameras, read_model, write_lenses, write_model
from dgs.core.formats.transforms import read_transforms, write_transforms
from dgs.core.lens import MODELS, Lens
from dgs.core.photos.load import Photo
from dgs.core.pose import Pose
from dgs.core.sfm.given import load_cameras
from dgs.core.views import SparsePoints
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement
from scipy.spatial.transform import Rotation

ROTATION = Rotation.from_rotvec([0.4, -0.2, 1.0]).as_matrix()
PARAMS = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": (-0.08,),
    "RADIAL": (-0.1, 0.03),
    "OPENCV": (-0.1, 0.02, 0.002, -0.001),
    "FULL_OPENCV": (-0.1, 0.02, 0.002, -0.001, 0.01, 0.02, 0.01, 0.005),
    "SIMPLE_RADIAL_FISHEYE": (0.05,),
    "RADIAL_FISHEYE": (0.05, -0.01),
    "OPENCV_FISHEYE": (0.05, -0.01, 0.004, -0.001),
}


def lens(model: str) -> Lens:
    simple, _ = MODELS[model]
    head = (500.0, 321.0, 239.0) if simple else (500.0, 510.0, 321.0, 239.0)
    return Lens(model, 640, 480, (*head, *PARAMS[model]))


def cameras() -> dict[str, Camera]:
    return {
        name: Camera(name, 640, 480, 500.0, 510.0, 321.0, 239.0, ROTATION, np.array([i, 2.0, 3.0]))
        for i, name in enumerate(["a b.png", "ü.png"])
    }


def photo(name: str, width: int = 640, height: int = 480) -> Photo:
    return Photo(name, Path(name), np.zeros((height, width, 3), np.uint8))


def test_whether_cameras_bring_points(tmp_path: Path) -> None:
    write_transforms(tmp_path / "transforms.json", cameras())
    assert not brings_points(tmp_path / "transforms.json")
    for name, count in (("some", 3), ("none", 0)):
        write_model(tmp_path / name, cameras(), SparsePoints(np.zeros((count, 3)), np.zeros((count, 3), np.uint8)))
        assert brings_points(tmp_path / name) == (count > 0)
    (tmp_path / "torn.json").write_text("{", "utf-8")
    assert not brings_points(tmp_path / "torn.json") and not brings_points(tmp_path / "nowhere")


@pytest.mark.parametrize("model", MODELS)
def test_lens_agrees_with_pycolmap_and_inverts(model: str) -> None:
    mine = lens(model)
    theirs = pycolmap.Camera(model=model, width=640, height=480, params=list(mine.params))
    rays = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2))
    expected = theirs.img_from_cam(np.concatenate([rays, np.ones((100, 1))], 1))
    np.testing.assert_allclose(mine.to_pixels(rays), expected, atol=1e-9)
    np.testing.assert_allclose(mine.from_pixels(expected), rays, atol=1e-8)


@pytest.mark.parametrize("binary", [True, False])
def test_colmap_round_trip(tmp_path: Path, binary: bool) -> None:
    points = SparsePoints(np.array([[1.0, 2, 3], [4, 5, 6]]), np.array([[1, 2, 3], [255, 0, 9]], np.uint8))
    given = cameras() if binary else {"ü.png": cameras()["ü.png"]}  # COLMAP's text allows no spaces
    write_model(tmp_path / "sparse" / "0", given, points, binary)
    lenses, poses, read = read_model(tmp_path)
    assert set(poses) == set(given)
    np.testing.assert_allclose(poses["ü.png"].rotation, ROTATION, atol=1e-12)
    np.testing.assert_allclose(poses["ü.png"].translation, [1, 2, 3])
    assert lenses["ü.png"] == Lens("PINHOLE", 640, 480, (500.0, 510.0, 321.0, 239.0))
    np.testing.assert_allclose(read.positions, points.positions)
    np.testing.assert_array_equal(read.colours, points.colours)


def test_distorted_lenses_survive_and_damage_is_named(tmp_path: Path) -> None:
    names = list(MODELS)
    pose = Pose(ROTATION, np.zeros(3))
    points = SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    write_lenses(tmp_path, {n: lens(n) for n in names}, dict.fromkeys(names, pose), points)
    assert read_model(tmp_path)[0] == {n: lens(n) for n in names}
    (tmp_path / "images.bin").write_bytes(b"\xff" * 11)
    with pytest.raises(FormatError, match="damaged"):
        read_model(tmp_path)
    with pytest.raises(FormatError, match="no COLMAP model"):
        read_model(tmp_path / "nowhere")


def test_transforms_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    write_transforms(path, cameras())
    lenses, poses = read_transforms(path)
    for name, camera in cameras().items():
        np.testing.assert_allclose(poses[name].rotation, camera.rotation, atol=1e-12)
        np.testing.assert_allclose(poses[name].translation, camera.translation, atol=1e-12)
        assert lenses[name].params == (500.0, 510.0, 321.0, 239.0)


def test_distortion_of_transforms_keeps_its_order(tmp_path: Path) -> None:
    """k1 k2 p1 p2, as in OpenCV: each has its own place, tangential ones too."""
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    content = {"w": 80, "h": 60, "fl_x": 70.0, "fl_y": 71.0, "cx": 41.0, "cy": 29.0, "frames": [frame]}
    content |= {"k1": 0.1, "k2": 0.02, "p1": 0.003, "p2": -0.004}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    lens = read_transforms(tmp_path)[0]["a.png"]
    assert (lens.model, lens.params) == ("OPENCV", (70.0, 71.0, 41.0, 29.0, 0.1, 0.02, 0.003, -0.004))
    (tmp_path / "transforms.json").write_text(json.dumps(content | {"k3": 0.5}))
    lens = read_transforms(tmp_path)[0]["a.png"]
    assert (lens.model, lens.params[4:9]) == ("FULL_OPENCV", (0.1, 0.02, 0.003, -0.004, 0.5))


def test_transforms_of_the_nerf_data_sets(tmp_path: Path) -> None:
    """camera_angle_x only; camera at z = 4 that looks down -z, as Blender's does."""
    matrix = np.eye(4)
    matrix[2, 3] = 4.0
    content = {
        "camera_angle_x": np.pi / 2,
        "frames": [{"file_path": "./train/r_0", "transform_matrix": matrix.tolist()}],
    }
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    found = load_cameras(tmp_path, [photo("R_0.png", 100, 80)])
    assert found.lenses["R_0.png"].fx == pytest.approx(50.0)
    assert len(found.points.positions) > 1000  # the file has none
    pose = found.poses["R_0.png"]
    np.testing.assert_allclose(pose.centre, [0, 0, 4], atol=1e-12)
    np.testing.assert_allclose(pose.rotation @ [0, 0, 0] + pose.translation, [0, 0, 4])
    np.testing.assert_allclose(pose.rotation @ [0, 1, 0] + pose.translation, [0, -1, 4])


SINGULAR = '{"w":1,"h":1,"fl_x":1,"frames":[{"file_path":"a","transform_matrix":' + str([[0] * 4] * 3) + "}]}"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"frames": [{"file_path": "a"}]}', '{"frames": [3]}', SINGULAR])
def test_bad_transforms_are_format_errors(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(FormatError, match=r"t\.json"):
        read_transforms(tmp_path / "t.json")


def test_known_cameras_fit_their_photos(tmp_path: Path) -> None:
    points = SparsePoints(np.ones((1, 3)), np.ones((1, 3), np.uint8))
    write_model(tmp_path, cameras(), points)
    found = load_cameras(tmp_path, [photo("A B.JPG", 320, 240), photo("other.png")])
    assert found.names == ("A B.JPG",)
    assert found.lenses["A B.JPG"].params == (250.0, 255.0, 160.5, 119.5)
    assert (found.figures.given, found.figures.registered) == (2, 1)
    with pytest.raises(CameraError, match="no camera for any"):
        load_cameras(tmp_path, [photo("z.png")])
    with pytest.raises(CameraError, match="640 x 480"):
        load_cameras(tmp_path, [photo("a b.png", 480, 640)])


@settings(max_examples=50, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-1e3, 1e3)] * 3))
def test_axes_round_trip(vector: tuple[float, ...], shift: tuple[float, ...]) -> None:
    rotation, translation = Rotation.from_rotvec(vector).as_matrix(), np.array(shift)
    back = conventions.from_opengl(conventions.to_opengl(rotation, translation))
    np.testing.assert_allclose(back[0], rotation, atol=1e-12)
    np.testing.assert_allclose(back[1], translation, atol=1e-9)
    quaternion = conventions.quaternion_from_rotation(rotation)
    np.testing.assert_allclose(conventions.rotation_from_quaternion(quaternion), rotation, atol=1e-9)


@pytest.mark.parametrize("text", [True, False])
def test_points_that_transforms_name(tmp_path: Path, text: bool) -> None:
    """nerfstudio's and BlenderNeRF's ply_file_path: beside the JSON, in the world of the poses."""
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    content = {"w": 80, "h": 60, "fl_x": 70.0, "ply_file_path": "points/cloud.ply", "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    assert len(read_cameras(tmp_path).points().positions) == 0  # the file is not there
    rows = np.array(
        [(1.0, 2, 3, 9, 8, 7), (-4.0, 5, 0.5, 255, 0, 1)],
        [(n, "f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")],
    )
    (tmp_path / "points").mkdir()
    PlyData([PlyElement.describe(rows, "vertex")], text=text).write(str(tmp_path / "points" / "cloud.ply"))
    points = read_cameras(tmp_path).points()
    np.testing.assert_array_equal(points.positions, [[1, 2, 3], [-4, 5, 0.5]])
    np.testing.assert_array_equal(points.colours, [[9, 8, 7], [255, 0, 1]])
    bare = np.array([(np.nan, 2.0, 3.0), (1.0, 2.0, 3.0)], [(n, "f4") for n in "xyz"])
    PlyData([PlyElement.describe(bare, "vertex")], text=text).write(str(tmp_path / "points" / "cloud.ply"))
    with pytest.raises(FormatError, match="1 points in"):
        read_cameras(tmp_path).points()
    (tmp_path / "points" / "cloud.ply").write_bytes(b"ply\nnothing")
    with pytest.raises(FormatError, match="cannot be read"):
        read_cameras(tmp_path).points()
    # A path that leads out of the folder is looked for inside it.
    (tmp_path / "transforms.json").write_text(json.dumps(content | {"ply_file_path": "../../cloud.ply"}))
    assert len(read_cameras(tmp_path).points().positions) == 0


def _two_folders(path: Path, second: str) -> None:
    """A transforms.json of 'left/0.png' and a second frame, each with a pose of its own, and 'left/1.png'."""
    matrices = [np.eye(4) for _ in range(3)]
    for index, matrix in enumerate(matrices):
        matrix[0, 3] = index
    names = ("./left/0.png", second, "left/1.png")
    frames = [{"file_path": n, "transform_matrix": m.tolist()} for n, m in zip(names, matrices, strict=True)]
    path.write_text(json.dumps({"w": 8, "h": 6, "fl_x": 9.0, "frames": frames}), "utf-8")


def test_photos_of_one_name_in_two_folders_stay_two(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    _two_folders(path, "right/0.png")
    lenses, poses = read_transforms(path)
    assert sorted(poses) == sorted(lenses) == ["1.png", "left/0.png", "right/0.png"]
    assert [round(-poses[name].translation[0]) for name in ("left/0.png", "right/0.png", "1.png")] == [0, 1, 2]
    photo = Photo("0.png", tmp_path / "0.png", np.zeros((6, 8, 3), np.uint8))
    with pytest.raises(CameraError, match="Two cameras could belong to the same photo: 'left/0.png' and 'right/0.png'"):
        load_cameras(path, [photo])
    _two_folders(path, "left/0.png")
    with pytest.raises(FormatError, match="two frames of the photo 'left/0.png'"):
        read_transforms(path)


def test_a_colmap_model_with_one_name_in_two_folders_is_as_clear(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 8 6 9 9 4 3\n")
    images = "1 1 0 0 0 0 0 0 1 left/0.png\n\n2 1 0 0 0 1 0 0 1 {}\n\n"
    (tmp_path / "images.txt").write_text(images.format("right/0.png"))
    assert sorted(read_colmap_cameras(tmp_path)[1]) == ["left/0.png", "right/0.png"]
    photo = Photo("0.png", tmp_path / "0.png", np.zeros((6, 8, 3), np.uint8))
    with pytest.raises(CameraError, match="Two cameras could belong to the same photo"):
        load_cameras(tmp_path, [photo])
    (tmp_path / "images.txt").write_text(images.format("left/0.png"))
    with pytest.raises(FormatError, match="two images 'left/0.png'"):
        read_colmap_cameras(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"])
def test_a_file_that_lacks_a_byte_was_not_written_whole(tmp_path: Path, name: str) -> None:
    """Of as short a model as can be: no observations, every file as small as its content allows."""
    lenses = {f"{i}.png": lens("OPENCV") for i in range(3)}
    poses = {n: Pose(np.eye(3), np.array([i, 0.0, 0.0])) for i, n in enumerate(lenses)}
    write_lenses(tmp_path, lenses, poses, SparsePoints(np.zeros((4, 3)), np.zeros((4, 3), np.uint8)))
    assert colmap._cut_off(tmp_path, lenses, 4) is None
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[:-1])
    assert colmap._cut_off(tmp_path, lenses, 4) == name, len(content)


def test_what_a_killed_process_of_the_same_number_left_is_no_hindrance(tmp_path: Path) -> None:
    (tmp_path / f".model.{os.getpid()}.part").mkdir()
    write_model(tmp_path, cameras(), SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8)))
    assert set(read_model(tmp_path)[1]) == set(cameras()) and not list(tmp_path.glob(".model*"))


def test_a_model_is_on_the_disk_before_it_has_its_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[tuple[str, str]] = []
    replace = os.replace
    monkeypatch.setattr(colmap, "sync_file", lambda path: done.append(("synced", path.name)))
    monkeypatch.setattr(colmap.os, "replace", lambda a, b: done.append(("named", Path(b).name)) or replace(a, b))
    write_model(tmp_path, cameras(), SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8)))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) >= 3 and sorted(done) == sorted((w, n) for n in names for w in ("synced", "named"))
    assert all(done.index(("synced", name)) < done.index(("named", name)) for name in names)


@pytest.mark.parametrize("name", ["cameras.bin", "images.txt", "notes.txt", "cameras.ply", "other"])
def test_a_file_of_a_model_stands_for_its_folder(tmp_path: Path, name: str) -> None:
    write_model(tmp_path, cameras(), SparsePoints(np.zeros((1, 3)), np.zeros((1, 3), np.uint8)))
    if not (tmp_path / name).exists():
        (tmp_path / name).write_text("x")
    found = colmap.COLMAP.find(tmp_path / name)
    assert found == (tmp_path if name in ("cameras.bin", "images.txt") else None)
