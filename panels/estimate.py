"""What a run would take, beside the button that starts it."""

from __future__ import annotations

from typing import Any

from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.questions import estimate
from .layout import sentence


def draw_estimate(layout: Any, context: Any) -> None:
    """The engine's prediction for the chosen preset; nothing where nobody asked."""
    settings, question = context.scene.dgs, estimate.question
    if question.running:
        layout.label(text="Estimating...", icon="TIME")
        return
    if question.subject != estimate.signature(settings):
        return
    if question.error:
        sentence(layout, context, in_users_language(question.error), "ERROR")
    if not question.answer:
        return
    column = layout.column(align=True)
    for number, (text, values) in enumerate(estimate.sentences(question.answer, settings.preset)):
        sentence(column, context, text, "TIME" if number == 0 else "BLANK1", **values)
    if settings.effects in ("auto", "all"):
        sentence(column, context, "Other effects take more time: trials, or steps that cost more", "BLANK1")
