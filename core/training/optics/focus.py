"""Each photo's focus, learned with the Gaussians.

**Where it begins.** A twin of photos that are sharp in different places is sharper than most of them are anywhere. So
every photo is compared with the plain twin's view, blurred evenly by each width of a ladder: the squared differences,
summed up in classes of depth, say how wide the blur is at each depth (`BlurByDepth`). As the twin may be softer than a
photo where that is sharp, the photo is blurred, too, a little. Any strength and focus is then a line through that
table, and the best of all of them costs next to nothing to find: one strength for all photos, each its own focus. A
photo that contradicts the common strength clearly (a sharp one among others) keeps its own. Later comparisons only
move a photo that has gone wrong.

Where points show foci (`inspection.focus_by_points`), learning begins with those, and none of it is searched for.

**How it goes on.** Whenever a photo is visited, its strength and focus take a part of a Gauss-Newton step towards what
the photo shows, the twin as it is; the two slopes are differences of the photo between small changes of each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...colour import linear_to_srgb, srgb_to_linear
from ...forward import Exposed
from ...forward.medium import MediumModel
from ...imaging.formation.effect import Shot
from ...imaging.formation.focus import FOCUS, Focus, FocusBlur
from ...imaging.formation.layered import LADDER
from ...imaging.formation.occluding import OCCLUDING, even_blur
from ...numbers import BY_DEFINITION, number
from ...rendering import OPAQUE_ENOUGH, Rendered
from .gauss_newton import LookedAt, normal_equations, shown_with

Array = NDArray[np.float64]

#: What most of the numbers below rest on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class LearnedFocusSettings:
    """Numbers of the focus that is learned."""

    search_at: tuple[float, ...] = number(
        (0.1, 0.2, 0.35, 0.5, 0.7),
        "share of the run",
        "at which all photos are compared with even blurs of the twin",
        _FIRST,
    )
    coarse_share: float = number(0.4, "share of the run", "on the grid of half the resolution at least", _FIRST)
    classes: int = number(24, "count", "classes of depth, of equally many px", _FIRST)
    foci: int = number(49, "count", "that are tried, evenly in 1 / depth", _FIRST)
    strengths: int = number(25, "count", "that are tried, besides none at all", _FIRST)
    beyond: float = number(0.6, "of the range of 1 / depth", "that a focus may lie nearer or farther", _FIRST)
    least_range: float = number(
        0.05,
        "1 / median depth",
        "between a photo's nearest and farthest: of a flatter scene no photo shows a focus",
        _FIRST,
    )
    narrowest: float = number(0.4, "px of the grid", "standard deviation over the scene's range that is tried", _FIRST)
    independent: float = number(400.0, "px", "that a photo's px count as: neighbours err alike", _FIRST)
    knee: float = number(0.1, "sRGB", "differences beyond count as this: wrong places, not blur", _FIRST)
    least_noise: float = number(0.004, "sRGB", "by which twin and photo differ at least: 1 of 255", BY_DEFINITION)
    softened: int = number(3, "rung", "of the ladder, by which photos are blurred where they are compared", _FIRST)
    most_said: float = number(
        60.0, "natural log of the likelihood", "that a photo says against a common strength at most", _FIRST
    )
    own: float = number(
        20.0,
        "natural log of the likelihood",
        "that a photo must gain by a strength of its own: a tenth of what is left of the difference; with 60 the sharp"
        " held-out photos were given blur, too",
        "the rendered depth of field, one seed: 60; no other value was compared",
    )
    own_unseen: float = number(8.0, "natural log of the likelihood", "the same for a photo that is held out", _FIRST)
    own_from: float = number(
        0.45, "share of the run", "from which on a strength of its own is asked about: before, the twin is soft", _FIRST
    )
    again: float = number(
        60.0,
        "natural log of the likelihood",
        "that a photo must gain to be moved by a later comparison: with 6, foci right to 4 % were moved by 24 %",
        "the rendered depth of field, one seed",
    )
    part: float = number(0.5, "share of a step", "that is taken at each visit: the twin changes, too", _FIRST)
    alike: float = number(0.05, "share", "standard deviation of strengths around the common one", _FIRST)
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count as their size (95 % efficient on normal noise)",
        BY_DEFINITION,
    )
    looked_at: int = number(20_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)
    change: float = number(0.1, "share", "of the strength by which a slope is measured", _FIRST)
    longest_step: float = number(0.25, "share", "of the strength, and of the range of 1 / depth, at a visit", _FIRST)
    unseen_visits: int = number(6, "visits", "of a photo that is held out, on the finished twin", _FIRST)


SETTINGS = LearnedFocusSettings()


@dataclass(frozen=True)
class Seen:
    """What the twin shows of a photo without the blur, and the photo.

    Attributes:
        rendered: the sharp view, margin included; depth: [h, w] of its surface; photo: [3, H, W] sRGB.
        counts: [H, W] bool, None for all px.
        medium: what else blurs; shot: how it is taken.
    """

    rendered: Rendered
    depth: Tensor
    photo: Tensor
    counts: Tensor | None
    medium: MediumModel
    shot: Shot


@dataclass(frozen=True)
class Tried:
    """What a search tries: strengths [S] and foci [F]."""

    strengths: Array
    foci: Array


@dataclass(frozen=True)
class BlurByDepth:
    """How far a photo is from the twin's view, blurred evenly, in classes of depth.

    Attributes:
        inverse: [C] 1 / depth of the classes; weights: [C] share of the px.
        variances: [L] of the even blurs, px^2 of the grid; differences: [C, L] mean squared difference, sRGB.
        products: [C, L - 1] mean product of the differences from two neighbouring blurs, which makes what a mixture
            of both leaves exact. softened: px^2 by which the photo was blurred.
        diagonal: of the photo, px of the grid.
    """

    inverse: Array
    weights: Array
    variances: Array
    differences: Array
    products: Array
    softened: float
    diagonal: float

    @staticmethod
    def of(seen: Seen, effect: FocusBlur, settings: LearnedFocusSettings) -> BlurByDepth | None:
        """Compared on one photo; None where it shows nothing."""
        margin, (height, width) = seen.shot.margin, seen.photo.shape[1:]
        inside = (slice(margin, margin + height), slice(margin, margin + width))
        light = srgb_to_linear(seen.rendered.image.detach())
        use = seen.rendered.alpha.detach()[inside] > OPAQUE_ENOUGH
        if seen.counts is not None:
            use = use & seen.counts
        if int(use.sum()) < settings.classes:
            return None
        inverse = 1.0 / seen.depth[inside].clamp(min=FOCUS.nearest_depth)[use].cpu().double().numpy()
        order = np.array_split(np.argsort(inverse, kind="stable"), settings.classes)
        softened, variance = even_blur(srgb_to_linear(seen.photo), LADDER[settings.softened - 1], effect.shape)
        photo = linear_to_srgb(softened)[:, use]
        gaps, variances = [], []
        for sigma in (0.0, *LADDER):
            if sigma > min(height, width) * OCCLUDING.widest:
                break
            blurred, its = even_blur(light, sigma, effect.shape)
            gaps.append(seen.medium.degraded(linear_to_srgb(blurred))[:, use] - photo)
            variances.append(its)
        # Differences that no blur explains are wrong places.
        most = torch.stack([gap.square().mean(dim=0) for gap in gaps]).amin(dim=0)
        weight = (1.0 / (1.0 + most / settings.knee**2)).cpu().double().numpy()

        def in_classes(one: Tensor, other: Tensor) -> list[float]:
            product = (one * other).mean(dim=0).cpu().double().numpy() * weight
            return [float(product[part].mean()) for part in order]

        differences = np.array([in_classes(gap, gap) for gap in gaps]).T
        products = np.array([in_classes(*pair) for pair in pairwise(gaps)]).T
        middles = np.array([float(np.median(inverse[part])) for part in order])
        weights = np.full(len(order), 1.0 / len(order))
        known = np.array(variances), differences, products, variance
        return BlurByDepth(middles, weights, *known, math.hypot(height, width))

    def cost(self, tried: Tried, settings: LearnedFocusSettings) -> Array:
        """[S, F] less natural log of the likelihood, for each strength and focus."""
        off = (self.inverse[:, None] - tried.foci[None, :]) ** 2  # [C, F]
        variance = (tried.strengths * self.diagonal)[:, None, None] ** 2 * off[None]  # [S, C, F]
        found = np.zeros((len(tried.strengths), len(tried.foci)))
        for c in range(len(self.inverse)):
            noise = max(float(self.differences[c].min()), settings.least_noise**2)
            found += self.weights[c] / noise * self._left(c, variance[:, c] + self.softened)
        return np.asarray(0.5 * settings.independent * found)

    def _left(self, c: int, variance: Array) -> Array:
        """Mean squared difference in a class after a blur of a variance (px^2): of the mixture of two of the ladder."""
        k = np.clip(np.searchsorted(self.variances, variance, side="right") - 1, 0, len(self.variances) - 2)
        low, high = self.variances[k], self.variances[k + 1]
        t = np.clip((variance - low) / (high - low), 0.0, 1.0)
        mixed = (1 - t) ** 2 * self.differences[c][k] + t**2 * self.differences[c][k + 1]
        return np.asarray(mixed + 2 * t * (1 - t) * self.products[c][k])


def _strength(costs: Mapping[str, Array], most: float) -> int:
    """Which strength but none explains photos best, by their costs [S, F]; no photo counts for more than `most`."""
    rows = [cost.min(axis=1) for cost in costs.values()]
    total = np.sum([np.minimum(row, row.min() + most) for row in rows], axis=0)
    return 1 + int(total[1:].argmin())  # (at none, nothing could be learned)


class LearnedFocus:
    """Strength and focus of photos, fitted and held-out ones.

    Args:
        start: the effect, for the photos that it is to be learned of; values are found in the course of the run.
        fitted: names of those that are trained on: they say what strength is common.

    Attributes:
        effect: as it is; the forward model's own, so that it sees every step.
        begun: whether any search has found values.
        common: the strength that photos share.
    """

    def __init__(self, start: FocusBlur, fitted: Sequence[str], settings: LearnedFocusSettings = SETTINGS) -> None:
        self.settings, self._fitted = settings, frozenset(fitted)
        self.effect = type(start).unknown(start.names)
        self.common, self.begun = 0.0, False
        self._own: set[str] = set()
        self._shown = start.shown & self._fitted
        self._searches, self._share = 0, 0.0
        self._range = 1.0
        self._normal: dict[str, tuple[Array, Array]] = {}
        self._begin_with(start)

    def _begin_with(self, start: FocusBlur) -> None:
        """What points show of photos that are trained on; its depths may have another unit."""
        for name in sorted(self._shown):
            values, row = start.of(name), self.effect.row_of(name)
            assert values is not None and row is not None
            self._set(row, values.strength * start.unit, values.focus / start.unit)
            if values.strength > 0:
                self.common, self.begun = values.strength * start.unit, True
            else:
                self._own.add(name)

    def due(self, share: float) -> bool:
        """Whether all photos are to be compared with even blurs, at a share in [0, 1) of the run."""
        done, at = self._searches, self.settings.search_at
        return done < len(at) and share >= at[done]

    def search(self, tables: Mapping[str, BlurByDepth], share: float) -> None:
        """Finds the common strength and each photo's focus from comparisons of fitted photos with even blurs.

        Args:
            share: of the run, in [0, 1).
        """
        self._searches += 1
        self._share = share
        if not tables:
            return
        tried = self._tried(list(tables.values()))
        if self._range < self.settings.least_range:
            return
        costs = {name: table.cost(tried, self.settings) for name, table in tables.items()}
        again = self.settings.again if self.begun else 0.0
        if not self.begun:
            self.common = float(tried.strengths[_strength(costs, self.settings.most_said)])
        common = int(np.abs(tried.strengths - self.common).argmin())
        for name, cost in costs.items():
            if name in self._shown:  # a twin that is still soft says less of it
                continue
            if not self._known(name) or self._now_in(cost, tried, name) > cost.min() + again:
                self._settle_on(name, cost, tried, common, self.settings.own)
        self._normal.clear()
        self.begun = True

    def _known(self, name: str) -> bool:
        """Whether anything has said what a photo's focus is."""
        now = self.effect.of(name)
        return name in self._own or (now is not None and now.strength > 0)

    def _now_in(self, cost: Array, tried: Tried, name: str) -> float:
        """Of the costs [S, F], that of a photo's values as they are."""
        now = self.effect.of(name)
        assert now is not None
        s, f = np.abs(tried.strengths - now.strength).argmin(), np.abs(tried.foci - now.focus).argmin()
        return float(cost[max(s - 1, 0) : s + 2, max(f - 1, 0) : f + 2].min())

    def search_unseen(self, name: str, table: BlurByDepth) -> None:
        """Finds the focus of a photo that is held out, with the strength that the others have."""
        row = self.effect.row_of(name)
        if row is None or not self.begun:
            return
        tried = self._tried([table])
        strengths = np.unique(np.append(tried.strengths, self.common))
        tried = Tried(strengths, tried.foci)
        cost = table.cost(tried, self.settings)
        at = int(np.searchsorted(strengths, self.common))
        self._settle_on(name, cost, tried, at, self.settings.own_unseen)

    def _settle_on(self, name: str, cost: Array, tried: Tried, common: int, own: float) -> None:
        """The best focus of a photo with the common strength, or a strength of its own that is better by `own`.

        Args:
            cost: [S, F]; common: which of the strengths is common.
        """
        self._own.discard(name)
        row, chosen, by_strength = self.effect.row_of(name), common, cost.min(axis=1)
        assert row is not None
        ripe = self._share >= self.settings.own_from
        if ripe and by_strength[common] - by_strength.min() > own:
            chosen = int(by_strength.argmin())
            self._own.add(name)
        self._set(row, tried.strengths[chosen], tried.foci[int(cost[chosen].argmin())])

    def _set(self, row: int, strength: float, focus: float) -> None:
        self.effect.parameters["strengths"][row] = float(strength)
        self.effect.parameters["foci"][row] = float(focus)

    def _tried(self, tables: Sequence[BlurByDepth]) -> Tried:
        """What fits these tables; no strength at all comes first."""
        s = self.settings
        low = float(np.median([np.quantile(t.inverse, 0.04) for t in tables]))
        high = float(np.median([np.quantile(t.inverse, 0.96) for t in tables]))
        self._range = max(high - low, 1e-3)
        widest = math.sqrt(min(float(t.variances[-1]) for t in tables))
        diagonal = tables[0].diagonal
        ends = s.narrowest / self._range / diagonal, widest / self._range / diagonal
        strengths = np.concatenate([[0.0], np.geomspace(*ends, s.strengths)])
        foci = np.linspace(max(0.0, low - s.beyond * self._range), high + s.beyond * self._range, s.foci)
        return Tried(strengths, foci)

    def learn(self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None = None) -> None:
        """Takes a part of a step of one photo's strength and focus; arguments as of `CameraPaths.learn`."""
        row, s = self.effect.row_of(name), self.settings
        if row is None or not self.begun or not self._searches:
            return
        found = self._linearised(name, exposed, photo, counts)
        now = self.effect.of(name)
        assert now is not None
        if found is None:
            return
        matrix, vector = found
        if name in self._fitted:
            self._normal[name] = matrix, vector + matrix @ np.array([now.strength, now.focus])
        self._agree()
        precision = np.diag([0.0, (0.5 * self._range) ** -2.0])
        pull = np.zeros(2)
        if name not in self._own and self.common > 0:
            precision[0, 0] = (s.alike * self.common) ** -2.0
            pull[0] = precision[0, 0] * (self.common - now.strength)
        precision[0, 0] += 1e-12
        covariance = np.linalg.inv(matrix + precision)
        self.effect.errors[row] = torch.from_numpy(np.sqrt(np.diag(covariance)))
        self._move(row, now, s.part * (covariance @ (vector + pull)))

    def _move(self, row: int, now: Focus, step: Array) -> None:
        s = self.settings
        if not np.isfinite(step).all():
            return
        most = np.array([s.longest_step * max(now.strength, self.common), s.longest_step * self._range])
        step = np.clip(step, -most, most)
        highest = 1.0 / FOCUS.nearest_depth
        self._set(row, max(0.0, now.strength + step[0]), float(np.clip(now.focus + step[1], 0.0, highest)))

    def _agree(self) -> None:
        """The common strength, from what every photo that shares it says whatever its focus."""
        values, weights = [], []
        for name, (matrix, target) in self._normal.items():
            if name in self._own:
                continue
            by_focus = matrix[1, 1] + (0.5 * self._range) ** -2.0
            weight = matrix[0, 0] - matrix[0, 1] ** 2 / by_focus
            if weight <= 0:
                continue
            values.append((target[0] - matrix[0, 1] * target[1] / by_focus) / weight)
            weights.append(1.0 / (1.0 / weight + (self.settings.alike * self.common) ** 2))
        if values:
            wanted = float(np.average(values, weights=weights))
            limit = self.settings.longest_step * self.common
            share = self.settings.part / max(1, len(values))
            self.common = max(0.0, self.common + share * float(np.clip(wanted - self.common, -limit, limit)))

    def _linearised(
        self, name: str, exposed: Exposed, photo: Tensor, counts: Tensor | None
    ) -> tuple[Array, Array] | None:
        """Gauss-Newton's matrix [2, 2] and vector [2] in (strength, focus), the photo's noise as it shows."""
        s, now = self.settings, self.effect.of(name)
        assert now is not None
        small = s.change * max(now.strength, self.common), s.change * self._range
        if small[0] <= 0:
            return None
        others = Focus(now.strength + small[0], now.focus), Focus(now.strength, now.focus + small[1])
        at = LookedAt.of(photo.shape[1], photo.shape[2], s)
        with torch.no_grad():
            still = exposed.degraded
            moved = [shown_with(exposed, self.effect, self.effect.alone(name, other), at) for other in others]
            if exposed.layers is not None:  # the slopes are those of one picture, blurred by the depth of its surface
                own = shown_with(exposed, self.effect, self.effect.alone(name, now), at)
                moved = [at.of_planes(still) + (one - own) for one in moved]
        return normal_equations(photo, still, list(zip(moved, small, strict=True)), counts, s)

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        values = torch.stack([self.effect.parameters[key] for key in ("strengths", "foci")], dim=1)
        names = list(self.effect.names)
        own = np.array([name in self._own for name in names])
        kept = np.array([[*m.ravel(), *t] for m, t in self._normal.values()]).reshape(-1, 6)
        of = np.array([names.index(name) for name in self._normal], np.int64)
        course = np.array([self.common, self._range, float(self.begun), float(self._searches), self._share])
        return {
            "focus": np.hstack([values.double().numpy(), self.effect.errors.double().numpy()]),
            "focus.own": own,
            "focus.course": course,
            "focus.normal": kept,
            "focus.normal_of": of,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        keys = ("focus", "focus.own", "focus.course", "focus.normal", "focus.normal_of")
        if any(key not in arrays for key in keys):
            return False
        values, own, course, kept, of = (arrays[key] for key in keys)
        names = list(self.effect.names)
        if values.shape != (len(self.effect.errors), 4) or own.shape != (len(names),) or not np.isfinite(values).all():
            return False
        for column, key in enumerate(("strengths", "foci")):
            self.effect.parameters[key].copy_(torch.from_numpy(values[:, column].astype(np.float32)))
        self.effect.errors.copy_(torch.from_numpy(values[:, 2:].astype(np.float32)))
        self._own = {name for name, mine in zip(names, own, strict=True) if mine}
        self.common, self._range = float(course[0]), float(course[1])
        self.begun, self._searches = bool(course[2]), int(course[3])
        self._share = float(course[4])
        self._normal = {
            names[int(i)]: (row[:4].reshape(2, 2).copy(), row[4:].copy()) for i, row in zip(of, kept, strict=True)
        }
        return True
