"""Short trainings with and without an effect, from the same seed, judged on photos that neither was trained on."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...effects.registry import switches
from ...effects.spec import Switch
from ...errors import Cancelled
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Shot
from ...imaging.formation.motion import CameraMotion
from ...imaging.medium import Medium
from ...imaging.psf import PointSpread
from ...lens import Lens
from ...photos.empty import background_shows
from ...pose import Pose
from ...progress import Progress, Silent
from ...training.grid import coarse_view
from ...training.job import TrainingJob
from ...training.run import train
from ...training.scale import scene_scale
from ...training.settings import TrainingSettings
from ...views import SparsePoints, View
from ..views import Viewer
from .comparison import SETTINGS, Array, Comparison
from .corrected import corrected, over_filed
from .found_again import FoundAgain, enough, found_again
from .kept import KeptTrials
from .matched import matched_psnr

#: Squared length of a straight path over the mean variance of its light along both axes: L^2 / 12 along it, 0 across.
STRAIGHT = 24.0
#: Share of a pair's time that the training with paths takes (31 photos of 600 x 400 px: 24.5 of 26.5 s).
_PATHS_COST = 0.9


@dataclass(frozen=True)
class Arm:
    """What one of two trainings simulates and masks.

    Attributes:
        still: whether photos that are trained on stand still: only those that judge have a path.
    """

    formation: Formation = field(default_factory=Formation)
    masked: tuple[Switch, ...] = ()
    still: bool = False

    def of_pair(self, judged: Sequence[str]) -> Formation:
        """What is simulated where these photos judge."""
        if not self.still:
            return self.formation
        effects = self.formation.effects
        return Formation([e.for_photos(judged) if isinstance(e, CameraMotion) else e for e in effects])


@dataclass(frozen=True)
class TrialTerms:
    """What all trials of a run are bound to.

    Attributes:
        settings: of the training; steps, Gaussians and points are cut down.
        left: seconds that they may still take; kept: what they said before.
    """

    settings: TrainingSettings
    left: Callable[[], float] = lambda: math.inf
    kept: KeptTrials = field(default_factory=KeptTrials)


class TrialCourse:
    """How far the trial of an effect is, as if all were made that may be: mostly less is.

    Args:
        hear: share in [0, 1).
    """

    def __init__(self, hear: Callable[[float], None] = lambda share: None) -> None:
        self._hear, self._done, self._whole, self._last = hear, 0.0, 1.0, 0.0

    def begin(self, pairs: float) -> None:
        """A trial of so many short pairs of trainings at most."""
        self._done, self._whole = 0.0, pairs

    def within(self, cost: float, share: float) -> None:
        """A share of a training is done that costs as much as so many short pairs."""
        self._last = max(self._last, min(0.99, (self._done + share * cost) / self._whole))
        self._hear(self._last)

    def add(self, cost: float) -> None:
        """Such a training is over."""
        self._done += cost


class _TimeIsUpError(Exception):
    """A training was cut off, as trials may take no longer."""


class _Hushed(Silent):
    """Says no more than how far a training is, and is cancelled with the run, or when trials may take no longer.

    Args:
        hear: share of the training that is done.

    Attributes:
        by_user: whether the run was.
    """

    def __init__(self, progress: Progress, terms: TrialTerms, hear: Callable[[float], None]) -> None:
        self._progress, self._terms, self._hear, self.by_user = progress, terms, hear, False
        self._total: int | None = None

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins; that of the steps counts."""
        self._total = total if name == "train" else None

    def advance(self, done: int, **figures: float) -> None:
        """So many steps are done."""
        if self._total:
            self._hear(min(1.0, done / self._total))

    def cancelled(self) -> bool:
        """Whether the training ends here."""
        self.by_user = self._progress.cancelled()
        return self.by_user or self._terms.left() <= 0.0


