"""View dependence: colours of the same point that change with the direction of view."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..photo_set import PhotoSet

#: rms relative change of a point's light over the directions that it was seen from.
SMALLEST = 0.05
#: Photos per point at least: a plane through the directions has three unknowns.
FEWEST = 6


def inspect(photos: PhotoSet) -> Evidence:
    """How much of what gains, vignetting and haze leave over follows the direction, beyond chance."""
    fit, tracks = photos.photometry, photos.tracks
    if fit is None or tracks is None:
        return unknown("view_dependence", "relative", SMALLEST, f"Not measured: {photos.no_tracks}")
    explained = []
    limit = 4.7 * fit.spread
    order = np.argsort(tracks.point, kind="stable")
    starts = np.flatnonzero(np.diff(tracks.point[order], prepend=-1))
    for rows in np.split(order, starts[1:]):
        good = rows[fit.weight[rows].mean(axis=1) > 0.2]
        if len(good) < FEWEST:
            continue
        rest = np.clip(fit.residual[good], -limit, limit).mean(axis=1)
        direction = tracks.direction[good] - tracks.direction[good].mean(axis=0)
        axes = np.linalg.svd(direction, full_matrices=False)[2][:2]
        matrix = np.column_stack([np.ones(len(good)), direction @ axes.T])
        left = rest - matrix @ np.linalg.lstsq(matrix, rest, rcond=None)[0]
        inside = float(left @ left) / max(1, len(good) - 3)
        total = float(np.var(rest, ddof=1))
        explained.append((total - inside, int(tracks.block[good[0]])))
    if len(explained) < 30:
        return unknown("view_dependence", "relative", SMALLEST, "Not measured: too few points are seen in six photos")
    values, blocks = np.array([e[0] for e in explained]), np.array([e[1] for e in explained])
    means = np.array([values[blocks == b].mean() for b in np.unique(blocks)])
    mean = float(values.mean())
    deviation = float(means.std(ddof=1) / np.sqrt(len(means))) if len(means) > 2 else abs(mean)
    value = float(np.sqrt(max(mean, 0.0)))
    error = max(deviation / max(2 * value, 0.03), 0.004)
    return judged(
        "view_dependence",
        value,
        error,
        SMALLEST,
        "relative",
        f"A point's light changes by {100 * value:.1f} % (rms) with the direction of view",
    )
