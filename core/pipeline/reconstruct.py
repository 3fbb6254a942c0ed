"""One run from photos to a reported twin."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..devices import choose_device
from ..errors import CameraError, DgsError
from ..files import check_writable, make_folder, plain, write_json
from ..formats.ply import write_ply
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..imaging.psf import PointSpread
from ..machine import machine, use_threads
from ..photos.load import Photo, load_photos
from ..photos.source import photo_source
from ..photos.write import render_names
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.page import write_page
from ..report.pictures import ViewPictures, spread
from ..run_settings import ReconstructSettings
from ..sfm.features import FEATURES
from ..sfm.find import find_cameras
from ..sfm.given import load_cameras
from ..views import fingerprint, heldout_names
from .blind import spreads_of, told_spreads
from .heldout import Scores, TruthFolder, ViewScorer
from .refinement import refined
from .snapshots import Watchers
from .summary import Facts, resolvable_period, summary
from .views import Viewer
from .world import near_origin

if TYPE_CHECKING:
    from ..effort.plan import Budget
    from ..training.run import Trained
    from .effects.choose import Chosen

#: Views shown in the page at most.
SHOWN = 6
#: A run that waits for a quality takes at most this many times the preset's steps.
UNTIL_STEPS = 4


@dataclass(frozen=True)
class Outcome:
    """What a run left behind.

    Attributes:
        report: the content of report.json.
        folder: where everything lies.
        cancelled: whether the user stopped it (what was finished is saved).
    """

    report: dict[str, Any]
    folder: Path
    cancelled: bool


class NoteKeeper:
    """Passes progress on and keeps the notes for the report."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.notes: list[str] = []
        #: Seconds that the user let the work wait.
        self.waited = 0.0

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; `total` steps if they can be counted."""
        self._progress.stage(name, total)

    def advance(self, done: int, **figures: float) -> None:
        """So many steps of the stage are done; figures worth showing."""
        self._progress.advance(done, **figures)

    def note(self, text: str) -> None:
        """Something the user should read, in one line."""
        self.notes.append(text)
        self._progress.note(text)

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        asked = time.perf_counter()
        answer = self._progress.cancelled()
        self.waited += time.perf_counter() - asked
        return answer


class Stopwatch:
    """Seconds of each named stage and in all, since `began` on the clock of `time.perf_counter`."""

    def __init__(self, began: float | None = None) -> None:
        self.began = self._lap = time.perf_counter() if began is None else began
        self.seconds: dict[str, float] = {}
        if began is not None:
            self.lap("start")

    def lap(self, name: str) -> None:
        """The time since the last lap belongs to `name`."""
        now = time.perf_counter()
        self.seconds[name] = round(now - self._lap, 3)
        self._lap = now

    def total(self) -> float:
        """Seconds since the start."""
        return round(time.perf_counter() - self.began, 3)


def reconstruct(settings: ReconstructSettings, progress: Progress, began: float | None = None) -> Outcome:
    """Photos in; twin.ply, cameras/, renders/, report.json and report.html out.

    Cameras and twin are written as soon as they are there: whatever happens later, they are kept.
    A cancelled training still saves the twin so far and reports it. With a time limit all is planned to be
    there when it is over.

    Args:
        began: when the time begins to count, on the clock of `time.perf_counter`; now if None.

    Raises:
        DgsError: one of its subclasses; what was written before stays.
    """
    from ..effort.estimate import kernels_compiled
    from ..effort.history import History
    from ..effort.plan import Budget

    watch, keeper = Stopwatch(began), NoteKeeper(progress)
    # What can be wrong with the request is found out before any work.
    told = told_spreads(settings.psf)
    truth = TruthFolder(settings.truth) if settings.truth is not None else None
    check_writable(settings.out)
    if settings.until is not None and settings.holdout_every == 0:
        raise DgsError("Quality is judged on photos held out, and none are", "Use --holdout-every 8")
    threads, device = use_threads(settings.threads), choose_device(settings.device)
    known = History(settings, machine(threads, device), kernels_compiled())
    budget = None
    if settings.time_limit is not None:
        budget = Budget(settings.time_limit, watch.began, known.records.runs, lambda: keeper.waited, known.others.share)
    settings = replace(settings, photos=photo_source(settings.photos, settings.out, settings.frames, keeper))
    photos = load_photos(settings.photos, settings.max_size, keeper, settings.masks)
    spreads, settings = spreads_of(told, photos, settings)
    medium = medium_for(photos, spreads.psf, settings, spreads.own)
    for note in spreads.notes:
        keeper.note(f"The point spread function: {note}")
    watch.lap("photos")

    hurried = budget is not None and settings.cameras is None and budget.hurry(photos)
    reconstruction, source = cameras_of(settings, photos, medium, threads, keeper, hurried)
    registered = [photo for photo in photos if photo.name in reconstruction.poses]
    watch.lap("sfm")

    held = heldout_names([photo.name for photo in photos], settings.holdout_every)
    refinement = None
    # What a checkpoint goes on from was trained with refined cameras already.
    if settings.refine_cameras and not (settings.resume and (settings.out / "checkpoint.npz").is_file()):
        reconstruction, refinement = refined(
            settings, reconstruction, registered, held, medium, threads, device, keeper
        )
        watch.lap("refine")
    trained, effects, medium, fitted = _train(
        settings, registered, held, reconstruction, medium, threads, device, keeper, watch, budget
    )
    write_ply(settings.out / "twin.ply", trained.gaussians.cloud())

    keeper.stage("save", len(held) + 2)
    facts = Facts(
        settings=settings,
        photos=photos,
        reconstruction=reconstruction,
        source=source,
        medium=medium,
        spreads=spreads,
        held=held,
        trained=trained,
        machine=machine(threads, device),
        notes=keeper.notes,
        effects=effects,
    )
    scores, pictures = _score(facts, truth, keeper, budget)
    if budget is not None and budget.overrun():
        keeper.note(
            f"The time limit was passed by {-budget.left():.0f} s: the cameras alone took {watch.seconds['sfm']:.0f} s"
        )
    watch.lap("save")
    report = summary(facts, scores, watch.seconds, watch.total())
    report["cameras"]["refined"] = plain(refinement)
    report["seconds"]["refine"] = watch.seconds.get("refine")
    report["predicted"] = known.predicted(photos, budget)
    write_json(settings.out / "report.json", report)
    write_page(settings.out / "report.html", report, pictures, medium.psf, reconstruction.cameras())
    known.keep(report, photos, fitted, budget, watch.total() - report["seconds"]["total"])
    keeper.advance(len(held) + 2)
    return Outcome(report, settings.out, trained.stopped == "cancelled")


def medium_for(
    photos: list[Photo],
    psf: PointSpread | None,
    settings: ReconstructSettings,
    own: Mapping[str, PointSpread | None] = MappingProxyType({}),
) -> Medium:
    """The medium on the grid of the photos as loaded (`--max-size` shrinks the blur too); `own` is by photo name."""
    return Medium(psf, settings.blur_space, own).at_scales({photo.name: photo.scale[0] for photo in photos})


def cameras_of(
    settings: ReconstructSettings,
    photos: list[Photo],
    medium: Medium,
    threads: int,
    progress: Progress,
    hurried: bool = False,
) -> tuple[Reconstruction, str]:
    """Known cameras, those of the run that is resumed, or cameras found from the photos.

    Written to `settings.out`/cameras; 'given' or 'sfm' tells where they come from.

    Raises:
        CameraError: no trustworthy cameras, or fewer than two.
        OutputError: they cannot be written.
    """
    from ..formats.colmap import write_lenses
    from ..sfm.settings import SfmSettings
    from ..training.settings import TrainingSettings
    from ..training.warmup import compile_kernels

    folder = settings.out / "cameras"
    resumed, work = settings.resume and folder.is_dir(), settings.out / "sfm"
    if not resumed:  # (of an earlier twin in this folder)
        (work / FEATURES).unlink(missing_ok=True)
    if settings.cameras is not None:
        reconstruction, offset = near_origin(load_cameras(settings.cameras, photos))
        source = "given"
        if offset is not None:
            progress.note(
                "The cameras lie too far from their origin for files of float32: cameras and twin were moved; "
                f"add ({', '.join(f'{value:g}' for value in offset)}) to return to the world that was given"
            )
        if reconstruction.figures.scattered:
            progress.note("The cameras came without points: random ones stand where the cameras look")
    elif resumed:
        reconstruction, source = load_cameras(folder, photos), "sfm"
        progress.note("The cameras are those of the run that is resumed")
    else:
        kernel = None if medium.psf is None or medium.psf.is_identity else medium.psf.kernel()
        wanted = SfmSettings(threads=threads)
        wanted = wanted.hurried() if hurried or settings.preset == "draft" else wanted
        # The child works on one core half of the time: meanwhile this process gets its kernels ready.
        asked = TrainingSettings.preset(settings.preset).sh_degree if settings.sh_degree is None else settings.sh_degree
        (early := threading.Thread(target=compile_kernels, args=(asked,))).start()
        reconstruction = find_cameras(photos, kernel, wanted, make_folder(work), progress, work / FEATURES)
        early.join()
        source = "sfm"
    if len(reconstruction.poses) < 2:
        raise CameraError(
            f"Only {len(reconstruction.poses)} of {len(photos)} photos have a camera",
            "Check that the names in the camera model are those of the photos",
        )
    write_lenses(folder, reconstruction.lenses, reconstruction.poses, reconstruction.points)
    return reconstruction, source


def _train(
    settings: ReconstructSettings,
    registered: list[Photo],
    held: list[str],
    reconstruction: Reconstruction,
    medium: Medium,
    threads: int,
    device: str,
    progress: Progress,
    watch: Stopwatch,
    budget: Budget | None,
) -> tuple[Trained, Chosen, Medium, int]:
    from ..photos.undistort import undistorted_views
    from ..training.run import train
    from ..training.settings import TrainingSettings
    from .effects.choose import choose_effects

    views = undistorted_views(registered, reconstruction)
    seen = {fingerprint(view.photo) for view in views if view.name in held}
    kept = [view for view in views if view.name not in held and fingerprint(view.photo) not in seen]
    copies = len(views) - len(kept) - sum(view.name in held for view in views)
    if copies:
        progress.note(f"{copies} photos are copies of held-out ones and were not trained on")
    if not kept:
        what = "Every photo with a camera is held out, so none is left to train on"
        raise CameraError(what, "Use --holdout-every 0 or more photos")
    changes: dict[str, Any] = {"max_gaussians": settings.max_gaussians, "sh_degree": settings.sh_degree}
    chosen = replace(
        TrainingSettings.preset(settings.preset),
        loss=settings.loss,
        seed=settings.seed,
        threads=threads,
        device=device,
        until=settings.until,
        min_steps=settings.min_steps,
        **{name: value for name, value in changes.items() if value is not None},
    )
    if settings.until is not None and budget is None:
        chosen = replace(chosen, steps=max(UNTIL_STEPS * chosen.steps, settings.min_steps))
    effects = choose_effects(settings.effects, registered, reconstruction, kept, medium, chosen, progress)
    medium = effects.formation.through(medium, [view.name for view in views])
    if settings.effects != "none":
        watch.lap("effects")
    fitted, watched = (effects.corrected(part) for part in (kept, [view for view in views if view.name in held]))
    if budget is not None:
        chosen = budget.train(
            registered,
            fitted,
            len(watched),
            reconstruction.points,
            medium,
            chosen,
            settings.max_gaussians,
            effects.formation,
            settings.out / "plan.json",
            settings.resume,
        )
        if budget.plan is not None and budget.plan.enough:
            progress.note("The time limit is more than what makes these photos' twin better: the run ends before it")
    trained = train(
        fitted,
        watched,
        reconstruction.points,
        medium,
        chosen,
        progress,
        settings.out / "checkpoint.npz",
        settings.resume,
        Watchers(settings.out, settings.snapshots),
        effects.formation,
    )
    if progress.cancelled() and trained.stopped == "done" and trained.steps < chosen.steps:
        trained.stopped = "cancelled"
    watch.lap("prepare")
    measured = {name: round(float(trained.seconds[name]), 3) for name in ("compile", "train")}
    watch.seconds["prepare"] = round(max(0.0, watch.seconds["prepare"] - sum(measured.values())), 3)
    watch.seconds.update(measured)
    return trained, effects, medium, len(fitted)


def _score(
    facts: Facts, truth: TruthFolder | None, progress: Progress, budget: Budget | None = None
) -> tuple[list[Scores], list[ViewPictures]]:
    """Renders and scores held-out views, all there is time for; a few fitted ones are shown where none is held out."""
    from ..training.scale import scene_scale

    cameras = facts.reconstruction.cameras()
    viewer = Viewer(
        facts.trained.gaussians,
        scene_scale(list(cameras.values()), facts.reconstruction.points),
        facts.machine["device"],
        facts.trained.low_pass,
        facts.trained.background,
    )
    scorer = ViewScorer(
        viewer,
        facts.reconstruction,
        facts.medium,
        truth,
        resolvable_period(facts.medium),
        progress,
        Formation() if facts.effects is None else facts.effects.formation,
    )
    by_name = {photo.name: photo for photo in facts.photos if photo.name in cameras}
    wanted = [name for name in facts.held if name in by_name]
    files, scores, pictures = render_names(wanted), [], []
    shown = set(spread(len(wanted), SHOWN))

    def one(name: str) -> tuple[Scores, ViewPictures] | None:
        if budget is not None and not budget.another():
            return None
        return scorer.score(by_name[name], True, facts.settings.out / "renders" / files[name])

    # Interpolation, transforms and files wait for one core at a time: whole views side by side do not.
    with ThreadPoolExecutor(facts.machine["threads"]) as pool:
        for index, found in enumerate(pool.map(one, wanted)):
            if found is None:
                continue
            scores.append(found[0])
            if index in shown:
                pictures.append(found[1])
            progress.advance(index + 1)
    if len(scores) < len(wanted):
        progress.note(f"{len(scores)} of {len(wanted)} held-out views were scored: there was no time for more")
    if not wanted:
        names = sorted(by_name)
        pictures = [scorer.score(by_name[names[i]], False, None)[1] for i in spread(len(names), 3)]
    return scores, pictures
