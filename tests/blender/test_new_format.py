"""A new format of splats is in Blender's importer, exporter, drop, menus and `blend` without a word there."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import operators  # noqa: E402
from dgs.command_line import run  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats import cameras as camera_files  # noqa: E402
from dgs.core.formats import gaussians as splat_files  # noqa: E402
from dgs.core.formats.cameras import CAMERA_FORMATS  # noqa: E402
from dgs.core.formats.gaussians import SPLAT_FORMATS  # noqa: E402
from dgs.core.formats.spec import CameraFormatSpec, FormatSpec  # noqa: E402
from dgs.core.lens import Lens  # noqa: E402
from dgs.core.pose import Pose  # noqa: E402
from dgs.dgs_addon.scene.twin import is_twin  # noqa: E402
from dgs.operators import menus  # noqa: E402

PARTS = ("means", "log_scales", "quaternions", "opacity_logits", "sh")
#: Those that read the tables when they are imported.
FILES = ("import_twin", "export_twin", "drop_files", "import_cameras")


def _read(path: Path) -> GaussianCloud:
    with np.load(path) as parts:
        return GaussianCloud(*(parts[name] for name in PARTS))


def _write(path: Path, cloud: GaussianCloud) -> None:
    with path.open("wb") as file:
        np.savez(file, **{name: getattr(cloud, name) for name in PARTS})


TOY = FormatSpec("Toy", (".toy",), "Every value, for nobody", _read, _write)
TOY_CAMERAS = CameraFormatSpec(
    "toy",
    "toy cameras",
    (".toycam",),
    lambda path: path if path.suffix == ".toycam" else None,
    lambda _path, _sizes: (
        {"a.png": Lens("SIMPLE_PINHOLE", 32, 24, (30.0, 16.0, 12.0))},
        {"a.png": Pose(np.eye(3), np.zeros(3))},
    ),
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The add-on as it is where the tables have one more line each."""
    with monkeypatch.context() as changed:
        changed.setattr(splat_files, "SPLAT_FORMATS", (*SPLAT_FORMATS, TOY))
        changed.setattr(camera_files, "CAMERA_FORMATS", (*CAMERA_FORMATS, TOY_CAMERAS))
        _reload()
        dgs.register()
        yield
        dgs.unregister()
    _reload()


def _reload() -> None:
    for name in FILES:
        importlib.reload(importlib.import_module(f"{operators.__name__}.{name}"))
    importlib.reload(operators)


def test_a_new_format_comes_and_goes(toy: None, cloud: GaussianCloud, tmp_path: Path) -> None:
    splat_files.write_gaussians(tmp_path / "in.toy", cloud)
    assert bpy.ops.dgs.import_twin(filepath=str(tmp_path / "in.toy")) == {"FINISHED"}
    assert is_twin(bpy.context.object)
    assert bpy.ops.dgs.export_twin(filepath=str(tmp_path / "out.toy"), format=".toy") == {"FINISHED"}
    assert _read(tmp_path / "out.toy").means.tobytes() == cloud.means.tobytes()
    (tmp_path / "a.toycam").touch()
    assert bpy.ops.dgs.import_cameras(filepath=str(tmp_path / "a.toycam")) == {"FINISHED"}
    assert bpy.context.scene.camera.name == "a"


def test_a_new_format_is_offered(toy: None) -> None:
    operator = bpy.ops.dgs.import_twin.get_rna_type()
    assert "*.toy" in operator.properties["filter_glob"].default.split(";")
    operator = bpy.ops.dgs.export_twin.get_rna_type()
    assert [item.identifier for item in operator.properties["format"].enum_items][-2:] == [".splat", ".toy"]
    assert "*.toycam" in bpy.ops.dgs.import_cameras.get_rna_type().properties["filter_glob"].default.split(";")
    dropped = operators.DGS_FH_twin.bl_file_extensions.split(";")
    assert ".toy" in dropped and ".ply" in dropped and ".glb" not in dropped
    assert "Toy" in operators.DGS_OT_import_twin.description(None, None)
    assert "toy cameras" in operators.DGS_OT_import_cameras.description(None, None)


def test_the_menus_name_a_new_format(toy: None) -> None:
    shown: list[str] = []

    class Menu:
        class layout:
            @staticmethod
            def operator(_name: str, text: str, **_more: object) -> None:
                shown.append(text)

    menus._import_entries(Menu, None)
    menus._export_entries(Menu, None)
    assert [text.count(".toy") for text in shown] == [1, 0, 1] and "toy cameras" in shown[1]


@pytest.mark.parametrize("suffix", [".toy", ".glb", ".spz", ".splat"])
def test_blend_takes_every_format(toy: None, suffix: str, cloud: GaussianCloud, tmp_path: Path) -> None:
    splat_files.write_gaussians(tmp_path / f"twin{suffix}", cloud)
    (tmp_path / "a.toycam").touch()
    words = ["--cameras", str(tmp_path / "a.toycam"), "--out", str(tmp_path / "twin.blend")]
    assert run(["blend", str(tmp_path / f"twin{suffix}"), *words]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "twin.blend"))
    assert is_twin(bpy.data.objects["twin"]) and bpy.context.scene.camera.name == "a"
