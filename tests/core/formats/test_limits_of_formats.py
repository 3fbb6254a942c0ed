"""The ends of every format's range, literal bytes, and what files of other programs have and ours have not."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core.cloud import GaussianCloud
from dgs.core.constants import SH_C0
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.cameras import read_cameras
from dgs.core.formats.colmap import model_folder, read_colmap_cameras, read_colmap_points, read_model, write_lenses
from dgs.core.formats.gaussians import read_gaussians, unusable, write_gaussians
from dgs.core.formats.gltf_file import Asset, open_gltf
from dgs.core.formats.ply import read_ply
from dgs.core.formats.spz import read_spz
from dgs.core.formats.transforms import read_transforms, write_transforms
from dgs.core.formats.turning import moved
from dgs.core.lens import Lens
from dgs.core.pose import Pose
from dgs.core.views import SparsePoints
from scipy.spatial.transform import Rotation


def cloud_of(**changes: Any) -> GaussianCloud:
    """One Gaussian; each value may be replaced."""
    values: dict[str, Any] = {
        "means": [[1.0, 2.0, 3.0]],
        "log_scales": [[-1.0, -2.0, -3.0]],
        "quaternions": [[1.0, 0.0, 0.0, 0.0]],
        "opacity_logits": [0.0],
        "sh": [[[0.0, 0.0, 0.0]]],
    }
    return GaussianCloud(**{name: np.array(value, np.float32) for name, value in (values | changes).items()})


def logit(opacity: float) -> float:
    return float(np.log(opacity / (1 - opacity)))


# --- .splat and SPZ ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("byte", "opacity"), [(0, 0.5 / 255), (1, 1 / 255), (254, 254 / 255), (255, 254.5 / 255)])
def test_an_opacity_byte_stands_for_the_middle_of_its_step(byte: int, opacity: float, tmp_path: Path) -> None:
    """The first and the last are half a step from what no logit has."""
    record = struct.pack("<6f", 0, 0, 0, 1, 1, 1) + bytes([0, 0, 0, byte]) + bytes([255, 128, 128, 128])
    (tmp_path / "a.splat").write_bytes(record)
    assert read_gaussians(tmp_path / "a.splat").opacity_logits[0] == pytest.approx(logit(opacity), abs=1e-4)
    data = spz_of(version=3, opacity=byte)
    (tmp_path / "a.spz").write_bytes(data)
    assert read_gaussians(tmp_path / "a.spz").opacity_logits[0] == pytest.approx(logit(opacity), abs=1e-4)


@pytest.mark.parametrize("name", ["a.splat", "a.spz"])
def test_what_is_beyond_a_byte_is_clipped(name: str, tmp_path: Path) -> None:
    bright, dark = [[9.0, 9.0, 9.0]], [[-9.0, -9.0, -9.0]]
    for sh, logits, colour, opacity in ((bright, 40.0, 255, 254.5 / 255), (dark, -200.0, 0, 0.5 / 255)):
        write_gaussians(tmp_path / name, cloud_of(sh=[sh], opacity_logits=[logits]))
        back = read_gaussians(tmp_path / name)
        range_of = 0.5 / SH_C0 if name == "a.splat" else 0.5 / 0.15
        np.testing.assert_allclose(back.sh[0, 0], range_of if colour else -range_of, rtol=1e-5)
        assert back.opacity_logits[0] == pytest.approx(logit(opacity), abs=1e-3)


def test_a_splat_without_size_or_turn_is_finite(tmp_path: Path) -> None:
    (tmp_path / "a.splat").write_bytes(struct.pack("<6f", *[0.0] * 6) + bytes([10, 20, 30, 40, 128, 128, 128, 128]))
    assert np.exp(read_gaussians(tmp_path / "a.splat").log_scales) == pytest.approx(1e-20, rel=1e-3)
    write_gaussians(tmp_path / "b.splat", cloud_of(quaternions=[[0.0] * 4]))
    assert (tmp_path / "b.splat").read_bytes()[28:] == bytes([128] * 4)
    write_gaussians(tmp_path / "b.spz", cloud_of(quaternions=[[0.0] * 4]))
    np.testing.assert_allclose(np.abs(read_gaussians(tmp_path / "b.spz").quaternions), [[1, 0, 0, 0]], atol=1e-6)


def spz_of(
    version: int = 3,
    degree: int = 0,
    opacity: int = 128,
    rotation: int = 3 << 30,
    magic: int = 0x5053474E,
    fraction: int = 12,
    cut: int = 0,
) -> bytes:
    """A packed file of one Gaussian at (0.5, -1, 2) of the file's axes."""
    header = struct.pack("<IIIBBBB", magic, version, 1, degree, fraction, 0, 0)
    position = b"".join(int(v * 2**fraction).to_bytes(3, "little", signed=True) for v in (0.5, -1.0, 2.0))
    turn = struct.pack("<I", rotation) if version == 3 else bytes([128, 128, 128])
    rest = bytes(range(128, 128 + 3 * ((degree + 1) ** 2 - 1)))
    data = header + position + bytes([opacity]) + bytes([128, 0, 255]) + bytes([160, 0, 255]) + turn + rest
    return gzip.compress(data[: len(data) - cut])


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_spz_values_are_where_the_format_has_them(degree: int, tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(spz_of(degree=degree))
    cloud = read_spz(tmp_path / "a.spz")
    np.testing.assert_array_equal(cloud.means, [[0.5, 1.0, -2.0]])
    np.testing.assert_allclose(cloud.log_scales, [[0.0, -10.0, 255 / 16 - 10]])
    np.testing.assert_allclose(cloud.sh[0, 0], [(128 / 255 - 0.5) / 0.15, -0.5 / 0.15, 0.5 / 0.15], rtol=1e-6)
    signs = [-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1]
    for k in range(1, (degree + 1) ** 2):
        np.testing.assert_allclose(cloud.sh[0, k], signs[k - 1] * (3 * (k - 1) + np.arange(3)) / 128, atol=1e-7)


@pytest.mark.parametrize(
    "wrong", [{"version": 1}, {"version": 4}, {"degree": 4}, {"magic": 0x5053474F}, {"cut": 1}, {"cut": 22}]
)
def test_spz_of_other_kinds_are_refused(wrong: dict[str, int], tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(spz_of(**wrong))
    with pytest.raises(FormatError, match=r"a\.spz"):
        read_spz(tmp_path / "a.spz")


def test_spz_rotations_by_their_bits(tmp_path: Path) -> None:
    """Largest of x y z w in two bits, then 10 bits each (sign, 9 of size in units of sqrt(1/2)/511) from the first."""
    size = 256 / 511 * np.sqrt(0.5)
    rest = np.sqrt(1 - size**2)
    for largest in range(4):
        for place in range(3):
            for sign in (0, 1):
                bits = largest << 30 | (sign << 9 | 256) << 10 * (2 - place)
                (tmp_path / "a.spz").write_bytes(spz_of(rotation=bits))
                found = read_spz(tmp_path / "a.spz").quaternions[0]
                expected = np.zeros(4)
                expected[largest] = rest
                expected[[i for i in range(4) if i != largest][place]] = -size if sign else size
                x, y, z, w = expected
                np.testing.assert_allclose(found, [w, x, -y, -z], atol=1e-6)
                write_gaussians(tmp_path / "b.spz", cloud_of(quaternions=[found * -3.0]))
                packed = gzip.decompress((tmp_path / "b.spz").read_bytes())[-4:]
                assert struct.unpack("<I", packed)[0] == bits, "of either sign and any length"


def test_a_damaged_spz_rotation_is_finite(tmp_path: Path) -> None:
    """Three components as large as can be are longer than a unit quaternion together."""
    (tmp_path / "a.spz").write_bytes(spz_of(rotation=3 << 30 | 511 << 20 | 511 << 10 | 511))
    assert np.isfinite(read_spz(tmp_path / "a.spz").quaternions).all()
    (tmp_path / "a.spz").write_bytes(spz_of(version=2))
    found = read_spz(tmp_path / "a.spz").quaternions[0]
    assert found[0] == pytest.approx(1.0, abs=1e-3) and np.abs(found[1:]).max() < 0.005


@pytest.mark.parametrize(("reach", "bits"), [(1e-3, 20), (7.9, 20), (8.1, 19), (5000.0, 10), (8e6, 0), (3e7, 0)])
def test_spz_positions_are_as_fine_as_24_bits_allow(reach: float, bits: int, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.spz", cloud_of(means=[[reach, -reach, reach]]))
    data = gzip.decompress((tmp_path / "a.spz").read_bytes())
    assert data[13] == bits
    expected = min(reach, 2**23 - 1)
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means[0, 0], expected, atol=0.5 / 2**bits, rtol=1e-6)
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means[0, 1], -expected, atol=1.0 / 2**bits, rtol=1e-6)
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means[0, 2], expected, atol=1.0 / 2**bits, rtol=1e-6)


