"""What the engine found in the photos, beside the buttons that ask for it."""

from __future__ import annotations

from typing import Any

from ..dgs_addon.job import inspection
from .layout import sentence


def draw_inspection(layout: Any, context: Any) -> None:
    """Two buttons, and the answers to what they asked."""
    column = layout.column(align=True)
    column.operator("dgs.inspect_photos", icon="VIEWZOOM")
    column.operator("dgs.measure_psf", icon="LIGHT_POINT")
    for question, text in ((inspection.effects, "Inspecting..."), (inspection.point_spread, "Measuring...")):
        if question.running:
            layout.label(text=text, icon="TIME")
        elif question.error:
            sentence(layout, context, question.error, "ERROR")
    measured = inspection.point_spread.answer
    if measured:
        text = f"Measured: sigma {measured['sigma']:.2f} ± {measured['sigma_uncertainty']:.2f} px"
        sentence(layout, context, text, "CHECKMARK")
    if inspection.effects.subject == (context.scene.dgs.photos,):
        lines = inspection.sentences(inspection.effects.answer)
        for text, needed in lines:
            if needed:
                sentence(layout, context, text, "CHECKMARK")
        if lines and not any(needed for _, needed in lines):
            sentence(layout, context, "Nothing but the scene shows in these photos", "CHECKMARK")
