"""Frosted glass takes the place of the point spread: what was given of either, as an effect of the chain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..camera import Camera
from ..errors import PsfError
from ..glass import GlassRequest
from ..imaging.formation.chain import Formation
from ..imaging.formation.glass import FrostedGlass, GlassScene, Stand
from ..imaging.formation.stands import middle_of, stands_between
from ..imaging.medium import Medium
from ..inspection.glass_by_points import glass_by_points
from ..inspection.photo_set import PhotoSet
from ..pose import Pose
from ..progress import Progress
from ..training.optics.glass import SETTINGS
from ..training.scale import scene_scale
from ..views import SparsePoints, View
from .effects.decision import Decision
from .simulated import SimulatedEffects


def glass_shown(effects: SimulatedEffects, estimated: bool = False) -> GlassRequest | None:
    """The glass that was chosen as the same points show it; None where none was.

    Where a point spread was given, that says how wide it blurs.

    Args:
        estimated: whether the point spread was read off the photos, like the glass, but as if all were equally far.
    """
    chosen = effects.chosen.formation.glass
    if chosen is None or chosen.spread == 0.0:
        return None
    angle = None if effects.medium.blurs and not estimated else chosen.angle
    lean = None if "tilt" not in chosen.parameters else (math.atan(chosen.tilt[0]), math.atan(chosen.tilt[1]))
    return GlassRequest(chosen.distance, angle, lean, standing=chosen.scene.stands is not None)


def with_glass(
    effects: SimulatedEffects,
    request: GlassRequest,
    points: SparsePoints,
    progress: Progress,
    source: PhotoSet | None = None,
) -> SimulatedEffects:
    """The same with a sheet of frosted glass instead of the point spread.

    Without an angle the point spread says how wide the glass blurs what lies at the scene's middle depth. Photos whose
    own point spread is none were taken without the glass. A distance that is not given is the one that the same points
    in different photos show; it is learned with the twin where they show it too roughly.

    Args:
        source: the photos with their cameras; None to ask no points.

    Raises:
        PsfError: nothing says how wide it blurs, or it stands behind what the photos show.
    """
    views, medium = effects.fitted, effects.medium
    size = scene_scale([view.camera for view in views], points).size
    camera = views[0].camera
    diagonal, focal = math.hypot(camera.width, camera.height), math.sqrt(camera.fx * camera.fy)
    every = [*views, *effects.heldout]
    clear = frozenset(name for name, psf in medium.per_view.items() if psf is None or psf.is_identity)
    behind = [view.name for view in every if view.name not in clear]
    sigma = medium.mean_sigma(behind) if behind else 0.0
    nearest, farthest = depths_between(every, points)
    _check(request, sigma, nearest)
    # (points are asked of a glass that faces the camera, and that all photos were taken through)
    ask = request.distance is None and source is not None and not clear and not request.tilted
    shown = _distance_shown(source, sigma, size, nearest) if ask and source is not None else None
    distance, error = shown or (request.distance or min(SETTINGS.begin * size, SETTINGS.nearest * nearest), 0.0)
    learned = _learned(request, bool(clear)) if request.distance is None and shown is None else frozenset[str]()
    own = effects.chosen.formation.glass
    seen = own if request in (glass_shown(effects), glass_shown(effects, estimated=True)) else None
    stands = None if not request.standing else stands_of(every) if seen is None else seen.scene.stands
    scene = GlassScene(focal / diagonal, diagonal, nearest, farthest, stands)
    far = sigma / (1.0 - distance / size) if request.angle is None else focal * request.angle
    glass = FrostedGlass.of(far / diagonal, distance, scene, clear, learned, _lean(request))
    before = next((d for d in effects.chosen.decisions if d.name == FrostedGlass.name and d.on), None)
    why = _why(request, learned, error)
    glass.errors = 0.0, error
    if before is not None and seen is not None:
        why, glass.errors, glass.tilt_errors = before.why, (0.0, seen.errors[1]), seen.tilt_errors
    progress.note(
        f"Frosted glass ({why}): {glass.sigma(size, diagonal):.2f} px wide at the scene's middle depth of {size:.3g}"
    )
    evidence = None if before is None else before.evidence
    line = Decision(FrostedGlass.name, True, why, evidence, parameters=dict(glass.described()))
    return _in_its_place(effects, glass, line, glass.sigma(size, diagonal))


def _check(request: GlassRequest, sigma: float, nearest: float) -> None:
    """Raises PsfError where a glass cannot be made of what was given."""
    if request.distance is not None and request.distance >= nearest:
        raise PsfError(
            f"A glass at {request.distance:g} stands behind what the photos show from {nearest:.3g} on",
            f"Give --glass a distance below {nearest:.2g}, in the cameras' unit",
        )
    if request.angle is None and sigma == 0.0:
        raise PsfError(
            "Nothing says how wide the glass blurs: where all photos were taken through it, none shows how sharp the "
            "scene is",
            "Give --psf gaussian:SIGMA (at the scene's middle depth), or --glass DISTANCE,ANGLE (measure-glass)",
        )


def _learned(request: GlassRequest, some_clear: bool) -> frozenset[str]:
    """What a training finds; the width only where some photos were taken without the glass."""
    return frozenset({"distance", *(["spread"] if some_clear else []), *(["tilt"] if request.tilted else [])})


def _lean(request: GlassRequest) -> tuple[float, float] | None:
    """Tangents of the tilt, where learning begins or as given; None for a glass that faces every camera."""
    if request.tilted or (request.standing and request.tilt is None):
        return 0.0, 0.0
    return None if request.tilt is None else (math.tan(request.tilt[0]), math.tan(request.tilt[1]))


def _why(request: GlassRequest, learned: frozenset[str], error: float) -> str:
    """Where distance and tilt come from."""
    if request.standing:
        return f"it stands in the world; {'its distance and tilt are learned' if learned else 'given'}"
    if learned:
        return "its distance and tilt are learned" if request.tilted else "its distance is learned"
    return "its distance as points show it" if error else "given"


def _in_its_place(effects: SimulatedEffects, glass: FrostedGlass, line: Decision, sigma: float) -> SimulatedEffects:
    """The glass instead of the point spread, and of a glass that was chosen before."""
    others = [effect for effect in effects.chosen.formation.effects if not isinstance(effect, FrostedGlass)]
    lines = [d for d in effects.chosen.decisions if d.name != FrostedGlass.name]
    chosen = replace(effects.chosen, formation=Formation([glass, *others]), decisions=[line, *lines])
    return replace(effects, chosen=chosen, medium=Medium(None, "linear"), sigma=sigma)


def middle_camera(cameras: Sequence[Camera]) -> Camera:
    """A standing glass is said as it stands before this one."""
    return cameras[middle_of(np.array([camera.centre for camera in cameras]))]


def stands_of(views: Sequence[View]) -> dict[str, Stand]:
    """Where all cameras stand against the one in their middle."""
    return stands_between({view.name: Pose(view.camera.rotation, view.camera.translation) for view in views})


def _distance_shown(source: PhotoSet, sigma: float, size: float, nearest: float) -> tuple[float, float] | None:
    """Distance and its standard error, given the width (px) at a depth; None where points show it too roughly."""
    shown = glass_by_points(source, sigma, size)
    if shown is None or shown.inside or not 0.0 < shown.distance < nearest:
        return None
    if shown.distance_error > SETTINGS.shown * shown.distance:
        return None
    return shown.distance, shown.distance_error


def depths_between(views: Sequence[View], points: SparsePoints) -> tuple[float, float]:
    """Depths between which nearly all points lie that cameras see; infinite where they see none."""
    seen = []
    positions = points.positions[:: max(1, len(points.positions) // SETTINGS.points)]
    for view in views:
        seen.append(view.camera.projected(positions)[1][view.camera.in_frame(positions)])
    depths = np.concatenate(seen)
    if not len(depths):
        return math.inf, math.inf
    nearest, farthest = np.quantile(depths, [SETTINGS.stray, 1.0 - SETTINGS.stray])
    return float(nearest), float(farthest)
