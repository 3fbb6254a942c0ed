"""View dependence: colours of the same point that change with the direction of view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords

if TYPE_CHECKING:
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class GlossSettings:
    """Numbers of the evidence for view dependence."""

    smallest_visible: float = number(
        0.05,
        "relative",
        "rms change of a point's light over the directions that it was seen from",
        SMALLEST_CHOSEN,
        SMALLEST_CHECKED,
    )
    fewest_photos: int = number(
        6, "count", "photos per point at least: a plane through the directions has three unknowns"
    )
    fewest_points: int = number(30, "count", "points at least")
    outlier: float = number(4.7, "robust sigmas", "beyond which a residual is cut (Tukey's usual 95 % efficiency)")
    least_weight: float = number(0.2, "share", "mean weight in the points' fit from which on an observation counts")
    least_error: float = number(0.004, "relative", "of the estimate")


SETTINGS = GlossSettings()


def inspect(photos: PhotoSet) -> Evidence:
    """How much of what gains, vignetting and haze leave over follows the direction, beyond chance."""
    import numpy as np  # late: the command line's help reads this file

    smallest = SETTINGS.smallest_visible
    fit, observations = photos.photometry, photos.observations
    if fit is None or observations is None:
        return unknown("view_dependence", "relative", smallest, f"Not measured: {photos.no_observations}")
    explained = []
    limit = SETTINGS.outlier * fit.spread
    order = np.argsort(observations.point, kind="stable")
    starts = np.flatnonzero(np.diff(observations.point[order], prepend=-1))
    for rows in np.split(order, starts[1:]):
        good = rows[fit.weight[rows].mean(axis=1) > SETTINGS.least_weight]
        if len(good) < SETTINGS.fewest_photos:
            continue
        rest = np.clip(fit.residual[good], -limit, limit).mean(axis=1)
        direction = observations.direction[good] - observations.direction[good].mean(axis=0)
        axes = np.linalg.svd(direction, full_matrices=False)[2][:2]
        matrix = np.column_stack([np.ones(len(good)), direction @ axes.T])
        left = rest - matrix @ np.linalg.lstsq(matrix, rest, rcond=None)[0]
        inside = float(left @ left) / max(1, len(good) - 3)
        total = float(np.var(rest, ddof=1))
        explained.append((total - inside, int(observations.block[good[0]])))
    if len(explained) < SETTINGS.fewest_points:
        return unknown("view_dependence", "relative", smallest, "Not measured: too few points are seen in six photos")
    values, blocks = np.array([e[0] for e in explained]), np.array([e[1] for e in explained])
    means = np.array([values[blocks == b].mean() for b in np.unique(blocks)])
    mean = float(values.mean())
    deviation = float(means.std(ddof=1) / np.sqrt(len(means))) if len(means) > 2 else abs(mean)
    value = float(np.sqrt(max(mean, 0.0)))
    error = max(deviation / max(2 * value, 0.03), SETTINGS.least_error)
    return judged(
        "view_dependence",
        value,
        error,
        smallest,
        "relative",
        f"A point's light changes by {100 * value:.1f} % (rms) with the direction of view",
    )


SPEC = EffectSpec(
    name="view_dependence",
    physics="Shiny surfaces mirror their surroundings, so that a point's light changes with the direction of view.",
    words=EffectWords(label="View Dependence"),
    inspect=inspect,
)
