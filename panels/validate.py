"""Step 6: how good the twin is."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job.steps import results
from ..dgs_addon.job.test_set import is_to_be_found
from ..dgs_addon.laboratory.media.registry import MEDIA
from ..dgs_addon.questions import exact
from ..dgs_addon.scene.cameras import photo_behind
from ..dgs_addon.scene.twin import scene_twin
from .job import draw_beside
from .layout import Step, folded, ready, sentence, split

#: Sizes of detail that are shown at most.
_BANDS = 12


class DGS_PT_validate(Step, bpy.types.Panel):
    """Look at it and measure it."""

    bl_idname = "DGS_PT_validate"
    bl_label = "6  Validate"

    def draw_header_preset(self, context: Any) -> None:
        """Done once there are scores."""
        ready(self.layout, bool(results(context.scene).report))

    def draw(self, context: Any) -> None:
        """The render button, the scores, the report."""
        layout = split(self.layout)
        row = layout.row(align=True)
        row.prop(context.scene.dgs, "view_kind", expand=True)
        layout.operator("dgs.exact_view", icon="IMAGE_DATA")
        _draw_exact(layout, context)
        layout.operator("dgs.render_twin", icon="RENDER_STILL")
        layout.operator("dgs.open_report", icon="URL")
        held = results(context.scene)
        if held.report:
            _draw_verdict(layout, context, held.report.get("verdict"))
            _draw_scores(layout, held.report)
        elif held.odd_report:
            sentence(layout, context, "The report is of another version; run Optimize again", "INFO")
        else:
            sentence(layout, context, "Scores appear here after Optimize", "INFO")
        body = folded(layout, "validate", "Sharp Photos")
        if body is not None:
            body.prop(context.scene.dgs, "truth", text="Folder")
            body.operator("dgs.compare_truth", icon="VIEWZOOM")
        body = folded(layout, "test_set", "Test Set")
        if body is not None:
            for name in ("test_set", "test_views", "test_width"):
                body.prop(context.scene.dgs, name)
            _draw_test_medium(body, context)
            body.operator("dgs.make_test_set", icon="SCENE")


def _draw_exact(layout: Any, context: Any) -> None:
    """The scene's own exact view, beside its photo, and whether it still is one."""
    image = context.scene.dgs.exact_view
    if image is None:
        return
    if exact.is_outdated(scene_twin(context.scene, context.object), context.scene):
        text = "Outdated: the twin, the camera or what is to be shown has changed"
        sentence(layout, context, text, "ERROR")
    settings = context.scene.dgs
    row = layout.row(align=True)
    row.operator("dgs.split_view", icon="MOD_MIRROR", depress=settings.split_shown)
    if settings.split_shown:
        layout.prop(settings, "split_against")
        layout.prop(settings, "split_at", slider=True)
    draw_beside(layout, context, exact.icon_name(image), photo_behind(context.scene.camera))


def _draw_test_medium(layout: Any, context: Any) -> None:
    """What the photos of a test set are taken through, and how its values are written."""
    settings = context.scene.dgs
    layout.prop(settings, "test_medium")
    if is_to_be_found(settings):
        text = iface_("A Gaussian of {sigma} px, for Optimize to find")
        sentence(layout, context, text.format(sigma=f"{settings.sigma:g}"), "INFO")
    spec = next((spec for spec in MEDIA if spec.name == settings.test_medium), None)
    if spec is not None:
        layout.prop(settings, "test_values")
        layout.label(text=f"{spec.form}: {spec.usual}", icon="BLANK1", translate=False)
        if not spec.parse(spec.usual).every_photo:
            layout.prop(settings, "test_sharp")


#: What stands before the verdict.
_VERDICT_ICONS = {"good": "CHECKMARK", "doubtful": "INFO", "poor": "ERROR"}


def _draw_verdict(layout: Any, context: Any, verdict: dict[str, Any] | None) -> None:
    """Whether the twin predicts photos that it has not seen, and what would help."""
    if verdict is not None:  # (reports of earlier versions have none)
        icon = _VERDICT_ICONS.get(verdict["level"], "INFO")
        sentence(layout, context, in_users_language(verdict["sentence"]), icon)
        for line in verdict["help"]:
            sentence(layout, context, f"{in_users_language(line)}.", "BLANK1")


def _draw_scores(layout: Any, report: dict[str, Any]) -> None:
    held = report["heldout"]
    lines = [
        (
            "Photos registered",
            iface_("{part} of {all}").format(part=report["photos"]["registered"], all=report["photos"]["given"]),
        ),
        ("Gaussians", f"{report['gaussians']:,}"),
        (iface_("Held-out photos ({count})").format(count=len(held["names"])), _decibel(held["degraded"]["psnr"])),
        ("Sharp photos", _decibel(held["sharp"]["psnr"])),
        *_detail((held.get("bands") or [])[:_BANDS]),
        ("Detail in the photos", f"{report['resolvable_period_px']:.1f} px"),
    ]
    box = layout.box().column(align=True)
    for name, value in lines:
        if value:
            row = box.split(factor=0.62)
            row.label(text=name)
            row.label(text=value)


def _detail(bands: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """How much of the truth's detail the twin has, by size: correlation of what lies between two periods."""
    return [
        (
            iface_("Detail of {finest} to {coarsest} px").format(
                finest=f"{band['finest']:g}", coarsest=f"{band['coarsest']:g}"
            ),
            f"{band['correlation']:.0%}",
        )
        for band in bands
        if band["correlation"] is not None
    ]


def _decibel(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} dB"
