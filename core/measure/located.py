"""Places that were asked for, found on the surface, each with its covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import DgsError
from ..numbers import number
from .looking import seen_along
from .matched import SETTINGS as MATCHED
from .matched import matched_depth
from .places import PRECISION, SurfacePoint, deviation_of_depth, reach_of, surface_depth
from .rays import inside, projected, ray
from .request import AskedPlace, AskedRay, Point
from .sights import Sight, Sights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeetingSettings:
    """Of rays that are to meet."""

    farthest: float = number(1e3, "usual depths", "at which rays can be said to meet")
    parallel: float = number(1e9, "condition", "of their equations, from which on rays are parallel")
    tried: int = number(3, "cameras", "whose surface a position in space is snapped to: the nearest ones")
    settled: float = number(1e-9, "usual depths", "step at which the search ends")


MEETING = MeetingSettings()


class NothingThere(DgsError):
    """A place was set where the twin has no surface."""


def located(asked: AskedPlace, views: Sights, marks: Mapping[str, Point], cameras: float) -> SurfacePoint:
    """Finds a place.

    Args:
        asked: what was asked for.
        marks: its points in px of the undistorted views.
        cameras: standard deviation of where cameras look, px.

    Raises:
        NothingThere: there is no surface where a point of one photo lies, or a line of sight leads.
        DgsError: points of several photos are of no common place.
    """
    click = PRECISION.click if asked.click is None else asked.click
    across = float(np.hypot(click, cameras))
    if asked.ray is not None:
        return _met_by(asked.ray, views, click, cameras, f"The place '{asked.name}'")
    if asked.position is not None:
        return _snapped(asked, views)
    if len(marks) == 1:
        ((photo, point),) = marks.items()
        return on_surface(views, views.views[photo], point, across, f"The place '{asked.name}' on '{photo}'")
    return met(asked.name, views, marks, across)


def on_surface(
    views: Sights, sight: Sight, point: Point, across: float, called: str, *, match: bool = True
) -> SurfacePoint:
    """Where the ray of a photo's point meets the surface; raises NothingThere.

    Args:
        across: standard deviation of where it was set, px; called: what it is, for errors.
        match: where the twin's pictures agree, if they do; else, and without, where its splats are.
    """
    camera = sight.camera
    if not inside(camera, *point):
        raise NothingThere(
            f"{called} lies outside the photo", f"Give px from 0 to {camera.width} across and to {camera.height} down"
        )
    depth = surface_depth(sight, *point)
    if not np.isfinite(depth):
        raise NothingThere(f"{called} hits nothing: the twin has no surface there", "Set it on something that is seen")
    matched = matched_depth(views, sight, *point, depth) if match else None
    depth = depth if matched is None else matched.depth
    position = camera.centre + ray(camera, *point) * depth
    deviation, seen = deviation_of_depth(views, camera, position, matched)
    pixel = depth / camera.fx
    along = ray(camera, *point)
    # across the ray a px is a px-equivalent; along it the surface is open
    covariance = across**2 * pixel**2 * (np.eye(3) - np.outer(along, along) / (along @ along))
    return SurfacePoint(
        position, covariance + (deviation * pixel) ** 2 * np.outer(along, along), pixel, seen, reach_of(matched)
    )


def end_on_surface(views: Sights, sight: Sight, end: Point, other: Point, across: float, called: str) -> SurfacePoint:
    """As `on_surface` of an end of a profile; where the twin has a hole there, as deep as the profile's next place.

    Behind a blur a light cell before a light background may come out as a hole. Nothing to the middle: NothingThere.
    """
    start, way = np.array(end), np.array(other) - np.array(end)
    length = max(float(np.linalg.norm(way)), 1e-9)
    points = [start + way * (moved / length) for moved in range(int(length / 2) + 1)]  # a px apart
    moved = next((k for k, (x, y) in enumerate(points) if np.isfinite(surface_depth(sight, x, y))), 0)
    if moved == 0:
        return on_surface(views, sight, end, across, called)
    x, y = points[moved]
    found = on_surface(views, sight, (float(x), float(y)), across, called)
    depth = float(sight.camera.rotation[2] @ found.position + sight.camera.translation[2])
    along = ray(sight.camera, *end)
    # As much nearer or farther as it lies beside.
    covariance = found.covariance + (moved * found.pixel) ** 2 * np.outer(along, along)
    return replace(found, position=sight.camera.centre + along * depth, covariance=covariance)


def _met_by(line: AskedRay, views: Sights, click: float, cameras: float, called: str) -> SurfacePoint:
    """Where a line of sight meets the surface, or the edge that is nearest there."""
    origin, towards = views.scale.points_to_unit(np.array([line.origin, line.towards]))
    found = seen_along(views, origin, towards, line.edges)
    if found is None:
        raise NothingThere(f"{called} hits nothing: the twin has no surface there", "Set it on something that is seen")
    sight, point = found
    set_at = click * line.spread * sight.camera.fx  # (a px of the viewer's is spread * depth wide, ours depth / fx)
    across = float(np.linalg.norm([set_at, click if line.edges or not line.spread else 0.0, cameras]))
    return on_surface(views, sight, point, across, called)


def met(name: str, views: Sights, marks: Mapping[str, Point], across: float) -> SurfacePoint:
    """Where the rays of several photos' points meet, by least squares of their distances in px."""
    rays = [(views.views[photo].camera, point) for photo, point in marks.items()]
    position = _nearest_to(rays)
    for _ in range(10):
        depths = _depths(rays, position)
        if not (min(depths) > 0 and max(depths) < MEETING.farthest):  # (of unit scenes: 1 is a usual depth)
            raise DgsError(f"The rays of '{name}' meet nowhere", "Mark the same place on photos from different sides")
        rows, rest = _linear(rays, position)
        step = np.linalg.lstsq(rows, rest, rcond=None)[0]
        if float(np.linalg.norm(step)) < MEETING.settled:
            break
        position = position + step
    depths = _depths(rays, position)
    # what the points themselves disagree by counts where it is more than they were said to
    freedom = max(1, rows.shape[0] - 3)
    variance = max(across**2, float(rest @ rest) / freedom)
    pixel = float(np.median([depth / camera.fx for depth, (camera, _) in zip(depths, rays, strict=True)]))
    return SurfacePoint(position, np.linalg.inv(rows.T @ rows) * variance, pixel, len(rays))


