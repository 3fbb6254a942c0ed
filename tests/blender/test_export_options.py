"""An export may be what is seen: inside the box, as large, turned and placed as in the scene. Else it says so."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.formats.ply import read_ply  # noqa: E402
from dgs.dgs_addon.axes import points_to_engine  # noqa: E402
from dgs.dgs_addon.scene.crop import add_crop_box  # noqa: E402
from dgs.dgs_addon.scene.nodes import (  # noqa: E402
    COUNT_INPUT,
    SIZE_INPUT,
    THRESHOLD_INPUT,
    UNLIMITED,
    set_splat_input,
    splat_modifier,
    splat_value,
)
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from mathutils import Matrix  # noqa: E402


@pytest.fixture
def twin(cloud: GaussianCloud) -> Iterator[Any]:
    """The twin of the nine splats, active."""
    dgs.register()
    thing = add_twin(cloud, "twin", bpy.context.scene.collection)
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    yield thing
    dgs.unregister()


def export(tmp_path: Path, **options: bool) -> GaussianCloud:
    assert bpy.ops.dgs.export_twin(filepath=str(tmp_path / "out.ply"), **options) == {"FINISHED"}
    return read_ply(tmp_path / "out.ply")


def instances() -> list[Any]:
    """What Blender itself shows of the twin, as matrices of its balls."""
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    return [np.array(item.matrix_world) for item in graph.object_instances if item.is_instance]


def test_what_is_written_is_what_blender_shows(twin: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    box = add_crop_box(twin, bpy.context.scene.collection)
    box.parent = None
    twin.matrix_world = Matrix.Translation((3, -1, 2)) @ Matrix.Rotation(0.4, 4, "Y") @ twin.matrix_world
    box.matrix_world = twin.matrix_world @ Matrix.Translation((0.6, 0, 5)) @ Matrix.Diagonal((1.3, 2, 2, 1))
    modifier = splat_modifier(twin)
    set_splat_input(modifier, THRESHOLD_INPUT, 0.45)
    set_splat_input(modifier, SIZE_INPUT, 1.5)
    set_splat_input(modifier, COUNT_INPUT, 4)
    shown = np.array([matrix[:3, 3] for matrix in instances()])
    assert 0 < len(shown) < 6
    out = export(tmp_path, only_shown=True, placed=True)
    np.testing.assert_allclose(out.means, points_to_engine(shown), atol=1e-5)
    words = capfd.readouterr()
    assert "were written" not in words.out + words.err and "as it came" not in words.out + words.err
    whole = export(tmp_path)
    words = capfd.readouterr()
    assert len(whole) == 9 and "All splats were written" in words.out + words.err
    assert "Written as it came from the photos" in words.out + words.err
    grown = [np.abs(out.log_scales - splat).sum(axis=1).min() for splat in whole.log_scales + np.log(1.5)]
    assert sorted(grown)[len(out) - 1] < 1e-4, "each is one of the twin's, half as large again"


def test_size_and_up_turn_shapes_and_gloss_along(twin: Any, cloud: GaussianCloud, tmp_path: Path) -> None:
    turn = Matrix.Rotation(0.9, 4, (0.3, -0.5, 0.8)) @ Matrix.Scale(2.5, 4)
    twin.matrix_world = turn @ twin.matrix_world
    bpy.context.view_layer.update()
    out = export(tmp_path, placed=True)
    np.testing.assert_allclose(out.log_scales, cloud.log_scales + np.log(2.5), atol=1e-5)
    # Imported again without any placing, it stands and looks as the one that was moved.
    moved = instances()
    twin.hide_viewport = True
    again = add_twin(out, "again", bpy.context.scene.collection)
    np.testing.assert_allclose(np.array(instances()), np.array(moved), atol=2e-5)
    direction = np.array([0.3, 0.4, -0.866])
    here, there = (np.array(thing.matrix_world.to_3x3().normalized()) for thing in (twin, again))

    def gloss(sh: np.ndarray, axes: np.ndarray) -> np.ndarray:
        x, y, z = axes.T @ direction
        return -y * sh[:, 1] + z * sh[:, 2] - x * sh[:, 3]

    np.testing.assert_allclose(gloss(out.sh, there), gloss(cloud.sh, here), atol=1e-5)


def test_what_cannot_be_written_is_refused(twin: Any, tmp_path: Path) -> None:
    set_splat_input(splat_modifier(twin), THRESHOLD_INPUT, 1.0)
    with pytest.raises(RuntimeError, match="shows no splat"):
        export(tmp_path, only_shown=True)
    twin.scale = (1, 1, 2)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="not scaled alike"):
        export(tmp_path, placed=True)
    assert not (tmp_path / "out.ply").exists()


def test_the_number_of_splats_is_limited_from_what_there_is(twin: Any) -> None:
    modifier = splat_modifier(twin)
    assert splat_value(modifier, COUNT_INPUT) == UNLIMITED
    assert bpy.ops.dgs.limit_splats() == {"FINISHED"}
    assert splat_value(modifier, COUNT_INPUT) == 9
