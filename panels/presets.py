"""Kept settings, behind a button in the header of step 4."""

from __future__ import annotations

from typing import Any

import bpy
from bl_ui.utils import PresetPanel

from ..operators.add_preset import SUBFOLDER


class DGS_PT_presets(PresetPanel, bpy.types.Panel):  # type: ignore[misc]
    """Chooses, keeps and removes them."""

    bl_idname = "DGS_PT_presets"
    bl_label = "Kept Settings"
    preset_subdir = SUBFOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "dgs.add_preset"

    def draw(self, context: Any) -> None:
        """As Blender's own, which names missing folders where nothing has been kept yet."""
        if not bpy.utils.preset_paths(SUBFOLDER):
            bpy.utils.user_resource("SCRIPTS", path=f"presets/{SUBFOLDER}", create=True)
        super().draw(context)
