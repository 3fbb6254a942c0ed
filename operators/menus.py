"""Where Blender's own menus offer what this add-on does; F3 finds it there."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..core.formats.cameras import camera_labels
from ..core.formats.gaussians import read_suffixes, written_formats
from ..dgs_addon.scene.twin import is_twin
from .export_twin import DGS_OT_export_twin
from .import_cameras import DGS_OT_import_cameras
from .import_twin import DGS_OT_import_twin

#: What can be done with a twin, in groups; each as in the tab.
_OBJECT = (
    ("dgs.view_twin", "dgs.exact_view", "dgs.split_view", "dgs.render_twin"),
    ("dgs.set_length", "dgs.set_up", "dgs.crop_twin", "dgs.limit_splats"),
    ("dgs.measure", "dgs.measure_again", "dgs.know_length", "dgs.export_measures", "dgs.make_mesh"),
    ("dgs.edit_splats", "dgs.restore_splats", "dgs.merge_twins", "dgs.apply_transform"),
    ("dgs.show_known", "dgs.suggest_next_views", "dgs.show_next_views", "dgs.show_states"),
    ("dgs.prepare_scene", "dgs.composite_meshes", "dgs.give_back"),
    ("dgs.export_twin", "dgs.mark_assets", "dgs.remove_twin"),
)
#: What selects splats, and what is done with them.
_SELECT = (
    ("dgs.select_by_size", "dgs.select_by_opacity", "dgs.select_by_colour", "dgs.select_by_error"),
    ("dgs.select_floaters",),
    ("dgs.delete_splats", "dgs.hide_splats", "dgs.show_splats", "dgs.restore_splats"),
)
#: What brings something into a scene.
_ADD = ("dgs.import_twin", "dgs.import_cameras", "dgs.add_results", "dgs.show_cameras")


class DGS_MT_object(bpy.types.Menu):
    """Object > Descatter."""

    bl_idname = "DGS_MT_object"
    bl_label = "Descatter"

    def draw(self, _context: Any) -> None:
        """What can be done with a twin."""
        _groups(self.layout, _OBJECT)


class DGS_MT_select(bpy.types.Menu):
    """Select > Descatter, in Edit Mode."""

    bl_idname = "DGS_MT_select"
    bl_label = "Descatter"

    def draw(self, _context: Any) -> None:
        """Ways to select splats."""
        _groups(self.layout, _SELECT)


class DGS_MT_add(bpy.types.Menu):
    """Add > Descatter."""

    bl_idname = "DGS_MT_add"
    bl_label = "Descatter"

    def draw(self, _context: Any) -> None:
        """Ways into the scene."""
        self.layout.operator_context = "INVOKE_REGION_WIN"  # the file browser opens
        for name in _ADD:
            self.layout.operator(name)


def add_menus() -> None:
    """Adds the entries of File > Import, File > Export, Add and Object."""
    for menu, entries in _entries():
        menu.append(entries)


def remove_menus() -> None:
    """Takes the entries out again."""
    for menu, entries in _entries():
        menu.remove(entries)


def _entries() -> tuple[tuple[Any, Any], ...]:
    kinds = bpy.types
    return (
        (kinds.TOPBAR_MT_file_import, _import_entries),
        (kinds.TOPBAR_MT_file_export, _export_entries),
        (kinds.VIEW3D_MT_add, _add_entries),
        (kinds.VIEW3D_MT_object, _object_entries),
        (kinds.VIEW3D_MT_object_apply, _apply_entries),
        (kinds.VIEW3D_MT_select_edit_mesh, _select_entries),
        (kinds.TOPBAR_MT_help, _help_entries),
    )


def _import_entries(menu: Any, _context: Any) -> None:
    words = iface_("Gaussian Splats ({suffixes})").format(suffixes=", ".join(read_suffixes()))
    menu.layout.operator(DGS_OT_import_twin.bl_idname, text=words, translate=False)
    words = iface_("Cameras and Photos ({formats})").format(formats=camera_labels())
    menu.layout.operator(DGS_OT_import_cameras.bl_idname, text=words, translate=False)


def _export_entries(menu: Any, _context: Any) -> None:
    suffixes = ", ".join(spec.suffixes[0] for spec in written_formats())
    words = iface_("Gaussian Splats ({suffixes})").format(suffixes=suffixes)
    menu.layout.operator(DGS_OT_export_twin.bl_idname, text=words, translate=False)


def _add_entries(menu: Any, _context: Any) -> None:
    menu.layout.menu(DGS_MT_add.bl_idname, icon="POINTCLOUD_DATA")


def _object_entries(menu: Any, _context: Any) -> None:
    menu.layout.separator()
    menu.layout.menu(DGS_MT_object.bl_idname, icon="POINTCLOUD_DATA")


def _apply_entries(menu: Any, context: Any) -> None:
    if is_twin(context.object):  # what Blender itself applies turns neither shapes nor gloss
        menu.layout.separator()
        menu.layout.operator("dgs.apply_transform")


def _select_entries(menu: Any, context: Any) -> None:
    if is_twin(context.object):
        menu.layout.separator()
        menu.layout.menu(DGS_MT_select.bl_idname, icon="POINTCLOUD_DATA")


def _help_entries(menu: Any, _context: Any) -> None:
    menu.layout.separator()
    menu.layout.operator("dgs.open_manual", text="Descatter Manual", icon="HELP")


def _groups(layout: Any, groups: tuple[tuple[str, ...], ...]) -> None:
    for number, group in enumerate(groups):
        if number:
            layout.separator()
        for name in group:
            layout.operator(name)
