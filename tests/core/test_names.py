"""Names from files are names: nothing is read or written outside the folder that the user named."""

import json
import os
import struct

import numpy as np
import pytest
from dgs.core.errors import FormatError, PhotoError
from dgs.core.formats.cameras import read_cameras
from dgs.core.formats.gltf import read_gltf
from dgs.core.names import inner_name
from dgs.core.photos.load import photo_files
from dgs.core.photos.write import render_names
from PIL import Image


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("a.png", "a.png"),
        ("cam1/a b.png", "cam1/a b.png"),
        ("../../x/a.png", "x/a.png"),
        ("/abs/a.bmp", "abs/a.bmp"),
        ("a\\b.png", "a/b.png"),
        ("C:\\x\\a.png", "x/a.png"),
        ("./a.png", "a.png"),
        ("a/.../b.png", "a/b.png"),
    ],
)
def test_no_name_leads_out(text, name):
    assert inner_name(text) == name


@pytest.mark.parametrize("text", ["", "..", "/", "a\nb.png", "a\0.png", "\ud800.png", "x" * 300, "a\u2028b"])
def test_what_is_no_name_is_refused(text):
    with pytest.raises(ValueError, match=r"image name"):
        inner_name(text)


def colmap(folder, *names):
    folder.mkdir()
    (folder / "cameras.txt").write_text("1 PINHOLE 40 30 30 30 20 15\n")
    lines = [f"{i} 1 0 0 0 {i} 0 2 1 {name}\n\n" for i, name in enumerate(names, start=1)]
    (folder / "images.txt").write_text("".join(lines))
    return folder


def test_render_writes_into_its_folder_whatever_a_model_calls_its_images(tmp_path):
    """They were written to '../../x/a.png' beside the folder, and to '/abs/a.bmp'."""
    model = read_cameras(colmap(tmp_path / "model", "../../x/a.png", "/abs/a.bmp", "a\\b.png", "../b.png"))
    out = (tmp_path / "out").resolve()
    for file in render_names(sorted(model.poses)).values():
        assert (out / file).resolve().is_relative_to(out), file


def test_images_that_become_one_are_refused(tmp_path):
    with pytest.raises(FormatError, match=r"two images 'a\.png'"):
        read_cameras(colmap(tmp_path / "model", "../a.png", "a.png"))


@pytest.mark.parametrize("name", ["..", "a\nb.png", 7, "\0"])
def test_transforms_name_photos(tmp_path, name):
    frame = {"file_path": name, "w": 4, "h": 3, "fl_x": 4, "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [frame]}))
    with pytest.raises(FormatError, match=r"damaged frame"):
        read_cameras(tmp_path)


@pytest.mark.parametrize("name", [b"a\nb.png", b"a\xff.png", b"a\\b.png", "a\u2028b.png".encode()])
def test_photos_whose_names_cannot_be_kept_are_refused_at_the_door(tmp_path, name):
    """After the whole training there was a traceback, or a twin that could not be opened again."""
    Image.new("RGB", (20, 20)).save(tmp_path / "good.png")
    try:
        (tmp_path / "good.png").rename(tmp_path / os.fsdecode(name))
    except OSError:
        pytest.skip("this file system takes no such name")
    with pytest.raises(
        PhotoError, match=r"(?s)^The name of the photo '[^\n]+' .*Rename it, or its folder\.$"
    ) as caught:
        photo_files(tmp_path)
    str(caught.value).encode("utf-8")


def gltf(folder, uri):
    content = {"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 4}], "nodes": [{"mesh": 0}]}
    content["bufferViews"] = [{"buffer": 0, "byteLength": 4}]
    content["accessors"] = [{"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}]
    primitive = {"attributes": {"POSITION": 0}, "extensions": {"KHR_gaussian_splatting": {}}}
    content["meshes"] = [{"primitives": [primitive]}]
    folder.mkdir(exist_ok=True)
    (folder / "a.gltf").write_text(json.dumps(content))
    return folder / "a.gltf"


@pytest.mark.parametrize("uri", ["../secret.bin", "%2e%2e/secret.bin", "..%5csecret.bin", "link.bin", "/etc/hostname"])
def test_gltf_reads_no_buffer_outside_its_folder(tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(struct.pack("<f", 1.0))
    (tmp_path / "asset").mkdir()
    (tmp_path / "asset" / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(FormatError, match="a buffer outside its folder"):
        read_gltf(gltf(tmp_path / "asset", uri))


def test_gltf_reads_a_buffer_beside_it(tmp_path):
    path = gltf(tmp_path / "asset", "in%20here.bin")
    (tmp_path / "asset" / "in here.bin").write_bytes(struct.pack("<f", 1.0))
    with pytest.raises(FormatError, match="lack"):  # it was read: what is missing are the splats' other values
        read_gltf(path)
