"""What the photos determine, painted on a twin and taken off again; suggested cameras as camera objects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.camera import Camera  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.constants import SH_C0  # noqa: E402
from dgs.core.conventions import rotation_from_quaternion  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.dgs_addon.axes import read_camera  # noqa: E402
from dgs.dgs_addon.scene.known import KNOWN, RAMP, add_known, show_known  # noqa: E402
from dgs.dgs_addon.scene.next_views import GAIN, ORDER, add_next_views  # noqa: E402
from dgs.dgs_addon.scene.twin import BASE, add_twin, read_twin  # noqa: E402


def test_known_is_painted_and_taken_off(cloud: GaussianCloud, tmp_path: Path) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    known = np.linspace(0.0, 1.0, len(cloud)).astype(np.float32)
    np.save(tmp_path / "known.npy", known)
    add_known(twin, tmp_path / "known.npy")
    values = np.empty(len(cloud), np.float32)
    twin.data.attributes[KNOWN].data.foreach_get("value", values)
    np.testing.assert_array_equal(values, known)
    own = read_twin(twin)

    show_known(twin, True)
    shown = np.empty(4 * len(cloud), np.float32)
    twin.data.attributes[BASE].data.foreach_get("color", shown)
    colours = shown.reshape(-1, 4)[:, :3] * SH_C0 + 0.5
    np.testing.assert_allclose(colours[[0, -1]], RAMP[[0, 2]], atol=1e-5)
    np.testing.assert_array_equal(read_twin(twin).sh, own.sh)  # exports keep the twin's own colours
    show_known(twin, True)  # twice is once
    show_known(twin, False)
    np.testing.assert_array_equal(read_twin(twin).sh, own.sh)
    assert "dgs_own_base" not in twin.data.attributes


def test_knowledge_of_another_twin_is_refused(cloud: GaussianCloud, tmp_path: Path) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    with pytest.raises(FormatError, match="Suggest Next Views"):
        add_known(twin, tmp_path / "known.npy")
    np.save(tmp_path / "known.npy", np.zeros(len(cloud) + 1, np.float32))
    with pytest.raises(FormatError, match="another state"):
        add_known(twin, tmp_path / "known.npy")


def test_suggested_cameras_stand_where_they_should(tmp_path: Path) -> None:
    rotation = rotation_from_quaternion(np.array([1.0, 0.2, -0.3, 0.1]))
    camera = Camera("orbit_003", 320, 200, 410.0, 410.0, 160.0, 100.0, rotation, np.array([0.1, 0.2, 3.0]))
    view = {
        "name": camera.name,
        "order": 1,
        "bits": 123.4,
        "width": 320,
        "height": 200,
        "fx": 410.0,
        "fy": 410.0,
        "cx": 160.0,
        "cy": 100.0,
        "rotation": rotation.tolist(),
        "translation": camera.translation.tolist(),
    }
    other = {**view, "name": "orbit_007", "order": None}
    path = tmp_path / "next_views.json"
    path.write_text(json.dumps({"views": [other, view]}))
    for _ in range(2):  # again replaces
        (thing,) = add_next_views(path, "next views", bpy.context.scene)
    assert len(bpy.data.collections["next views"].objects) == 1
    assert thing[ORDER] == 1 and thing[GAIN] == pytest.approx(123.4) and "123 bits" in thing.name
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 320, 200
    bpy.context.view_layer.update()
    back = read_camera(thing, bpy.context.scene.render, camera.name)
    np.testing.assert_allclose(back.rotation, camera.rotation, atol=1e-6)
    np.testing.assert_allclose(back.translation, camera.translation, atol=1e-5)
    path.write_text("{")
    with pytest.raises(FormatError, match="damaged"):
        add_next_views(path, "next views", bpy.context.scene)
