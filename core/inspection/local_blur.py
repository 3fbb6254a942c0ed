"""How blur varies with depth and over the frame, from tiles of all photos at once.

    variance(tile) = a + b q + c q^2 + d r^2,     q = 1 / depth, r = distance from the photo's middle

Defocus is a parabola in q (a thin lens's circle of confusion is linear in 1 / depth, its variance quadratic); what
the optics do over the frame goes with r^2. Both are fitted together, as the middle of a photo is often nearer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..numbers import NOT_CHECKED, number
from .evidence import judged

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LocalBlurSettings:
    """Numbers of the fit of blur by depth and place."""

    smallest_defocus: float = number(
        1.0,
        "px",
        "smallest visible standard deviation that the blurriest depth has beyond the sharpest",
        "judgement of what shows in a twin; set once, before benchmarks/effects.py was run",
        "benchmarks/effects.py: 133 drawn sets of 12 scenes, all of one kind; no real photos",
    )
    draws: int = number(100, "count", "random draws of tiles (bootstrap) that the errors are computed from")
    fewest_tiles: int = number(40, "count", "tiles that a fit needs at least")
    least_range: float = number(
        0.1,
        "median depths",
        "between the first and the last tenth of the tiles' depths: a flatter scene shows no defocus",
    )
    least_error: float = number(0.1, "px", "smallest error that is reported for the defocus")
    bins: int = number(10, "count", "bins of equally many tiles; the fit goes through their medians")
    scene_variance: float = number(
        0.15,
        "px^2",
        "by which the blur seems to differ from bin to bin because what is seen differs",
        "drawn scenes",
        NOT_CHECKED,
    )
    scene_share: float = number(0.15, "share", "of the variance, for the same reason", "drawn scenes", NOT_CHECKED)


SETTINGS = LocalBlurSettings()


@dataclass(frozen=True)
class Tiles:
    """Blur of one region of one photo each.

    Attributes:
        photo: [N] index into `PhotoSet.looked_at`.
        x, y: [N] middle, px.
        variance, error: [N] px^2.
        depth: [N] median depth of the points in it over the set's median; NaN where unknown.
    """

    photo: NDArray[np.int64] = field(repr=False)
    x: Array = field(repr=False)
    y: Array = field(repr=False)
    variance: Array = field(repr=False)
    error: Array = field(repr=False)
    depth: Array = field(repr=False)


@dataclass(frozen=True)
class LocalBlur:
    """Blur by depth and place; variances in px^2.

    Attributes:
        by_depth: whether depths could be used.
        sharpest: least variance over the depths there are.
        defocus, defocus_error: standard deviation (px) that the blurriest depth has beyond the sharpest.
        corner, corner_error: variance at the corner minus that in the middle, px^2.
        depths, variances: [n] tiles with a depth, for pictures; curve: [2, 50] depth and fitted variance.
    """

    by_depth: bool
    sharpest: float
    defocus: float
    defocus_error: float
    corner: float
    corner_error: float
    depths: Array = field(repr=False)
    variances: Array = field(repr=False)
    curve: Array = field(repr=False)

    @property
    def defocus_significant(self) -> bool:
        """Whether blur changes with depth by more than the smallest visible."""
        return judged("", self.defocus, self.defocus_error, SETTINGS.smallest_defocus, "px", "").needed


def fit_local_blur(tiles: Tiles, height: int, width: int) -> LocalBlur | None:
    """The joint fit over photos of this size, px; None with too few tiles."""
    r2 = ((tiles.x - width / 2) ** 2 + (tiles.y - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    with_depth = np.isfinite(tiles.depth)
    by_depth = (
        with_depth.sum() >= SETTINGS.fewest_tiles
        and np.ptp(np.quantile(tiles.depth[with_depth], [0.1, 0.9])) > SETTINGS.least_range
    )
    use = with_depth if by_depth else np.ones(len(r2), bool)
    if use.sum() < SETTINGS.fewest_tiles:
        return None
    fit = _JointFit.of(tiles.variance[use], r2[use], tiles.depth[use] if by_depth else None)
    best = fit.solve(np.arange(len(fit.variance)))
    draws = [fit.solve(rows) for rows in _drawn(tiles.x[use], tiles.y[use])]
    fitted = fit.curve(best)
    lift = max(float(np.ptp(fitted)), 0.0) if by_depth else 0.0
    # The range of a noisy curve is larger than that of the true one: what noise alone gives is taken off.
    ranges = np.array([float(np.ptp(fit.curve(d))) for d in draws])
    noise = float(np.mean([np.ptp(fit.curve(d) - fitted) for d in draws]))
    lift_error = float(ranges.std())
    clean = max(lift - noise, 0.0)
    defocus = float(np.sqrt(clean))
    error = max(lift_error / max(2 * defocus, 1.0), SETTINGS.least_error) if by_depth else float("inf")
    return LocalBlur(
        by_depth,
        float(max(fitted.min(), 0.0)),
        defocus,
        error,
        float(best[-1]),
        float(np.std([d[-1] for d in draws])),
        tiles.depth[use] if by_depth else np.zeros(0),
        fit.variance,
        np.stack([1.0 / fit.grid, fitted]) if by_depth else np.zeros((2, 0)),
    )


@dataclass(frozen=True)
class _JointFit:
    """Variance as a parabola in 1 / depth and a line in r^2, [N] tiles.

    Attributes:
        off_focus, off_axis: 1 / depth and r^2 from their middles; grid: [50] of 1 / depth; middle: of that.
    """

    variance: Array
    off_focus: Array
    off_axis: Array
    grid: Array
    middle: float
    by_depth: bool

    @staticmethod
    def of(variance: Array, r2: Array, depth: Array | None) -> _JointFit:
        """Of tiles, whose depth is left out where it is None."""
        q = np.zeros(len(variance)) if depth is None else 1.0 / depth
        low, high = np.quantile(q, [0.05, 0.95])
        middle = (low + high) / 2
        off_axis = r2 - float(np.median(r2))
        return _JointFit(variance, q - middle, off_axis, np.linspace(low, high, 50), middle, depth is not None)

    def solve(self, rows: NDArray[np.int64]) -> Array:
        """[4] parabola and slope, of some tiles, by turns, each through medians of bins."""
        v, q, r = self.variance[rows], self.off_focus[rows], self.off_axis[rows]
        slope, parabola = 0.0, np.zeros(3)
        for _ in range(3):
            if self.by_depth:
                x, y, sd = _binned(q, v - slope * r)
                parabola = _polynomial(x, y, sd, 2)
            else:
                parabola = np.array([np.median(v - slope * r), 0.0, 0.0])
            x, y, sd = _binned(r, v - np.polyval(parabola[::-1], q))
            slope = float(_polynomial(x, y, sd, 1)[1])
        return np.array([*parabola, slope])

    def curve(self, solution: Array) -> Array:
        """[50] variance on the grid."""
        return np.asarray(np.polyval(solution[2::-1], self.grid - self.middle))


def _drawn(x: Array, y: Array) -> Iterator[NDArray[np.int64]]:
    """Rows of tiles, drawn often: whole places, as tiles at one place of neighbouring photos show the same."""
    random = np.random.default_rng(0)
    place = np.round(x / 8).astype(int) * 1000 + np.round(y / 8).astype(int)
    groups = np.unique(place)
    members = [np.flatnonzero(place == g) for g in groups]
    for _ in range(SETTINGS.draws):
        yield np.concatenate([members[g] for g in random.integers(0, len(groups), len(groups))])


def _binned(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Median x, median y and its standard deviation in bins that hold equally many: tiles' scatter has long tails."""
    order = np.argsort(x, kind="stable")
    each, more = divmod(len(order), SETTINGS.bins)
    parts = order[: more * (each + 1)].reshape(more, each + 1), order[more * (each + 1) :].reshape(-1, max(each, 1))
    rows = [of for of in parts if of.size and of.shape[1] >= 3]
    found = [np.median(y[of], axis=1) for of in rows]
    off = [np.median(np.abs(y[of] - m[:, None]), axis=1) for of, m in zip(rows, found, strict=True)]
    middles, scatter = np.concatenate(found), 1.4826 * np.concatenate(off)
    counts = np.repeat([of.shape[1] for of in rows], [len(of) for of in rows])
    deviation = np.sqrt(
        1.57 * scatter**2 / counts + SETTINGS.scene_variance**2 + (SETTINGS.scene_share * np.abs(middles)) ** 2
    )
    return np.concatenate([np.median(x[of], axis=1) for of in rows]), middles, deviation


def _polynomial(x: Array, y: Array, deviation: Array, degree: int) -> Array:
    """Coefficients, constant first, weighted by 1 / deviation."""
    matrix = np.vander(x, degree + 1, increasing=True) / deviation[:, None]
    return np.asarray(np.linalg.lstsq(matrix, y / deviation, rcond=None)[0])
