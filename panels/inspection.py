"""What the engine found in the photos, beside the buttons that ask for it."""

from __future__ import annotations

from typing import Any

from ..core.outputs import asks_to_overwrite
from ..dgs_addon.engine.question import Question
from ..dgs_addon.engine_sentences import in_users_language
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
    if inspection.effects.subject == (context.scene.dgs.photos,):  # not another scene's
        _draw_error(layout, context, inspection.effects, "dgs.inspect_photos")
    _draw_error(layout, context, inspection.point_spread, "dgs.measure_psf")
    measured = inspection.point_spread.answer
    if measured and context.scene.dgs.medium == "file":
        values = {"sigma": f"{measured['sigma']:.2f}", "error": f"{measured['sigma_uncertainty']:.2f}"}
        figures(layout, "Measured: sigma {sigma} ± {error} px", "CHECKMARK", **values)
    _draw_findings(layout, context)


def _draw_findings(layout: Any, context: Any) -> None:
    """What the photos show and, where the settings leave it out, the button that takes it in."""
    settings = context.scene.dgs
    if inspection.effects.subject != (settings.photos,) or not inspection.effects.answer:
        return
    needed = [found for found in inspection.findings(inspection.effects.answer) if found.needed]
    missing = False
    for found in needed:
        if not inspection.can_be_modelled(found):
            icon = "INFO"
        elif inspection.is_modelled(found, settings):
            icon = "CHECKMARK"
        else:
            icon, missing = "ERROR", True
        sentence(layout, context, found.text, icon)
    if missing:
        sentence(layout, context, "The settings above leave out what is marked", "BLANK1")
        layout.operator("dgs.use_inspection", icon="CHECKMARK")
    elif needed:
        sentence(layout, context, "The settings above take all of this into account", "BLANK1")
    else:
        sentence(layout, context, "These photos show no effect that has to be modelled", "CHECKMARK")


def _draw_error(layout: Any, context: Any, question: Question, button: str) -> None:
    """What went wrong; where files of others would be replaced, the button that allows it."""
    if not asks_to_overwrite(question.error):
        if question.error:
            sentence(layout, context, in_users_language(question.error), "ERROR")
        return
    box = layout.box()
    sentence(box, context, in_users_language(question.error.partition(". ")[0]), "ERROR")
    row = box.row()
    row.operator_context = "EXEC_DEFAULT"  # without the file browser: the photo is the same
    pressed = row.operator(button, text="Replace", icon="FILE_REFRESH")
    pressed.replace = True
    if button == "dgs.measure_psf":
        pressed.filepath = question.subject[0]
