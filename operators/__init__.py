"""Blender operators; `CLASSES` in the order in which they are registered."""

from __future__ import annotations

from typing import Any

import bpy

from .import_cameras import DGS_OT_import_cameras
from .import_twin import DGS_OT_import_twin
from .prepare_scene import DGS_OT_prepare_scene

CLASSES: tuple[type, ...] = (DGS_OT_import_twin, DGS_OT_import_cameras, DGS_OT_prepare_scene)


def add_menus() -> None:
    """Adds the imports to File > Import."""
    bpy.types.TOPBAR_MT_file_import.append(_import_entries)


def remove_menus() -> None:
    """Takes the imports out of File > Import."""
    bpy.types.TOPBAR_MT_file_import.remove(_import_entries)


def _import_entries(menu: Any, _context: Any) -> None:
    menu.layout.operator(DGS_OT_import_twin.bl_idname, text="Gaussian Splats (.ply)")
    menu.layout.operator(DGS_OT_import_cameras.bl_idname, text="Cameras and Photos (COLMAP, transforms.json)")
