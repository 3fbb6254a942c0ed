"""One run from photos to a reported twin: the row of all stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import DgsError
from ..files import check_writable
from ..imaging.medium import Medium
from ..inspection.photo_set import PhotoSet
from ..lock import working_on
from ..machine import Machine
from ..outputs import claim_output_folder
from ..photos.load import Photo
from ..photos.movie import is_movie
from ..photos.truth import TruthFolder
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.summary import RunFacts, TimeFacts
from ..run_settings import RunSettings
from ..training.job import TrainingJob
from ..training.ranks import ALONE, Ranks
from ..training.run import Trained
from ..training.scale import scene_scale
from ..training.settings import TrainingSettings
from ..twin.begun import BegunRun, Start
from ..twin.folder import TwinFolder
from ..views import SparsePoints
from ..warming import begin_warming
from .adjusted import adjusted, adjustment_said, adjusts, keep_adjusted
from .blind import Spreads, given_spreads
from .cameras import FoundCameras, cameras_of, given_cameras, search_for
from .effects.ablation import TrialTerms
from .effects.decision import parse_effects
from .effects.kept import KeptTrials
from .effects.unseen import formation_of_all
from .fitted import SplitViews, split_views
from .glass import glass_shown, with_glass
from .medium import FoundMedium, medium_of
from .photos import LoadedPhotos, read_photos
from .refinement import RefinementJob, refine
from .report import camera_facts, medium_facts, photo_facts, write_report
from .scores import ViewScorer, resolvable_period, score_views
from .shutter import check_shutter, curve_found, shutter_found, with_shutter
from .simulated import SimulatedEffects, simulate
from .surface import with_samples
from .timing import MakeTiming, NoteKeeper, Stopwatch, Timing, Untimed
from .training import Shown, fit_into_time, train_twin, training_settings, usual_settings
from .views import Viewer


@dataclass(frozen=True)
class FinishedRun:
    """What a run left behind.

    Attributes:
        report: the content of report.json.
        folder: where everything lies.
        cancelled: whether the user stopped it (what was finished is saved).
    """

    report: dict[str, Any]
    folder: Path
    cancelled: bool


def reconstruct(
    run: RunSettings,
    progress: Progress,
    began: float | None = None,
    timing_on: MakeTiming = Untimed,
    ranks: Ranks = ALONE,
) -> FinishedRun:
    """Photos in; twin.ply, cameras/, renders/, report.json and report.html out.

    Cameras and twin are written to OUT/.run as soon as they are there: whatever happens later, they are kept. All
    results take the place of what stood in the folder at once, at the end (`core.twin.begun`); a twin that stood there
    goes to history/. A cancelled training still saves the twin so far and reports it. With a time limit all is
    planned to be there when it is over.

    Args:
        run: from `ReconstructSettings.split`.
        began: when the time begins to count, on the clock of `time.perf_counter`; now if None.
        timing_on: the run's time limit and the machine's memory of past runs.
        ranks: processes that train together, each with a folder of its own; `resume` is rank 0's.

    Raises:
        OtherRankFinishes: the training is over, and this is not rank 0.
        DgsError: one of its subclasses; the folder is as it was, and OUT/.run has what a resumption can use.
    """
    watch, keeper = Stopwatch(began), NoteKeeper(progress)
    # What can be wrong with the request is found out before any work.
    given = given_spreads(run.medium.psf)
    parse_effects(run.effects)
    check_shutter(run.shutter, run.medium.motion_apart)
    if run.training.until is not None and run.photos.holdout_every == 0:
        raise DgsError("Quality is judged on photos held out, and none are", "Use --holdout-every 8")
    truth = TruthFolder(run.truth) if run.truth is not None else None
    check_writable(run.out)
    claim_output_folder(run.out)
    with working_on(run.out, "reconstruct", keeper.note):
        start: Start = "resume" if run.resume else "cameras" if run.keep_cameras else "anew"
        begun = BegunRun(TwinFolder(run.out), start, is_movie(run.photos.photos))
        with begun.until_finished(_inputs(run)):
            machine = Machine.ready(run.threads, run.device)
            begin_warming(machine.device, machine.free and ranks.alone)
            timing = timing_on(machine, lambda: time.perf_counter() - watch.began - keeper.waited)
            return _stages(run, given, truth, _Course(begun, machine, timing, watch, keeper, ranks))


@dataclass(frozen=True)
class _Course:
    """What all stages of one run share: its folder, the machine, its time, and whom it reports to."""

    begun: BegunRun
    machine: Machine
    timing: Timing
    watch: Stopwatch
    keeper: NoteKeeper
    ranks: Ranks


def _inputs(run: RunSettings) -> list[Path]:
    """Files and folders that the run reads."""
    paths = (run.photos.photos, run.photos.masks, run.cameras.given, run.cameras.reference, run.truth)
    return [path for path in paths if path is not None]


@dataclass(frozen=True)
class _Scene:
    """What the first stages found: photos, their blur and cameras, and what the training begins with."""

    loaded: LoadedPhotos
    blur: FoundMedium
    cameras: FoundCameras
    photos: list[Photo]
    points: SparsePoints
    views: SplitViews

    @property
    def found(self) -> bool:
        """Whether the cameras are this run's own."""
        return self.cameras.source == "sfm"