class Ablation:
    """Pairs of trainings, and scores of what was already trained.

    Args:
        views: those of the training; held-out ones of the report take no part.
        points: of the training.
        medium: of the training. Effects of the sensor are tried without its blur: photos disagree about gains and
            corners as much when both twins stay soft, and fewer points do. What the light meets before the blur
            is tried through it, from all points: it goes by their depth.
        terms: what trainings are bound to; progress: may cancel them, and hears where they get longer.
    """

    def __init__(
        self,
        views: Sequence[View],
        points: SparsePoints,
        medium: Medium,
        terms: TrialTerms,
        progress: Progress = Silent(),
    ) -> None:
        self.views, self.points, self._progress, self._terms = list(views), points, progress, terms
        self.step = max(1, min((min(v.camera.width, v.camera.height) for v in self.views), default=1) // SETTINGS.side)
        self._asked = terms.settings
        self.settings = replace(self._asked, time_limit=None, until=None, min_steps=0, grid_step=None)
        self._cut(SETTINGS.steps, SETTINGS.gaussians)
        self._full, self.medium = medium, medium.on_grid(self.step)
        self._lengths: list[float] = []  # of paths that were learned, or widths off the focus, px of the trial's grid
        self._scored: dict[tuple[tuple[str, ...], tuple[Switch, ...], bool, str, int], Array] = {}
        self._ways: dict[int, dict[str, Array]] = {}  # of fitted photos through the exposure, by pair
        self._compared = 0  # pairs that the last comparison took
        self._slowest = 0.0  # s, of a pair
        self.course, self._of_paths = TrialCourse(), False

    def judged(self, pair: int) -> list[int]:
        """Which photos a pair of trainings is judged by."""
        found = list(
            range((1 + pair * (SETTINGS.every // SETTINGS.pairs)) % SETTINGS.every, len(self.views), SETTINGS.every)
        )
        return [
            found[i] for i in np.linspace(0, len(found) - 1, min(SETTINGS.most_judged, len(found))).round().astype(int)
        ]

    @property
    def possible(self) -> bool:
        """Whether there are photos enough to judge by."""
        return sum(len(self.judged(pair)) for pair in range(SETTINGS.pairs)) >= SETTINGS.fewest_judged

    def compare(self, without: Arm, with_it: Arm, certain: bool = False) -> Comparison:
        """`with_it` against `without`; what was kept of the same trial, where it was made before.

        Photos of which no px counts are no part of it.

        Args:
            certain: something else shows it beyond doubt: the trial may contradict, and need not confirm.

        Raises:
            Cancelled: the user asked to stop. OutputError: what it says cannot be kept.
        """
        asked = self._asked_for(without, with_it)
        said = self._terms.kept.get(asked)
        if said is None:
            try:
                said = self._made(without, with_it, certain)
            except _TimeIsUpError:
                said = Comparison.not_made("the time limit leaves no time to try it")
            self._terms.kept.put(asked, said)
        return said

    def _asked_for(self, without: Arm, with_it: Arm) -> str:
        """Which trial that is, of which run."""
        masked = [[name for name, switch in switches().items() if switch in arm.masked] for arm in (without, with_it)]
        arms = sorted(without.formation.names), sorted(with_it.formation.names), masked
        run = replace(self.settings, device="auto", threads=0)
        return repr((arms, self.step, run, self._full, [view.name for view in self.views]))

    def _made(self, without: Arm, with_it: Arm, certain: bool = False) -> Comparison:
        self.course.begin(SETTINGS.pairs)
        if without.formation.learns_focus is not with_it.formation.learns_focus:
            arms = [Formation([e for e in a.formation.effects if e.place != "sensor"]) for a in (without, with_it)]
            finer = self._whole(Arm(with_it.formation, without.masked))
            return finer._compare_foci(Arm(arms[0]), Arm(arms[1]))
        if without.formation.motion is not with_it.formation.motion:
            arms = [Formation([e for e in a.formation.effects if e.place != "sensor"]) for a in (without, with_it)]
            finer = self._finer(Arm(with_it.formation, without.masked))
            return finer._compare_paths(Arm(arms[0]), Arm(arms[1]), certain)
        return self._compare(without, with_it, bool(without.formation.light or with_it.formation.light))

    def _compare_paths(self, without: Arm, with_it: Arm, certain: bool = False) -> Comparison:
        """The same for the camera's motion: where hardly any photo learns a path, nothing else is trained.

        Where spectra show beyond doubt that photos moved, each in its way, short trainings are enough: longer ones
        would only confirm, and what photos share is no rival.
        """

        def not_found(long: Array) -> str:
            share = float((long >= SETTINGS.path_seen).mean())
            return (
                "" if share >= SETTINGS.photos_moved else f"a short training finds paths in {share:.0%} of the photos"
            )

        self._of_paths = True
        self.course.begin(SETTINGS.pairs * (1.0 + (SETTINGS.longer_takes if self._longer() is not None else 0.0)))
        trial, found = self, self._compare(without, with_it, True, SETTINGS.path_gain, not_found)
        # That nothing is gained short trainings cannot say: they are too short for what a weak shake takes.
        longer = None if found.contradicts or found.clear or certain else self._longer()
        if longer is not None:
            short = f"{found.mean:+.2f} +- {found.error:.2f} dB"
            enough = self._terms.left() >= SETTINGS.longer_takes * self._slowest
            then = "longer ones are made" if enough else "the time limit leaves none for longer ones"
            self._progress.note(f"motion: short trainings do not settle it ({short}); {then}")
            longer = longer if enough else None
        with contextlib.suppress(_TimeIsUpError):
            if longer is not None:
                found = longer._compare(without, with_it, True, SETTINGS.longer_gain, not_found, last=True)
                trial, found = longer, longer._believed(with_it, found)
            blurs = self.medium.blurs or without.formation.blurs
            if found.confirms and not blurs and not certain and not found.beside:
                return trial._against_even_blur(without, with_it, found)
        return found

    def _believed(self, with_it: Arm, found: Comparison) -> Comparison:
        """What longer trainings confirm, if it is by paths that the photos have.

        What moved the camera is found again by another training, of other photos and from another start. That decides,
        however much is gained: any path explains a photo better, and a blur that all photos share leaves none of them
        its own. Where it cannot be asked, more has to be gained than a rival does.
        """
        if not found.confirms:
            return found
        again = self._found_again(with_it)
        if again is None:
            return self._against_still_photos(with_it, found)
        apart = f"{again.apart:.0%} as far apart as those of different photos"
        if again.confirms:
            return replace(found, beside=f"; two trainings find the same paths, {apart}")
        gained = f"paths explain {found.mean:+.2f} dB more than none, but two trainings do not find the same ones"
        return replace(found, seen=f"{gained} ({apart}): nothing moved", least=math.inf)

    def _found_again(self, with_it: Arm) -> FoundAgain | None:
        """How far both pairs' trainings find the same paths; None for too few photos, or where no time is left."""
        fewer = set(range(len(self.views))).difference(*(self.judged(pair) for pair in range(SETTINGS.pairs)))
        if not enough(len(fewer)) or (self._compared < SETTINGS.pairs and self._terms.left() < self._slowest):
            return None
        with contextlib.suppress(_TimeIsUpError):
            for pair in range(self._compared, SETTINGS.pairs):
                self._scores(with_it, self.medium, pair)
            return found_again(self._ways.get(0, {}), self._ways.get(1, {}))
        return None

    def _against_still_photos(self, with_it: Arm, found: Comparison) -> Comparison:
        """Paths against none in the photos that are trained on, where those that judge have theirs all the same.

        A path of its own explains a photo better whatever the twin: it lays the twin where it fits, and spreads what
        stands in the wrong place. So photos that nothing moved are explained better, too, though their twin is worse.
        """
        pairs, still = range(self._compared), replace(with_it, still=True)
        scores = [self._scores(with_it, self.medium, pair) - self._scores(still, self.medium, pair) for pair in pairs]
        return _against(
            found, scores, "than a path of each photo that judges, before a twin of still ones: nothing moved"
        )

    def _against_even_blur(self, without: Arm, with_it: Arm, found: Comparison) -> Comparison:
        """Paths against one round blur of all photos, as wide as they are, by the pairs that judged them.

        Paths stay where they explain more beyond chance, or where the round blur explains next to none of what they do.
        Paths can bend until they spread light evenly: blur that all photos share, as frosted glass makes it, is
        explained by such paths better than by none at all.
        """
        lengths = np.asarray(self._lengths)
        sigma = float(np.sqrt(np.square(lengths).mean() / STRAIGHT))
        even = Medium(PointSpread(sigma_x=sigma, sigma_y=sigma), "linear")
        pairs = range(self._compared)
        scores = [self._scores(with_it, self.medium, pair) - self._scores(without, even, pair) for pair in pairs]
        width = f"{sigma * self.step:.1f} px"
        seen = f"than a round blur that all photos share ({width}): blur of a medium, not of motion"
        return _against(found, scores, seen)

    def _compare_foci(self, without: Arm, with_it: Arm) -> Comparison:
        """The same for the photos' focus: where nothing is found out of focus, nothing else is trained."""

        def not_found(widest: Array) -> str:
            middle = float(np.median(widest))
            return "" if middle >= SETTINGS.focus_seen else f"a short training finds {middle:.2f} px of it"

        return self._compare(without, with_it, True, SETTINGS.focus_gain, not_found)

    def _compare(
        self,
        without: Arm,
        with_it: Arm,
        through: bool,
        least: float = 0.0,
        not_found: Callable[[Array], str] = lambda lengths: "",
        last: bool = False,
    ) -> Comparison:
        """Pair by pair, until the verdict is settled.

        Args:
            through: whether photos are tried through the medium; least: see `Comparison`.
            not_found: (lengths or widths that were learned) -> what to say where they are none.
            last: no longer trainings follow: what is surely more than confirms need not be clear.

        Raises:
            _TimeIsUpError: before the first pair had an end.
        """
        medium = self.medium if through else Medium()
        found: list[Array] = []
        for pair in range(SETTINGS.pairs):
            if pair and self._terms.left() < self._slowest:
                break  # what one pair says decides
            begun = time.perf_counter()
            try:
                second = self._scores(with_it, medium, pair)
                lengths = np.asarray(self._lengths)
                seen = not_found(lengths) if len(lengths) else ""
                if seen:
                    return Comparison(np.zeros(len(lengths)), seen, least)
                found.append(second - self._scores(without, medium, pair))
            except _TimeIsUpError:
                if not found:
                    raise
                break
            self._slowest = max(self._slowest, time.perf_counter() - begun)
            self._compared = pair + 1
            differences = np.concatenate(found)
            so_far = Comparison(differences[np.isfinite(differences)], least=least)
            if so_far.settled or (last and so_far.surely_more):
                break
        return so_far

    def _scores(self, arm: Arm, medium: Medium, pair: int) -> Array:
        """PSNR in dB of every photo that a pair is judged by, photos' own gains matched."""
        kind = "own" if medium is self.medium else "even" if medium.blurs else "none"
        key = (tuple(sorted(arm.formation.names)), arm.masked, arm.still, kind, pair)
        if key not in self._scored:
            views = [self._coarse(view, medium) for view in corrected(self.views, arm.formation, arm.masked)]
            judged = [views[i].name for i in self.judged(pair)]
            self._scored[key] = np.asarray(self._of_pair(views, arm.of_pair(judged), medium, pair))
        return self._scored[key]

    def _of_pair(self, views: list[View], formation: Formation, medium: Medium, pair: int) -> list[float]:
        """Trains on what the pair does not judge, of `views`, and judges by photos as they were filed."""
        blurred = medium is self.medium or medium.blurs
        settings = replace(self.settings, seed=self.settings.seed + 1000 + pair)
        judged = self.judged(pair)
        fitted = [view for i, view in enumerate(views) if i not in judged]
        # Only their own path through the exposure and their focus are read off the photos that judge.
        learned = formation.motion is not None or formation.learns_focus
        others = [views[i] for i in judged] if learned else []
        points = self.points if blurred else _fewer(self.points)
        scale = scene_scale([view.camera for view in fitted], points)
        job = TrainingJob(fitted, others, points, medium, settings, formation, evaluated=False)
        cost = self._cost(formation)
        hushed = _Hushed(self._progress, self._terms, lambda share: self.course.within(cost, share))
        trained = train(job, hushed)
        self.course.add(cost)
        if trained.stopped == "cancelled":
            if hushed.by_user:
                raise Cancelled("Stopped while effects were tried")
            raise _TimeIsUpError
        if (moved := trained.formation.motion) is not None:
            lengths = [moved.length(v.name, v.camera.fx) / moved.exposures for v in fitted if v.name in moved.names]
            self._lengths.extend(lengths)
            if lengths:  # not where only the photos that judge have paths
                self._ways[pair] = _ways_of(moved, fitted)
        if (focus := trained.formation.focus) is not None:
            self._lengths.extend(focus.widest(v.name, math.hypot(v.camera.width, v.camera.height)) for v in fitted)
        device = "cpu" if settings.device == "auto" else settings.device
        viewer = Viewer(trained.gaussians, scale, device, trained.low_pass, trained.background)
        scores = []
        filed = (replace(self.views[i], mask=_counted(self.views[i])) for i in judged)
        for view in (self._coarse(view, medium) for view in filed):
            c = view.camera
            lens = Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy))
            shown = viewer.degraded(lens, Pose(c.rotation, c.translation), medium, view.name, trained.formation)
            shot = Shot(view.name, c.height, c.width, middle=(c.cx, c.cy))
            photo = over_filed(view.planes(), view.transparency(), view.background, formation, shot)
            scores.append(matched_psnr(shown, photo, view.mask, background_shows(view)))
        return scores

    def _cost(self, formation: Formation) -> float:
        """Of a training, in short pairs."""
        pair = SETTINGS.longer_takes if self.settings.steps > SETTINGS.path_steps else 1.0
        if not self._of_paths:
            return pair / 2
        return pair * (_PATHS_COST if formation.motion is not None else 1.0 - _PATHS_COST)

    def _finer(self, arm: Arm) -> Ablation:
        """Trials on the middles of photos averaged down less, as what a kernel does is small; the sensor is undone."""
        finest = min(SETTINGS.path_px * self.step, self._path(arm.formation.motion))
        step = max(1, min(self.step, int(finest / SETTINGS.path_px)))
        views = corrected(self.views, arm.formation, arm.masked)
        return self._on([cropped(view, step * SETTINGS.path_side) for view in views], step)

    def _whole(self, arm: Arm) -> Ablation:
        """Trials on whole photos, so that they hold all depths, averaged down less; the sensor is undone."""
        views = corrected(self.views, arm.formation, arm.masked)
        side = min(min(view.camera.width, view.camera.height) for view in views)
        return self._on(views, max(1, side // SETTINGS.focus_side))

    def _on(self, views: list[View], step: int) -> Ablation:
        """Trials on other views, of which `step` px become one."""
        other = Ablation(views, self.points, self._full, self._terms, self._progress)
        other.step, other.medium = step, self._full.on_grid(step)
        other.course, other._of_paths = self.course, self._of_paths
        other._cut(SETTINGS.path_steps, SETTINGS.path_gaussians)
        return other

    def _longer(self) -> Ablation | None:
        """The same trials with more steps and Gaussians; None where the training itself is no longer."""
        if self._asked.steps <= self.settings.steps:
            return None
        other = self._on(self.views, self.step)
        other._cut(SETTINGS.longer * SETTINGS.path_steps, SETTINGS.longer * SETTINGS.path_gaussians)
        return other

    def _cut(self, steps: int, gaussians: int) -> None:
        """Trains no longer than so, and no longer than was asked for."""
        most = min(gaussians, self._asked.max_gaussians)
        self.settings = replace(self.settings, steps=min(steps, self._asked.steps), max_gaussians=most)

    def _path(self, motion: CameraMotion | None) -> float:
        """Median length (px) of the paths that blur: what a photo must be large enough to show."""
        focals = {view.name: view.camera.fx for view in self.views}
        lengths = (
            [] if motion is None else [motion.length(name, focals[name]) for name in motion.names if name in focals]
        )
        longer = [length for length in lengths if length >= SETTINGS.shortest_path]
        return float(np.median(longer)) if longer else 0.0

    def _coarse(self, view: View, medium: Medium) -> View:
        return coarse_view(view, self.step, medium.blur_space)


def _against(found: Comparison, scores: Sequence[Array], seen: str) -> Comparison:
    """What was found, unless a rival explains a share of it, and paths do not beat that beyond chance.

    Args:
        scores: dB of paths over the rival, of each pair; seen: what to say of it.
    """
    differences = np.concatenate(scores)
    beyond = Comparison(differences[np.isfinite(differences)])
    if beyond.confirms or beyond.mean > (1.0 - SETTINGS.rival_share) * found.mean:
        return found
    more = f"paths explain {found.mean:+.2f} dB more than none, but {beyond.mean:+.2f} +- {beyond.error:.2f} dB more"
    return replace(found, seen=f"{more} {seen}", least=math.inf)


def _ways_of(motion: CameraMotion, views: Sequence[View]) -> dict[str, Array]:
    """[T, 2] px, by photo."""
    ways = {view.name: motion.way(view.name, view.camera.fx) for view in views}
    return {name: way.double().numpy() for name, way in ways.items() if way is not None}


def cropped(view: View, side: int) -> View:
    """The middle of a view, whose shorter side is `side` px at most; the very same one where it is no larger."""
    camera = view.camera
    share = side / min(camera.width, camera.height)
    if share >= 1.0:
        return view
    width, height = round(camera.width * share), round(camera.height * share)
    left, top = (camera.width - width) // 2, (camera.height - height) // 2
    inside = (slice(top, top + height), slice(left, left + width))
    camera = replace(camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top)
    mask = None if view.mask is None else np.ascontiguousarray(view.mask[inside])
    alpha = None if view.alpha is None else np.ascontiguousarray(view.alpha[inside])
    return replace(view, camera=camera, photo=np.ascontiguousarray(view.photo[inside]), mask=mask, alpha=alpha)


def _fewer(points: SparsePoints) -> SparsePoints:
    """At most `SETTINGS.points` of them, evenly through the list."""
    if len(points.positions) <= SETTINGS.points:
        return points
    kept = np.linspace(0, len(points.positions) - 1, SETTINGS.points).round().astype(int)
    return points.chosen(kept)


def _counted(view: View) -> NDArray[np.bool_] | None:
    """Px that count: those of the mask that are not clipped, whatever the arm."""
    top = int(np.iinfo(view.photo.dtype).max)
    clear = ~(view.photo >= top - top // (view.levels or top)).any(axis=2)
    behind = background_shows(view)
    if behind is not None:
        clear |= behind
    return clear if view.mask is None else clear & view.mask
