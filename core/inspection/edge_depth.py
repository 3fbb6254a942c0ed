"""How wide the blur is at a depth: of the edges that photos clearly share, and where those stand.

Blur that grows with the depth has no one width; edges show the width of the depth at which most of them are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..numbers import number
from .blind_psf import edges_of, shared_width
from .edge_blur import edges_as_wide

if TYPE_CHECKING:
    from .edges import Edges
    from .photo_set import PhotoSet


FIRST_ON_GLASS = "the first values, tried on three sets behind Cycles' glass; no others were compared"
NO_ALARMS = "20 sets without a glass, none taken for one"


@dataclass(frozen=True)
class EdgeDepthSettings:
    """Of the depths of edges."""

    alike: float = number(
        0.08, "log width", "from the shared one, of an edge that counts as sharing it", FIRST_ON_GLASS, NO_ALARMS
    )
    near: float = number(
        0.03,
        "of the photo's shorter side",
        "from an edge to the point that says how far it is",
        FIRST_ON_GLASS,
        NO_ALARMS,
    )
    fewest: int = number(10, "edges", "of a known depth, at least", FIRST_ON_GLASS, NO_ALARMS)


SETTINGS = EdgeDepthSettings()


@dataclass(frozen=True)
class EdgeWidth:
    """px, standard deviation of the blur, at a depth in the cameras' unit."""

    width: float
    depth: float


def width_of_edges(photos: PhotoSet) -> EdgeWidth | None:
    """The blur that edges share, and the median of their depths; None where no blur or no depth is clear."""
    observations = photos.observations
    if observations is None:
        return None
    mode = edges_of(photos)
    shared = shared_width(mode)
    if mode is None or shared is None:
        return None
    edges = edges_as_wide(photos, float(np.sqrt(mode.variance)), len(photos.greys))
    depths = _depths(photos, edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(0.5 * np.log(edges.variance / mode.variance))
    known = depths[(apart < SETTINGS.alike) & np.isfinite(depths)]
    if len(known) < SETTINGS.fewest:
        return None
    return EdgeWidth(shared[0], float(np.median(known)) * observations.median_depth)


def _depths(photos: PhotoSet, edges: Edges) -> NDArray[np.float64]:
    """[N] depth of the point that is seen nearest to each edge, in median depths; NaN where none is near."""
    reach = SETTINGS.near * min(photos.greys[0].shape)
    found = np.full(len(edges), np.nan)
    for index in np.unique(edges.photo):
        pixel, depth = photos.seen(int(index))
        if not len(depth):
            continue
        mine = np.flatnonzero(edges.photo == index)
        away, nearest = KDTree(pixel).query(np.stack([edges.x[mine], edges.y[mine]], axis=1))
        found[mine] = np.where(away < reach, depth[nearest], np.nan)
    return found
