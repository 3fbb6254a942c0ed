"""A twin's true size and its up direction: structure from motion estimates neither metres nor gravity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...core.errors import FormatError


def markers(twin: Any, selected: Sequence[Any]) -> list[Any]:
    """The selected objects that mark points: all but the twin."""
    return [thing for thing in selected if thing != twin]


def cameras_of(twin: Any) -> list[Any]:
    """The twin's own cameras, by name."""
    return sorted((child for child in twin.children if child.type == "CAMERA"), key=lambda child: child.name)


def set_length(twin: Any, marked: Sequence[Any], length: float) -> float:
    """Scales a twin so that what was measured has its true length.

    Args:
        twin: `bpy` object; its cameras go along, as its children.
        marked: two objects on the twin, which go along too; else the way through its cameras counts.
        length: the true length, in the scene's units.

    Returns:
        The factor.

    Raises:
        FormatError: there is nothing to measure, or its ends coincide.
    """
    ends = [thing.matrix_world.translation for thing in (marked if len(marked) == 2 else cameras_of(twin))]
    measured = sum((b - a).length for a, b in zip(ends, ends[1:], strict=False))
    if measured < 1e-9:
        raise FormatError("There is no length to measure", "Select two objects that mark points of the twin")
    factor = length / measured
    _change(twin, marked if len(marked) == 2 else (), Matrix.Scale(factor, 4))
    return factor


def set_up(twin: Any, marked: Sequence[Any]) -> float:
    """Turns a twin so that its floor lies level.

    Args:
        twin: `bpy` object; its cameras go along.
        marked: three or more objects on the floor, which go along; else the cameras are taken to have
            been held upright, on average.

    Returns:
        The angle in radians.

    Raises:
        FormatError: no cameras, or the objects lie on a line.
    """
    cameras = cameras_of(twin)
    upright = np.mean([camera.matrix_world.to_3x3().col[1] for camera in cameras], axis=0) if cameras else None
    if len(marked) >= 3:
        up = _normal([thing.matrix_world.translation for thing in marked], upright)
    elif upright is not None and np.linalg.norm(upright) > 1e-6:
        up = upright
    else:
        raise FormatError("The up direction cannot be determined", "Select three objects that mark points of the floor")
    turn = Vector(up).rotation_difference(Vector((0.0, 0.0, 1.0)))
    _change(twin, marked if len(marked) >= 3 else (), turn.to_matrix().to_4x4())
    return float(turn.angle)


def _normal(points: Sequence[Any], upright: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """The plane's normal, on the side of the cameras' up; without cameras, on that of the scene's."""
    places = np.array(points, np.float64)
    _, sizes, axes = np.linalg.svd(places - places.mean(axis=0))
    if sizes[1] < 1e-6 * max(sizes[0], 1e-12):
        raise FormatError("The selected objects lie on a line", "Mark three points of the floor that do not")
    normal: NDArray[np.float64] = axes[2]
    side = upright if upright is not None else np.array([0.0, 0.0, 1.0])
    return normal if float(normal @ side) >= 0 else -normal


def _change(twin: Any, marked: Sequence[Any], change: Any) -> None:
    """Applies a change about the twin's own place."""
    middle = twin.matrix_world.translation.copy()
    about = Matrix.Translation(middle) @ change @ Matrix.Translation(-middle)
    for thing in (twin, *(thing for thing in marked if thing.parent != twin)):
        thing.matrix_world = about @ thing.matrix_world
