"""The job as it runs and as it ended; drawn at the top, where no scrolling hides it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bpy.app.translations import pgettext_iface as iface_

from ..core.outputs import asks_to_overwrite
from ..dgs_addon.engine_sentences import in_users_language
from ..dgs_addon.job import pictures, runner
from ..dgs_addon.job.state import JobState, duration_text
from ..dgs_addon.paths import absolute, out_folder
from .layout import figures, sentence
from .thumbnails import photo_icon

#: Notes of the engine that are shown; the log has all.
_NOTES = 2
#: Characters of a path that are shown: its end.
_PATH = 60
#: The buttons whose jobs write into folders that may hold files of others.
_STARTED_BY = {"cameras": "dgs.find_cameras", "synthesize": "dgs.make_test_set"}
_PHASES = {"paused": "Paused", "cancelling": "Stopping: what is done will be kept"}
#: Width of Blender's unit of layout in px, at a scale of 1.
_UNIT = 20


def draw_job(layout: Any, context: Any) -> None:
    """The job of this Blender, or what one before left unfinished; nothing if there is neither."""
    job = runner.current()
    if job is not None and job.homeless:
        _homeless(layout.box(), context, job)
    if job is not None and job.state.alive:
        if runner.belongs(job, context.scene):
            _running(layout.box(), context, job)
        else:
            _elsewhere(layout.box(), context, job)
    elif job is not None and (job.request.out == out_folder(context.scene.dgs) or _unfinished(job, context.scene)):
        _ended(layout, context, job)
    else:
        _before(layout, context)


def draw_picture(layout: Any, context: Any, job: runner.Job) -> None:
    """A job's twin so far above its curves, as wide as the sidebar; nothing as long as it has none."""
    if pictures.shows(job):
        draw_square(layout, context, pictures.JOB)


def draw_square(layout: Any, context: Any, name: str) -> None:
    """One of the add-on's pictures, if it is there, as wide as the sidebar."""
    if not pictures.icon(name):
        return
    width = context.region.width / context.preferences.system.ui_scale
    layout.template_icon(icon_value=pictures.icon(name), scale=max(5.0, (width - 70) / _UNIT))


def draw_beside(layout: Any, context: Any, name: str, photo: Path | None) -> None:
    """One of the add-on's pictures, and a photo beside it where there is one."""
    if photo is None or not pictures.icon(name):
        draw_square(layout, context, name)
        return
    width = context.region.width / context.preferences.system.ui_scale
    row = layout.row(align=True)
    for icon, text in ((pictures.icon(name), "Twin"), (photo_icon(photo), "Photo")):
        column = row.column(align=True)
        column.template_icon(icon_value=icon, scale=max(4.0, (width - 80) / 2 / _UNIT))
        middle = column.row()
        middle.alignment = "CENTER"
        middle.label(text=text)


def _homeless(box: Any, context: Any, job: runner.Job) -> None:
    """A finished twin whose scene is gone or has other photos by now."""
    text = "The twin '{name}' is finished; its scene is gone or has other photos"
    sentence(box, context, text, "CHECKMARK", name=job.request.home.name)
    row = box.row(align=True)
    row.operator("dgs.add_results", text="Add Twin", icon="ADD").folder = str(job.request.home)
    row.operator("dgs.dismiss", text="", icon="X").notice = "TWIN"


def _elsewhere(box: Any, context: Any, job: runner.Job) -> None:
    """Another scene's job: that it runs, and the way to end it."""
    sentence(box, context, "A job of the scene '{name}' is running", "INFO", name=runner.scene_name(job))
    row = box.row(align=True)
    row.progress(factor=job.state.factor, type="BAR", text=iface_(job.state.title), translate=False)
    row.operator("dgs.cancel_job", text="", icon="CANCEL")


def _running(box: Any, context: Any, job: runner.Job) -> None:
    state = job.state
    words = iface_(_PHASES.get(state.phase, state.title))
    if state.phase == "running" and state.seconds_left is not None:
        words = iface_("{stage}, {time} left").format(stage=words, time=duration_text(state.seconds_left))
    box.progress(factor=state.factor, type="BAR", text=words, translate=False)
    row = box.row(align=True)
    paused = state.phase == "paused"
    row.operator("dgs.pause_job", text="Continue" if paused else "Pause", icon="PLAY" if paused else "PAUSE")
    row.operator("dgs.cancel_job", text="Stop Now" if state.phase == "cancelling" else "Cancel", icon="CANCEL")
    row.operator("dgs.show_log", text="", icon="TEXT")
    draw_picture(box, context, job)
    draw_figures(box, state)
    for note in state.notes[-_NOTES:]:
        sentence(box, context, note, "INFO")


def draw_figures(layout: Any, state: JobState) -> None:
    """The curves' last values, in the curves' colours."""
    if not state.marks:
        return
    accuracy = next((mark.psnr for mark in reversed(state.marks) if mark.psnr is not None), None)
    row = layout.row()
    figures(row, "Loss {value:.4f}", "COLORSET_02_VEC", value=state.marks[-1].loss)
    if accuracy is not None:
        figures(row, "{value:.2f} dB", "COLORSET_04_VEC", value=accuracy)


def _unfinished(job: runner.Job, scene: Any) -> bool:
    """Whether a job that has a folder of its own has not come to its end."""
    own = job.request.twin is not None and job.state.phase != "done" and runner.belongs(job, scene)
    return own or _unfinished_set(job, scene)


def _unfinished_set(job: runner.Job, scene: Any) -> bool:
    return job.request.kind == "synthesize" and job.state.phase != "done" and runner.belongs(job, scene)


def _ended(layout: Any, context: Any, job: runner.Job) -> None:
    if job.state.phase not in ("failed", "cancelled"):
        return
    box = layout.box()
    if job.state.phase == "failed":
        sentence(box, context, in_users_language(job.state.error), "ERROR")
    else:
        sentence(box, context, "Cancelled; what was done is kept", "INFO")
    if asks_to_overwrite(job.state.error):
        box.operator(
            _STARTED_BY.get(job.request.kind, "dgs.optimize"), text="Replace", icon="FILE_REFRESH"
        ).replace = True
    elif _unfinished_set(job, context.scene):
        box.operator("dgs.make_test_set", text="Resume", icon="PLAY")
    elif job.request.twin is not None:  # it is begun again where it was begun
        box.operator("dgs.show_log", icon="TEXT")
    else:
        _ways_out(box)


def _before(layout: Any, context: Any) -> None:
    """What a Blender before this one left behind."""
    out = out_folder(context.scene.dgs)
    record, fault = runner.unfinished(out) if out is not None else (None, "")
    if fault:
        sentence(layout.box(), context, in_users_language(fault), "ERROR")
    if record is None:
        return
    box = layout.box()
    if record.interrupted:
        sentence(box, context, "The last job was interrupted; its last checkpoint is kept", "ERROR")
    elif record.error:
        sentence(box, context, in_users_language(record.error), "ERROR")
    else:
        sentence(box, context, "The last job was cancelled; what was done is kept", "INFO")
    if Path(record.photos) != absolute(context.scene.dgs.photos):  # the job's own are resumed, not those of step 1
        figures(box, "Its photos: {path}", "FILE_FOLDER", path=record.photos[-_PATH:])
    _ways_out(box)


def _ways_out(layout: Any) -> None:
    row = layout.row(align=True)
    row.operator("dgs.resume_job", icon="PLAY")
    row.operator("dgs.show_log", icon="TEXT")
