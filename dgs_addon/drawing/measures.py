"""Measures drawn over 3D views: lines between their places, and what came out with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ...core.errors import DgsError
from ..scene.measures import from_file, measures_of, value_text
from ..scene.twin import is_twin

#: Colours: of lines, of the measure that is chosen, of one that could not be measured, of what lies under words.
_LINE, _CHOSEN, _MISSED = (1.0, 1.0, 1.0, 1.0), (1.0, 0.62, 0.16, 1.0), (1.0, 0.3, 0.25, 1.0)
_UNDER, _SHADE = (0.06, 0.06, 0.07, 0.85), (0.0, 0.0, 0.0, 0.6)
#: Px at a scale of 1: width of lines, radius of places, height of words, and what is free around them.
_WIDTH, _RADIUS, _WORDS, _MARGIN = 2.0, 4.0, 13.0, 6.0

Points = list[tuple[float, float]]


@dataclass
class Pending:
    """A measure that is being set.

    Attributes:
        twin: `bpy` object; kind: as of `scene.measures.KINDS`.
        places: where its places are, the file's axes.
        hover: where the next one would be; None where nothing is.
        mouse: px of the region, and the region itself.
        words: beside the mouse.
    """

    twin: Any
    kind: str
    places: list[Any] = field(default_factory=list)
    hover: Any = None
    mouse: tuple[float, float] = (0.0, 0.0)
    region: Any = None
    words: str = ""


#: What is being set now; `operators.measure` changes it.
pending: Pending | None = None
_handle: Any = None


def start() -> None:
    """Begins to draw, where there is a window."""
    global _handle
    if _handle is None and not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def stop() -> None:
    """Ends it."""
    global _handle, pending
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = pending = None


def set_pending(what: Pending | None) -> None:
    """Says what is being set."""
    global pending
    pending = what


def _draw() -> None:
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    for thing in context.view_layer.objects:
        held = measures_of(thing) if is_twin(thing) and thing.visible_get() else None
        if held is not None and held.items:
            _draw_all(context, thing, held)
    if pending is not None:
        _draw_pending(context, pending)


def _draw_all(context: Any, twin: Any, held: Any) -> None:
    try:
        world = from_file(twin)
    except DgsError:
        return
    words = []
    for index, item in enumerate(held.items):
        if not item.shown or not item.places:
            continue
        chosen = twin == context.object and index == held.active
        colour = _MISSED if not item.found else _CHOSEN if chosen else _LINE
        points = _projected(context, world, [place.position for place in item.places])
        if points is None:
            continue
        _draw_measure(context, item.kind, points, colour)
        if item.found:
            words.append((value_text(item), _middle(item.kind, points), colour))
    for one in words:  # over all lines
        _write(context, *one)


def _draw_pending(context: Any, now: Pending) -> None:
    try:
        world = from_file(now.twin)
    except (DgsError, ReferenceError):  # the twin is gone
        return
    here = context.region == now.region
    positions = [*now.places, *([now.hover] if now.hover is not None else [])]
    points = _projected(context, world, positions) if positions else []
    if points:
        _draw_measure(context, now.kind, points, _CHOSEN)
    if here and now.words:
        scale = context.preferences.system.ui_scale
        _write(context, now.words, (now.mouse[0] + 18 * scale, now.mouse[1] + 22 * scale), _CHOSEN, left=True)


def _projected(context: Any, world: Any, positions: Sequence[Any]) -> Points | None:
    """Px of the region; None where one of them lies behind the viewer."""
    points: Points = []
    for position in positions:
        place = Vector((world @ np.array([*position, 1.0]))[:3])
        found = location_3d_to_region_2d(context.region, context.space_data.region_3d, place)
        if found is None:
            return None
        points.append((found.x, found.y))
    return points


def _draw_measure(context: Any, kind: str, points: Points, colour: tuple[float, ...]) -> None:
    """Its lines with a dark rim, and its places."""
    scale = context.preferences.system.ui_scale
    lines = list(zip(points, points[1:], strict=False))
    if kind == "area" and len(points) > 2:
        lines.append((points[-1], points[0]))
        _fill([(points[0], a, b) for a, b in zip(points[1:], points[2:], strict=False)], (*colour[:3], 0.15))
    if kind == "width" and len(points) == 2:
        lines += [_across(points[0], points[1], 8 * scale), _across(points[1], points[0], 8 * scale)]
    if kind == "angle" and len(points) == 3:
        lines += _arc(points, 26 * scale)
    for width, tint in ((_WIDTH + 2.0, _SHADE), (_WIDTH, colour)):
        _strokes(context, lines, width * scale, tint)
    for point in points:
        _dot(point, (_RADIUS + 1.5) * scale, _SHADE)
        _dot(point, _RADIUS * scale, colour)


def _across(at: tuple[float, float], other: tuple[float, float], reach: float) -> tuple[Any, Any]:
    """A stroke through a place, across the line to another."""
    dx, dy = other[0] - at[0], other[1] - at[1]
    length = max(math.hypot(dx, dy), 1e-6)
    x, y = -dy / length * reach, dx / length * reach
    return (at[0] - x, at[1] - y), (at[0] + x, at[1] + y)


def _arc(points: Points, reach: float) -> list[tuple[Any, Any]]:
    """Between both sides of an angle."""
    middle = points[1]
    first, last = (math.atan2(p[1] - middle[1], p[0] - middle[0]) for p in (points[0], points[2]))
    turn = (last - first + math.pi) % (2 * math.pi) - math.pi
    reach = min(reach, *(0.6 * math.dist(p, middle) for p in (points[0], points[2])))
    way = [
        (middle[0] + reach * math.cos(first + turn * step / 16), middle[1] + reach * math.sin(first + turn * step / 16))
        for step in range(17)
    ]
    return list(zip(way, way[1:], strict=False))


def _middle(kind: str, points: Points) -> tuple[float, float]:
    """Where the words go."""
    if kind == "angle" and len(points) == 3:
        return points[1]
    if kind == "polyline":
        half = len(points) // 2
        return points[half] if len(points) % 2 else _mean(points[half - 1 : half + 1])
    return _mean(points)


def _mean(points: Points) -> tuple[float, float]:
    return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)


def _write(context: Any, text: str, at: tuple[float, float], colour: tuple[float, ...], left: bool = False) -> None:
    """Words on a dark ground; their middle is above `at`, or they begin there."""
    scale = context.preferences.system.ui_scale
    blf.size(0, _WORDS * scale)
    wide, high = blf.dimensions(0, text)
    margin = _MARGIN * scale
    x = at[0] if left else at[0] - wide / 2
    y = at[1] if left else at[1] + 12 * scale
    x = min(max(x, margin), max(margin, context.region.width - wide - margin))
    box = (x - margin, y - margin, x + wide + margin, y + _WORDS * 0.75 * scale + margin)
    _fill(_rounded(box, 5 * scale), _UNDER)
    blf.color(0, *colour)
    blf.position(0, round(x), round(y), 0)
    blf.draw(0, text)


def _rounded(box: tuple[float, ...], radius: float) -> list[Any]:
    """Triangles of a box with round corners."""
    x0, y0, x1, y1 = box
    rim = []
    for cx, cy, begin in (
        (x1 - radius, y1 - radius, 0.0),
        (x0 + radius, y1 - radius, 0.5),
        (x0 + radius, y0 + radius, 1.0),
        (x1 - radius, y0 + radius, 1.5),
    ):
        turns = [(begin + step / 8) * math.pi for step in range(5)]
        rim += [(cx + radius * math.cos(turn), cy + radius * math.sin(turn)) for turn in turns]
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    return [(middle, a, b) for a, b in zip(rim, [*rim[1:], rim[0]], strict=True)]


def _dot(at: tuple[float, float], radius: float, colour: tuple[float, ...]) -> None:
    turns = [step * math.pi / 8 for step in range(17)]
    rim = [(at[0] + radius * math.cos(turn), at[1] + radius * math.sin(turn)) for turn in turns]
    _fill([(at, a, b) for a, b in zip(rim, rim[1:], strict=False)], colour)


def _fill(triangles: Sequence[Any], colour: tuple[float, ...]) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("color", colour)
    corners = [(x, y) for triangle in triangles for x, y in triangle]
    gpu.state.blend_set("ALPHA")  # (words that are drawn in between set it back)
    batch_for_shader(shader, "TRIS", {"pos": corners}).draw(shader)
    gpu.state.blend_set("NONE")


def _strokes(context: Any, lines: Sequence[tuple[Any, Any]], width: float, colour: tuple[float, ...]) -> None:
    if not lines:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", (context.region.width, context.region.height))
    shader.uniform_float("lineWidth", width)
    shader.uniform_float("color", colour)
    ends = [(x, y, 0.0) for line in lines for x, y in line]
    gpu.state.blend_set("ALPHA")
    batch_for_shader(shader, "LINES", {"pos": ends}).draw(shader)
    gpu.state.blend_set("NONE")