def test_spz_harmonics_keep_five_bits_of_the_first_degree_and_four_of_the_others(tmp_path: Path) -> None:
    sh = np.linspace(-1.2, 1.2, 48).reshape(1, 16, 3)
    write_gaussians(tmp_path / "a.spz", cloud_of(sh=sh))
    rest = np.frombuffer(gzip.decompress((tmp_path / "a.spz").read_bytes())[-45:], np.uint8).astype(int)
    first, others = rest[:9], rest[9:]
    assert set(first % 8) <= {0, 7} and (first % 16 != 0).any(), "255 is what 256 is clipped to"
    assert set(others % 16) <= {0, 15}
    signs = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1])[:, None]
    off = (rest.reshape(15, 3) - 128) / 128 - np.clip(sh[0, 1:] * signs, -1, 127 / 128)
    assert np.abs(off[:3]).max() <= 4.5 / 128 and np.abs(off[3:]).max() <= 8.5 / 128
    assert abs(off.mean()) < 0.02, "rounded, not cut"


def test_no_gaussians_at_all(tmp_path: Path) -> None:
    empty = GaussianCloud(*(np.zeros(s, np.float32) for s in ((0, 3), (0, 3), (0, 4), 0, (0, 4, 3))))
    write_gaussians(tmp_path / "a.spz", empty)
    assert read_gaussians(tmp_path / "a.spz").sh.shape == (0, 4, 3)


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "a.spz", "a.splat", "a.ply"])
def test_a_file_that_is_not_there_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=name):
        read_gaussians(tmp_path / name)


