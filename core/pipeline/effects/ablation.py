"""Short trainings with and without an effect, from the same seed, judged on photos that neither was trained on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...effects.spec import Switch
from ...errors import Cancelled
from ...imaging.formation.chain import Formation
from ...imaging.formation.effect import Shot
from ...imaging.formation.motion import CameraMotion
from ...imaging.medium import Medium
from ...imaging.psf import PointSpread
from ...lens import Lens
from ...numbers import BY_DEFINITION, number
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
from .corrected import corrected, over_filed
from .matched import matched_psnr

Array = NDArray[np.float64]

#: Squared length of a straight path over the mean variance of its light along both axes: L^2 / 12 along it, 0 across.
STRAIGHT = 24.0


@dataclass(frozen=True)
class TrialSettings:
    """Numbers of the short trainings."""

    every: int = number(
        4, "photos", "of which one is judged by a pair of trainings without it, others by the next pair"
    )
    fewest_judged: int = number(5, "photos", "judged at least, by all pairs together")
    most_judged: int = number(8, "photos", "judged by a pair at most")
    pairs: int = number(2, "count", "pairs of trainings, each with a seed and judged photos of its own")
    steps: int = number(100, "steps", "of a short training")
    gaussians: int = number(2000, "count", "of a short training")
    side: int = number(
        80,
        "px",
        "along the shorter side, to which photos are averaged down: what is tried changes from photo to photo, or "
        "slowly over the frame and the depth, and shows there as well, at a price that does not grow with the photos",
    )
    points: int = number(1000, "count", "sparse points that a trial of what the sensor does starts from at most")
    shortest_path: float = number(
        1.0, "px", "of a path that counts as one: shorter ones blur less than the px", "judgement"
    )
    path_seen: float = number(1.5, "px of the trial's grid", "from which on a path that was learned is one")
    photos_moved: float = number(0.2, "share of the photos", "that learn a path at least, or none is simulated")
    path_gain: float = number(
        0.3,
        "dB",
        "that paths must gain besides being no chance: photos that are held out are aligned by theirs a little",
        "sharp photos of copr gained 0.05 and of banana 0.21, shaken ones of the rendered ball 1.7",
        "tea (real, shaken) 0.57; no other sharp set",
    )
    round_share: float = number(
        0.33,
        "of what paths gain",
        "that a round blur of all photos must gain to stand for paths that do not beat it beyond chance",
        "a ball behind the engine's own glass: half; tea (really shaken): none of it",
        "no other value was tried",
    )
    focus_gain: float = number(
        0.1,
        "dB",
        "that a focus of each photo must gain besides being no chance: held-out photos have theirs, too",
        "a rendered depth of field 0.21 +- 0.05",
        "sharp photos of banana 0.04 +- 0.12 and copr 0.03 +- 0.06, forced to be tried; as a loss that contradicts what"
        " points show: drinks, where the trial has 0.00, -0.05 or -0.10 +- 0.04 and the whole run gains 0.85",
    )
    focus_seen: float = number(
        0.4, "px of the trial's grid", "of blur (standard deviation) off the focus, from which on there is one"
    )
    focus_side: int = number(200, "px", "shorter side of the photos in a trial of a focus at least")
    path_px: float = number(4.0, "px", "that a path must still be long in a trial of it")
    path_side: int = number(200, "px", "shorter side of the photos' middles in a trial of a path")
    path_steps: int = number(
        200,
        "steps",
        "in a trial of a path: with half of them paths of 6 px are not confirmed",
        "drawn scenes with paths of 6 and 12 px, photos of 720 px",
    )
    path_gaussians: int = number(
        6000,
        "count",
        "in a trial of a path; with half of them and of the side paths of 12 px on photos of 720 px are not confirmed",
        "drawn scenes with paths of 6 and 12 px, photos of 720 px",
    )
    longer: int = number(
        3,
        "times",
        "the steps and Gaussians of a trial of a path, where short ones are not clear: what 200 steps make of a scene"
        " is too poor for a weak shake (2 to 6 px: -0.09 +- 0.06 dB on a shelf, 0.08 +- 0.06 in a village; with 600"
        " steps 2.4 +- 0.4 and 0.39 +- 0.12, sharp ones -0.27 +- 0.04), and so wrong from inside a room that shaken and"
        " sharp photos gain alike (0.19 +- 0.10 and 0.10 +- 0.13; 0.85 +- 0.21 and -0.12 +- 0.10)",
        "these rendered sets; 400 steps with 6000 Gaussians gain 0.86 +- 0.16 on the shelf, but -0.09 +- 0.11 in the"
        " village",
        "sharp photos of copr 0.06 +- 0.17, of banana 0.50 +- 0.21, of brighton 0.13 +- 0.26: none is confirmed",
    )
    longer_gain: float = number(
        0.35,
        "dB",
        "that paths must gain in longer trials, as `path_gain`",
        "between a sharp room with noise and drifting exposures, 0.30 +- 0.11, and a weakly shaken village, 0.39 +-"
        " 0.12 (cameras found: 0.45 +- 0.12); a sharp plant with noise and JPEG 0.20 +- 0.05",
    )
    clearly: float = number(
        2.0,
        "times",
        "what confirms after both pairs of trainings: where the first alone gains so much, the second is spared, and"
        " so are longer ones",
        "a first choice: a pair's photos do not know how far two trainings differ by chance",
    )
    chance: float = number(
        0.0228, "probability", "that chance gives as large a gain: a normal's beyond two standard errors", BY_DEFINITION
    )


SETTINGS = TrialSettings()


@dataclass(frozen=True)
class Arm:
    """What one of two trainings simulates and masks."""

    formation: Formation = field(default_factory=Formation)
    masked: tuple[Switch, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """Paired differences (dB), one for each judged photo.

    Attributes:
        seen: what else there is to say; least: gain (dB) that confirms at least.
        least_lost: loss (dB) that contradicts at least.
    """

    differences: Array
    seen: str = ""
    least: float = 0.0
    least_lost: float = 0.0

    @property
    def mean(self) -> float:
        """Mean gain, dB."""
        return float(self.differences.mean())

    @property
    def error(self) -> float:
        """Standard error of `mean`."""
        count = len(self.differences)
        return float(self.differences.std(ddof=1) / math.sqrt(count)) if count > 1 else math.inf

    @property
    def confirms(self) -> bool:
        """Whether the gain is more than chance."""
        return self.mean > max(self.needed * self.error, self.least)

    @property
    def clear(self) -> bool:
        """Whether far more is gained than confirms."""
        wanted = max(self.needed * self.error, self.least)
        return len(self.differences) >= SETTINGS.fewest_judged and self.mean > SETTINGS.clearly * wanted

    @property
    def settled(self) -> bool:
        """Whether a second pair of trainings would hardly change the verdict: clear, not found, or out of reach."""
        if self.seen or self.clear:
            return True
        return len(self.differences) >= SETTINGS.fewest_judged and self.mean + self.needed * self.error < self.least

    @property
    def contradicts(self) -> bool:
        """Whether the loss is more than chance, or what was tried is not found at all."""
        return bool(self.seen) or self.mean < -self.least_lost - self.needed * self.error

    @property
    def needed(self) -> float:
        """Standard errors that a gain must exceed: 2 with many photos, more with few (Student's t)."""
        return -float(stdtrit(max(1, len(self.differences) - 1), SETTINGS.chance))


class _Hushed(Silent):
    """Says nothing, and is cancelled with the run."""

    def __init__(self, progress: Progress) -> None:
        self.cancelled = progress.cancelled  # type: ignore[method-assign]


class Ablation:
    """Pairs of trainings, and scores of what was already trained.

    Args:
        views: those of the training; held-out ones of the report take no part.
        points, settings: of the training; steps, Gaussians and points are cut down.
        medium: of the training. Effects of the sensor are tried without its blur: photos disagree about gains and
            corners as much when both twins stay soft, and fewer points do. What the light meets before the blur
            is tried through it, from all points: it goes by their depth.
        progress: may cancel them, and hears where they get longer.
    """

    def __init__(
        self,
        views: Sequence[View],
        points: SparsePoints,
        medium: Medium,
        settings: TrainingSettings,
        progress: Progress = Silent(),
    ) -> None:
        self.views, self.points, self._progress = list(views), points, progress
        self.step = max(1, min((min(v.camera.width, v.camera.height) for v in self.views), default=1) // SETTINGS.side)
        self._asked = settings
        self.settings = replace(settings, time_limit=None, until=None, min_steps=0, grid_step=None)
        self._cut(SETTINGS.steps, SETTINGS.gaussians)
        self._full, self.medium = medium, medium.on_grid(self.step)
        self._lengths: list[float] = []  # of paths that were learned, or widths off the focus, px of the trial's grid
        self._scored: dict[tuple[tuple[str, ...], tuple[Switch, ...], str, int], Array] = {}
        self._compared = 0  # pairs that the last comparison took

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

    def compare(self, without: Arm, with_it: Arm) -> Comparison:
        """`with_it` against `without`.

        Photos of which no px counts are no part of it.
        """
        if without.formation.learns_focus is not with_it.formation.learns_focus:
            arms = [Formation([e for e in a.formation.effects if e.place != "sensor"]) for a in (without, with_it)]
            finer = self._whole(Arm(with_it.formation, without.masked))
            return finer._compare_foci(Arm(arms[0]), Arm(arms[1]))
        if without.formation.motion is not with_it.formation.motion:
            arms = [Formation([e for e in a.formation.effects if e.place != "sensor"]) for a in (without, with_it)]
            finer = self._finer(Arm(with_it.formation, without.masked))
            return finer._compare_paths(Arm(arms[0]), Arm(arms[1]))
        return self._compare(without, with_it, bool(without.formation.light or with_it.formation.light))

    def _compare_paths(self, without: Arm, with_it: Arm) -> Comparison:
        """The same for the camera's motion: where hardly any photo learns a path, nothing else is trained."""

        def not_found(long: Array) -> str:
            share = float((long >= SETTINGS.path_seen).mean())
            return (
                "" if share >= SETTINGS.photos_moved else f"a short training finds paths in {share:.0%} of the photos"
            )

        trial, found = self, self._compare(without, with_it, True, SETTINGS.path_gain, not_found)
        # That nothing is gained short trainings cannot say: they are too short for what a weak shake takes.
        longer = None if found.contradicts or found.clear else self._longer()
        if longer is not None:
            short = f"{found.mean:+.2f} +- {found.error:.2f} dB"
            self._progress.note(f"motion: short trainings do not settle it ({short}); longer ones are made")
            trial, found = longer, longer._compare(without, with_it, True, SETTINGS.longer_gain, not_found)
        blurs = self.medium.blurs or without.formation.blurs
        return found if blurs or not found.confirms else trial._against_even_blur(without, with_it, found)

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
        differences = np.concatenate(scores)
        beyond = Comparison(differences[np.isfinite(differences)])
        if beyond.confirms or beyond.mean > (1.0 - SETTINGS.round_share) * found.mean:
            return found
        seen = (
            f"paths explain {found.mean:+.2f} dB more than none, but {beyond.mean:+.2f} +- {beyond.error:.2f} dB more "
            f"than a round blur that all photos share ({sigma * self.step:.1f} px): blur of a medium, not of motion"
        )
        return replace(found, seen=seen, least=math.inf)

    def _compare_foci(self, without: Arm, with_it: Arm) -> Comparison:
        """The same for the photos' focus: where nothing is found out of focus, nothing else is trained."""

        def not_found(widest: Array) -> str:
            middle = float(np.median(widest))
            return "" if middle >= SETTINGS.focus_seen else f"a short training finds {middle:.2f} px of it"

        # A loss counts from where a gain does: most of a small photo may be a background that hides either.
        found = self._compare(without, with_it, True, SETTINGS.focus_gain, not_found)
        return replace(found, least_lost=SETTINGS.focus_gain)

    def _compare(
        self,
        without: Arm,
        with_it: Arm,
        through: bool,
        least: float = 0.0,
        not_found: Callable[[Array], str] = lambda lengths: "",
    ) -> Comparison:
        """Pair by pair, until the verdict is settled.

        Args:
            through: whether photos are tried through the medium; least: see `Comparison`.
            not_found: (lengths or widths that were learned) -> what to say where they are none.
        """
        medium = self.medium if through else Medium()
        found: list[Array] = []
        for pair in range(SETTINGS.pairs):
            self._compared = pair + 1
            second = self._scores(with_it, medium, pair)
            lengths = np.asarray(self._lengths)
            seen = not_found(lengths) if len(lengths) else ""
            if seen:
                return Comparison(np.zeros(len(lengths)), seen, least)
            found.append(second - self._scores(without, medium, pair))
            differences = np.concatenate(found)
            so_far = Comparison(differences[np.isfinite(differences)], least=least)
            if so_far.settled:
                break
        return so_far

    def _scores(self, arm: Arm, medium: Medium, pair: int) -> Array:
        """PSNR in dB of every photo that a pair is judged by, photos' own gains matched."""
        kind = "own" if medium is self.medium else "even" if medium.blurs else "none"
        key = (tuple(sorted(arm.formation.names)), arm.masked, kind, pair)
        if key not in self._scored:
            views = [self._coarse(view, medium) for view in corrected(self.views, arm.formation, arm.masked)]
            self._scored[key] = np.asarray(self._of_pair(views, arm.formation, medium, pair))
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
        trained = train(job, _Hushed(self._progress))
        if trained.stopped == "cancelled":
            raise Cancelled("Stopped while effects were tried")
        if (moved := trained.formation.motion) is not None:
            lengths = [moved.length(v.name, v.camera.fx) / moved.exposures for v in fitted]
            self._lengths.extend(lengths)
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
        other = Ablation(views, self.points, self._full, self._asked, self._progress)
        other.step, other.medium = step, self._full.on_grid(step)
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
