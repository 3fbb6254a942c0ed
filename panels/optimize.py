"""Step 4: the job's settings and its button."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import batch, runner
from ..dgs_addon.job.state import duration_text
from ..dgs_addon.job.steps import results
from ..dgs_addon.paths import out_folder
from .estimate import draw_estimate
from .job import draw_figures, draw_picture
from .layout import Step, figures, folded, ready, sentence, split
from .presets import DGS_PT_presets


class DGS_PT_optimize(Step, bpy.types.Panel):
    """Start it."""

    bl_idname = "DGS_PT_optimize"
    bl_label = "4  Optimize"

    def draw_header_preset(self, context: Any) -> None:
        """Kept settings; done once there is a twin."""
        row = self.layout.row()
        DGS_PT_presets.draw_panel_header(row)
        ready(self.layout, results(context.scene).twin and not runner.running())

    def draw(self, context: Any) -> None:
        """How much effort, and the button."""
        layout, settings = split(self.layout), context.scene.dgs
        layout.prop(settings, "preset")
        row = layout.row()
        row.scale_y = 1.5
        row.operator("dgs.optimize", icon="PLAY")
        row.operator("dgs.estimate", text="", icon="TIME")
        draw_estimate(layout, context)
        job = runner.current()
        if runner.running():
            sentence(layout, context, "It runs: see the top of this tab", "INFO")
        elif (
            job is not None
            and job.state.phase == "done"
            and job.request.kind == "reconstruct"
            and job.request.home == out_folder(settings)  # not another scene's
        ):
            figures(layout, "Done in {time}", "CHECKMARK", time=duration_text(job.state.seconds()))
            draw_picture(layout, context, job)
            draw_figures(layout, job.state)
        _draw_batch(layout, context)
        _draw_more(layout, settings)


def _draw_batch(layout: Any, context: Any) -> None:
    """What several folders together have come to."""
    work = batch.current()
    if work is None:
        return
    box = layout.box()
    if work.alive:
        sentence(box, context, "Several folders: {note}", "TIME", note=work.note or str(len(work.folders)))
        row = box.row()
        row.label(text=work.stage, translate=False)
        row.operator("dgs.cancel_batch", text="Cancel", icon="X")
        return
    for place, line in enumerate(work.lines):
        name, psnr = Path(line["photos"]).name, line.get("psnr")
        if line["how"].startswith("done"):
            row = box.row()
            score = "" if psnr is None else f"{psnr:.2f} dB"
            row.label(text=f"{name}  {score}", icon="CHECKMARK", translate=False)
            row.operator("dgs.take_set", text="Add Twin").number = place
        else:
            why = in_users_language(line["why"]) or iface_(line["how"])
            sentence(box, context, "{name}: {why}", "ERROR", name=name, why=why)
    if not work.lines:
        sentence(box, context, in_users_language(work.error) or "It ended before any twin was made", "ERROR")


def _draw_more(layout: Any, settings: Any) -> None:
    body = folded(layout, "optimize", "More")
    if body is None:
        return
    for name in ("time_limit", "max_gaussians", "sh_degree", "holdout_every", "device", "threads", "seed"):
        body.prop(settings, name)
    body.prop(settings, "add_when_done")
    body.prop(settings, "live")
    body.operator("dgs.batch", icon="FILE_FOLDER")
    body.operator("dgs.show_tradeoff", icon="IMAGE_DATA")
