"""The numbers of the search for changes, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from ..numbers import BY_DEFINITION, number

#: Rendered, 28 photos of 300 x 200 px through 5 px of blur, by `benchmarks.cracked_wall`.
WALL = "a rendered wall through 5 px of blur"


@dataclass(frozen=True)
class EvidenceSettings:
    """Of what photos say of a place."""

    window: int = number(11, "px", "side of the window about a place in which photos are compared", WALL)
    slow: float = number(
        25.0, "px", "standard deviation of the fields of light that are no change: shadows move, vignettes differ", WALL
    )
    same: float = number(5.0, "px", "that a camera's surface may lie off a place that it sees", WALL)
    photos: int = number(6, "count", "photos of each twin that must see a place", WALL)
    finest: int = number(400, "px", "width of a photo from which the blur may ask for a coarser grid", WALL)
    floor: float = number(
        0.05, "px-equivalent", "standard deviation that is left of every motion, whatever agrees", WALL
    )


@dataclass(frozen=True)
class AlignmentSettings:
    """Of how one twin's world is brought into the other's."""

    photos: int = number(12, "count", "photos of each twin whose features are matched, evenly chosen", WALL)
    matches: int = number(40, "count", "matches on both surfaces that must agree on one similarity", WALL)
    reach: float = number(6.0, "px", "that a match may lie off where the similarity has it", WALL)
    first_reach: float = number(15.0, "px", "as much, for similarities of three matches, which are rough", WALL)
    judges: int = number(400, "count", "matches that judge those", BY_DEFINITION)
    draws: int = number(2000, "count", "random triples that the first similarity is sought with", BY_DEFINITION)
    contrary: float = number(4.0, "factor", "by which photos may fit another world worse than their own", WALL)
    rounds: int = number(4, "count", "of refinement by the photos, each about the last one's world", WALL)
    reweighted: int = number(8, "count", "rounds in which places that say otherwise lose their weight", BY_DEFINITION)
    still: float = number(0.2, "px-equivalent", "that a round may move the surface for it to be the last one", WALL)


@dataclass(frozen=True)
class RegionSettings:
    """Of what is called a change."""

    rate: float = number(0.01, "share", "of false ones among the places called changed (Benjamini and Hochberg)", WALL)
    smallest: float = number(0.3, "px-equivalent", "motion below which none is called one", WALL)
    radii: tuple[float, ...] = number(
        (0.0, 5.0, 10.0, 16.0), "px", "of the neighbourhoods whose places are asked for one common motion", WALL
    )
    area: float = number(60.0, "px-equivalents^2", "that a region covers at least: half a window", WALL)
    left: float = number(0.5, "share", "of what photos contradict that a motion leaves, from which it is none", WALL)
    ratio: float = number(
        2.5, "factor", "of the residual's energy after and before, from which a place may be gone", WALL
    )
    front: float = number(
        2.0, "px-equivalents", "by which a surface must lie in front to have vanished or appeared", WALL
    )
    depth: float = number(
        0.8, "px-equivalent", "by which two draft twins of one scene differ in depth, in the median", WALL
    )
    halo: float = number(
        12.0, "px-equivalents", "about what is contradicted in which windows and blur see it, too", WALL
    )
    minor: float = number(0.25, "share", "of contradicted places up to which a region has only moved", WALL)
    stands_out: float = number(0.3, "share", "of what is contradicted that must lie in front to be gone or new", WALL)
    beside: float = number(1.0, "px-equivalent", "from a region's middle line from which a place is on one side", WALL)
    side_places: int = number(5, "count", "places on each side of a region that is said to have grown", WALL)
    sure: float = number(3.0, "standard deviations", "by which two sides must have gone apart", WALL)
    opposite: float = number(
        3.0,
        "times",
        "what both sides move by in common, that they must go apart: 2 is where one of them stands still",
        f"{WALL}; tiles of 27 and of 40 px that moved to the right were said to have grown by half of it",
        "all other walls of tiles",
    )
    towards: float = number(0.7, "cosine", "of a motion with the way to the cameras that is called towards them", WALL)
    shared: float = number(0.2, "share", "of the first surface's places that photos of both must show", WALL)
    depths: int = number(12, "count", "cameras at most that say which of two surfaces lies in front", WALL)
    faces: int = number(6000, "count", "faces of the mesh whose corners are asked; two places for each four", WALL)
    detail: float = number(2.0, "px", "side of the mesh's voxels", WALL)


#: `benchmarks.tiled_wall`: every second of 24 tiles of 27 px, 7 px apart, moved by 1 px through 5 px of blur.
TILES = "a rendered wall of tiles that move to the right"
OTHER_TILES = "the same upwards, and towards the cameras"
BOTH = f"{TILES}; {WALL}, of whose block a spot is found"
#: The same wall, rendered and drawn anew, twice before and six times after: 96 motions of 1 px, 48 of 2 px.
CHOSEN = "that wall rendered anew, tiles moved to the right and upwards by 1 and by 2 px"
CHECKED = "walls of larger and of smaller tiles, moved by 1, 1.4 and 2 px"


@dataclass(frozen=True)
class PartSettings:
    """Of how a region is parted, and of how large the motions of its parts are."""

    near: float = number(3.0, "px-equivalents", "about a place whose motion is asked by itself", TILES, OTHER_TILES)
    peak: float = number(0.8, "share", "of a region's places that have moved by less than its peak", TILES, OTHER_TILES)
    levels: tuple[float, ...] = number(
        (0.9, 0.8, 0.7, 0.6, 0.5),
        "share",
        "of the peak, at which parts are separated: half of it is where blur leaves an edge",
        CHOSEN,
        CHECKED,
    )
    shares: tuple[float, ...] = number(
        (0.35, 0.5, 0.65, 0.8), "share", "of the peak, from which places are tried to have moved", CHOSEN, CHECKED
    )
    about: float = number(
        22.0, "px-equivalents", "about a part where what may have gone along counts: two windows", BY_DEFINITION
    )
    sure: float = number(
        2.0,
        "standard deviations",
        "by which a motion must fall off between two parts, and a motion in the direction that is seen worst be real",
        CHOSEN,
        CHECKED,
    )
    inside: float = number(4.0, "px-equivalents", "from what does not belong to a part, for its motion", TILES)
    places: int = number(5, "count", "places of a part that are asked at least", TILES)
    photos: int = number(12, "count", "photos before which parts are moved, evenly chosen: these have no noise", TILES)
    rounds: int = number(2, "count", "in which parts are moved: by what shows, and by what is missing then", TILES)
    usual: float = number(0.8, "share", "of a motion that shows, to begin with", BY_DEFINITION)
    lowest: float = number(0.5, "share", "of a motion that shows at least: what is divided by less is a guess", BOTH)
    least: float = number(0.5, "share", "of what shows that a motion has at least", CHOSEN, CHECKED)
    noise: float = number(1.3, "factor", "by which noise in photos' gradients makes motions too small at most", CHOSEN)
    drawn: float = number(
        0.1,
        "share",
        "of a motion, standard deviation: a draft twin's own edges are as far off",
        f"{CHOSEN}: with the true tiles for supports motions come out 0.99 to 1.03 of the truth, rms 0.11 to 0.13",
        CHECKED,
    )
    small: float = number(0.1, "share", "of a change that is degraded, for its derivative", BY_DEFINITION)


@dataclass(frozen=True)
class PictureSettings:
    """Of what is drawn."""

    views: int = number(3, "count", "cameras that the picture is drawn from, evenly chosen", BY_DEFINITION)
    pale: float = number(0.35, "share", "of its darkness that what has not changed keeps", BY_DEFINITION)
    unseen: tuple[int, int, int] = number((225, 205, 160), "sRGB", "of places that too few photos show", BY_DEFINITION)
    quantile: float = number(0.98, "share", "of the moved places whose motion the colour bar holds", BY_DEFINITION)
    steps: int = number(9, "count", "colours of that bar that change.json names, evenly chosen", BY_DEFINITION)


EVIDENCE, ALIGNMENT, REGIONS = EvidenceSettings(), AlignmentSettings(), RegionSettings()
PARTS, PICTURE = PartSettings(), PictureSettings()
