"""The one job of this Blender. Everything here runs on the main thread; the worker has its own.

A timer drains the worker's queue; nothing else touches bpy. The job belongs to the process, not to a
file: loading another .blend lets it go on, and its result goes to the scene that asked, if it is there.
Without a window there is no timer: `wait` drains the queue itself.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import DgsError
from ...core.files import make_folder
from ...core.kernel_cache import is_compiled
from ..drawing.live import SHOWN
from ..drawing.process import warm_up
from ..paths import out_folder
from ..scene.comparison import add_changes
from ..scene.nodes import splat_nodes
from ..scene.software import SOFTWARE_SPLATS, drawn_by_software
from ..window import Pace, redraw, redraw_views
from . import pictures
from .job import Job
from .options import RESUMABLE
from .record import LOG, Record, read_record
from .request import Request
from .results import add_results, is_edited, prepared, show_live, twin_of
from .snapshot import News, SnapshotReader
from .state import ending
from .test_set import use_test_set
from .worker import Ended, Extra, Worker

#: Seconds between two readings of the queue: several in each redraw of the panel, and too little to be felt.
TICK = 0.1
#: Splats of the live twin at most: Blender evaluates them anew for each snapshot.
MAXIMUM_LIVE_SPLATS = 50_000
#: Events taken from the queue at most in one tick: a backlog must not block the window.
_EVENTS_PER_TICK = 50
#: Seconds after a wish to stop, in which the engine has not come to its safe point, until it is ended; and in stages
#: in which native code (the compiler) hears nothing for long, and nothing is made that could be kept.
PATIENCE, SHORT_PATIENCE = 120.0, 2.0
#: These stages; '' is the engine's start.
_NOTHING_TO_KEEP = ("", "photos", "compile")
#: Where these kernels are compiled, all are that draw a twin.
_DRAWING_KERNELS = "packing_kernels"


_job: Job | None = None


def current() -> Job | None:
    """The job of this Blender that runs or ran last."""
    return _job


def running() -> bool:
    """Whether a job works now."""
    return _job is not None and _job.state.alive


def busy() -> bool:
    """Whether a job works now, or is being put into the scene."""
    return running() or (_job is not None and _job.finishing is not None)


def start(request: Request, python: Path, scene: Any) -> Job:
    """Starts the engine; returns at once.

    Raises:
        DgsError: another job runs, or the results' folder cannot be written to.
    """
    global _job
    if running():
        raise DgsError("A job is running already", "Wait for it or cancel it")
    make_folder(request.out)
    live = scene.dgs.live and not bpy.app.background
    snapshots = SnapshotReader(request.out, live, SOFTWARE_SPLATS if drawn_by_software() else MAXIMUM_LIVE_SPLATS)
    record = Record(
        request.kind, str(request.photos), request.count, dict(request.options), selection=request.selection
    )
    record.save(request.out)

    def began(pid: int) -> None:
        # On the worker's thread: another Blender is to see that this job is in good hands.
        record.pid = pid
        with contextlib.suppress(DgsError):
            record.save(request.out)

    worker = Worker(request.command(python), request.out / LOG, snapshots.read_news, began)
    _job = Job(request, scene.session_uid, scene.name, worker, record, snapshots)
    worker.start()
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK, persistent=True)
    _job.to_be_drawn = _job.to_be_prepared = _will_be_seen(request, scene)
    # Now, while the engine itself starts, which keeps one core busy; but where kernels are still to be compiled, both
    # would do it: then when the job has done so.
    _start_drawing(_job, is_compiled(_DRAWING_KERNELS))
    return _job


def _will_be_seen(request: Request, scene: Any) -> bool:
    """Whether splats will be drawn over a view when the job has ended, or before."""
    if bpy.app.background or request.kind not in ("reconstruct", "update"):
        return False
    return bool(getattr(scene, SHOWN, True) and (scene.dgs.add_when_done or scene.dgs.live))


def unfinished(out: Path) -> tuple[Record | None, str]:
    """The record of a job in `out` that ended before its time, or what is wrong with the record that is there.

    Returns:
        (record, ''), (None, '') where there is no such job, or (None, why its file cannot be used).
    """
    if _job is not None and _job.state.alive:
        return None, ""
    try:
        record = read_record(out)
    except DgsError as error:
        return None, str(error)
    if record is None or record.kind not in RESUMABLE:
        return None, ""
    ended_early = record.interrupted or record.phase in ("cancelled", "failed")
    return (record if ended_early else None), ""


def resumable(out: Path) -> Record | None:
    """The record of a job in `out` that ended before its time; None if there is none, or it cannot be used."""
    return unfinished(out)[0]


def cancel() -> None:
    """Asks the engine to stop at its next safe point; what is done is kept. A second call ends it at once."""
    if _job is None or not _job.state.alive:
        return
    if _job.asked is not None:
        _job.worker.kill()
        return
    _job.asked, _job.state.phase = time.monotonic(), "cancelling"
    _job.worker.send("cancel")


def pause(on: bool) -> None:
    """Lets the engine wait, or go on."""
    if _job is not None and _job.state.phase in ("running", "paused"):
        _job.state.phase = "paused" if on else "running"
        _job.worker.send("pause" if on else "continue")


def wait(seconds: float = float("inf")) -> bool:
    """Drains the queue until the job has ended, for Blender without a window; False if it did not in time."""
    until = time.monotonic() + seconds
    while busy():
        if time.monotonic() > until:
            return False
        _drain()
        time.sleep(0.02)
    return True


def stop() -> None:
    """Ends the job at once, as when the add-on is switched off; its last checkpoint stays."""
    global _job
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    if _job is not None and _job.state.alive:
        _job.worker.kill()
        _job.worker.join(5.0)
    _job = None


def _tick() -> float | None:
    _drain()
    return TICK if busy() else None


def _drain() -> None:
    job = _job
    if job is None:
        return
    if job.finishing is not None:
        _go_on(job)
    changed = False
    for _ in range(_EVENTS_PER_TICK):
        try:
            message = job.worker.events.get_nowait()
        except queue.Empty:
            break
        changed = True
        if isinstance(message, Ended):
            _end(job, message.status)
        elif isinstance(message, Extra):
            _take_in(job, message.value)
        else:
            job.state.apply(message)
    _start_drawing(job, job.state.stage in ("train", "save"))
    _prepare_nodes(job)
    _show_live(job)
    if job.asked is not None and job.state.alive and time.monotonic() - job.asked > _patience(job):
        job.worker.kill()
    if not bpy.app.background:
        _show(job, changed)


def _start_drawing(job: Job, now: bool) -> None:
    """Starts the process that will draw the twin, so that its first picture is not late."""
    if job.to_be_drawn and now:
        job.to_be_drawn = False
        warm_up()


def _prepare_nodes(job: Job) -> None:
    """Makes the nodes of the twin that is about to come, which takes a moment: it is there sooner then."""
    if job.to_be_prepared and job.state.stage == "save":
        job.to_be_prepared = False
        splat_nodes(job.request.options.get("sh_degree") != 0)


def _patience(job: Job) -> float:
    return SHORT_PATIENCE if job.state.stage in _NOTHING_TO_KEEP else PATIENCE


def _end(job: Job, status: int) -> None:
    phase, error = ending(status, job.state.error, job.asked is not None)
    job.state.end(phase, error)
    job.record.phase, job.record.error, job.record.result = phase, error, job.state.result
    try:
        job.record.save(job.request.out)
    except DgsError as failure:
        job.state.end("failed", str(failure))
        return
    if job.request.kind == "reconstruct" and job.state.result:
        job.finishing = _finish(job)
    elif job.request.kind == "update" and phase == "done":
        job.cloud, job.finishing = None, _finish(job)
    elif job.request.kind == "change" and phase == "done":
        job.finishing = _finish_comparison(job)
    elif job.request.kind == "synthesize" and phase == "done":
        asking = _asking_scene(job)
        if asking is not None:
            use_test_set(job.request.out, asking.dgs)


def _go_on(job: Job) -> None:
    assert job.finishing is not None
    try:
        next(job.finishing)
        return
    except DgsError as failure:
        job.state.end("failed", str(failure))
        job.news = True
    except StopIteration:
        pass
    except ReferenceError:  # another file was loaded meanwhile, or an undo took the scene away
        job.homeless = job.news = True
    job.finishing = None


def _finish(job: Job) -> Iterator[None]:
    while (scene := _scene(job)) is not None and is_edited(job.request.home, scene):
        yield  # until Edit Mode is left
    if scene is None:
        asking = _asking_scene(job)
        job.homeless = asking is None or asking.dgs.add_when_done
        return
    if not scene.dgs.add_when_done:
        return
    yield from add_results(job, scene)
    _push_undo("Descatter Twin")


def _finish_comparison(job: Job) -> Iterator[None]:
    """What has changed comes to the twin that was compared, if it is still in a scene."""
    home, asking = job.request.home, _asking_scene(job)
    offered = [asking] if asking is not None else bpy.data.scenes
    scene = next((scene for scene in offered if twin_of(home, scene) is not None), None)
    while scene is not None and is_edited(home, scene):
        yield  # until Edit Mode is left
    twin = None if scene is None else twin_of(home, scene)
    if twin is not None:
        add_changes(twin, job.request.out, "/".join(job.request.photos.parts[-2:]), scene)
        redraw_views()
        _push_undo("Descatter Changes")


def _push_undo(message: str) -> None:
    """Else the next undo would take out again what has just come."""
    windows = bpy.context.window_manager.windows
    if windows and not bpy.app.background:
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.ed.undo_push(message=message)


def belongs(job: Job, scene: Any) -> bool:
    """Whether a scene asked for this job, or holds the folder that it writes to."""
    return bool(job.scene == scene.session_uid) or out_folder(scene.dgs) == job.request.home


def scene_name(job: Job) -> str:
    """What the scene that asked is called now, or was called then."""
    asking = _asking_scene(job)
    return job.scene_name if asking is None else str(asking.name)


def settle(home: Path) -> None:
    """The twin in this folder has come into a scene, or nobody wants it."""
    if _job is not None and _job.request.home == home:
        _job.homeless = False


def _asking_scene(job: Job) -> Any:
    """The scene that asked, whatever it is called now; None if it is gone."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == job.scene), None)


