"""Files dropped onto a 3D view: a photo brings its folder along, cameras their photos, splats become a twin."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.formats.gaussians import dropped_suffixes
from ..core.photos.kinds import HEIF, MOVIES, SUFFIXES


class _Drop(bpy.types.FileHandler):
    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        """Only 3D views; elsewhere a picture means a picture."""
        return context.area is not None and context.area.type == "VIEW_3D"


class DGS_FH_photos(_Drop):
    """Photos, or a movie."""

    bl_idname = "DGS_FH_photos"
    bl_label = "Descatter: Photos"
    bl_import_operator = "dgs.choose_photos"
    bl_file_extensions = ";".join(sorted(SUFFIXES | HEIF | MOVIES))  # whether HEIC can be read is said after the drop


class DGS_FH_data_set(_Drop):
    """Cameras that lie with their photos, such as a transforms.json."""

    bl_idname = "DGS_FH_data_set"
    bl_label = "Descatter: Photos and Cameras"
    bl_import_operator = "dgs.choose_photos"
    bl_file_extensions = ".json"


class DGS_FH_twin(_Drop):
    """Gaussian splats."""

    bl_idname = "DGS_FH_twin"
    bl_label = "Descatter: Gaussian Splats"
    bl_import_operator = "dgs.import_twin"
    bl_file_extensions = ";".join(dropped_suffixes())
