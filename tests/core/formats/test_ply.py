"""3DGS PLY files: both ways, what other programs leave out or add, and damaged files."""

import numpy as np
import pytest
from dgs.core.cloud import GaussianCloud
from dgs.core.errors import FormatError, OutputError
from dgs.core.formats.ply import read_ply, write_ply
from plyfile import PlyData, PlyElement


def some_cloud(count: int = 7, coefficients: int = 4) -> GaussianCloud:
    random = np.random.default_rng(3)

    def values(*shape: int) -> np.ndarray:
        return random.normal(size=shape).astype(np.float32)

    return GaussianCloud(
        values(count, 3), values(count, 3), values(count, 4), values(count), values(count, coefficients, 3)
    )


def assert_same(a: GaussianCloud, b: GaussianCloud) -> None:
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
@pytest.mark.parametrize("count", [0, 1, 7])
def test_round_trip_is_exact(tmp_path, count, coefficients):
    cloud = some_cloud(count, coefficients)
    write_ply(tmp_path / "ü twin.ply", cloud)
    assert_same(read_ply(tmp_path / "ü twin.ply"), cloud)


def test_layout_is_that_of_other_viewers(tmp_path):
    """f_rest holds all of red's coefficients, then green's, then blue's."""
    cloud = some_cloud(2, 4)
    write_ply(tmp_path / "twin.ply", cloud)
    vertex = PlyData.read(tmp_path / "twin.ply")["vertex"]
    names = [p.name for p in vertex.properties]
    assert names[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names[9:18] == [f"f_rest_{i}" for i in range(9)]
    assert names[18:] == ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    np.testing.assert_array_equal(vertex["f_rest_1"], cloud.sh[:, 2, 0])  # second of red
    np.testing.assert_array_equal(vertex["f_rest_3"], cloud.sh[:, 1, 1])  # first of green


def rewritten(path, change, text=False, byte_order="<"):
    """The file with its vertex fields changed by `change(dict) -> dict`."""
    data = PlyData.read(path, mmap=False)["vertex"].data
    fields = change({name: np.array(data[name]) for name in data.dtype.names})
    rows = np.empty(len(data), [(name, values.dtype) for name, values in fields.items()])
    for name, values in fields.items():
        rows[name] = values
    PlyData([PlyElement.describe(rows, "vertex")], text=text, byte_order=byte_order).write(path)


@pytest.mark.parametrize(("text", "byte_order"), [(True, "="), (False, "<"), (False, ">")])
def test_ascii_and_both_byte_orders(tmp_path, text, byte_order):
    cloud = some_cloud()
    write_ply(tmp_path / "twin.ply", cloud)
    rewritten(tmp_path / "twin.ply", lambda fields: fields, text, byte_order)
    assert_same(read_ply(tmp_path / "twin.ply"), cloud)


def test_missing_harmonics_extra_and_shuffled_fields_are_tolerated(tmp_path):
    cloud = some_cloud()
    write_ply(tmp_path / "twin.ply", cloud)

    def change(fields):
        kept = {n: v.astype(np.float64) for n, v in reversed(fields.items()) if not n.startswith(("f_rest", "n"))}
        return {"label": np.arange(len(cloud), dtype=np.uint8), **kept}

    rewritten(tmp_path / "twin.ply", change)
    read = read_ply(tmp_path / "twin.ply")
    assert read.sh.shape == (7, 1, 3) and read.means.dtype == np.float32
    np.testing.assert_array_equal(read.sh[:, 0], cloud.sh[:, 0])
    np.testing.assert_array_equal(read.quaternions, cloud.quaternions)


def test_degree_four_is_cut_to_three(tmp_path):
    cloud = some_cloud(coefficients=25)
    write_ply(tmp_path / "twin.ply", cloud)
    np.testing.assert_array_equal(read_ply(tmp_path / "twin.ply").sh, cloud.sh[:, :16])


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.99])
def test_a_file_that_declares_more_than_it_holds(tmp_path, text, share):
    path = tmp_path / "short.ply"
    write_ply(path, some_cloud(200))
    rewritten(path, lambda fields: fields, text=text)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(FormatError, match="short.ply") as caught:
        read_ply(path)
    assert "\n" not in str(caught.value)


def test_an_absurd_count_does_not_eat_the_memory(tmp_path):
    write_ply(tmp_path / "huge.ply", some_cloud(5))
    data = (tmp_path / "huge.ply").read_bytes()
    (tmp_path / "huge.ply").write_bytes(data.replace(b"element vertex 5", b"element vertex 900000000000000"))
    with pytest.raises(FormatError, match="huge.ply"):
        read_ply(tmp_path / "huge.ply")


@pytest.mark.parametrize(
    "content", [b"", b"\x89PNG\r\n\x1a\n", b"ply\nformat ascii 1.0\nend_header\n", "plü".encode("utf-16")]
)
def test_other_files_are_refused_by_name(tmp_path, content):
    (tmp_path / "other.ply").write_bytes(content)
    with pytest.raises(FormatError, match="other.ply"):
        read_ply(tmp_path / "other.ply")


def test_missing_fields_are_named(tmp_path):
    write_ply(tmp_path / "twin.ply", some_cloud())
    rewritten(tmp_path / "twin.ply", lambda f: {n: v for n, v in f.items() if n not in ("opacity", "rot_2")})
    with pytest.raises(FormatError, match="opacity, rot_2"):
        read_ply(tmp_path / "twin.ply")


def test_odd_number_of_harmonics_is_refused(tmp_path):
    write_ply(tmp_path / "twin.ply", some_cloud())
    rewritten(tmp_path / "twin.ply", lambda f: {n: v for n, v in f.items() if n != "f_rest_8"})
    with pytest.raises(FormatError, match="8 f_rest"):
        read_ply(tmp_path / "twin.ply")


def test_harmonics_with_a_gap_are_refused(tmp_path):
    """As many as a degree has, but not one after the other."""
    write_ply(tmp_path / "twin.ply", some_cloud())
    rewritten(tmp_path / "twin.ply", lambda f: {n.replace("f_rest_8", "f_rest_9"): v for n, v in f.items()})
    with pytest.raises(FormatError, match="9 f_rest"):
        read_ply(tmp_path / "twin.ply")


def test_no_such_file_and_a_folder(tmp_path):
    for path in (tmp_path / "absent.ply", tmp_path):
        with pytest.raises(FormatError, match=path.name):
            read_ply(path)


def test_a_failed_write_keeps_the_old_file(tmp_path):
    write_ply(tmp_path / "twin.ply", some_cloud())
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="file"):
        write_ply(tmp_path / "file" / "twin.ply", some_cloud())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "twin.ply"]
