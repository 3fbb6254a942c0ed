"""Plans a run for the time it is given, and keeps it within.

Everything counts, from the start of the process to the last file. What is left after the cameras goes to the
training but for what scoring and saving will take; the number of Gaussians grows with the root of the steps,
as the presets' does (300 steps: 22,000; 1000: 40,000; 4000: 80,000) up to what helps.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..numbers import BY_DEFINITION, number
from ..photos.load import Photo
from ..training.grid import GRID, grid_step
from ..training.job import PlannedTraining, TrainingJob
from ..training.settings import PRESETS
from ..views import View
from .described import RunDescription
from .model import PREDICTIONS, slowdown, stage_seconds
from .probe import PROBE, Speed, probe
from .records import PastRun, Work, photo_work

_HELPED = (
    "33 real photos: 4000 steps reached 28.67 dB, 2000 28.71 (3 seeds); the ball with 66: 4000 were 0.09 dB below 1000"
)


@dataclass(frozen=True)
class PlanSettings:
    """How a time limit is divided."""

    gaussians: int = number(
        40_000, "Gaussians", "at 1000 steps, as the balanced preset; they grow with the root of the steps"
    )
    fewest_gaussians: int = number(5_000, "Gaussians", "that a twin has at least, however short the time")
    most_gaussians: int = number(150_000, "Gaussians", "beyond which more have not been tried by plans")
    useful_steps: int = number(
        3000, "steps", "beyond these a run ends as soon as held-out photos gain no more: on some sets they do", _HELPED
    )
    useful_visits: int = number(60, "steps per photo", "the same of large sets", _HELPED)
    longest_steps: int = number(
        30_000, "steps", "are planned at most, however long the time", "3D Gaussian splatting (Kerbl et al. 2023)"
    )
    longest_visits: int = number(
        300,
        "steps per photo",
        "the same of sets with fewer photos than 100: what they show is learned, and the rest learned by heart",
        "3D Gaussian splatting (Kerbl et al. 2023): 30,000 steps for the 100 photos of a synthetic scene",
        "42 rendered photos of an orrery, 16 minutes: 29.57 dB after 42,997 steps",
    )
    probing: float = number(0.01, "share", "of what is left, for each of the four to six parts of a probe")
    coarse_steps: int = number(150, "steps", "with fewer, a grid of half the resolution buys more than it loses")
    camera_share: float = number(0.35, "share", "of the time: cameras that would take more are found in a hurry")
    trial_share: float = number(
        0.35,
        "share",
        "of what is left after the cameras that trials of effects may take: what they find is worth decibels, and so is"
        " the training's time",
        "a first choice; no other value was tried",
        "a weakly shaken shelf: limits of 60 and 300 s were kept, 300 s sufficed to find the shake",
    )
    scored: int = number(2, "views", "that are scored however short the time is")
    score_share: float = number(0.12, "share", "of the time that scoring more views than that may take")
    spare_share: float = number(0.01, "share", "of the time, kept back for what cannot be foreseen")
    most_spare: float = number(2.0, "s", "kept back at most")
    allowed_share: float = number(0.05, "share", "of a limit by which it may be passed without a word", BY_DEFINITION)
    allowed_seconds: float = number(3.0, "s", "by which any limit may be passed without a word", BY_DEFINITION)
    least_training: float = number(0.1, "share", "of the time that the training gets, however long the cameras took")


PLANNING = PlanSettings()
#: Of the search for the steps that fill a time: bounds, and halvings of the interval between them (to 0.1 steps).
_MOST_STEPS, _HALVINGS = 200_000.0, 40


@dataclass(frozen=True)
class Plan:
    """What fits into the time.

    Attributes:
        limit: seconds in all.
        hurried: cameras with half the observations.
        steps, gaussians, grid_step: of the training, as expected.
        train_seconds: of its iterations and held-out evaluations.
        save_seconds: kept for scoring, saving and the report.
        scored: held-out views that are scored.
        step_seconds: expected for one step.
        enough: the time is more than the longest training takes; the run ends before.
    """

    limit: float
    hurried: bool
    steps: int
    gaussians: int
    grid_step: int | None
    train_seconds: float
    save_seconds: float
    scored: int
    step_seconds: float
    enough: bool = False

    def plain(self) -> dict[str, float | int | bool | None]:
        """For report.json."""
        return {name: round(v, 4) if isinstance(v, float) else v for name, v in asdict(self).items()}


def gaussians_for(steps: float, ample: int = 0) -> int:
    """How many Gaussians so many steps can place, of as many as sharp photos show amply (`TrainingJob.ample`)."""
    wanted = PLANNING.gaussians * math.sqrt(max(steps, 0.0) / 1000.0)
    wanted = max(wanted, min(ample, PRESETS.sharp_gaussians / math.sqrt(PRESETS.sharp_steps) * wanted))
    return int(min(max(wanted, PLANNING.fewest_gaussians), PLANNING.most_gaussians))


def useful_steps(photos: int) -> int:
    """More steps than these make a twin better on some sets only: there held-out photos decide."""
    return max(PLANNING.useful_steps, PLANNING.useful_visits * photos)


def longest_steps(photos: int) -> int:
    """More steps than these are not planned."""
    return max(min(PLANNING.longest_steps, PLANNING.longest_visits * photos), useful_steps(photos))


def steps_within(speed: Speed, seconds: float, fixed: int | None = None, ample: int = 0) -> tuple[int, int]:
    """(steps, Gaussians) that fill the time; `fixed` Gaussians where the user wants so many, `ample` as above."""
    low, high = 1.0, _MOST_STEPS
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        count = fixed or gaussians_for(middle, ample)
        low, high = (middle, high) if speed.training(int(middle), count) <= seconds else (low, middle)
    steps = max(1, int(low))
    return steps, fixed or gaussians_for(steps, ample)


class Budget:
    """One run's time.

    Args:
        limit: seconds from the start of the process to the last file.
        spent: seconds so far; those that the user let the work wait do not count.
        runs: of this machine, for what scoring and saving take.
        busy: share of the machine that others use.
        run: what is to be done; None for a run that finds its cameras.
    """

    def __init__(
        self,
        limit: float,
        spent: Callable[[], float],
        runs: Sequence[PastRun],
        busy: Callable[[], float | None] = lambda: None,
        run: RunDescription | None = None,
    ) -> None:
        self.limit, self.spent, self._runs, self._busy = limit, spent, runs, busy
        self._search, self._points = (True, True) if run is None else (run.search, run.points)
        self._page = 0.0
        self.plan: Plan | None = None
        self.hurried = False
        self.speed: Speed | None = None
        self._scoring: float | None = None
        self._begun = 0
        self._lock = threading.Lock()

    def left(self) -> float:
        """Seconds until the end; negative when it has passed."""
        return self.limit - self.spent()

    def overrun(self) -> float:
        """Seconds that were taken beyond the limit, where that is more than is allowed; else 0."""
        over = -self.left()
        return over if over > max(PLANNING.allowed_seconds, PLANNING.allowed_share * self.limit) else 0.0

    def hurry(self, photos: Sequence[Photo]) -> bool:
        """Whether the cameras, or points for cameras that come without any, must be found in a hurry."""
        stages = self._stages(self._work(photos, len(photos), 0))
        self.hurried = stages["sfm"] + stages["surface"] > PLANNING.camera_share * self.limit
        return self.hurried

    def for_trials(self) -> Callable[[], float]:
        """Seconds that are left to trials of effects: a share of what is left now, less what passes from now on."""
        end = self.spent() + PLANNING.trial_share * max(0.0, self.left())
        return lambda: end - self.spent()

    def train(
        self,
        job: TrainingJob,
        photos: Sequence[Photo],
        fixed: int | None = None,
        earlier: Mapping[str, Any] | None = None,
    ) -> PlannedTraining:
        """The training that fills what is left; probes the machine for a second or two.

        Args:
            photos: those with a camera; fixed: Gaussians, where the user wants so many.
            earlier: plan of the run that is resumed, whose grid and Gaussians its checkpoint needs; empty where it is
                gone; None for a new run.
        """
        if earlier is not None:
            job, fixed = _as_before(earlier, job, fixed)
        settings, held = job.settings, len(job.heldout)
        width, height = job.views[0].camera.width, job.views[0].camera.height
        usual = settings.grid_step or grid_step(job.medium, width, height)
        scored, saving = self._saving(photos, len(job.views), held)
        speed, steps, count = self._probed(job, saving, fixed)
        halved = min(width, height) // (2 * usual) >= GRID.smallest_side
        if steps < PLANNING.coarse_steps and settings.grid_step is None and earlier is None and halved:
            settings = replace(settings, grid_step=2 * usual)
            speed, steps, count = self._probed(replace(job, settings=settings), saving, fixed)
        self.speed = speed
        mine = self._training_time(saving)
        by_evidence = settings.until is None and steps > max(useful_steps(len(job.views)), settings.min_steps)
        longest = max(longest_steps(len(job.views)), settings.min_steps)
        enough = settings.until is None and steps > longest  # who asks for a quality may go on for it
        if enough:
            steps, count = longest, fixed or gaussians_for(longest, job.ample)
            mine = min(mine, speed.training(steps, count))
        if by_evidence and settings.min_steps == 0:
            settings = replace(settings, until="plateau")
        self.plan = Plan(
            limit=self.limit,
            hurried=self.hurried,
            steps=steps,
            gaussians=count,
            grid_step=settings.grid_step,
            train_seconds=mine,
            save_seconds=saving,
            scored=scored,
            step_seconds=speed.training(steps, count) / steps,
            enough=enough,
        )
        planned = replace(settings, steps=steps, max_gaussians=count, time_limit=mine)
        return PlannedTraining(planned, self.plan.plain(), enough)

    def another(self) -> bool:
        """Whether there is time to score one more view; called by several threads, each time before one."""
        with self._lock:
            now = self.spent()
            if self._scoring is None:
                self._scoring = now
            self._begun += 1
            if self._begun <= PLANNING.scored:
                return True
            # Those that are under way count as done: what is left over pays for the report's page.
            each = (now - self._scoring) / max(1, self._begun - PLANNING.scored)
            return now + each + self._page <= self.limit

    def _probed(self, job: TrainingJob, saving: float, fixed: int | None) -> tuple[Speed, int, int]:
        """What an iteration costs, and the steps and Gaussians that fill the training's time."""
        phase = min(PROBE.phase_seconds, max(0.0, PLANNING.probing * self.left()))
        speed = probe(replace(job, views=_neighbours(job.views)), len(job.views), len(job.heldout), phase_seconds=phase)
        return speed, *steps_within(speed, self._training_time(saving), fixed, job.ample)

    def _training_time(self, saving: float) -> float:
        spare = min(PLANNING.most_spare, PLANNING.spare_share * self.limit)
        return max(self.left() - saving - spare, PLANNING.least_training * self.limit)

    def _saving(self, photos: Sequence[Photo], fitted: int, held: int) -> tuple[int, float]:
        """Views to score, and seconds that this and the rest will take."""

        def seconds(scored: int) -> float:
            stages = self._stages(self._work(photos, fitted, scored))
            self._page = stages["page"]
            return stages["save"] + stages["page"]

        base, scored = seconds(0), held
        while scored > PLANNING.scored and seconds(scored) - base > PLANNING.score_share * self.limit:
            scored -= 1
        return scored, seconds(scored)

    def _work(self, photos: Sequence[Photo], fitted: int, scored: int) -> Work:
        """Before anything is planned: 1000 steps."""
        work = photo_work(photos, search=self._search, hurried=False, compiled=True, points=self._points)
        return work.training(fitted, scored, 1000, PLANNING.gaussians)

    def _stages(self, work: Work) -> dict[str, float]:
        return stage_seconds(self._runs, work, 0.0, slowdown(self._busy()))[0]


def _neighbours(views: Sequence[View]) -> list[View]:
    """A few neighbours among the views: they see the same."""
    count = PREDICTIONS.sampled
    middle = max(0, len(views) // 2 - count // 2)
    return list(views[middle : middle + count])


def _as_before(earlier: Mapping[str, Any], job: TrainingJob, fixed: int | None) -> tuple[TrainingJob, int | None]:
    try:
        count, grid = int(earlier["gaussians"]), earlier["grid_step"]
    except (ValueError, KeyError, TypeError):  # none: the checkpoint itself says what does not fit
        return job, fixed
    return replace(job, settings=replace(job.settings, grid_step=grid)), count
