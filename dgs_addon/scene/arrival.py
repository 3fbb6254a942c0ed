"""A twin's arrival: it stands upright, alone, and in the middle of the view.

What Blender's own new file holds (cube, light and camera, as long as nobody touched them) is hidden: it stands in the
twin. A twin that came before and was moved, turned or scaled stays where it is.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any

import bpy
import numpy as np
from mathutils import Quaternion, Vector

from ...core.errors import FormatError
from .changes import hide
from .placing import cameras_of, set_up
from .twin import read_means

#: Of Blender's own new file: name, kind of object, place.
_STARTUP = (
    ("Cube", "MESH", (0.0, 0.0, 0.0)),
    ("Light", "LIGHT", (4.0762, 1.0055, 5.9039)),
    ("Camera", "CAMERA", (7.3589, -6.9258, 4.9583)),
)
#: How exactly (m) they must stand there: Blender keeps 32 bits.
_THERE = 1e-3
#: Width of what a 3D view's lens (mm) looks through, mm; of its own cameras it is 36.
_VIEW_SENSOR = 72.0
#: How much farther away than the photo a view looks from: sidebar and toolbar lie over its borders.
AIR = 1.3
#: Share of the splats' distances from their middle that a view without cameras takes in.
_BULK = 0.9
#: Degrees from which on given cameras count as lying on their side: a world that somebody has levelled is left as it
#: is, and cameras held by hand or on a dome lean by less, on average.
_LEVEL = 30.0


def hide_startup(scene: Any) -> list[str]:
    """Hides what is left of Blender's own new file; returns the names."""
    hidden = []
    for name, _, _ in _STARTUP:
        thing = scene.objects.get(name)
        if thing is not None and is_startup(thing):
            hide(thing, scene)
            hidden.append(name)
    return hidden


def is_startup(thing: Any) -> bool:
    """Whether a `bpy` object is one of Blender's own new file that nobody has touched."""
    return any(thing.name == name and thing.type == kind and _untouched(thing, place) for name, kind, place in _STARTUP)


def _untouched(thing: Any, place: tuple[float, float, float]) -> bool:
    plain = not (thing.hide_render or thing.parent or thing.children or thing.modifiers or thing.constraints)
    plain = plain and thing.animation_data is None and thing.data.users == 1
    there = (thing.location - Vector(place)).length < _THERE and tuple(thing.scale) == (1.0, 1.0, 1.0)
    if thing.type == "MESH":
        corners = {tuple(abs(value) for value in vertex.co) for vertex in thing.data.vertices}
        plain = plain and len(thing.data.vertices) == 8 and corners == {(1.0, 1.0, 1.0)}
    return bool(plain and there)


def stand_upright(twin: Any, given: bool) -> float:
    """Turns a twin so that its cameras stand upright, on average.

    Args:
        twin: `bpy` object with its cameras as children.
        given: whether the cameras were given: then somebody may have levelled their world, and it is turned only where
            they would lie on their side.

    Returns:
        The angle in radians; 0 where nothing was turned.
    """
    cameras = cameras_of(twin)
    if not cameras:
        return 0.0
    up = np.mean([camera.matrix_world.to_3x3().normalized().col[1] for camera in cameras], axis=0)
    length = float(np.linalg.norm(up))
    if length < 1e-6 or (given and up[2] > length * math.cos(math.radians(_LEVEL))):
        return 0.0
    with contextlib.suppress(FormatError):
        return set_up(twin, [])
    return 0.0


def frame(twin: Any, scene: Any) -> None:
    """Moves all 3D views of a scene that do not look through a camera: they see the twin as its first photo does."""
    for window in bpy.context.window_manager.windows:
        if window.scene != scene:
            continue
        for area in window.screen.areas:
            if area.type == "VIEW_3D" and area.spaces.active.region_3d is not None:
                space = area.spaces.active
                # Lines from the twin to its cameras would lie across it, and a floor that is none of its own.
                space.overlay.show_relationship_lines = space.overlay.show_floor = False
                space.overlay.show_axis_x = space.overlay.show_axis_y = False
                if space.region_3d.view_perspective != "CAMERA":
                    _look(space, *viewpoint(twin, scene.camera, space.lens))


def viewpoint(twin: Any, camera: Any, lens: float) -> tuple[Any, Any, float]:
    """Where to look from.

    Args:
        twin: `bpy` object.
        camera: one of the twin's own, or any other, or None.
        lens: the view's focal length, mm.

    Returns:
        The point around which the view turns, the view's rotation, and the distance from it.
    """
    world = np.array(twin.matrix_world, np.float64)
    places = read_means(twin) @ world[:3, :3].T + world[:3, 3]
    middle = np.median(places, axis=0)
    radius = max(float(np.quantile(np.linalg.norm(places - middle, axis=1), _BULK)), 1e-6)
    if camera is None or camera.parent != twin:
        front = Quaternion((1.0, 0.0, 0.0), math.radians(90.0))
        return Vector(middle), front, radius * 2.0 * lens / _VIEW_SENSOR * 2.0
    seen = camera.matrix_world
    forward = -np.array(seen.to_3x3().normalized().col[2], np.float64)
    start = np.array(seen.translation, np.float64)
    depth = float((middle - start) @ forward)
    if depth <= 0.0:  # it looks away from the middle, as in a room
        depth = radius
    wide = camera.data.sensor_width / camera.data.lens / (_VIEW_SENSOR / lens)
    pivot = Vector(start + depth * forward)
    return pivot, seen.to_quaternion(), depth * AIR * float(np.clip(wide, 0.5, 2.0))


def _look(space: Any, pivot: Any, turn: Any, distance: float) -> None:
    view = space.region_3d
    view.view_location, view.view_rotation, view.view_distance = pivot, turn, distance
    space.clip_end = max(space.clip_end, 20.0 * distance)
    space.clip_start = min(space.clip_start, 0.01 * distance)
