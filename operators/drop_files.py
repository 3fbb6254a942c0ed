"""Files dropped onto a 3D view: photos bring their folder along, splats become a twin."""

from __future__ import annotations

from typing import Any

import bpy


class _Drop(bpy.types.FileHandler):
    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        """Only 3D views; elsewhere a picture means a picture."""
        return context.area is not None and context.area.type == "VIEW_3D"


class DGS_FH_photos(_Drop):
    """Photos."""

    bl_idname = "DGS_FH_photos"
    bl_label = "Descatter: Photos of This Folder"
    bl_import_operator = "dgs.choose_photos"
    bl_file_extensions = ".png;.jpg;.jpeg;.tif;.tiff;.webp;.bmp"


class DGS_FH_twin(_Drop):
    """Gaussian splats."""

    bl_idname = "DGS_FH_twin"
    bl_label = "Descatter: Gaussian Splats"
    bl_import_operator = "dgs.import_twin"
    bl_file_extensions = ".ply;.spz;.splat"