def _scene(job: Job) -> Any:
    """The scene that takes the twin: the one that asked, or after another file was loaded one with the same results.

    None where it is gone, or other photos were chosen in it (or an undo took them back).
    """
    asking = _asking_scene(job)
    offered = [asking] if asking is not None else bpy.data.scenes
    return next((scene for scene in offered if out_folder(scene.dgs) == job.request.home), None)


def _take_in(job: Job, news: News) -> None:
    if news.picture is not None:
        job.picture = news.picture
    if news.cloud is not None:
        job.cloud, job.unseen = news.cloud, True


def _show_live(job: Job) -> None:
    now = time.monotonic()
    if not job.live_pace.due(now) or not job.unseen or not job.snapshots.live or not job.state.alive:
        return
    scene = _scene(job)
    if scene is None:
        return
    if prepared(job.cloud) or is_edited(job.request.out, scene):
        return  # enough for one tick, or nothing may be changed now
    job.unseen = False
    if job.live_twin and twin_of(job.request.out, scene) is None:
        job.snapshots.live = False  # the user has deleted it: it comes back when it is finished
        return
    job.live_twin = True
    show_live(job, scene)
    _draws(job.live_pace, now)


def _show(job: Job, changed: bool) -> None:
    """Keeps the panel up to date, rarely: drawing a sidebar makes Blender compose the whole window."""
    now = time.monotonic()
    job.news |= changed
    if not job.news or (job.state.alive and not job.pace.due(now)):
        return
    if job.finishing is not None:
        return  # all at once with the twin
    job.news = False
    pictures.refresh(job)
    redraw()
    _draws(job.pace, now)


def _draws(pace: Pace, now: float) -> None:
    """Measures a drawing: Blender draws after this tick, and looks at its timers again after that."""
    pace.asked(now)
    bpy.app.timers.register(lambda: pace.drawn(time.monotonic()), first_interval=0.0, persistent=True)