def _stages(run: RunSettings, given: Spreads | None, truth: TruthFolder | None, course: _Course) -> FinishedRun:
    """The row itself."""
    folder, keeper = course.begun.folder, course.keeper
    loaded = read_photos(run.photos, folder, keeper)
    blur = medium_of(run.medium, given, loaded.photos, keeper)
    course.watch.lap("photos")
    cameras = _cameras(run, loaded, blur.medium, course)
    photos = loaded.placed(cameras.reconstruction.poses)
    points = _first_points(run, loaded, cameras, blur.medium, course)
    views = split_views(photos, cameras.reconstruction, loaded.held, keeper)
    scene = _Scene(loaded, blur, cameras, photos, points, views)
    effects, settings = _effects(run, scene, given is None, course)
    trained = _training(run, scene, effects, settings, course)
    return _saved(run, scene, effects, trained, truth, course)


def _effects(
    run: RunSettings, scene: _Scene, blind: bool, course: _Course
) -> tuple[SimulatedEffects, TrainingSettings]:
    """What is simulated besides the blur, and the training's settings for it; `blind`: no blur was given."""
    timing, keeper, known = course.timing, course.keeper, scene.cameras.reconstruction
    medium = scene.blur.medium
    sigma = medium.mean_sigma([photo.name for photo in scene.photos])
    settings = training_settings(run.training, course.machine, timing.limited, Shown(sigma))
    terms = TrialTerms(settings, timing.for_trials(), KeptTrials(course.begun.folder, run.resume))
    effects = simulate(run.effects, scene.photos, known, scene.views, medium, terms, keeper)
    if (glass := run.glass or glass_shown(effects, blind)) is not None:
        effects = with_glass(effects, glass, scene.points, keeper, PhotoSet(scene.photos, known))
        sigma = effects.sigma
    effects = with_shutter(effects, run.shutter, keeper)
    if run.effects != "none":
        course.watch.lap("effects")
    shown = Shown(sigma, effects.chosen.formation, effects.fitted)
    return effects, training_settings(run.training, course.machine, timing.limited, shown)


def _training(
    run: RunSettings, scene: _Scene, effects: SimulatedEffects, settings: TrainingSettings, course: _Course
) -> Trained:
    """The training itself, as long as its time allows; what it found of the cameras is said."""
    watch, keeper, folder, known = course.watch, course.keeper, course.begun.folder, scene.cameras.reconstruction
    sigma = effects.typical.mean_sigma([view.name for view in effects.fitted])
    shown = Shown(sigma, effects.chosen.formation, effects.fitted)
    asked = TrainingJob(
        effects.fitted,
        effects.heldout,
        scene.points,
        effects.medium,
        settings,
        effects.chosen.formation,
        adjust=adjusts(run.cameras.adjust, scene.found or known.figures.from_photos),
        restore=True,
        ample=shown.amply(settings.sh_degree),
    )
    planned = fit_into_time(asked, scene.photos, run.training.max_gaussians, run.resume, course.timing, folder)
    if planned.enough:
        keeper.note("The time limit is more than the longest training of these photos takes: the run ends before it")
    job, resumes = replace(asked, settings=planned.settings), _resumes(run, course.ranks)
    trained = train_twin(job, course.machine, resumes, run.snapshots, folder, keeper, course.ranks)
    moved = None if scene.found else adjustment_said(known, trained, run.cameras.adjust)
    for said in filter(None, (shutter_found(trained.formation), curve_found(trained.formation), moved)):
        keeper.note(said)
    watch.lap("prepare")
    watch.part("prepare", {name: round(float(trained.seconds[name]), 3) for name in ("compile", "train")})
    return trained


