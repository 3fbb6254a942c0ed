"""True size and up direction: points that are measured afterwards lie where they should."""

from __future__ import annotations

import math
from typing import Any

import pytest

bpy = pytest.importorskip("bpy")
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.core.errors import FormatError  # noqa: E402
from dgs.dgs_addon.scene.placing import set_length, set_up  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from mathutils import Matrix  # noqa: E402


@pytest.fixture
def twin(cloud: GaussianCloud) -> Any:
    """A twin that stands tilted, with three cameras 2 apart whose up is its own."""
    thing = add_twin(cloud, "twin", bpy.context.scene.collection)
    for place in range(3):
        camera = bpy.data.objects.new(f"camera {place}", bpy.data.cameras.new("c"))
        bpy.context.scene.collection.objects.link(camera)
        camera.parent = thing
        camera.matrix_world = Matrix.Translation((2.0 * place, 0, 0)) @ Matrix.Rotation(math.pi / 2, 4, "X")
    bpy.context.view_layer.update()
    thing.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.4, 4, "Y") @ thing.matrix_world
    bpy.context.view_layer.update()
    return thing


def mark(*place: float) -> Any:
    thing = bpy.data.objects.new("mark", None)
    thing.location = place
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    return thing


def test_two_points_get_their_distance(twin: Any) -> None:
    a, b = mark(0, 0, 0), mark(0, 0, 4)
    assert set_length(twin, [a, b], 10.0) == pytest.approx(2.5)
    bpy.context.view_layer.update()
    assert (a.matrix_world.translation - b.matrix_world.translation).length == pytest.approx(10.0, rel=1e-5)
    assert twin.matrix_world.to_scale()[0] == pytest.approx(2.5, rel=1e-5)


def test_the_way_through_the_cameras_gets_its_length(twin: Any) -> None:
    assert set_length(twin, [], 8.0) == pytest.approx(2.0, rel=1e-5)
    bpy.context.view_layer.update()
    places = [child.matrix_world.translation for child in sorted(twin.children, key=lambda c: c.name)]
    assert (places[2] - places[0]).length == pytest.approx(8.0, rel=1e-5)


def test_cameras_tell_up(twin: Any) -> None:
    assert set_up(twin, []) == pytest.approx(0.4, abs=1e-5)
    bpy.context.view_layer.update()
    assert twin.children[0].matrix_world.to_3x3().col[1][2] == pytest.approx(1.0, abs=1e-5)


def test_a_floor_shows_what_is_up(twin: Any) -> None:
    marks = [mark(0, 0, 0), mark(1, 0, 1), mark(0, 1, 0), mark(1, 1, 1)]
    assert set_up(twin, marks) == pytest.approx(math.pi / 4, abs=1e-5)
    bpy.context.view_layer.update()
    heights = [thing.matrix_world.translation.z for thing in marks]
    assert max(heights) - min(heights) < 1e-5


def test_what_cannot_be_measured_is_refused(cloud: GaussianCloud) -> None:
    alone = add_twin(cloud, "alone", bpy.context.scene.collection)
    with pytest.raises(FormatError, match="two objects"):
        set_length(alone, [], 1.0)
    with pytest.raises(FormatError, match="three objects"):
        set_up(alone, [mark(0, 0, 0), mark(1, 0, 0)])
    with pytest.raises(FormatError, match="on a line"):
        set_up(alone, [mark(0, 0, 0), mark(1, 0, 0), mark(2, 0, 0)])
