"""What the engine found in the photos, beside the buttons that ask for it."""

from __future__ import annotations

from typing import Any

from ..dgs_addon.questions import inspection
from .layout import figures, sentence


def draw_inspection(layout: Any, context: Any) -> None:
    """Two buttons, and the answers to what they asked."""
    column = layout.column(align=True)
    column.operator("dgs.inspect_photos", icon="VIEWZOOM")
    column.operator("dgs.measure_psf", icon="LIGHT_POINT")
    if inspection.effects.running:
        layout.label(text="Inspecting...", icon="TIME")
    if inspection.point_spread.running:
        layout.label(text="Measuring...", icon="TIME")
    for question in (inspection.effects, inspection.point_spread):
        if question.error:
            sentence(layout, context, question.error, "ERROR")
    measured = inspection.point_spread.answer
    if measured:
        values = {"sigma": f"{measured['sigma']:.2f}", "error": f"{measured['sigma_uncertainty']:.2f}"}
        figures(layout, "Measured: sigma {sigma} ± {error} px", "CHECKMARK", **values)
    if inspection.effects.subject == (context.scene.dgs.photos,):
        lines = inspection.sentences(inspection.effects.answer)
        for line, needed in lines:
            if needed:
                sentence(layout, context, line, "CHECKMARK")
        if lines and not any(needed for _, needed in lines):
            sentence(layout, context, "These photos show no effect that has to be modelled", "CHECKMARK")
