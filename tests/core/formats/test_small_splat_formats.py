"""SPZ and .splat: what comes back is what went in, to the last step of the format."""

import gzip
import struct

import numpy as np
import pytest
from dgs.core.cloud import GaussianCloud
from dgs.core.constants import SH_C0
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.gaussians import read_gaussians, write_gaussians
from dgs.core.formats.spz import read_spz


@pytest.fixture(params=[0, 1, 2, 3])
def cloud(request):
    random = np.random.default_rng(request.param)
    count, coefficients = 500, (request.param + 1) ** 2
    return GaussianCloud(
        means=random.normal(0, 3, (count, 3)).astype(np.float32),
        log_scales=random.uniform(-8, 0, (count, 3)).astype(np.float32),
        quaternions=random.normal(size=(count, 4)).astype(np.float32),
        opacity_logits=random.uniform(-4, 4, count).astype(np.float32),
        sh=random.uniform(-0.9, 0.9, (count, coefficients, 3)).astype(np.float32),
    )


def same_turn(a, b):
    """Largest angle between two lists of quaternions, in radians."""
    unit = [q / np.linalg.norm(q, axis=1, keepdims=True) for q in (a.astype(np.float64), b.astype(np.float64))]
    return 2 * np.arccos(np.minimum(1.0, np.abs((unit[0] * unit[1]).sum(axis=1)))).max()


def opacity(cloud):
    return 1 / (1 + np.exp(-cloud.opacity_logits.astype(np.float64)))