def _depths(rays: Sequence[tuple[Camera, Point]], position: Array) -> list[float]:
    return [float((camera.rotation @ position + camera.translation)[2]) for camera, _ in rays]


def _nearest_to(rays: Sequence[tuple[Camera, Point]]) -> Array:
    """[3] point nearest to all rays."""
    total, moment = np.zeros((3, 3)), np.zeros(3)
    for camera, point in rays:
        way = ray(camera, *point)
        beside = np.eye(3) - np.outer(way, way) / (way @ way)
        total, moment = total + beside, moment + beside @ camera.centre
    if np.linalg.cond(total) > MEETING.parallel:
        return np.full(3, np.nan)
    return np.asarray(np.linalg.solve(total, moment))


def _linear(rays: Sequence[tuple[Camera, Point]], position: Array) -> tuple[Array, Array]:
    """[2 n, 3] px that a position's projections move by, and [2 n] px from them to the points."""
    rows, rest = [], []
    for camera, point in rays:
        x, y, z = camera.rotation @ position + camera.translation
        jacobian = np.array([[camera.fx / z, 0, -camera.fx * x / z**2], [0, camera.fy / z, -camera.fy * y / z**2]])
        rows.append(jacobian @ camera.rotation)
        rest.append(np.array(point) - np.array(projected(camera, position)))
    return np.concatenate(rows), np.concatenate(rest)


def _snapped(asked: AskedPlace, views: Sights) -> SurfacePoint:
    """The surface nearest to a position along the rays of the cameras that see it: of the nearest camera."""
    assert asked.position is not None
    position = views.scale.points_to_unit(np.array(asked.position)[None])[0]
    click = PRECISION.click if asked.click is None else asked.click
    found = []
    for sight in views.views.values():
        x, y = projected(sight.camera, position)
        if not inside(sight.camera, x, y):
            continue
        depth = surface_depth(sight, x, y)
        off = abs(depth - float((sight.camera.rotation @ position + sight.camera.translation)[2]))
        if off < (PRECISION.snap + MATCHED.reach) * depth / sight.camera.fx:
            found.append((off, sight, (x, y)))
    called = f"The place '{asked.name}'"
    for match in (True, False):  # a position may have been set on the splats' own surface, too
        for _, sight, point in sorted(found, key=lambda one: one[0])[: MEETING.tried]:
            place = on_surface(views, sight, point, click, called, match=match)
            if np.linalg.norm(place.position - position) < PRECISION.snap * place.pixel:
                return place
    raise NothingThere(
        f"The place '{asked.name}' lies on no surface that a camera sees", "Give a position on the twin's surface"
    )
