"""Plans a run for the time it is given, and keeps it within.

Everything counts, from the start of the process to the last file. What is left after the cameras goes to the
training but for what scoring and saving will take; the number of Gaussians grows with the root of the steps,
as the presets' does (300 steps: 22,000; 1000: 40,000; 4000: 80,000) up to what helps.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ..files import write_json
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..photos.load import Photo
from ..training.grid import SMALLEST_SIDE, grid_step
from ..training.settings import TrainingSettings
from ..views import SparsePoints, View
from .model import VIEWS, slowdown, stage_seconds
from .probe import PHASE_SECONDS, Speed, probe
from .records import Run, Work

#: Gaussians at 1000 steps; they grow with the root of the steps between these limits.
GAUSSIANS, FEWEST, MOST = 40_000, 5_000, 150_000
#: More than this (and than so many steps for each photo) has brought nothing: with 33 real photos 4000 steps
#: reached 28.67 dB and 2000 28.71 (3 seeds), on the ball with 66 4000 were 0.09 dB below 1000 (one run).
USEFUL_STEPS, USEFUL_VISITS = 3000, 60
#: Of what is left, each of the (four to six) parts of a probe may take this share.
PROBING = 0.01
#: With fewer steps than this, a grid of half the resolution buys more than it loses.
FEW_STEPS = 150
#: Cameras that would take more than this share of the time are found in a hurry.
CAMERA_SHARE = 0.35
#: Views that are scored in a short time: at least so many, and for at most this share of the time.
FEWEST_SCORED, SCORE_SHARE = 2, 0.12
#: Kept back for what cannot be foreseen, as a share of the time and in seconds at most.
SPARE, MOST_SPARE = 0.01, 2.0
#: A limit is kept within the larger of these: a share of it, and seconds.
ALLOWED_SHARE, ALLOWED_SECONDS = 0.05, 3.0
#: However long the cameras took, the training gets this share of the time.
LEAST_TRAINING = 0.1


@dataclass(frozen=True)
class Plan:
    """What fits into the time.

    Attributes:
        limit: seconds in all.
        hurried: cameras with half the observations.
        steps, gaussians, grid_step: of the training, as expected.
        train_seconds: of its iterations and looks.
        save_seconds: kept for scoring, saving and the report.
        scored: held-out views that are scored.
        step_seconds: expected for one step.
        enough: the time is more than what makes a twin better; the run ends before.
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


def gaussians_for(steps: float) -> int:
    """How many Gaussians so many steps can place."""
    return int(min(max(GAUSSIANS * math.sqrt(max(steps, 0.0) / 1000.0), FEWEST), MOST))


def useful_steps(photos: int) -> int:
    """More steps than these have not made a twin better."""
    return max(USEFUL_STEPS, USEFUL_VISITS * photos)


def steps_within(speed: Speed, seconds: float, fixed: int | None = None) -> tuple[int, int]:
    """(steps, Gaussians) that fill the time; `fixed` Gaussians where the user wants so many."""
    low, high = 1.0, 200_000.0
    for _ in range(40):
        middle = math.sqrt(low * high)
        count = fixed or gaussians_for(middle)
        low, high = (middle, high) if speed.training(int(middle), count) <= seconds else (low, middle)
    steps = max(1, int(low))
    return steps, fixed or gaussians_for(steps)


