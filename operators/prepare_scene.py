"""Sets up the scene so that splats render right."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.changes import noting
from ..dgs_addon.scene.material import prepare_scene


class DGS_OT_prepare_scene(bpy.types.Operator):
    """Choose Cycles, enough transparent bounces, and the photos' own colours"""

    bl_idname = "dgs.prepare_scene"
    bl_label = "Set Up Rendering"
    bl_options = {"REGISTER", "UNDO"}

    blending: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Blending",
        items=(
            ("LIGHT", "As Light", "Splats give off light like any other object (view transform Standard)"),
            ("TRAINED", "As Trained", "Exactly the engine's picture (view transform Raw); lit objects look wrong"),
        ),
    )

    def execute(self, context: Any) -> set[str]:
        """Changes the scene's render and colour settings."""
        with noting(context.scene):
            prepare_scene(context.scene, as_trained=self.blending == "TRAINED")
        return {"FINISHED"}
