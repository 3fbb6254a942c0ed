"""Brings the add-on into Blender, and takes it out again."""

from __future__ import annotations

import bpy

from .. import operators
from ..dgs_addon.drawing import measures as drawn_measures
from ..dgs_addon.drawing.registration import register_drawing, unregister_drawing
from ..dgs_addon.engine import install
from ..dgs_addon.engine.interpreter import reads_heif
from ..dgs_addon.job import batch, pictures, runner, watching
from ..dgs_addon.job.properties import DGS_PG_settings, register_properties, unregister_properties
from ..dgs_addon.manual import register_manual, unregister_manual
from ..dgs_addon.photos import ask_about_heif
from ..dgs_addon.questions import estimate, exact, inspection, measures, meshes, next_views, split_view
from ..dgs_addon.scene.measures import (
    DGS_PG_measure,
    DGS_PG_measures,
    DGS_PG_place,
    register_measures,
    unregister_measures,
)
from ..dgs_addon.translations import register_translations, unregister_translations
from . import CLASSES, LISTS, forget_thumbnails
from .preferences import DGS_AP_preferences

#: What is registered now, in order; empty while the add-on is off.
_registered: list[type] = []


def register() -> None:
    """Adds classes and menu entries; does nothing if they are there already."""
    if _registered:
        return
    groups = (DGS_PG_settings, DGS_PG_place, DGS_PG_measure, DGS_PG_measures, DGS_AP_preferences)
    for kind in (*groups, *operators.CLASSES, *operators.GIZMOS, *LISTS, *CLASSES):
        bpy.utils.register_class(kind)
        _registered.append(kind)
    register_properties()
    register_measures()
    register_drawing()
    register_translations()
    register_manual()
    ask_about_heif(reads_heif)
    operators.add_menus()
    split_view.start()
    drawn_measures.start()
    bpy.app.handlers.load_post.extend((watching.go_on, exact.go_on))


def unregister() -> None:
    """Takes everything out again in reverse order; does nothing if it is out already."""
    if not _registered:
        return
    for handler in (watching.go_on, exact.go_on):
        bpy.app.handlers.load_post.remove(handler)
    _stop_everything()
    split_view.stop()
    drawn_measures.stop()
    pictures.clear()
    forget_thumbnails()
    operators.remove_menus()
    unregister_manual()
    unregister_translations()
    unregister_drawing()
    unregister_measures()
    unregister_properties()
    while _registered:
        bpy.utils.unregister_class(_registered.pop())


def _stop_everything() -> None:
    exact.stop()
    measures.stop()
    meshes.stop()
    for question in (inspection.effects, inspection.point_spread, estimate.question, next_views.question):
        question.stop()
    watching.stop()
    runner.stop()
    batch.stop()
    install.stop()
