"""Keeps the settings of steps 3 and 4 under a name, as Blender keeps all its presets."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase

#: Where Blender keeps them, below its own folder of presets.
SUBFOLDER = "descatter"
#: What a preset holds: how photos are treated, never which photos these are or where anything lies.
_NAMES = (
    *(
        "max_size",
        "background",
        "medium",
        "sigma",
        "sigma_minor",
        "angle",
        "blur_space",
        "effects",
        "adjust_cameras",
        "refine_cameras",
    ),
    *("preset", "time_limit", "max_gaussians", "sh_degree", "holdout_every", "seed", "device", "threads"),
    *("add_when_done", "live"),
)


class DGS_OT_add_preset(AddPresetBase, bpy.types.Operator):  # type: ignore[misc]
    """Keep the settings of medium and optimization under a name, or remove those of a name"""

    bl_idname = "dgs.add_preset"
    bl_label = "Keep Settings"

    preset_menu = "DGS_PT_presets"
    preset_defines = ["settings = bpy.context.scene.dgs"]
    preset_values = [f"settings.{name}" for name in _NAMES]
    preset_subdir = SUBFOLDER
