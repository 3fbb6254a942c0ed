"""What a scene needs to show a twin as it was trained, where nobody has chosen otherwise.

Descatter draws a twin in milliseconds, to a step of 8 bits as the engine does: so a scene gets it whose render engine
nobody has chosen, and which holds nothing else to render. Cycles takes longer, and shows lit objects, too.
"""

from __future__ import annotations

from typing import Any

from ..engine.interpreter import why_not
from .arrival import is_startup
from .changes import HIDDEN
from .material import OWN_ENGINE, prepare_cycles, prepare_scene, show_colours
from .twin import is_twin

#: What Blender's own new file chooses, by version.
_DEFAULTS = ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT")
#: Its settings there: who chose the engine has mostly changed one of them.
_UNTOUCHED = {"taa_render_samples": 64, "taa_samples": 16}
#: What final pictures of Descatter would not show.
_RENDERED = ("MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "VOLUME", "POINTCLOUD", "GREASEPENCIL", "GPENCIL")


def set_up_scene(scene: Any) -> None:
    """Chooses Descatter where nobody has chosen a render engine, else Cycles; the photos' colours.

    Cycles is set up in any case: whoever chooses it later, or opens the file where this add-on is not, finds it ready.
    """
    if scene.render.engine != OWN_ENGINE and (why_not() or not nobody_has_chosen(scene)):
        prepare_scene(scene)
        return
    if hasattr(scene, "cycles"):
        prepare_cycles(scene)
    scene.render.engine = OWN_ENGINE
    show_colours(scene)


def nobody_has_chosen(scene: Any) -> bool:
    """Whether the render engine is Blender's first, as it comes, and nothing but twins would be rendered."""
    if scene.render.engine not in _DEFAULTS:
        return False
    if any(getattr(scene.eevee, name, value) != value for name, value in _UNTOUCHED.items()):
        return False
    return not any(_is_rendered(thing) for thing in scene.objects)


def _is_rendered(thing: Any) -> bool:
    if thing.type not in _RENDERED or is_twin(thing) or thing.hide_render:
        return False
    return not (HIDDEN in thing or is_startup(thing))
