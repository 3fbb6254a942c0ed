"""Settings kept under a name; twins as assets."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.dgs_addon.scene.nodes import splat_modifier  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.operators.add_preset import SUBFOLDER, DGS_OT_add_preset  # noqa: E402
from dgs.panels.presets import DGS_PT_presets  # noqa: E402


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def test_settings_are_kept_and_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BLENDER_USER_SCRIPTS", str(tmp_path))
    monkeypatch.setattr(DGS_PT_presets, "bl_label", DGS_PT_presets.bl_label)  # (Blender writes the chosen one's there)
    settings = bpy.context.scene.dgs
    settings.photos = "/my/photos"
    settings.medium, settings.sigma, settings.preset, settings.sh_degree = "gaussian", 3.25, "fine", "0"
    settings.max_gaussians, settings.time_limit = 12345, 90.0
    assert bpy.ops.dgs.add_preset(name="Behind glass") == {"FINISHED"}
    file = tmp_path / "presets" / SUBFOLDER / "Behind_glass.py"
    assert file.is_file() and "/my/photos" not in file.read_text()
    for name in ("medium", "sigma", "preset", "sh_degree", "max_gaussians", "time_limit"):
        settings.property_unset(name)
    assert settings.sigma != 3.25
    bpy.ops.script.execute_preset(filepath=str(file), menu_idname="DGS_PT_presets")
    assert (settings.medium, settings.preset, settings.sh_degree) == ("gaussian", "fine", "0")
    assert (settings.sigma, settings.max_gaussians, settings.time_limit) == (3.25, 12345, 90.0)
    assert settings.photos == "/my/photos"
    assert bpy.ops.dgs.add_preset(name="Behind glass", remove_name=True) == {"FINISHED"}
    assert not file.exists()


def test_every_kept_setting_is_one() -> None:
    for path in DGS_OT_add_preset.preset_values:
        assert path.removeprefix("settings.") in bpy.context.scene.dgs.bl_rna.properties


def test_a_twin_becomes_an_asset_with_what_shows_it(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    bpy.context.view_layer.objects.active = twin
    assert bpy.ops.dgs.mark_assets() == {"FINISHED"}
    assert twin.asset_data is not None and "9 splats" in twin.asset_data.description
    assert splat_modifier(twin).node_group.asset_data is not None
    assert [material.name for material in bpy.data.materials if material.asset_data is not None]
    assert bpy.ops.dgs.mark_assets() == {"FINISHED"}
    assert [tag.name for tag in twin.asset_data.tags] == ["Descatter"]
