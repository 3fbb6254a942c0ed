"""What all panels draw alike: their place, sentences that wrap, how a step stands."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..dgs_addon.window import TAB, wrapped

#: Width of the panel's borders in px, at a scale of 1.
_BORDER = 62


class Sidebar:
    """A panel in the 3D view's sidebar, tab 'Descatter'."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = TAB


class Step(Sidebar):
    """A numbered step below the main panel."""

    bl_parent_id = "DGS_PT_main"


def sentence(layout: Any, context: Any, text: str, icon: str = "NONE", **values: object) -> None:
    """A text, in the user's language, over as many lines as the sidebar's width needs: labels do not wrap.

    `values` stand in the places of the text, whose words are translated before.
    """
    text = iface_(text).format(**values) if values else iface_(text)
    scale = context.preferences.system.ui_scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(wrapped(text, context.region.width / scale - _BORDER)):
        mark = icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE"
        column.label(text=line, icon=mark, translate=False)


def figures(layout: Any, text: str, icon: str = "NONE", **values: object) -> None:
    """A label with `values` in the places of `text`, whose words are translated before."""
    layout.label(text=iface_(text).format(**values), icon=icon, translate=False)


def ready(header: Any, done: bool) -> None:
    """A mark at the right of a step's header: done, or not yet."""
    header.label(text="", icon="CHECKMARK" if done else "RADIOBUT_OFF")


def folded(layout: Any, name: str, title: str) -> Any:
    """The body of a part that is closed until someone opens it; None while it is closed."""
    header, body = layout.panel(f"DGS_PT_folded_{name}", default_closed=True)
    header.label(text=title)
    if body is not None:
        body.use_property_split = True
        body.use_property_decorate = False
    return body


def split(layout: Any) -> Any:
    """Names at the left, values at the right; no dots for animation."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def background() -> bool:
    """Whether there is no window to draw in."""
    return bool(bpy.app.background)
