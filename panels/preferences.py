"""The add-on's preferences: where the engine is, and how it gets there."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..dgs_addon.drawing.drawer import drawer, forget_card
from ..dgs_addon.engine.folder import engine_folder, is_installed
from ..dgs_addon.engine.install import errand
from ..dgs_addon.window import redraw_views

#: Last lines of a check that are shown; the whole of it is in the log.
_SHOWN = 24


def _try_again(_settings: Any, _context: Any) -> None:
    """Another wish: a card that has failed is tried again."""
    forget_card()
    redraw_views()


class DGS_AP_preferences(bpy.types.AddonPreferences):
    """Shown in Edit > Preferences > Add-ons."""

    bl_idname = __package__.rsplit(".panels", 1)[0]

    python: bpy.props.StringProperty(
        name="Python of the Engine",
        subtype="FILE_PATH",
        description="A Python 3.11 or newer that holds the engine's packages. Empty: the one installed below",
    )
    wheels: bpy.props.StringProperty(
        name="Wheels",
        subtype="DIR_PATH",
        description="Folder of downloaded wheels to install from without a network. Empty: from the network",
    )

    draw_with: bpy.props.EnumProperty(
        name="Draw With",
        items=(
            ("AUTO", "Automatic", "The graphics card where there is one, else the engine"),
            ("CARD", "Graphics Card", "A shader blends the splats on the graphics card"),
            ("ENGINE", "Engine", "The engine draws pictures in its own process, as it does for final pictures"),
        ),
        update=_try_again,
        description="Who draws splats in 3D views. Final pictures are always the engine's",
    )

    def draw(self, context: Any) -> None:
        """Where the engine is, the button that installs it, and what the last check said."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "python")
        if not self.python.strip():
            self._draw_install(layout, context)
        layout.operator("dgs.check_engine", icon="VIEWZOOM")
        self._draw_errand(layout)
        layout.prop(self, "draw_with")
        layout.label(text=drawer().why, icon="SHADING_RENDERED", translate=False)
        layout.operator("dgs.open_manual", icon="HELP")

    def _draw_install(self, layout: Any, context: Any) -> None:
        layout.prop(self, "wheels")
        if engine_folder() is None:
            layout.label(text="The engine can only be installed for an extension", icon="INFO")
        elif is_installed():
            layout.label(text="The engine is installed", icon="CHECKMARK")
        else:
            layout.label(text="Not installed: 1.6 GB on disk, with CUDA several more; outside Blender", icon="INFO")
        if engine_folder() is not None and not is_installed() and not self.wheels.strip():
            _draw_online(layout, context)
        layout.operator("dgs.install_engine", icon="IMPORT")

    def _draw_errand(self, layout: Any) -> None:
        work = errand()
        if work is None:
            return
        if work.running:
            row = layout.row()
            row.progress(factor=work.done / work.total, type="BAR", text=work.title)
            row.operator("dgs.cancel_install", text="", icon="X")
        elif work.status == 0:
            layout.label(text="All is well", icon="CHECKMARK")
        else:
            word = rpt_("{step} failed: see the last lines").format(step=rpt_(work.title))
            layout.label(text=rpt_("Cancelled") if work.cancelled else word, icon="ERROR", translate=False)
        column = layout.box().column(align=True)
        column.scale_y = 0.75
        for line in list(work.lines)[-_SHOWN:]:
            column.label(text=line[:160], translate=False)


def _draw_online(layout: Any, context: Any) -> None:
    """Blender's own switch for online access, where it is off: the button below is grey without it."""
    if bpy.app.online_access:
        return
    box = layout.box()
    if bpy.app.online_access_override:
        box.label(text="Blender was started offline (--offline-mode): choose a folder of wheels", icon="ERROR")
        return
    box.label(text="The packages come from the network, which Blender may not use yet", icon="ERROR")
    box.prop(context.preferences.system, "use_online_access")
