"""Step 1: the photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.paths import absolute
from ..dgs_addon.photos import PhotoFolder, photo_folder
from .layout import Step, folded, ready, sentence, split
from .thumbnails import thumbnails

#: Warnings that are shown; the rest are counted.
_WARNINGS = 4


def _found(context: Any) -> PhotoFolder | None:
    folder = absolute(context.scene.dgs.photos)
    return photo_folder(folder) if folder is not None else None


class DGS_PT_images(Step, bpy.types.Panel):
    """Which photos."""

    bl_idname = "DGS_PT_images"
    bl_label = "1  Images"

    def draw_header_preset(self, context: Any) -> None:
        """Done once there are enough photos."""
        found = _found(context)
        ready(self.layout, found is not None and not found.problem)

    def draw(self, context: Any) -> None:
        """The folder, what is in it, and what is wrong with it."""
        layout, settings = split(self.layout), context.scene.dgs
        found = _found(context)
        text = "Choose Photos" if found is None else "Choose Others"
        layout.operator("dgs.choose_photos", icon="FILE_FOLDER", text=text)
        if found is None:
            sentence(layout, context, "Or drop photos here. 20 or more, from all sides you want to see.", "INFO")
            return
        layout.prop(settings, "photos", text="Folder")
        if found.problem:
            sentence(layout, context, found.problem, "ERROR")
            return
        size = f", {found.size[0]} x {found.size[1]} px" if found.size else ""
        layout.label(text=f"{len(found.files)} photos{size}", icon="IMAGE_DATA")
        grid = layout.row(align=True)
        folder = absolute(settings.photos)
        assert folder is not None
        for icon in thumbnails(folder, found.files):
            grid.template_icon(icon_value=icon, scale=2.6)
        for warning in found.warnings[:_WARNINGS]:
            sentence(layout, context, warning, "ERROR")
        if len(found.warnings) > _WARNINGS:
            layout.label(text=f"and {len(found.warnings) - _WARNINGS} more", icon="BLANK1")
        body = folded(layout, "images", "More")
        if body is not None:
            body.prop(settings, "masks")
            body.prop(settings, "max_size")
            body.prop(settings, "out")