def _saved(
    run: RunSettings,
    scene: _Scene,
    effects: SimulatedEffects,
    trained: Trained,
    truth: TruthFolder | None,
    course: _Course,
) -> FinishedRun:
    """Held-out views scored, and the report of it all."""
    begun, machine, timing, watch, keeper = course.begun, course.machine, course.timing, course.watch, course.keeper
    loaded, known, folder = scene.loaded, scene.cameras.reconstruction, begun.folder
    keeper.stage("save", len(loaded.held) + 2)
    period = resolvable_period(effects.typical)
    seen = formation_of_all(trained.formation, scene.views.names)
    viewer, stood = _viewer(trained, known, machine.device), scene.found or adjusted(trained)
    scorer = ViewScorer(viewer, known, effects.medium, truth, period, keeper, seen, stood)
    scored = score_views(scorer, scene.photos, loaded.held, machine.threads, timing, folder)
    if over := timing.overrun():
        took = f"the cameras took {watch.seconds['sfm']:.0f} s, effects {watch.seconds.get('effects', 0.0):.0f} s"
        keeper.note(f"The time limit was passed by {over:.0f} s: {took}")
    watch.lap("save")
    facts = RunFacts(
        asked={**run.asked, "photos": str(begun.final(loaded.source)), "psf": scene.blur.spreads.source},
        photos=photo_facts(loaded.finally_in(begun)),
        cameras=camera_facts(scene.cameras),
        medium=medium_facts(scene.blur, effects),
        effects=effects.chosen.with_learned(keep_adjusted(known, trained, folder)).plain(),
        trained=trained,
        scores=scored.scores,
        fitted=scored.fitted,
        time=TimeFacts(watch.seconds, watch.total(), timing.predicted(loaded.photos)),
        machine=replace(machine, device=trained.settings.device).facts,
        notes=keeper.notes,
    )
    report = write_report(facts, scored.pictures, folder)
    timing.keep(report, loaded.photos, len(effects.fitted), watch.total() - report["seconds"]["total"])
    keeper.advance(len(loaded.held) + 2)
    return FinishedRun(report, run.out, trained.stopped == "cancelled")


def _resumes(run: RunSettings, ranks: Ranks) -> bool:
    """Whether the training goes on from a checkpoint: what rank 0 was asked."""
    return ranks.bytes_of_first(b"1" if run.resume else None) is not None


def _cameras(run: RunSettings, loaded: LoadedPhotos, medium: Medium, course: _Course) -> FoundCameras:
    """Given, those of the run that is resumed, or found; moved by the loss where that is asked for."""
    machine, watch, keeper, folder = course.machine, course.watch, course.keeper, course.begun.folder
    file = run.cameras.given
    given = None if file is None else FoundCameras(given_cameras(file, loaded.photos, keeper), "given", file)
    course.begun.check_photos(loaded.contents, None if given is None else given.reconstruction.digest())
    with_points = given is not None and not given.reconstruction.figures.scattered
    hurried = not with_points and course.timing.hurry(loaded.photos)
    # What a checkpoint goes on from was trained with refined cameras already.
    refined = run.cameras.refine and run.resume and folder.checkpoint.is_file()
    search = search_for(run.training, machine.threads, hurried, run.resume or run.keep_cameras)
    search = replace(search, refined=refined, hurried=hurried, held=frozenset(loaded.held))
    cameras = cameras_of(given, loaded.photos, medium, search, folder, keeper)
    watch.lap("sfm")
    if cameras.surface_seconds:
        watch.part("sfm", {"surface": round(cameras.surface_seconds, 3)})
    if run.cameras.refine and not refined:
        photos = loaded.placed(cameras.reconstruction.poses)
        usual = usual_settings(run.training, machine)
        cameras = refine(cameras, RefinementJob(photos, loaded.held, medium, usual, run.cameras.reference), keeper)
        folder.save_cameras(cameras.reconstruction)
        watch.lap("refine")
    return cameras


def _first_points(
    run: RunSettings, loaded: LoadedPhotos, cameras: FoundCameras, medium: Medium, course: _Course
) -> SparsePoints:
    """The cameras' points, with samples of surfaces between them for a training that begins."""
    found = cameras.reconstruction
    goes_on = run.resume and course.begun.folder.checkpoint.is_file()
    if goes_on or found.points.confidence is not None:
        return found.points
    seen = [photo for photo in loaded.placed(found.poses) if photo.name not in loaded.held]
    points = with_samples(found, seen, medium, course.keeper)
    course.watch.lap("surface")
    return points


def _viewer(trained: Trained, cameras: Reconstruction, device: str) -> Viewer:
    """Of the twin, in the units that the cameras give the scene."""
    scale = scene_scale(list(cameras.cameras().values()), cameras.points)
    return Viewer(trained.gaussians, scale, device, trained.low_pass, trained.background)
