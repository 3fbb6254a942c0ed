"""glTF with KHR_gaussian_splatting: what comes back is what went in; nodes, integers and damage are understood."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from dgs.core.cloud import GaussianCloud
from dgs.core.colour import srgb_to_linear
from dgs.core.constants import SH_C0
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.gaussians import read_gaussians, write_gaussians
from dgs.core.formats.turning import flipped, harmonics, moved, rotated_harmonics
from dgs.core.rasterizer.harmonics import basis
from scipy.spatial.transform import Rotation

PREFIX = "KHR_gaussian_splatting:"


@pytest.fixture(params=[0, 1, 2, 3])
def cloud(request: Any) -> GaussianCloud:
    random = np.random.default_rng(request.param)
    count = 301
    return GaussianCloud(
        means=random.normal(0, 3, (count, 3)).astype(np.float32),
        log_scales=random.uniform(-8, 0, (count, 3)).astype(np.float32),
        quaternions=random.normal(size=(count, 4)).astype(np.float32),
        opacity_logits=random.uniform(-4, 4, count).astype(np.float32),
        sh=random.uniform(-0.9, 0.9, (count, (request.param + 1) ** 2, 3)).astype(np.float32),
    )


def parts(path: Path) -> tuple[dict[str, Any], bytes]:
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def covariances(cloud: GaussianCloud) -> np.ndarray:
    turn = Rotation.from_quat(cloud.quaternions.astype(np.float64)[:, [1, 2, 3, 0]]).as_matrix()
    factor = turn * np.exp(cloud.log_scales.astype(np.float64))[:, None, :]
    return factor @ factor.transpose(0, 2, 1)


def test_round_trip(cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.glb", cloud)
    back = read_gaussians(tmp_path / "a.glb")
    assert back.means.tobytes() == cloud.means.tobytes() and back.sh.tobytes() == cloud.sh.tobytes()
    np.testing.assert_allclose(back.log_scales, cloud.log_scales, atol=1e-6)
    np.testing.assert_allclose(back.opacity_logits, cloud.opacity_logits, atol=1e-4)
    np.testing.assert_allclose(covariances(back), covariances(cloud), rtol=1e-4, atol=1e-9)


def test_the_file_is_as_published(cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.glb", cloud)
    content, binary = parts(tmp_path / "a.glb")
    assert len((tmp_path / "a.glb").read_bytes()) % 4 == 0
    assert content["extensionsUsed"] == ["KHR_gaussian_splatting"]
    primitive = content["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert extension["kernel"] == "ellipse" and extension["colorSpace"] == "srgb_rec709_display"

    def array(name: str) -> np.ndarray:
        accessor = content["accessors"][primitive["attributes"][name]]
        view = content["bufferViews"][accessor["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        kind = {5126: "<f4", 5123: "<u2"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        return np.frombuffer(binary, kind, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)

    # y up and z back; x y z w; sizes and opacities as they are, not as logarithms and logits.
    np.testing.assert_array_equal(array("POSITION"), cloud.means * [1, -1, -1])
    position = content["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_allclose(position["max"], (cloud.means * [1, -1, -1]).max(axis=0))
    rotation = array(f"{PREFIX}ROTATION")
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=1), 1, atol=1e-6)
    w, x = cloud.quaternions[0, :2]
    np.testing.assert_allclose(rotation[0, 3] / rotation[0, 0], w / x, rtol=1e-5)
    np.testing.assert_allclose(array(f"{PREFIX}SCALE"), np.exp(cloud.log_scales), rtol=1e-6)
    np.testing.assert_allclose(array(f"{PREFIX}OPACITY")[:, 0], 1 / (1 + np.exp(-cloud.opacity_logits)), rtol=1e-5)
    shown = srgb_to_linear(np.clip(0.5 + SH_C0 * cloud.sh[:, 0].astype(float), 0, 1))
    np.testing.assert_allclose(array("COLOR_0")[:, :3] / 65535, shown, atol=1 / 65535)
    names = {name for name in primitive["attributes"] if "SH_DEGREE" in name}
    assert len(names) == cloud.sh.shape[1] and f"{PREFIX}SH_DEGREE_0_COEF_0" in names


def rewritten(path: Path, change: Any, out: Path) -> Path:
    """The file as .gltf with its buffer inside, after `change` of the JSON."""
    content, binary = parts(path)
    content["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    change(content)
    out.write_text(json.dumps(content), "utf-8")
    return out


def test_nodes_place_turn_and_size_the_splats(cloud: GaussianCloud, tmp_path: Path) -> None:
    """Seen from a camera that moves along, nothing changes: neither shape nor colour."""
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7])

    def change(content: dict[str, Any]) -> None:
        content["nodes"] = [
            {"translation": [1, 2, 3], "children": [1]},
            {"rotation": turn.as_quat().tolist(), "scale": [2, 2, 2], "mesh": 0},
        ]
        content["scenes"] = [{"nodes": [0]}]

    write_gaussians(tmp_path / "a.glb", cloud)
    back = flipped(read_gaussians(rewritten(tmp_path / "a.glb", change, tmp_path / "b.gltf")))
    before, matrix = flipped(cloud), turn.as_matrix()
    np.testing.assert_allclose(back.means, 2 * before.means @ matrix.T + [1, 2, 3], atol=2e-5)
    np.testing.assert_allclose(covariances(back), 4 * matrix @ covariances(before) @ matrix.T, rtol=1e-3, atol=1e-8)
    direction = np.array([[0.48, -0.6, 0.64]])
    coefficients = cloud.sh.shape[1]
    seen = np.einsum("k,nkc->nc", harmonics(direction)[0, :coefficients], before.sh)
    turned = np.einsum("k,nkc->nc", harmonics(direction @ matrix.T)[0, :coefficients], back.sh)
    np.testing.assert_allclose(turned, seen, atol=1e-5)


def test_stretched_and_mirrored_nodes_are_refused(tmp_path: Path) -> None:
    cloud = GaussianCloud(*(np.zeros(s, np.float32) for s in ((2, 3), (2, 3), (2, 4), 2, (2, 1, 3))))
    write_gaussians(tmp_path / "a.glb", cloud)
    for scale in ([1, 2, 1], [-1, 1, 1]):
        path = rewritten(tmp_path / "a.glb", lambda c, s=scale: c["nodes"][0].update(scale=s), tmp_path / "b.gltf")
        with pytest.raises(FormatError, match="stretches or mirrors"):
            read_gaussians(path)


def test_small_integers_and_strides_are_read(tmp_path: Path) -> None:
    """Rotations as normalised bytes and opacities as normalised shorts, interleaved in one view."""
    rows = struct.pack("<4bHxx", 0, 0, 127, 0, 65535) + struct.pack("<4bHxx", 0, 0, 0, 127, 13107)
    floats = np.array([[1, 2, 3], [4, 5, 6]], "<f4").tobytes()
    scales = np.array([[1, 1, 1], [0.5, 0.25, 0.125]], "<f4").tobytes()
    data = rows + floats + scales
    views = [{"buffer": 0, "byteLength": 16, "byteStride": 8}, {"buffer": 0, "byteOffset": 16, "byteLength": 48}]
    accessors = [
        {"bufferView": 0, "componentType": 5120, "type": "VEC4", "count": 2, "normalized": True},
        {"bufferView": 0, "byteOffset": 4, "componentType": 5123, "type": "SCALAR", "count": 2, "normalized": True},
        {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": 2},
        {"bufferView": 1, "byteOffset": 24, "componentType": 5126, "type": "VEC3", "count": 2},
    ]
    attributes = {
        "POSITION": 2,
        f"{PREFIX}ROTATION": 0,
        f"{PREFIX}SCALE": 3,
        f"{PREFIX}OPACITY": 1,
        f"{PREFIX}SH_DEGREE_0_COEF_0": 2,
    }
    extension = {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
    content = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "a%20b.bin"}],
        "meshes": [{"primitives": [{"mode": 0, "attributes": attributes, "extensions": extension}]}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"a b\.bin"):
        read_gaussians(tmp_path / "a.gltf")
    (tmp_path / "a b.bin").write_bytes(data)
    cloud = read_gaussians(tmp_path / "a.gltf")
    np.testing.assert_allclose(cloud.means, [[1, -2, -3], [4, -5, -6]])
    np.testing.assert_allclose(np.abs(cloud.quaternions), [[0, 0, 0, 1], [1, 0, 0, 0]])
    np.testing.assert_allclose(np.exp(cloud.log_scales[1]), [0.5, 0.25, 0.125], rtol=1e-6)
    assert cloud.opacity_logits[0] > 10 and cloud.opacity_logits[1] == pytest.approx(np.log(0.2 / 0.8), abs=1e-3)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda c: c["meshes"][0]["primitives"][0]["attributes"].pop(f"{PREFIX}SCALE"), "lack.*SCALE"),
        (lambda c: c["meshes"][0]["primitives"][0].pop("extensions"), "holds no Gaussian splats"),
        (lambda c: c["accessors"][0].update(count=10**9), "damaged"),
        (lambda c: c["accessors"][0].update(sparse={}), "sparse"),
        (lambda c: c["nodes"].__setitem__(0, {"mesh": 7}), "damaged"),
        (lambda c: c["nodes"][0].update(children=[0]), "circle"),
        (lambda c: c["asset"].update(version="1.0"), "no glTF 2.0"),
        (lambda c: _extension(c).update(extensions={"KHR_compressed": {}}), "compressed"),
        (lambda c: _extension(c).update(colorSpace="lin_rec709_display"), "lin_rec709_display"),
    ],
)
def test_what_cannot_be_read_is_named(change: Any, word: str, tmp_path: Path) -> None:
    cloud = GaussianCloud(*(np.zeros(s, np.float32) for s in ((2, 3), (2, 3), (2, 4), 2, (2, 1, 3))))
    write_gaussians(tmp_path / "a.glb", cloud)
    with pytest.raises(FormatError, match=word):
        read_gaussians(rewritten(tmp_path / "a.glb", change, tmp_path / "b.gltf"))


def _extension(content: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = content["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]
    return found


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.99])
def test_files_that_were_cut_off_are_refused(share: float, cloud: GaussianCloud, tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.glb", cloud)
    data = (tmp_path / "a.glb").read_bytes()
    (tmp_path / "a.glb").write_bytes(data[: int(share * len(data))])
    with pytest.raises(FormatError, match=r"a\.glb"):
        read_gaussians(tmp_path / "a.glb")


def test_places_that_cannot_be_written_are_named(cloud: GaussianCloud, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        write_gaussians(tmp_path / "file" / "a.glb", cloud)
    with pytest.raises(FormatError, match=r"\.glb"):
        write_gaussians(tmp_path / "a.gltf", cloud)


def test_harmonics_are_the_rasterizers() -> None:
    directions = torch.nn.functional.normalize(torch.randn(50, 3, dtype=torch.float64), dim=1)
    np.testing.assert_allclose(harmonics(directions.numpy()), basis(directions, 16).numpy(), atol=1e-12)


def test_half_a_turn_is_the_same_in_both_ways(cloud: GaussianCloud) -> None:
    turn = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(rotated_harmonics(cloud.sh, turn), flipped(cloud).sh, atol=1e-6)
    turned = moved(cloud, turn, 1.0, np.zeros(3))
    np.testing.assert_allclose(covariances(turned), covariances(flipped(cloud)), atol=1e-7)
    assert flipped(flipped(cloud)).sh.tobytes() == cloud.sh.tobytes()