class Budget:
    """One run's time.

    Args:
        limit: seconds from `began` to the last file.
        began: on the clock of `time.perf_counter`.
        runs: of this machine, for what scoring and saving take.
        waited: seconds that the user let the work wait, which do not count.
        busy: share of the machine that others use.
    """

    def __init__(
        self,
        limit: float,
        began: float,
        runs: Sequence[Run],
        waited: Callable[[], float] = lambda: 0.0,
        busy: Callable[[], float | None] = lambda: None,
    ) -> None:
        self.limit, self.began, self._runs, self._waited, self._busy = limit, began, runs, waited, busy
        self._page = 0.0
        self.plan: Plan | None = None
        self.hurried = False
        self.speed: Speed | None = None
        self._scoring: float | None = None
        self._begun = 0
        self._lock = threading.Lock()

    def spent(self) -> float:
        """Seconds so far."""
        return time.perf_counter() - self.began - self._waited()

    def left(self) -> float:
        """Seconds until the end; negative when it has passed."""
        return self.limit - self.spent()

    def overrun(self) -> bool:
        """Whether more time was taken than a time limit allows: 5 % of it, or three seconds."""
        return self.left() < -max(ALLOWED_SECONDS, ALLOWED_SHARE * self.limit)

    def hurry(self, photos: Sequence[Photo]) -> bool:
        """Whether the cameras must be found in a hurry."""
        work = self._work(photos, len(photos), 0, GAUSSIANS)
        self.hurried = self._stages(work)["sfm"] > CAMERA_SHARE * self.limit
        return self.hurried

    def train(
        self,
        photos: Sequence[Photo],
        views: Sequence[View],
        held: int,
        points: SparsePoints,
        medium: Medium,
        settings: TrainingSettings,
        fixed: int | None = None,
        formation: Formation = Formation(),
        kept: Path | None = None,
        resume: bool = False,
    ) -> TrainingSettings:
        """Settings that fill what is left; probes the machine for a second or two.

        Args:
            photos: all of them; views: those that are fitted; held: how many could be scored.
            fixed: Gaussians, where the user wants so many.
            kept: file of the plan; resume: its grid and Gaussians are taken from it, as the checkpoint needs them.
        """
        if resume and kept is not None:
            fixed, settings = _as_before(kept, fixed, settings)
        width, height = views[0].camera.width, views[0].camera.height
        usual = settings.grid_step or grid_step(medium, width, height)
        small = self._small(views, points)
        phase = min(PHASE_SECONDS, max(0.0, PROBING * self.left()))
        speed = probe(small, points, medium, settings, len(views), held, formation=formation, phase_seconds=phase)
        scored, saving = self._saving(photos, len(views), held)
        mine = self._training_time(saving)
        steps, count = steps_within(speed, mine, fixed)
        grid = settings.grid_step
        if steps < FEW_STEPS and grid is None and not resume and min(width, height) // (2 * usual) >= SMALLEST_SIDE:
            grid = 2 * usual
            settings = replace(settings, grid_step=grid)
            speed = probe(small, points, medium, settings, len(views), held, formation=formation, phase_seconds=phase)
            steps, count = steps_within(speed, self._training_time(saving), fixed)
        self.speed = speed
        mine = self._training_time(saving)
        useful = max(useful_steps(len(views)), settings.min_steps)
        enough = steps > useful and settings.until is None  # who asks for a quality may go on for it
        if enough:
            steps, count = useful, fixed or gaussians_for(useful)
            mine = min(mine, speed.training(steps, count))
        step = speed.training(steps, count) / steps
        self.plan = Plan(self.limit, self.hurried, steps, count, grid, mine, saving, scored, step, enough)
        if kept is not None:
            write_json(kept, self.plan.plain())
        return replace(settings, steps=steps, max_gaussians=count, time_limit=mine)

    def another(self) -> bool:
        """Whether there is time to score one more view; called by several threads, each time before one."""
        with self._lock:
            now = self.spent()
            if self._scoring is None:
                self._scoring = now
            self._begun += 1
            if self._begun <= FEWEST_SCORED:
                return True
            # Those that are under way count as done: what is left over pays for the report's page.
            each = (now - self._scoring) / max(1, self._begun - FEWEST_SCORED)
            return now + each + self._page <= self.limit

    def _training_time(self, saving: float) -> float:
        spare = min(MOST_SPARE, SPARE * self.limit)
        return max(self.left() - saving - spare, LEAST_TRAINING * self.limit)

    def _saving(self, photos: Sequence[Photo], fitted: int, held: int) -> tuple[int, float]:
        """Views to score, and seconds that this and the rest will take."""

        def seconds(scored: int) -> float:
            stages = self._stages(self._work(photos, fitted, scored, GAUSSIANS))
            self._page = stages["page"]
            return stages["save"] + stages["page"]

        base, scored = seconds(0), held
        while scored > FEWEST_SCORED and seconds(scored) - base > SCORE_SHARE * self.limit:
            scored -= 1
        return scored, seconds(scored)

    def _stages(self, work: Work) -> dict[str, float]:
        return stage_seconds(self._runs, work, 0.0, slowdown(self._busy()))[0]

    @staticmethod
    def _small(views: Sequence[View], points: SparsePoints) -> list[View]:
        """Neighbours among the views: they see the same."""
        middle = max(0, len(views) // 2 - VIEWS // 2)
        return list(views[middle : middle + VIEWS])

    @staticmethod
    def _work(photos: Sequence[Photo], fitted: int, scored: int, gaussians: int) -> Work:
        return work_of(photos, fitted, scored, 1000, gaussians, True, False, True)


def work_of(
    photos: Sequence[Photo],
    fitted: int,
    scored: int,
    steps: int,
    gaussians: int,
    search: bool,
    hurried: bool,
    compiled: bool,
) -> Work:
    """What there is to do with these photos."""
    used = [photo.size[0] * photo.size[1] for photo in photos]
    files = [(w * h) / (p.scale[0] * p.scale[1]) for p, (w, h) in ((p, p.size) for p in photos)]
    mean = sum(used) / max(1, len(used)) / 1e6
    return Work(len(photos), sum(files) / 1e6, mean, fitted, scored, steps, gaussians, search, hurried, compiled)


def _as_before(kept: Path, fixed: int | None, settings: TrainingSettings) -> tuple[int | None, TrainingSettings]:
    try:
        plan = json.loads(kept.read_text("utf-8"))
        return int(plan["gaussians"]), replace(settings, grid_step=plan["grid_step"])
    except (OSError, ValueError, KeyError, TypeError):  # none: the checkpoint itself will tell what does not fit
        return fixed, settings