# --- glTF --------------------------------------------------------------------------------------------------------


def asset_of(values: np.ndarray, kind: int, element: str, view: dict[str, int] | None = None, **more: Any) -> Asset:
    """An asset with one accessor."""
    binary = values.tobytes()
    accessor = {"bufferView": 0, "componentType": kind, "type": element, "count": 2, **more}
    content = {"accessors": [accessor], "bufferViews": [{"buffer": 0, **(view or {})}], "buffers": [{}]}
    return Asset(Path("a.glb"), content, binary)


@pytest.mark.parametrize(
    ("element", "width"), [("SCALAR", 1), ("VEC2", 2), ("VEC3", 3), ("VEC4", 4), ("MAT2", 4), ("MAT3", 9), ("MAT4", 16)]
)
@pytest.mark.parametrize(
    ("kind", "dtype"), [(5120, "<i1"), (5121, "<u1"), (5122, "<i2"), (5123, "<u2"), (5125, "<u4"), (5126, "<f4")]
)
def test_every_type_of_an_accessor_has_its_width(element: str, width: int, kind: int, dtype: str) -> None:
    values = np.arange(1, 2 * width + 1).reshape(2, width).astype(dtype)
    np.testing.assert_array_equal(asset_of(values, kind, element).array(0), values)
    with pytest.raises(FormatError, match="beyond their buffer"):
        asset_of(values.ravel()[:-1], kind, element).array(0)


