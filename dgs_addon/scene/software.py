"""Windows that no graphics card draws, but the processor: in them every splat counts."""

from __future__ import annotations

import bpy
import gpu

#: Balls that the processor draws about as fast as it draws an empty 3D view.
SOFTWARE_SPLATS = 5000


def drawn_by_software() -> bool:
    """Whether this Blender has a window, and the processor draws it."""
    if bpy.app.background:
        return False
    return bool(gpu.platform.device_type_get() == "SOFTWARE")
