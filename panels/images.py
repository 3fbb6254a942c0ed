"""Step 1: the photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.paths import chosen_photos
from ..dgs_addon.photos import PhotoFolder
from .layout import Step, figures, folded, ready, sentence, split
from .thumbnails import thumbnails

#: Warnings that are shown; the rest are counted.
_WARNINGS = 4


class DGS_PT_images(Step, bpy.types.Panel):
    """Which photos."""

    bl_idname = "DGS_PT_images"
    bl_label = "1  Images"

    def draw_header_preset(self, context: Any) -> None:
        """Done once there are enough photos."""
        found = chosen_photos(context.scene.dgs)
        ready(self.layout, found is not None and not found.problem)

    def draw(self, context: Any) -> None:
        """The folder, what is in it, and what is wrong with it."""
        layout, settings = split(self.layout), context.scene.dgs
        found = chosen_photos(context.scene.dgs)
        text = "Choose Photos" if found is None else "Choose Others"
        layout.operator("dgs.choose_photos", icon="FILE_FOLDER", text=text)
        if found is None:
            sentence(layout, context, "Or drop photos or a movie here: 20 views or more, from all sides", "INFO")
            return
        layout.prop(settings, "photos", text="Movie" if found.movie else "Folder")
        if found.problem:
            sentence(layout, context, found.problem, "ERROR")
            return
        self._draw_found(layout, settings, found)
        if found.with_alpha:
            figures(layout, "{count} photos with alpha: empty where transparent", "IMAGE_ALPHA", count=found.with_alpha)
        for warning in found.warnings[:_WARNINGS]:
            sentence(layout, context, warning, "ERROR")
        if len(found.warnings) > _WARNINGS:
            figures(layout, "and {count} more", "BLANK1", count=len(found.warnings) - _WARNINGS)
        body = folded(layout, "images", "More")
        if body is not None:
            body.prop(settings, "masks")
            body.prop(settings, "background")
            body.prop(settings, "max_size")
            body.prop(settings, "out")

    def _draw_found(self, layout: Any, settings: Any, found: PhotoFolder) -> None:
        grid = layout.row(align=True)
        if found.movie is not None:
            layout.prop(settings, "frames")
            icons = thumbnails(found.movie.parent, (found.movie,))
        else:
            size = f", {found.size[0]} x {found.size[1]} px" if found.size else ""
            text = "{count} chosen photos{size}" if settings.selection else "{count} photos{size}"
            figures(layout, text, "IMAGE_DATA", count=len(found.files), size=size)
            icons = thumbnails(found.files[0].parent, found.files)
        for icon in icons:
            grid.template_icon(icon_value=icon, scale=2.6 if found.movie is None else 6.0)
