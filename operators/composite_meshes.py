"""Final pictures of twins among meshes."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.scene.changes import noting
from ..dgs_addon.scene.compositing import composite
from ..dgs_addon.scene.twin import why_no_picture

#: EEVEE's name, which is not the same in all Blenders.
_EEVEE = "BLENDER_EEVEE" if not (4, 2) <= bpy.app.version < (5, 0) else "BLENDER_EEVEE_NEXT"


class DGS_OT_composite_meshes(bpy.types.Operator):
    """Render twins with Descatter and everything else with Cycles or EEVEE, and put both together by depth"""

    bl_idname = "dgs.composite_meshes"
    bl_label = "Composite with Meshes"
    bl_options = {"REGISTER", "UNDO"}

    meshes: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Meshes",
        description="What renders everything but the twins",
        items=(
            ("CYCLES", "Cycles", "Light as it goes; slow without a graphics card"),
            ("EEVEE", "EEVEE", "Quick where there is a graphics card"),
        ),
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        """There is a twin and a camera."""
        reason = why_no_picture(context.scene)
        cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Any) -> set[str]:
        """The twins get a scene of their own; this one's compositor takes its picture in."""
        with noting(context.scene):
            composite(context.scene, "CYCLES" if self.meshes == "CYCLES" else _EEVEE)
        return {"FINISHED"}
