"""Brings the drawing into Blender, and takes it out again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

from ..scene.hiding import follow
from . import live, process
from .drawer import forget_card
from .edited import forget_edits
from .meshes import forget_meshes
from .quad import forget_shaders
from .render_engine import BACKGROUND, ENGINE, EXPECTED_ERROR, DescatterRenderEngine
from .splat_shader import forget_splat_shaders
from .through import THROUGH
from .twins import changed_twins, forget_twins
from .viewport import forget_views

#: Engines whose panels of general settings make sense for ours too, and those of them that do not.
_ALIKE = "BLENDER_WORKBENCH"
_NOT_OURS = {
    "RENDER_PT_opengl_sampling",
    "RENDER_PT_opengl_lighting",
    "RENDER_PT_opengl_color",
    "RENDER_PT_opengl_options",
}


def register_drawing() -> None:
    """Adds the render engine, its setting, and the watchers of twins."""
    bpy.utils.register_class(DescatterRenderEngine)
    setting = bpy.props.FloatVectorProperty(
        name="Background",
        description="Colour behind the twins where the film is not transparent, as photos show it",
        subtype="COLOR_GAMMA",
        min=0.0,
        max=1.0,
        default=(0.0, 0.0, 0.0),
    )
    setattr(bpy.types.Scene, BACKGROUND, setting)
    through = bpy.props.BoolProperty(
        name="Through the Medium",
        description="Blur the picture as the medium of step 3 does, at the size that it has in the photos",
    )
    setattr(bpy.types.Scene, THROUGH, through)
    error = bpy.props.BoolProperty(
        name="Expected Error",
        description="A pass of how far the photos leave open what is seen: 0 they fix its colour, 1 they say nothing."
        " 'Determined and Guessed' brings it to a twin",
    )
    setattr(bpy.types.ViewLayer, EXPECTED_ERROR, error)
    shown = bpy.props.BoolProperty(
        name="Live Splats",
        description="Draw the splats as the engine sees them over the scene, in Solid and Material Preview",
        default=True,
    )
    setattr(bpy.types.Scene, live.SHOWN, shown)
    for panel in _general_panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    bpy.app.handlers.depsgraph_update_post.extend((_watch, follow))
    bpy.app.handlers.load_post.append(_forget)
    live.start()


def unregister_drawing() -> None:
    """Takes everything out again, and ends the server."""
    live.stop()
    forget_edits()
    process.stop()
    forget_views()
    forget_card()
    forget_shaders()
    forget_splat_shaders()
    forget_meshes()
    bpy.app.handlers.load_post.remove(_forget)
    for watcher in (_watch, follow):
        bpy.app.handlers.depsgraph_update_post.remove(watcher)
    for panel in _general_panels():
        panel.COMPAT_ENGINES.discard(ENGINE)
    delattr(bpy.types.Scene, live.SHOWN)
    delattr(bpy.types.ViewLayer, EXPECTED_ERROR)
    delattr(bpy.types.Scene, THROUGH)
    delattr(bpy.types.Scene, BACKGROUND)
    bpy.utils.unregister_class(DescatterRenderEngine)


def _general_panels() -> Iterator[Any]:
    """Panels of Blender's own that are drawn for engines they name, such as resolution, output and passes."""
    for panel in bpy.types.Panel.__subclasses__():
        if _ALIKE in getattr(panel, "COMPAT_ENGINES", ()) and panel.__name__ not in _NOT_OURS:
            yield panel


@bpy.app.handlers.persistent
def _watch(_scene: Any, depsgraph: Any) -> None:
    changed_twins(depsgraph)


@bpy.app.handlers.persistent
def _forget(*_: Any) -> None:
    forget_twins()
    forget_edits()
