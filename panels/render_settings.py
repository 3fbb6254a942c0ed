"""What the render engine "Descatter" can be asked, in the properties editor."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.drawing.render_engine import BACKGROUND, ENGINE, EXPECTED_ERROR
from ..dgs_addon.drawing.through import THROUGH
from ..dgs_addon.scene.known import KNOWN
from ..dgs_addon.scene.twin import is_twin


class RENDER_PT_descatter(bpy.types.Panel):
    """Settings of the engine."""

    bl_idname = "RENDER_PT_descatter"
    bl_label = "Descatter"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_options = {"HIDE_HEADER"}
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Our engine is chosen."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        """The background; which view transform shows the photos' colours."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        scene = context.scene
        layout.prop(scene.render, "film_transparent", text="Transparent")
        row = layout.row()
        row.active = not scene.render.film_transparent
        row.prop(scene, BACKGROUND)
        layout.prop(scene, THROUGH)
        if scene.view_settings.view_transform != "Standard":
            layout.label(text="Only the view transform Standard shows the photos' colours", icon="INFO")
            layout.prop(scene.view_settings, "view_transform")


class VIEWLAYER_PT_descatter_passes(bpy.types.Panel):
    """Passes that no other engine has."""

    bl_idname = "VIEWLAYER_PT_descatter_passes"
    bl_label = "Descatter"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Our engine is chosen."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context: Any) -> None:
        """The pass, and what a twin lacks for it."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(context.view_layer, EXPECTED_ERROR)
        twins = [thing for thing in context.scene.objects if is_twin(thing)]
        if getattr(context.view_layer, EXPECTED_ERROR) and not any(KNOWN in twin.data.attributes for twin in twins):
            layout.label(text="Press Determined and Guessed first (step 5)", icon="INFO")