@pytest.mark.parametrize(("kind", "dtype", "most"), [(5120, "<i1", 127), (5121, "<u1", 255), (5122, "<i2", 32767)])
def test_normalised_integers_end_at_one(kind: int, dtype: str, most: int) -> None:
    lowest = -most - 1 if np.dtype(dtype).kind == "i" else 0
    values = np.array([[most, lowest], [most // 2, 1]]).astype(dtype)
    found = asset_of(values, kind, "VEC2", normalized=True).array(0)
    assert found[0, 0] == 1.0 and found[0, 1] == (-1.0 if lowest else 0.0)
    np.testing.assert_allclose(found[1], [(most // 2) / most, 1 / most])
    floats = np.array([[2.5, -3.0], [0.0, 7.0]], "<f4")
    np.testing.assert_array_equal(asset_of(floats, 5126, "VEC2", normalized=True).array(0), floats)


def test_offsets_and_strides_add_up() -> None:
    raw = np.arange(40, dtype="<f4")
    view = {"byteOffset": 8, "byteStride": 20}
    found = asset_of(raw, 5126, "VEC3", view, byteOffset=4).array(0)
    np.testing.assert_array_equal(found, [[3, 4, 5], [8, 9, 10]])
    with pytest.raises(FormatError, match="beyond their buffer"):  # rows that overlap
        asset_of(raw, 5126, "VEC3", {"byteStride": 8}).array(0)
    just = np.arange(11, dtype="<f4")  # the last row needs no room behind it
    np.testing.assert_array_equal(asset_of(just, 5126, "VEC3", view, byteOffset=4).array(0), [[3, 4, 5], [8, 9, 10]])


def nodes_of(*nodes: dict[str, Any], **more: Any) -> Asset:
    return Asset(Path("a.glb"), {"nodes": list(nodes), "meshes": [{"name": "m"}], **more}, None)


def test_a_matrix_of_a_node_is_column_by_column_and_children_follow_their_parents() -> None:
    turn = np.array([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 6.0], [0.0, 0.0, 1.0, 7.0], [0.0, 0.0, 0.0, 1.0]])
    parent = {"matrix": turn.T.ravel().tolist(), "children": [1]}
    child = {"translation": [1.0, 2.0, 3.0], "scale": [2.0, 3.0, 4.0], "mesh": 0}
    ((mesh, matrix),) = nodes_of(parent, child).placed_meshes()
    assert mesh == {"name": "m"}
    np.testing.assert_allclose(matrix @ [1, 0, 0, 1], turn @ [3, 2, 3, 1])
    np.testing.assert_allclose(matrix @ [0, 1, 0, 1], turn @ [1, 5, 3, 1])
    np.testing.assert_allclose(matrix @ [0, 0, 1, 1], turn @ [1, 2, 7, 1])


def test_a_rotation_of_a_node_is_that_of_its_quaternion() -> None:
    for vector in np.random.default_rng(0).normal(size=(5, 3)):
        turn = Rotation.from_rotvec(vector)
        ((_, matrix),) = nodes_of({"rotation": turn.as_quat().tolist(), "mesh": 0}).placed_meshes()
        np.testing.assert_allclose(matrix[:3, :3], turn.as_matrix(), atol=1e-12)


def test_the_scene_that_is_named_counts() -> None:
    two = ({"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0, "translation": [2, 0, 0]})
    scenes = [{"nodes": [0]}, {"nodes": [1]}]
    seen = lambda asset: [float(matrix[0, 3]) for _, matrix in asset.placed_meshes()]  # noqa: E731
    assert seen(nodes_of(*two, scenes=scenes)) == [1.0]
    assert seen(nodes_of(*two, scenes=scenes, scene=1)) == [2.0]
    assert seen(nodes_of(*two)) == [1.0, 2.0]
    assert seen(nodes_of({"children": [1]}, two[1])) == [2.0], "only those that are below none"
    with pytest.raises(FormatError, match="circle"):
        seen(nodes_of({"children": [1]}, {"children": [1]}, scenes=[{"nodes": [0]}]))
    chain = [{"children": [i + 1]} for i in range(100)]
    assert seen(nodes_of(*chain, two[0], scenes=[{"nodes": [0]}])) == [1.0]
    with pytest.raises(FormatError, match="circle"):
        seen(nodes_of(*chain, {"children": [101]}, two[0], scenes=[{"nodes": [0]}]))


def test_a_glb_by_its_bytes(tmp_path: Path) -> None:
    """Chunks of other kinds are passed over, and what stands behind the declared length."""
    words = json.dumps({"asset": {"version": "2.0"}, "buffers": [{}]}).encode()
    words += b" " * (-len(words) % 4)
    chunk = lambda kind, data: struct.pack("<II", len(data), kind) + data  # noqa: E731
    body = chunk(0x4E4F534A, words) + chunk(0x12345678, b"????") + chunk(0x004E4942, b"data")
    whole = struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
    (tmp_path / "a.glb").write_bytes(whole + b"behind the end")
    assert open_gltf(tmp_path / "a.glb")._buffer(0) == b"data"
    only = chunk(0x4E4F534A, words)
    (tmp_path / "a.glb").write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(only)) + only)
    with pytest.raises(ValueError, match="no content"):
        open_gltf(tmp_path / "a.glb")._buffer(0)
    for head in ((0x46546C67, 1, len(whole)), (0x46546C67, 2, len(whole) + 1)):
        (tmp_path / "a.glb").write_bytes(struct.pack("<III", *head) + body)
        with pytest.raises(FormatError, match=r"no glTF 2\.0"):
            open_gltf(tmp_path / "a.glb")


def test_a_written_glb_is_laid_out_as_the_standard_wants(tmp_path: Path) -> None:
    sh = np.zeros((1, 4, 3))
    sh[0, 1:] = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    cloud = cloud_of(sh=sh, quaternions=[[2.0, 0.0, 0.0, 0.0]], opacity_logits=[np.log(3.0)])
    write_gaussians(tmp_path / "a.glb", cloud)
    data = (tmp_path / "a.glb").read_bytes()
    magic, version, length, words, kind = struct.unpack_from("<IIIII", data)
    assert (magic, version, length, kind) == (0x46546C67, 2, len(data), 0x4E4F534A) and words % 4 == 0
    content = json.loads(data[20 : 20 + words])
    size, kind = struct.unpack_from("<II", data, 20 + words)
    assert kind == 0x004E4942 and 28 + words + size == len(data) and size % 4 == 0
    assert content["asset"]["version"] == "2.0" and content["scene"] == 0 and content["scenes"] == [{"nodes": [0]}]
    assert content["nodes"] == [{"name": "a", "mesh": 0}] and content["buffers"] == [{"byteLength": size}]
    attributes, accessors = content["meshes"][0]["primitives"][0]["attributes"], content["accessors"]
    prefix = "KHR_gaussian_splatting:"
    types = {
        "POSITION": "VEC3",
        "COLOR_0": "VEC4",
        f"{prefix}ROTATION": "VEC4",
        f"{prefix}SCALE": "VEC3",
        f"{prefix}OPACITY": "SCALAR",
        **{f"{prefix}SH_DEGREE_{d}_COEF_{n}": "VEC3" for d, n in ((0, 0), (1, 0), (1, 1), (1, 2))},
    }
    assert {name: accessors[index]["type"] for name, index in attributes.items()} == types
    assert [name for name, i in attributes.items() if accessors[i].get("normalized")] == ["COLOR_0"]
    assert [name for name, i in attributes.items() if "min" in accessors[i]] == ["POSITION"]
    asset = open_gltf(tmp_path / "a.glb")
    value = lambda name: asset.array(attributes[name])[0]  # noqa: E731
    np.testing.assert_allclose(value("COLOR_0"), [0.2140, 0.2140, 0.2140, 0.75], atol=2e-4)  # linear of half grey
    np.testing.assert_allclose(value(f"{prefix}ROTATION"), [0, 0, 0, 1])
    np.testing.assert_allclose(value(f"{prefix}SH_DEGREE_1_COEF_0"), [-1, -2, -3])  # odd in y
    np.testing.assert_allclose(value(f"{prefix}SH_DEGREE_1_COEF_1"), [-4, -5, -6])  # odd in z
    np.testing.assert_allclose(value(f"{prefix}SH_DEGREE_1_COEF_2"), [7, 8, 9])
    write_gaussians(tmp_path / "b.glb", cloud_of(quaternions=[[0.0] * 4], log_scales=[[200.0, -200.0, 0.0]]))
    back = read_gaussians(tmp_path / "b.glb")
    np.testing.assert_array_equal(np.abs(back.quaternions), [[1, 0, 0, 0]])
    np.testing.assert_allclose(back.log_scales, [[80.0, np.log(1e-30), 0.0]], atol=1e-4)


@pytest.mark.parametrize(("opacity", "expected"), [(0.0, 1e-7), (1.0, 1 - 1e-7), (0.25, 0.25)])
def test_opacities_of_gltf_have_a_logit(opacity: float, expected: float, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.glb", cloud_of(opacity_logits=[{0.0: -200.0, 1.0: 200.0}.get(opacity, -np.log(3))]))
    assert read_gaussians(tmp_path / "a.glb").opacity_logits[0] == pytest.approx(logit(expected), rel=1e-4)


def test_a_degree_that_is_not_complete_is_left_out(tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.glb", cloud_of(sh=np.ones((1, 9, 3))))
    data = (tmp_path / "a.glb").read_bytes()
    changed = data.replace(b"SH_DEGREE_2_COEF_4", b"SH_DEGREE_9_COEF_4")
    (tmp_path / "a.glb").write_bytes(changed)
    assert read_gaussians(tmp_path / "a.glb").sh.shape == (1, 4, 3)


def test_splats_of_several_meshes_are_joined(tmp_path: Path) -> None:
    """Of different degrees: what one lacks is none."""
    write_gaussians(tmp_path / "a.glb", cloud_of(sh=np.ones((1, 4, 3))))
    data = (tmp_path / "a.glb").read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20 : 20 + size])
    primitive = json.loads(json.dumps(content["meshes"][0]["primitives"][0]))
    primitive["attributes"] = {n: i for n, i in primitive["attributes"].items() if "DEGREE_1" not in n}
    content["meshes"].append({"primitives": [primitive]})
    content["nodes"].append({"mesh": 1, "translation": [0, 0, 4]})
    content["scenes"] = [{"nodes": [0, 1]}]
    (tmp_path / "b.bin").write_bytes(data[28 + size :])
    content["buffers"][0]["uri"] = "b.bin"
    (tmp_path / "b.gltf").write_text(json.dumps(content))
    both = read_gaussians(tmp_path / "b.gltf")
    np.testing.assert_allclose(both.means, [[1, 2, 3], [1, 2, -1]], atol=1e-6)
    assert both.sh.shape == (2, 4, 3) and (both.sh[0, 1:] == 1).all() and (both.sh[1, 1:] == 0).all()


# --- turning -----------------------------------------------------------------------------------------------------


def test_moved_gaussians_in_closed_form() -> None:
    """A quarter turn about z: x becomes y; e^size grows by the factor; the quaternion is the product."""
    turn = Rotation.from_rotvec([0, 0, np.pi / 2])
    cloud = cloud_of(quaternions=[[np.cos(0.3), np.sin(0.3), 0.0, 0.0]])
    after = moved(cloud, turn.as_matrix(), 2.0, np.array([10.0, 20.0, 30.0]))
    np.testing.assert_allclose(after.means, [[6.0, 22.0, 36.0]], atol=1e-5)
    np.testing.assert_allclose(after.log_scales, cloud.log_scales + np.log(2.0), atol=1e-6)
    inner = Rotation.from_rotvec([0.6, 0, 0])
    found = Rotation.from_quat(after.quaternions[0, [1, 2, 3, 0]])
    np.testing.assert_allclose(found.as_matrix(), (turn * inner).as_matrix(), atol=1e-6)


# --- PLY ---------------------------------------------------------------------------------------------------------


def test_a_ply_of_bytes_and_a_ply_of_lists(tmp_path: Path) -> None:
    names = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2")
    names += ("rot_0", "rot_1", "rot_2", "rot_3")
    head = ["ply", "format ascii 1.0", "element vertex 1", *(f"property char {n}" for n in names), "end_header"]
    (tmp_path / "a.ply").write_text("\n".join(head) + "\n" + " ".join(str(i) for i in range(14)) + "\n")
    cloud = read_ply(tmp_path / "a.ply")
    assert cloud.means.tolist() == [[0, 1, 2]] and cloud.quaternions.tolist() == [[10, 11, 12, 13]]
    assert cloud.sh.tolist() == [[[3, 4, 5]]] and cloud.opacity_logits.tolist() == [6]
    text = (tmp_path / "a.ply").read_text()
    lists = text.replace("property char opacity", "property list uchar char opacity")
    (tmp_path / "a.ply").write_text(lists.replace(" 6 7 ", " 1 6 7 "))
    with pytest.raises(FormatError, match="'opacity'.*no numbers"):
        read_ply(tmp_path / "a.ply")
    (tmp_path / "a.ply").write_text(text.replace("char x", "char packed_position"))
    with pytest.raises(FormatError, match="compressed"):
        read_ply(tmp_path / "a.ply")


def test_gaussians_that_are_not_finite_are_counted() -> None:
    good, bad = cloud_of(), cloud_of(log_scales=[[0.0, np.inf, 0.0]])
    both = GaussianCloud(*(np.concatenate([getattr(c, n) for c in (good, bad, good)]) for n in _FIELDS))
    assert unusable(good) == ""
    assert unusable(both).startswith("1 of 3 ")
    with pytest.raises(FormatError, match="None of the 1"):
        unusable(bad)
    for name in _FIELDS:
        value = np.full_like(getattr(good, name), np.nan)
        with pytest.raises(FormatError, match="is finite"):
            unusable(cloud_of(**{name: value}))


_FIELDS = ("means", "log_scales", "quaternions", "opacity_logits", "sh")


# --- cameras -----------------------------------------------------------------------------------------------------


def binary_model(folder: Path, model: int = 1, params: tuple[float, ...] = (50.0, 51.0, 32.0, 24.0)) -> None:
    """COLMAP's binary files by hand: one lens, two images with observations, two points with tracks."""
    folder.mkdir(parents=True, exist_ok=True)
    lens = struct.pack(f"<iiQQ{len(params)}d", 7, model, 64, 48, *params)
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", 1) + lens)
    image = lambda i, name, seen: (  # noqa: E731
        struct.pack("<i7di", i, 1, 0, 0, 0, i, 2.0, 3.0, 7)
        + name.encode()
        + b"\0"
        + struct.pack("<Q", seen)
        + struct.pack("<ddq", 1.0, 2.0, -1) * seen
    )
    (folder / "images.bin").write_bytes(struct.pack("<Q", 2) + image(1, "ä.png", 3) + image(2, "b.png", 0))
    point = lambda i, at, track: (  # noqa: E731
        struct.pack("<Q3d3BdQ", i, *at, i, 20, 30, 0.5, track) + struct.pack("<ii", 1, 0) * track
    )
    points = struct.pack("<Q", 2) + point(9, (1, 2, 3), 2) + point(4, (4, 5, 6), 0)
    (folder / "points3D.bin").write_bytes(points)


def test_a_binary_model_with_observations_and_tracks(tmp_path: Path) -> None:
    binary_model(tmp_path)
    lenses, poses, points = read_model(tmp_path)
    assert lenses["b.png"] == Lens("PINHOLE", 64, 48, (50.0, 51.0, 32.0, 24.0)) == lenses["ä.png"]
    assert {name: pose.translation.tolist() for name, pose in poses.items()} == {
        "ä.png": [1.0, 2.0, 3.0],
        "b.png": [2.0, 2.0, 3.0],
    }
    np.testing.assert_allclose(poses["b.png"].rotation, np.eye(3))
    assert points.positions.tolist() == [[4, 5, 6], [1, 2, 3]], "by their number"
    assert points.colours.tolist() == [[4, 20, 30], [9, 20, 30]]


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_model_that_lacks_its_last_byte(name: str, tmp_path: Path) -> None:
    binary_model(tmp_path)
    file = tmp_path / name
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(FormatError, match="damaged"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("model", "params"),
    [
        (0, (50.0, 32.0, 24.0)),
        (2, (50.0, 32.0, 24.0, 0.1)),
        (3, (50.0, 32.0, 24.0, 0.1, 0.2)),
        (4, (50.0, 51.0, 32.0, 24.0, 0.1, 0.2, 0.3, 0.4)),
        (5, (50.0, 51.0, 32.0, 24.0, 0.1, 0.2, 0.3, 0.4)),
        (6, (50.0, 51.0, 32.0, 24.0, *(0.1,) * 8)),
        (8, (50.0, 32.0, 24.0, 0.1)),
        (9, (50.0, 32.0, 24.0, 0.1, 0.2)),
    ],
)
def test_lens_models_by_their_number(model: int, params: tuple[float, ...], tmp_path: Path) -> None:
    names = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"]
    names += ["", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"]
    binary_model(tmp_path, model, params)
    lens = read_colmap_cameras(tmp_path)[0]["b.png"]
    assert (lens.model, lens.params) == (names[model], params)


@pytest.mark.parametrize("model", [-1, 7, 10])
def test_lens_models_without_a_name_are_refused_by_number(model: int, tmp_path: Path) -> None:
    binary_model(tmp_path, model)
    with pytest.raises(FormatError, match=f"lens model {model} "):
        read_colmap_cameras(tmp_path)


TEXT = {
    "cameras.txt": "# list\n\n7 SIMPLE_RADIAL 64 48 50 32 24 0.25\n",
    "images.txt": "# images\n\n1 1 0 0 0 1 2 3 7 a.png\n10 11 -1\n2 0 0 0 1 4 5 6 7 b c.png\n\n",
    "points3D.txt": "# points\n9 1 2 3 10 20 30 0.5 1 0\n\n4 4 5 6 40 50 60 0.5\n",
}


def test_a_text_model_with_comments_and_empty_lines(tmp_path: Path) -> None:
    for name, text in TEXT.items():
        (tmp_path / name).write_text(text)
    lenses, poses, points = read_model(tmp_path)
    assert lenses["a.png"] == Lens("SIMPLE_RADIAL", 64, 48, (50.0, 32.0, 24.0, 0.25))
    assert poses["b c.png"].translation.tolist() == [4, 5, 6]
    np.testing.assert_allclose(poses["b c.png"].rotation, np.diag([-1.0, -1.0, 1.0]))
    assert points.positions.tolist() == [[4, 5, 6], [1, 2, 3]] and points.colours.tolist()[1] == [10, 20, 30]


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("images.txt", "1 1 0 0 0 1 2 3", "1 0 0 0 0 1 2 3"),
        ("images.txt", "1 1 0 0 0 1 2 3", "1 1 0 0 0 nan 2 3"),
        ("images.txt", "b c.png", "a.png"),
        ("images.txt", "4 5 6 7 b", "4 5 6 8 b"),
        ("points3D.txt", "9 1 2 3", "9 1 inf 3"),
        ("points3D.txt", "10 20 30 0.5 1 0", "10"),
    ],
)
def test_text_models_that_say_nothing_useful_are_refused(name: str, old: str, new: str, tmp_path: Path) -> None:
    for file, text in TEXT.items():
        (tmp_path / file).write_text(text.replace(old, new) if file == name else text)
    with pytest.raises(FormatError, match="damaged|finite"):
        read_model(tmp_path)


def test_a_model_without_images_or_points(tmp_path: Path) -> None:
    for name, text in TEXT.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "points3D.txt").unlink()
    assert len(read_colmap_points(tmp_path).positions) == 0
    (tmp_path / "images.txt").write_text("# none\n\n")
    with pytest.raises(FormatError, match="places no image"):
        read_model(tmp_path)


@pytest.mark.parametrize("below", [".", "sparse/0", "sparse", "0", "cameras", "colmap/sparse/0"])
def test_a_model_is_found_below(below: str, tmp_path: Path) -> None:
    binary_model(tmp_path / below)
    assert model_folder(tmp_path) == tmp_path / below
    assert set(read_cameras(tmp_path).poses) == {"ä.png", "b.png"}
    for file in ("cameras.bin", "images.bin", "points3D.bin"):
        found = read_cameras(tmp_path / below / file)
        assert found.place == tmp_path / below and len(found.points().positions) == 2
    (tmp_path / below / "images.bin").unlink()
    assert model_folder(tmp_path) is None


def test_lenses_are_shared_and_written_once(tmp_path: Path) -> None:
    a, b = Lens("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0)), Lens("PINHOLE", 64, 48, (60.0, 50.0, 32.0, 24.0))
    points = SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    poses = {name: Pose(np.eye(3), np.array([float(i), 0, 0])) for i, name in enumerate("wxyz")}
    lenses = {"w": a, "x": b, "y": a, "z": b}
    write_lenses(tmp_path, lenses, poses, points, binary=False)
    lines = [line for line in (tmp_path / "cameras.txt").read_text().splitlines() if not line.startswith("#")]
    assert len(lines) == 2
    assert read_colmap_cameras(tmp_path)[0] == lenses
    for place in (tmp_path / "cameras.txt" / "below", tmp_path / "taken"):
        (tmp_path / "taken" / "cameras.bin").mkdir(parents=True, exist_ok=True)
        with pytest.raises(OutputError, match="camera model cannot be written"):
            write_lenses(place, lenses, poses, points)


BASE = {"w": 80, "h": 60, "fl_x": 70.0, "frames": [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}]}


@pytest.mark.parametrize(
    ("values", "model", "params"),
    [
        ({}, "PINHOLE", (70, 70, 40, 30)),
        ({"fl_y": 71.0, "cx": 41.0, "cy": 29.0}, "PINHOLE", (70, 71, 41, 29)),
        ({"camera_angle_y": np.pi / 2}, "PINHOLE", (70, 30, 40, 30)),
        ({"k1": 0.1}, "OPENCV", (70, 70, 40, 30, 0.1, 0, 0, 0)),
        ({"p2": 0.1}, "OPENCV", (70, 70, 40, 30, 0, 0, 0, 0.1)),
        ({"k4": 0.1}, "FULL_OPENCV", (70, 70, 40, 30, 0, 0, 0, 0, 0, 0, 0, 0)),
        (
            {"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4, "camera_model": "OPENCV_FISHEYE"},
            "OPENCV_FISHEYE",
            (70, 70, 40, 30, 0.1, 0.2, 0.3, 0.4),
        ),
        ({"k1": 0.1, "is_fisheye": True}, "OPENCV_FISHEYE", (70, 70, 40, 30, 0.1, 0, 0, 0)),
    ],
)
def test_lenses_of_transforms(values: dict[str, Any], model: str, params: tuple[float, ...], tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text(json.dumps(BASE | values))
    lens = read_transforms(tmp_path)[0]["a.png"]
    assert (lens.model, lens.width, lens.height) == (model, 80, 60)
    assert lens.params == pytest.approx(params)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"fl_x": None, "camera_angle_x": 0.0}, "damaged"),
        ({"fl_x": None, "camera_angle_x": np.pi}, "damaged"),
        ({"fl_x": None}, "focal length is missing"),
        ({"w": None}, "size is missing"),
        ({"h": None}, "size is missing"),
        ({"fl_x": 1e999}, "damaged"),
    ],
)
def test_transforms_that_lack_something(values: dict[str, Any], word: str, tmp_path: Path) -> None:
    content = {key: value for key, value in (BASE | values).items() if value is not None}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=word):
        read_transforms(tmp_path)