def test_spz_round_trip(cloud, tmp_path):
    write_gaussians(tmp_path / "a.spz", cloud)
    back = read_gaussians(tmp_path / "a.spz")
    np.testing.assert_allclose(back.means, cloud.means, atol=2e-6)
    np.testing.assert_allclose(back.log_scales, cloud.log_scales, atol=1 / 32 + 1e-6)
    np.testing.assert_allclose(opacity(back), opacity(cloud), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(back.sh[:, 0], cloud.sh[:, 0], atol=0.5 / 255 / 0.15 + 1e-6)
    np.testing.assert_allclose(back.sh[:, 1:4], cloud.sh[:, 1:4], atol=4.51 / 128)
    np.testing.assert_allclose(back.sh[:, 4:], cloud.sh[:, 4:], atol=8.51 / 128)
    assert same_turn(back.quaternions, cloud.quaternions) < 0.006
    assert (tmp_path / "a.spz").stat().st_size < 500 * (21 + 3 * cloud.sh.shape[1])


def test_spz_turns_the_axes(tmp_path):
    """In the file y points up and z back: the bytes say so."""
    cloud = GaussianCloud(
        means=np.array([[1.0, 2.0, 3.0]], np.float32),
        log_scales=np.zeros((1, 3), np.float32),
        quaternions=np.array([[0.9, 0.1, 0.2, 0.3]], np.float32),
        opacity_logits=np.zeros(1, np.float32),
        sh=np.array([[[0.0] * 3, [0.5] * 3, [0.25] * 3, [0.125] * 3]], np.float32),
    )
    write_gaussians(tmp_path / "a.spz", cloud)
    data = gzip.decompress((tmp_path / "a.spz").read_bytes())
    magic, version, count, degree, fraction, _, _ = struct.unpack_from("<IIIBBBB", data)
    assert (magic, version, count, degree) == (0x5053474E, 3, 1, 1)
    positions = [int.from_bytes(data[16 + 3 * i : 19 + 3 * i], "little", signed=True) / 2**fraction for i in range(3)]
    assert positions == [1.0, -2.0, -3.0]
    harmonics = (np.frombuffer(data[-9:], np.uint8).astype(float) - 128) / 128
    assert harmonics[::3].tolist() == [-0.5, -0.25, 0.125]  # odd in y, in z, in x


def test_spz_harmonics_keep_their_meaning(tmp_path):
    """Each harmonic's sign is that of the real harmonic with y and z turned round."""
    from dgs.core.formats.turning import FLIP

    x, y, z = np.random.default_rng(0).normal(size=3)

    def real(x, y, z):
        return np.array(
            [
                y,
                z,
                x,
                x * y,
                y * z,
                2 * z * z - x * x - y * y,
                x * z,
                x * x - y * y,
                y * (3 * x * x - y * y),
                x * y * z,
                y * (4 * z * z - x * x - y * y),
                z * (2 * z * z - 3 * x * x - 3 * y * y),
                x * (4 * z * z - x * x - y * y),
                z * (x * x - y * y),
                x * (x * x - 3 * y * y),
            ]
        )

    np.testing.assert_allclose(real(x, -y, -z), FLIP * real(x, y, z))


def test_spz_version_2_is_read(tmp_path):
    header = struct.pack("<IIIBBBB", 0x5053474E, 2, 1, 0, 12, 0, 0)
    position = b"".join(int(v * 4096).to_bytes(3, "little", signed=True) for v in (0.5, -1.0, 2.0))
    rotation = bytes(round(127.5 + 127.5 * v) for v in (0.6, 0.0, 0.0))
    data = header + position + bytes([128]) + bytes([128, 128, 128]) + bytes([160, 160, 160]) + rotation
    (tmp_path / "old.spz").write_bytes(gzip.compress(data))
    cloud = read_spz(tmp_path / "old.spz")
    assert cloud.means.tolist() == [[0.5, 1.0, -2.0]] and np.allclose(cloud.log_scales, 0)
    assert same_turn(cloud.quaternions, np.array([[0.8, 0.6, 0, 0]])) < 0.02


def test_splat_round_trip(cloud, tmp_path):
    write_gaussians(tmp_path / "a.splat", cloud)
    assert (tmp_path / "a.splat").stat().st_size == 32 * len(cloud)
    back = read_gaussians(tmp_path / "a.splat")
    assert back.means.tobytes() == cloud.means.tobytes()
    np.testing.assert_allclose(back.log_scales, cloud.log_scales, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(opacity(back), opacity(cloud), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(back.sh[:, 0] * SH_C0, cloud.sh[:, 0] * SH_C0, atol=0.5 / 255 + 1e-6)
    assert same_turn(back.quaternions, cloud.quaternions) < 0.02 and back.sh.shape[1] == 1


@pytest.mark.parametrize("name", ["a.spz", "a.splat", "a.ply", "a.obj"])
def test_damaged_files_are_refused(name, tmp_path):
    with pytest.raises(FormatError):
        read_gaussians(tmp_path / name)
    for data in (b"", b"nonsense", gzip.compress(b"short"), gzip.compress(b"\0" * 64)):
        (tmp_path / name).write_bytes(data)
        if name != "a.splat" or len(data) % 32:
            with pytest.raises(FormatError):
                read_gaussians(tmp_path / name)


@pytest.mark.parametrize("name", ["a.spz", "a.splat"])
def test_places_that_cannot_be_written_are_named(name, cloud, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        write_gaussians(tmp_path / "file" / name, cloud)


def test_splat_golden_bytes(tmp_path):
    """One Gaussian, byte for byte: a reader and a writer that err alike would not notice it themselves."""
    record = (
        struct.pack("<6f", 1.0, 2.0, 3.0, 0.5, 0.25, 0.125) + bytes([255, 128, 0, 204]) + bytes([243, 141, 102, 166])
    )
    (tmp_path / "golden.splat").write_bytes(record)
    cloud = read_gaussians(tmp_path / "golden.splat")
    assert cloud.means.tolist() == [[1.0, 2.0, 3.0]]
    np.testing.assert_allclose(np.exp(cloud.log_scales), [[0.5, 0.25, 0.125]], rtol=1e-6)
    np.testing.assert_allclose(cloud.quaternions, [[115 / 128, 13 / 128, -26 / 128, 38 / 128]], atol=1e-7)
    np.testing.assert_allclose(0.5 + SH_C0 * cloud.sh[0, 0], [1.0, 128 / 255, 0.0], atol=1e-6)
    np.testing.assert_allclose(opacity(cloud), [0.8], atol=1e-6)
    length = np.linalg.norm([115, 13, -26, 38]) / 128
    write_gaussians(tmp_path / "again.splat", cloud)
    again = (tmp_path / "again.splat").read_bytes()
    assert again[:28] == record[:28]
    turned = np.array(list(again[28:]), float) - 128
    np.testing.assert_allclose(turned, np.array([115, 13, -26, 38]) / length, atol=0.5)


def of(**changes):
    """One Gaussian."""
    usual = {
        "means": np.zeros((1, 3)),
        "log_scales": np.zeros((1, 3)),
        "quaternions": np.array([[1.0, 0, 0, 0]]),
        "opacity_logits": np.zeros(1),
        "sh": np.zeros((1, 1, 3)),
    }
    return GaussianCloud(**{name: np.asarray(value, np.float32) for name, value in {**usual, **changes}.items()})


def test_a_splat_without_a_size_has_the_least(tmp_path):
    write_gaussians(tmp_path / "a.splat", of(log_scales=[[-200.0, 0.0, 0.0]]))  # exp(-200) is 0 in float32
    np.testing.assert_allclose(read_gaussians(tmp_path / "a.splat").log_scales, [[np.log(1e-20), 0.0, 0.0]], rtol=1e-5)


@pytest.mark.parametrize(("length", "turned"), [(1.1e-12, True), (1e-12, False), (0.9e-12, False), (0.0, False)])
def test_a_rotation_of_no_length_is_none(tmp_path, length, turned):
    write_gaussians(tmp_path / "a.spz", of(quaternions=[[0.0, length, 0.0, 0.0]]))
    back = read_gaussians(tmp_path / "a.spz").quaternions
    np.testing.assert_allclose(np.abs(back), [[0, 1, 0, 0] if turned else [1, 0, 0, 0]], atol=1e-3)
