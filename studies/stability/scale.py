"""Units and places of the world: UTM coordinates, millimetres, kilometres, and scenes without extent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from ...core.errors import CameraError
from ...core.lens import Lens
from ...core.pipeline.views import Viewer
from ...core.pipeline.world import near_origin
from ...core.pose import Pose
from ...core.rasterizer import render
from ...core.reconstruction import Figures, Reconstruction
from ...core.training.density.initial import first_gaussians
from ...core.training.scale import SceneScale, scene_scale
from ...core.views import SparsePoints
from .case import Site, case, explained
from .photographed import moved_world, small_set, trained_steps
from .scenes import random_scene

STEPS = 24


def _apart(size: float, offset: float, density_every: int = 10) -> float:
    """Mean difference of two twins' pictures, trained here and in another world."""
    views, points, medium = small_set(6)
    there_views, there_points = moved_world(views, points, size, offset * np.array([1.0, -1.0, 0.5]))
    images = []
    for v, p in ((views, points), (there_views, there_points)):
        trainer = trained_steps(v, p, medium, STEPS, density_every=density_every)
        level = trainer.levels[-1]
        with torch.no_grad():
            images.append(render(trainer.optimizer.gaussians, level.views[2].camera).image)
    return float((images[0] - images[1]).abs().mean())


@case("scale", "units of 2^-10 and 2^10", "training gives the same picture, to the bit", 0.0, "nothing is rounded")
def exact_units(site: Site) -> float:
    """Powers of two change no digit: whatever depends on the units shows, density control included."""
    return max(_apart(2.0**-10, 0.0), _apart(2.0**10, 0.0))


@case(
    "scale",
    "units of 1e-3 and 1e3",
    "training without density control gives the same picture, mean difference",
    1e-3,
    "rounding differs in the last bit, and signs in the loss let few steps part; which of two nearly equal Gaussians "
    "is split may differ then, too, on some processors: hence without",
)
def units(site: Site) -> float:
    """Photogrammetry in millimetres or kilometres: step sizes and the near plane must follow."""
    return max(_apart(size, 0.0, density_every=2 * STEPS) for size in (1e-3, 1e3))


@case("scale", "world 1e6 away", "training gives the same picture, mean difference", 1e-3, "as above")
def utm_training(site: Site) -> float:
    """UTM coordinates: float32 numbers near 1e6 lie 0.06 apart."""
    return _apart(1.0, 1e6)


@case(
    "scale",
    "a twin 1e6 away in a float32 file",
    "places are kept to 1e-6 of the viewing distance",
    1e-6,
    "float32's rounding at coordinates of about 1",
)
def utm_file(site: Site) -> float:
    """PLY files hold float32: cameras and twin are moved near the origin, and the report keeps the offset."""
    views, points, _ = small_set(6)
    views, points = moved_world(views, points, 1.0, np.array([5e5, 5.2e6, 100.0]))
    poses = {v.name: Pose(v.camera.rotation, v.camera.translation) for v in views}
    given = Reconstruction(poses, {}, points, Figures("colmap", 6, 6, 62.0, math.nan, math.nan, 0.0))
    moved, offset = near_origin(given)
    if offset is None:
        return math.inf
    kept = moved.points.positions.astype(np.float32).astype(np.float64) + offset
    centres = max(float(np.abs(moved.poses[n].centre + offset - poses[n].centre).max()) for n in poses)
    return max(float(np.abs(kept - points.positions).max()) / 3.0, centres / 3.0)


@case("scale", "a world that needs no move", "is left alone, to the bit", 0.0, "a count of violations")
def nothing_to_move(site: Site) -> float:
    """Structure from motion's own worlds lie at their origin."""
    views, points, _ = small_set(6)
    poses = {v.name: Pose(v.camera.rotation, v.camera.translation) for v in views}
    given = Reconstruction(poses, {}, points, Figures("colmap", 6, 6, 62.0, math.nan, math.nan, 0.0))
    moved, offset = near_origin(given)
    return float(offset is not None or moved is not given)


@case("scale", "world to unit and back", "the same Gaussians", 1e-6, "float32's rounding, in units of the scene")
def there_and_back(site: Site) -> float:
    """What is trained in units of the scene is saved in units of the world."""
    scene, errors = random_scene(50, 1), []
    for size in (1e-6, 1e-3, 1e3, 1e6):
        unit = SceneScale(size * np.array([3.0, -2.0, 1.0]), size)
        again = unit.to_unit(unit.to_world(scene))
        errors.append(float((again.means - scene.means).abs().max()))
        errors.append(float((again.log_scales - scene.log_scales).abs().max()) / 10)
    return max(errors)


@case("scale", "near plane in units of the scene", "a twin in other units is drawn alike", 5e-5, "centres of float32")
def viewer_units(site: Site) -> float:
    """A near plane in world units would swallow a scene in kilometres, or let one in millimetres stand in the lens."""
    views, points, _ = small_set(4)
    lens = Lens("PINHOLE", 64, 48, (62.0, 62.0, 32.0, 24.0))
    pictures = []
    for size in (1.0, 1e-4, 1e4):
        moved, cloud = moved_world(views, points, size, np.zeros(3))
        scale = scene_scale([v.camera for v in moved], cloud)
        twin = random_scene(60, 0, seed=9)
        twin.means[:, 2] -= 3.5
        twin.means *= size
        twin.log_scales += math.log(size)
        camera = moved[1].camera
        pictures.append(Viewer(twin, scale, "cpu").sharp(lens, Pose(camera.rotation, camera.translation)))
    return float(max(np.abs(p - pictures[0]).max() for p in pictures[1:]))


@case("scale", "points without extent", "finite Gaussians, within the budget", 0.0, "a count of violations")
def no_extent(site: Site) -> float:
    """All points in one site, on a line, twice the same, one alone."""
    views, points, _ = small_set(4)
    violations = 0
    line = points.positions * [1.0, 0.0, 0.0]
    for positions in (np.zeros((50, 3)), line, np.repeat(points.positions[:5], 9, axis=0), points.positions[:1]):
        gaussians = first_gaussians(
            [v.camera for v in views],
            lambda i: views[i].planes(),
            SparsePoints(positions, np.full((len(positions), 3), 90, np.uint8)),
            300,
            1,
            np.random.default_rng(0),
        )
        violations += not 1 <= len(gaussians) <= 300
        violations += sum(int((~t.isfinite()).sum()) for _, t in gaussians.named())
    return float(violations)


@case("scale", "no point before a camera", "a typed error with a way out", 0.0, "a count of violations")
def nothing_in_front(site: Site) -> float:
    """Cameras of another convention look away from their points; or there are no points at all."""
    views, points, _ = small_set(4)
    behind = replace(points, positions=points.positions + [0.0, 0.0, -100.0])
    none = SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    for cloud in (behind, none):
        with explained(CameraError):
            scene_scale([v.camera for v in views], cloud)
    return 0.0