def test_sizes_of_transforms_come_from_the_photos_by_their_stem(tmp_path: Path) -> None:
    content = {"camera_angle_x": np.pi / 2, "frames": BASE["frames"]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    lens = read_transforms(tmp_path, {"a": (100, 50)})[0]["a.png"]
    assert (lens.width, lens.height) == (100, 50)
    assert lens.params == pytest.approx((50, 50, 50, 25))


def test_transforms_are_written_for_everybody(tmp_path: Path) -> None:
    from dgs.core.camera import Camera

    camera = Camera("ü.png", 80, 60, 70.0, 71.0, 41.0, 29.0, np.eye(3), np.array([1.0, 2.0, 3.0]))
    write_transforms(tmp_path / "t.json", {"ü.png": camera})
    content = json.loads((tmp_path / "t.json").read_text("utf-8"))
    (frame,) = content["frames"]
    assert content["camera_model"] == "PINHOLE" and frame["file_path"] == "ü.png"
    assert [frame[key] for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")] == [80, 60, 70.0, 71.0, 41.0, 29.0]
    # Camera to world; the camera's y points up and its z back.
    np.testing.assert_allclose(frame["transform_matrix"], [[1, 0, 0, -1], [0, -1, 0, -2], [0, 0, -1, -3], [0, 0, 0, 1]])
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        write_transforms(tmp_path / "file" / "t.json", {})
