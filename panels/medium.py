"""Step 3: what blurs the photos."""

from __future__ import annotations

from typing import Any

import bpy

from ..dgs_addon.paths import absolute
from ..dgs_addon.questions import inspection
from .inspection import draw_inspection
from .layout import Step, folded, ready, sentence, split


class DGS_PT_medium(Step, bpy.types.Panel):
    """Which medium."""

    bl_idname = "DGS_PT_medium"
    bl_label = "3  Medium"

    def draw_header_preset(self, context: Any) -> None:
        """Done where the photos or the user say what blurs them; without a medium only if the photos show no blur."""
        ready(self.layout, _decided(context.scene.dgs))

    def draw(self, context: Any) -> None:
        """Its kind and its figures."""
        layout, settings = split(self.layout), context.scene.dgs
        layout.prop(settings, "medium")
        self._kind(layout, context)
        layout.prop(settings, "effects")
        draw_inspection(layout, context)

    def _kind(self, layout: Any, context: Any) -> None:
        settings = context.scene.dgs
        if settings.medium == "none":
            sentence(layout, context, "No blur is modelled: ordinary Gaussian splatting", "INFO")
            return
        if settings.medium == "auto":
            sentence(layout, context, "The width of the blur is estimated from the photos", "INFO")
        elif settings.medium == "auto-each":
            sentence(layout, context, "Each photo's blur is estimated, as far as it differs from the others'", "INFO")
        elif settings.medium == "gaussian":
            layout.prop(settings, "sigma", text="Sigma (px)")
        elif settings.medium == "ellipse":
            layout.prop(settings, "sigma", text="Sigma Along (px)")
            layout.prop(settings, "sigma_minor", text="Across (px)")
            layout.prop(settings, "angle")
        else:
            layout.prop(settings, "psf_file")
        body = folded(layout, "medium", "More")
        if body is not None:
            body.prop(settings, "blur_space")


def _decided(settings: Any) -> bool:
    if settings.medium == "file":
        path = absolute(settings.psf_file)
        return path is not None and path.is_file()
    if settings.medium != "none":
        return True
    found = inspection.findings(inspection.effects.answer) if inspection.effects.subject == (settings.photos,) else []
    return any(one.name == "blur" and not one.needed for one in found)
