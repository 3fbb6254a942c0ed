"""What a run would take, beside the button that starts it."""

from __future__ import annotations

from typing import Any

from ..dgs_addon.job import estimate
from .layout import figures, sentence


def draw_estimate(layout: Any, context: Any) -> None:
    """The engine's prediction for the chosen preset; nothing where nobody asked."""
    settings = context.scene.dgs
    if estimate.running():
        layout.label(text="Estimating...", icon="TIME")
        return
    told, error = estimate.known(settings)
    if error:
        sentence(layout, context, error, "ERROR")
    if not told:
        return
    column = layout.column(align=True)
    column.scale_y = 0.9
    for number, (text, values) in enumerate(estimate.sentences(told, settings.preset)):
        figures(column, text, "TIME" if number == 0 else "BLANK1", **values)
