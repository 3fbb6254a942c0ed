"""How wide the blur is at a depth: of edges that have nothing near them, and where those stand.

Blur that grows with the depth has no one width; edges show the width of the depth at which most of them are. Where too
few stand alone, those count that photos clearly share: among them are flanks of thin lines, up to a fifth too narrow.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..imaging.formation.glass import oblique
from ..numbers import NOT_CHECKED, number
from .blind_psf import SETTINGS as PHOTOS
from .blind_psf import edges_of, shared_width
from .edge_blur import edges_as_wide
from .lone_edges import lone_edges

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
        "from an edge to the points that say how far it is",
        FIRST_ON_GLASS,
        NO_ALARMS,
    )
    off: float = number(
        0.07,
        "share",
        "of the width of edges that stand alone, standard error",
        "three sets behind Cycles' glass: +4, -5 and +9 % beside what such glass blurs",
        NOT_CHECKED,
    )
    around: int = number(8, "points", "next to an edge that are asked")
    least_around: int = number(3, "points", "of these, at least, that are that near")
    front: float = number(
        0.2,
        "share",
        "of these that are nearer than what the edge is one of: strays",
        "two sets behind Cycles' glass: widths -1.8 and +7.6 % off, by the next point alone -6 and +5 %",
        NOT_CHECKED,
    )
    fewest: int = number(10, "edges", "of a known depth, at least", FIRST_ON_GLASS, NO_ALARMS)


SETTINGS = EdgeDepthSettings()


@dataclass(frozen=True)
class LoneWidths:
    """Edges that stand alone, of `looked_at`, and how far they are.

    Attributes:
        depths: [N] in the cameras' unit; widths: [N] px, standard deviation of the blur where the edge is.
        on_axis: [N] px, as wide as a glass would blur it on the axis.
    """

    edges: Edges = field(repr=False)
    depths: NDArray[np.float64] = field(repr=False)
    widths: NDArray[np.float64] = field(repr=False)
    on_axis: NDArray[np.float64] = field(repr=False)


@dataclass(frozen=True)
class EdgeWidth:
    """The blur of edges where they are.

    Attributes:
        width: px, standard deviation of the blur on the axis; depth: in the cameras' unit.
        alone: the edges that say so, where these stand alone.
    """

    width: float
    depth: float
    alone: LoneWidths | None = None


def width_of_edges(photos: PhotoSet) -> EdgeWidth | None:
    """The blur that edges share, and the median of their depths; None where no blur or no depth is clear."""
    if photos.observations is None:
        return None
    mode = edges_of(photos)
    shared = shared_width(mode)
    if mode is None or shared is None:
        return None
    alone = _alone(photos)
    if alone is not None:
        return EdgeWidth(float(np.median(alone.on_axis)), float(np.median(alone.depths)), alone)
    edges = edges_as_wide(photos, float(np.sqrt(mode.variance)), len(photos.greys))
    depths = _depths(photos, edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(0.5 * np.log(edges.variance / mode.variance))
    near = depths[(apart < SETTINGS.alike) & np.isfinite(depths)]
    if len(near) < SETTINGS.fewest:
        return None
    return EdgeWidth(shared[0], float(np.median(near)))


def _alone(photos: PhotoSet) -> LoneWidths | None:
    """Edges that stand alone and have a depth; None where they are too few."""
    edges = lone_edges(photos)
    depths = _depths(photos, edges)
    known = np.isfinite(depths)
    if known.sum() < SETTINGS.fewest:
        return None
    edges = edges.chosen(known)
    widths = np.sqrt(np.maximum(edges.variance - PHOTOS.own_variance, 0.0))
    return LoneWidths(edges, depths[known], widths, widths / _off_axis(photos, edges))


def _off_axis(photos: PhotoSet, edges: Edges) -> NDArray[np.float64]:
    """[N] what rough glass blurs by more at an edge than on the axis."""
    assert photos.cameras is not None
    out = np.ones(len(edges))
    for index, photo in enumerate(photos.looked_at):
        lens, mine = photos.cameras.lenses.get(photo.name), edges.photo == index
        if lens is not None:
            x, y = edges.x[mine] - lens.width / 2, edges.y[mine] - lens.height / 2
            out[mine] = oblique((x / lens.fx) ** 2 + (y / lens.fy) ** 2)
    return out


def _depths(photos: PhotoSet, edges: Edges) -> NDArray[np.float64]:
    """[N] depth of what each edge is an edge of, in the cameras' unit; NaN where no points are near.

    At the rim of something in front that is what is in front.
    """
    cameras, found = photos.cameras, np.full(len(edges), np.nan)
    assert cameras is not None
    reach = SETTINGS.near * min(photos.greys[0].shape)
    for index in np.unique(edges.photo):
        name, mine = photos.looked_at[int(index)].name, np.flatnonzero(edges.photo == index)
        if name not in cameras.poses:
            continue
        local = cameras.points.positions @ cameras.poses[name].rotation.T + cameras.poses[name].translation
        local = local[local[:, 2] > 0.0]
        if len(local) < SETTINGS.around:
            continue
        pixel = cameras.lenses[name].to_pixels(local[:, :2] / local[:, 2:])
        at = np.stack([edges.x[mine], edges.y[mine]], axis=1)
        away, near = KDTree(pixel).query(at, k=SETTINGS.around)
        depth = np.where(away < reach, np.append(local[:, 2], 0.0)[near], np.nan)
        enough = np.isfinite(depth).sum(axis=1) >= SETTINGS.least_around
        found[mine[enough]] = np.nanquantile(depth[enough], SETTINGS.front, axis=1)
    return found
