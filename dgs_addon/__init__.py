"""The Blender side: operators, panels and what they put into a scene.

bpy is imported inside the functions: the command line reads parts of this package without Blender.
"""

from __future__ import annotations

from typing import Any

#: What is registered now, in order; empty while the add-on is off.
_registered: list[type] = []


def register(operators: Any, panels: Any) -> None:
    """Adds the classes and menu entries of the two packages; does nothing if they are there already."""
    if _registered:
        return
    import bpy

    from .properties import register_properties
    from .translations import register_translations

    for kind in _classes(operators, panels):
        bpy.utils.register_class(kind)
        _registered.append(kind)
    register_properties()
    register_translations()
    operators.add_menus()
    from .job.watching import go_on

    bpy.app.handlers.load_post.append(go_on)


def unregister(operators: Any, panels: Any) -> None:
    """Takes everything out again in reverse order; does nothing if it is out already."""
    if not _registered:
        return
    import bpy

    from . import exact
    from .engine import install
    from .job import estimate, inspection, pictures, runner, watching
    from .properties import unregister_properties
    from .translations import unregister_translations

    exact.stop()
    inspection.effects.stop()
    inspection.point_spread.stop()
    watching.stop()
    bpy.app.handlers.load_post.remove(watching.go_on)
    runner.stop()
    install.stop()
    estimate.stop()
    pictures.clear()
    panels.forget_thumbnails()
    operators.remove_menus()
    unregister_translations()
    unregister_properties()
    while _registered:
        bpy.utils.unregister_class(_registered.pop())


def _classes(*packages: Any) -> list[type]:
    from .preferences import DGS_AP_preferences
    from .properties import DGS_PG_settings

    return [DGS_PG_settings, DGS_AP_preferences, *(kind for package in packages for kind in package.CLASSES)]
