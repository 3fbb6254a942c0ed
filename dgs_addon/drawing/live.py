"""Splats as the engine sees them, drawn over the scene in Solid and Material Preview, with the scene's depth.

The twins themselves show an outline there (`scene.live`). Where another engine draws a viewport in Rendered mode
(Cycles, EEVEE), they show their splats as instances again, since all viewports share one evaluation; and so they are
saved, as a Blender without this add-on has nothing else to show.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from ..scene.live import drawn_live, set_drawn_live
from ..scene.nodes import LIVE_INPUT, set_splat_input, splat_input, splat_modifier, splat_value
from ..scene.twin import is_twin
from . import process
from .drawer import can_draw, card_draws
from .render_engine import ENGINE
from .viewport import Look, draw_twins

#: Scene property: whether splats are drawn so.
SHOWN = "dgs_live_splats"
#: Engines that do not show instances as splats in Rendered mode: ours draws by itself, the other as Solid.
_OWN = (ENGINE, "BLENDER_WORKBENCH")
#: What is drawn over the scene is blended as light, and shown by this curve (found on screenshots of 4.3 and 5.2).
_OVERLAY = 2.2

_handle: Any = None


def start() -> None:
    """Begins to draw, where there is a window."""
    global _handle
    if _handle is None and not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")
        bpy.app.handlers.save_pre.append(_before_saving)
        bpy.app.handlers.save_post.append(_after_saving)


def stop() -> None:
    """Ends it; twins show their instances again."""
    global _handle
    if _handle is None:
        return
    if bpy.app.timers.is_registered(_adapt):
        bpy.app.timers.unregister(_adapt)
    bpy.app.handlers.save_post.remove(_after_saving)
    bpy.app.handlers.save_pre.remove(_before_saving)
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    _set(False)


def wanted() -> bool:
    """Whether twins are to be outlines: their splats are drawn in all viewports there are."""
    return (card_draws() or process.draws()) and _possible()


def _possible() -> bool:
    """Whether splats may be drawn over all viewports there are."""
    if not can_draw():
        return False
    for window in bpy.context.window_manager.windows:
        scene = window.scene
        if not getattr(scene, SHOWN, True):
            return False
        spaces = (area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D")
        if scene.render.engine not in _OWN and any(space.shading.type == "RENDERED" for space in spaces):
            return False
    return True


def _draw() -> None:
    context = bpy.context
    scene, space = context.scene, context.space_data
    on = wanted()
    adapted = on == drawn_live() and all(_is_live(twin) is on for twin in _twins(scene.objects))
    if not adapted and not bpy.app.timers.is_registered(_adapt):  # nothing may be changed while it is drawn
        bpy.app.timers.register(_adapt, first_interval=0.0)
    rendered = space.shading.type == "RENDERED"
    if not _possible() or (rendered and scene.render.engine == ENGINE):
        return
    draw_twins(context, context.view_layer.depsgraph, Look(depth=True, light=True, power=_OVERLAY))


def _adapt() -> None:
    _set(wanted())


def _set(on: bool) -> None:
    set_drawn_live(on)
    for twin in _twins(bpy.data.objects):
        if _is_live(twin) is (not on) and twin.library is None:
            set_splat_input(splat_modifier(twin), LIVE_INPUT, on)


def _is_live(twin: Any) -> bool | None:
    """Whether a twin shows an outline; None where it cannot: its nodes are of an older version, or were removed."""
    modifier = splat_modifier(twin)
    if modifier is None or splat_input(modifier, LIVE_INPUT) is None:
        return None
    return bool(splat_value(modifier, LIVE_INPUT))


def _twins(things: Any) -> Iterator[Any]:
    return (thing for thing in things if is_twin(thing) and _is_live(thing) is not None)


@bpy.app.handlers.persistent
def _before_saving(*_: Any) -> None:
    for twin in _twins(bpy.data.objects):
        if _is_live(twin) and twin.library is None:
            set_splat_input(splat_modifier(twin), LIVE_INPUT, False)


@bpy.app.handlers.persistent
def _after_saving(*_: Any) -> None:
    _set(wanted())
