"""Recipe after recipe, until the cameras can be trusted. Runs in the child process only."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..colmap_library import pycolmap
from ..numbers import BY_DEFINITION, number
from ..reconstruction import CONTRADICTED, Attempt
from . import courses, keyframes, mapping
from .contradictions import agreement
from .features import FEATURES, read_features, save_features
from .job import SfmJob
from .refine import pixel_exact
from .settings import Recipe, SfmSettings, recipes

#: COLMAP's, of one attempt.
DATABASE = "database.db"
Say = Callable[..., None]


@dataclass(frozen=True)
class TrustSettings:
    """When a model is believed, and what is said of it where it is not."""

    shortest_focal: float = number(
        0.2, "longest sides", "no camera has a shorter focal length (150 degrees wide)", BY_DEFINITION
    )
    longest_focal: float = number(
        8.0, "longest sides", "no camera has a longer focal length (7 degrees wide)", BY_DEFINITION
    )
    largest_reprojection: float = number(1.5, "px", "a larger mean reprojection error is no fit")
    smallest_angle: float = number(1.0, "degrees", "rays that meet at less than this show no depth")
    rotating_share: float = number(
        0.8, "share", "of pairs that a camera explains which only turned, above which no depth is believed"
    )
    flat_share: float = number(0.8, "share", "of flat pairs, above which a failure is put down to a flat scene")
    points_per_photo: int = number(
        20,
        "count",
        "a photo that sees fewer points than this on average hangs on chance. (Points seen, not points in all: on a"
        " rail fifty photos may share the same few hundred.)",
    )
    contradicted_share: float = number(
        0.05,
        "share",
        "of the pairs that a model does not explain, from which on it is doubted: pairs of things that only look alike"
        " are fewer",
        "an indoor set of 48 photos: wrong models 0.15 and 0.16, right ones 0 to 0.014",
    )
    missing_share: float = number(
        0.05,
        "share",
        "of the photos that a trusted model may lack without that they are looked for by other features: further"
        " recipes take longer than the first (brighton, shaken: 36 s more for one photo of 24)",
    )
    joined_share: float = number(0.25, "share", "of the photos that must join for a model, or be tied to another one")


SETTINGS = TrustSettings()


@dataclass(frozen=True)
class SfmResult:
    """kind 'done' or 'failed', and the message to the parent."""

    kind: str
    message: dict[str, Any]


def run(job: SfmJob, say: Say) -> SfmResult:
    """Tries the recipes; leaves the best trusted model in `job.folder`/best."""
    pycolmap.logging.minloglevel = 3
    pycolmap.logging.logtostderr = True
    started = time.perf_counter()
    best: tuple[tuple[bool, float], Any, Attempt] | None = None
    kept: tuple[Path, Recipe] | None = None
    log: list[Attempt] = []
    geometries: list[mapping.PairGeometry] = []
    for index, recipe in enumerate(recipes(job.kernel is not None)):
        if index and (time.perf_counter() - started > job.settings.time_limit or _enough(best, recipe, job)):
            break
        begun = time.perf_counter()
        recipe = lighter(recipe, job)
        model, geometry = _try(job, recipe, index, say)
        geometries.append(geometry)
        attempt = judge(model, geometry, job.settings, recipe)
        attempt = replace(attempt, seconds=time.perf_counter() - begun)
        log.append(attempt)
        say(attempt=asdict(attempt))
        if model is not None and attempt.verdict in ("trusted", "incomplete", CONTRADICTED):
            photos = attempt.registered * (1.0 - attempt.contradicted) + min(0.9, attempt.points / 1e5)
            score = (attempt.verdict == "trusted", photos)
            if best is None or score > best[0]:
                best, kept = (score, model, attempt), (job.folder / f"try{index}" / DATABASE, recipe)
        if geometry.rotating > SETTINGS.rotating_share:
            break
    if best is None:
        return SfmResult("failed", explain(geometries, log, len(job.images)))
    output = job.folder / "best"
    output.mkdir(exist_ok=True)
    best[1].write_binary(str(output))
    if kept is not None:
        save_features(output / FEATURES, read_features(kept[0]), kept[1])
    return SfmResult("done", asdict(best[2]))


def _enough(best: tuple[tuple[bool, float], Any, Attempt] | None, following: Recipe, job: SfmJob) -> bool:
    """Whether the recipe that follows need not be tried."""
    if best is None or best[2].verdict != "trusted":
        return False
    complete = best[2].registered >= (1.0 - SETTINGS.missing_share) * len(job.images)
    return complete or not following.for_missing or len(job.images) >= job.settings.many


def lighter(recipe: Recipe, job: SfmJob) -> Recipe:
    """The recipe for large sets, whose photos are tied together many times over."""
    settings = job.settings
    if len(job.images) < settings.many:
        return recipe
    size = 0
    if job.kernel is not None and recipe.noise_to_signal > 0 and _narrowest(job.kernel) >= settings.many_sigma:
        size = max(np.load(next(iter(job.images.values())), allow_pickle=False).shape) // 2
    return replace(recipe, max_features=min(recipe.max_features, settings.many_features), guided=False, image_size=size)


def _narrowest(kernel: NDArray[np.float64]) -> float:
    """Standard deviation (px) of a kernel along its narrower axis."""
    at = [np.arange(n) - (n - 1) / 2 for n in kernel.shape]
    return float(min(np.sqrt((kernel.sum(axis=1 - i) * x**2).sum()) for i, x in enumerate(at)))


def _try(job: SfmJob, recipe: Recipe, index: int, say: Say) -> tuple[Any, mapping.PairGeometry]:
    folder = job.folder / f"try{index}"
    images, database = folder / "images", folder / DATABASE
    folder.mkdir(exist_ok=True)
    say(stage="features", recipe=recipe.name)
    greys = mapping.filtered_greys(job, recipe.noise_to_signal)
    mapping.write_images(greys, images, job.settings.threads)
    mapping.extract(job, recipe, database, images)
    say(stage="matches", recipe=recipe.name)
    mapping.match(job, recipe, database)
    geometry = mapping.pair_geometry(database)
    say(stage="mapping", recipe=recipe.name)
    joined = 0

    def count() -> None:
        nonlocal joined
        joined += 1
        say(joined=joined)

    models = folder / "models"
    model = _by_keyframes(job, recipe, database, images, models, greys, count)
    if model is None:
        joined = 0
        model = courses.best(job, recipe, database, images, models, SETTINGS.contradicted_share, count)
        if model is not None and job.settings.refine.rounds > 0:
            say(stage="refinement", recipe=recipe.name)
            settings = job.settings.unfiltered() if job.kernel is None else job.settings.refine
            model = pixel_exact(model, greys, settings)
    if model is not None:
        geometry = replace(geometry, contradicted=agreement(database, model).contradicted)
        model.extract_colors_for_all_images(str(images))
    shutil.rmtree(images)
    return model, geometry


def _by_keyframes(
    job: SfmJob, recipe: Recipe, database: Path, images: Path, output: Path, greys: dict[str, Any], count: Say
) -> Any | None:
    """The short way for large sets, see `core.sfm.keyframes`; None where it does not lead to all photos."""
    settings = job.settings
    if len(job.images) < settings.many or settings.refine_many.rounds == 0:
        return None
    matches = keyframes.read_matches(database)
    chosen = keyframes.choose_keyframes(matches, recipe.pose_inliers)
    if chosen is None:
        return None
    found = mapping.map_incrementally(job, recipe, database, images, output, count, chosen)
    if not found or found[0].num_reg_images() < (1.0 - keyframes.SETTINGS.unplaced_share) * len(chosen):
        return None
    model = pixel_exact(found[0], greys, settings.refine_many)
    return keyframes.place_others(model, matches, greys, recipe, settings.refine_many, count)


def judge(model: Any, geometry: mapping.PairGeometry, settings: SfmSettings, recipe: Recipe) -> Attempt:
    """Whether a model is to be trusted: 'trusted', 'incomplete' (few photos), or why not."""
    attempt = Attempt(recipe.name, recipe.reason)
    given = geometry.images
    if model is None or model.num_reg_images() < 2:
        return replace(attempt, verdict="no model")
    registered = model.num_reg_images()
    cameras = [model.cameras[model.images[i].camera_id] for i in model.reg_image_ids()]
    shares = np.array([c.mean_focal_length() / max(c.width, c.height) for c in cameras])
    model.update_point_3d_errors()
    attempt = replace(
        attempt,
        registered=registered,
        points=model.num_points3D(),
        focal_px=float(np.mean([c.mean_focal_length() for c in cameras])),
        reprojection_px=float(model.compute_mean_reprojection_error()),
        angle_deg=widest_angle(model),
        contradicted=geometry.contradicted,
    )
    verdict = "trusted"
    if geometry.rotating > SETTINGS.rotating_share:  # bundle adjustment may invent depth for it all the same
        verdict = "the camera only turned"
    elif registered < 3 or registered < SETTINGS.joined_share * given:
        verdict = "too few photos joined"
    elif not (SETTINGS.shortest_focal < shares.min() and shares.max() < SETTINGS.longest_focal):
        verdict = "implausible focal length"
    elif not attempt.reprojection_px < SETTINGS.largest_reprojection:
        verdict = "large reprojection error"
    elif attempt.angle_deg < SETTINGS.smallest_angle:
        verdict = "rays too parallel"
    elif model.compute_num_observations() < SETTINGS.points_per_photo * registered:
        verdict = "too few points"
    elif registered < settings.minimum_share * given:
        verdict = "incomplete"
    elif geometry.contradicted > SETTINGS.contradicted_share:
        verdict = CONTRADICTED
    return replace(attempt, verdict=verdict)


def widest_angle(model: Any) -> float:
    """Median over the points of the widest angle (degrees) between two rays that meet there."""
    centres = {i: np.array(model.images[i].projection_center()) for i in model.reg_image_ids()}
    angles = []
    for point_id in sorted(model.point3D_ids())[:: max(1, model.num_points3D() // 1000)]:
        point = model.points3D[point_id]
        rays = np.array([centres[e.image_id] - point.xyz for e in point.track.elements])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1.0, 1.0))))
    return float(np.median(angles)) if angles else 0.0


def explain(geometries: list[mapping.PairGeometry], log: list[Attempt], given: int) -> dict[str, str]:
    """Why no recipe led to cameras, as the kind of error and its two sentences."""
    tried = ", ".join(f"{a.name}: {a.verdict}" for a in log)
    most = max(geometries, key=lambda g: (g.connected, g.verified))
    parallel = any(a.verdict == "rays too parallel" for a in log)
    if most.connected < max(3, SETTINGS.joined_share * given) and most.connected < given:
        return {
            "kind": "NoOverlap",
            "what": f"Only {most.connected} of {given} photos share enough detail with another one ({tried})",
            "way_out": "Take photos whose views overlap by at least two thirds, check the point spread"
            " function, or give your own cameras with --cameras",
        }
    if parallel or most.rotating > SETTINGS.rotating_share or most.flat > SETTINGS.flat_share:
        return {
            "kind": "DegenerateMotion",
            "what": f"The photos show a flat scene or a camera that only turned ({most.flat:.0%} of the"
            f" pairs; {tried})",
            "way_out": "Move the camera sideways between photos, put something with depth into the"
            " scene, or give your own cameras with --cameras",
        }
    return {
        "kind": "CameraError",
        "what": f"No trustworthy cameras were found for {given} photos ({tried})",
        "way_out": "Take more overlapping photos, check the point spread function, or give your"
        " own cameras with --cameras",
    }
