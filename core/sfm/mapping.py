"""Features, matches, mapping: pycolmap, driven by one recipe. Runs in the child process only."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..colmap_library import pycolmap
from ..numbers import BY_DEFINITION, number
from .job import SfmJob
from .pairs import choose_pairs
from .settings import Recipe
from .sharpen import as_bytes, wiener


@dataclass(frozen=True)
class MappingSettings:
    """Of COLMAP's mapper, where it is asked for other than its defaults, and of pairs without a baseline."""

    still: float = number(
        0.03, "share of the distance", "a camera that moves by less than this only turns, as far as photos can show"
    )
    mapper_tolerance: float = number(
        1e-6, "share", "gain below which the mapper's own bundle adjustments stop: exactness there would be thrown away"
    )
    smallest_model: int = number(3, "photos", "a model of fewer checks nothing", BY_DEFINITION)
    largest_number_of_models: int = number(
        5, "count", "models that the mapper may begin: the largest is taken, more take time"
    )


SETTINGS = MappingSettings()


def filtered_greys(job: SfmJob, noise_to_signal: float) -> dict[str, NDArray[np.float32]]:
    """The grey photos in [0, 1], with the blur undone as far as noise allows."""

    def one(path: Path) -> NDArray[np.float32]:
        grey = np.load(path, allow_pickle=False).astype(np.float32) / np.float32(65535)
        if job.kernel is None or noise_to_signal == 0.0:
            return grey
        return wiener(grey, job.kernel, noise_to_signal)

    with ThreadPoolExecutor(job.settings.threads) as pool:
        return dict(zip(job.images, pool.map(one, job.images.values()), strict=True))


def write_images(greys: dict[str, NDArray[np.float32]], folder: Path, threads: int) -> None:
    """8-bit grey PNGs, as pycolmap reads them."""

    def one(item: tuple[str, NDArray[np.float32]]) -> None:
        path = folder / item[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(as_bytes(item[1])).save(path, compress_level=1)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, greys.items()))


def extract(job: SfmJob, recipe: Recipe, database: Path, images: Path) -> None:
    """SIFT features (Lowe 2004; L1-root normalised) into the database; one lens per folder."""
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = job.settings.threads
    options.use_gpu = False
    options.sift.max_num_features = recipe.max_features
    options.sift.peak_threshold = recipe.peak_threshold
    options.sift.first_octave = recipe.first_octave
    if recipe.image_size:
        options.max_image_size = recipe.image_size
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = job.settings.lens_model
    if job.masked:
        reader.mask_path = str(job.folder / "masks")
    mode = pycolmap.CameraMode.PER_FOLDER if job.settings.one_lens else pycolmap.CameraMode.PER_IMAGE
    # Threads that finish in any order would number the images in any order, and the mapper goes by number.
    with pycolmap.Database.open(database):
        pass  # makes the file
    pycolmap.import_images(database, images, camera_mode=mode, options=reader)
    pycolmap.extract_features(database, images, camera_mode=mode, reader_options=reader, extraction_options=options)
    if job.focals:
        with pycolmap.Database.open(database) as store:
            for image in store.read_all_images():
                focal = job.focals.get(image.name.split("/")[0])
                if focal is not None:
                    camera = store.read_camera(image.camera_id)
                    for at in camera.focal_length_idxs():
                        camera.params[at] = focal
                    camera.has_prior_focal_length = True
                    store.update_camera(camera)


def match(job: SfmJob, recipe: Recipe, database: Path) -> None:
    """Matches and verifies pairs: all of them in small sets, the promising ones in large sets."""
    options, verification = _matching(job, recipe)
    names = None
    if len(job.images) >= (job.settings.every_pair_below if recipe.every_pair else job.settings.choose_pairs_from):
        names = choose_pairs(database, job.settings)
    if names is None:
        pycolmap.match_exhaustive(database, options, verification_options=verification)
        return
    pairs = job.folder / "pairs.txt"
    pairs.write_text("".join(f"{a} {b}\n" for a, b in names), encoding="utf-8")
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pairs)
    pycolmap.match_image_pairs(database, options, pairing, verification)


def _matching(job: SfmJob, recipe: Recipe) -> tuple[Any, Any]:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = job.settings.threads
    options.use_gpu = False
    options.guided_matching = recipe.guided
    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = recipe.min_inliers
    verification.ransac.random_seed = recipe.seed
    verification.ransac.max_num_trials = recipe.trials
    return options, verification


def map_incrementally(
    job: SfmJob,
    recipe: Recipe,
    database: Path,
    images: Path,
    output: Path,
    joined: Any = None,
    only: list[str] | None = None,
) -> list[Any]:
    """COLMAP's incremental mapper (Schoenberger & Frahm 2016), of the images in `only` if any; largest model first."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1  # sums of several threads differ from run to run
    options.random_seed = recipe.seed
    options.min_num_matches = recipe.min_inliers
    options.min_model_size = SETTINGS.smallest_model
    options.max_num_models = SETTINGS.largest_number_of_models
    options.extract_colors = False
    options.mapper.init_min_num_inliers = recipe.init_inliers
    options.mapper.abs_pose_min_num_inliers = recipe.pose_inliers
    options.mapper.abs_pose_min_inlier_ratio = recipe.pose_ratio
    # The patch alignment and its adjustment come after; exactness here would be thrown away.
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 2.0
    options.ba_local_max_refinements = 1
    options.ba_global_max_refinements = 2
    options.ba_global_function_tolerance = options.ba_local_function_tolerance = SETTINGS.mapper_tolerance
    if only is not None:
        options.image_names = only
    output.mkdir(parents=True, exist_ok=True)
    models = pycolmap.incremental_mapping(database, images, output, options, next_image_callback=joined)
    return sorted(models.values(), key=lambda m: (-m.num_reg_images(), -m.num_points3D()))


@dataclass(frozen=True)
class PairGeometry:
    """What the verified pairs say about the motion.

    Attributes:
        images: number of photos.
        verified: pairs with enough inliers.
        connected: photos in at least one verified pair.
        flat: share of verified pairs that a homography explains (plane or pure rotation).
        rotating: share of verified pairs that a camera explains which only turned.
        contradicted: share of the verified pairs that the model which came of them does not explain.
    """

    images: int
    verified: int
    connected: int
    flat: float
    rotating: float
    contradicted: float = 0.0


def pair_geometry(database: Path) -> PairGeometry:
    """Reads the verified pairs of the database."""
    kinds = pycolmap.TwoViewGeometryConfiguration
    flat = {kinds.PLANAR, kinds.PANORAMIC, kinds.PLANAR_OR_PANORAMIC}
    connected: set[int] = set()
    homographies, centres = [], []
    verified = 0
    with pycolmap.Database.open(database) as store:
        images = {image.image_id: store.read_camera(image.camera_id) for image in store.read_all_images()}
        ids, geometries = store.read_two_view_geometries()
        for pair, geometry in zip(ids, geometries, strict=True):
            if len(geometry.inlier_matches) == 0:
                continue
            verified += 1
            first, second = pycolmap.pair_id_to_image_pair(pair)
            connected.update((first, second))
            if geometry.config in flat:
                homographies.append(np.array(geometry.H, float))
                centres.append([(images[i].width / 2, images[i].height / 2) for i in (first, second)])
    sizes = [max(camera.width, camera.height) for camera in images.values()]
    turned = _turned(np.array(homographies), np.array(centres), float(max(sizes, default=1)))
    total = max(1, verified)
    return PairGeometry(len(images), verified, len(connected), len(homographies) / total, turned / total)


def _turned(homographies: NDArray[np.float64], centres: NDArray[np.float64], size: float) -> int:
    """How many homographies are K R K^-1 for one focal length: a camera that only turned.

    With the focal length of the best fit, M = K^-1 H K of determinant 1 is a rotation up to t n^T / d;
    |M M^T - I| is the baseline as a share of the distance.
    """
    if len(homographies) == 0 or not np.isfinite(homographies).all():
        return 0
    best = 0
    for focal in size * np.geomspace(0.4, 4.0, 60):
        inner = np.zeros((len(homographies), 3, 3))
        outer = np.zeros_like(inner)
        for side, matrix in enumerate((inner, outer)):
            matrix[:, 0, 0] = matrix[:, 1, 1] = focal
            matrix[:, :2, 2], matrix[:, 2, 2] = centres[:, side], 1.0
        turn = np.linalg.inv(outer) @ homographies @ inner
        determinant = np.cbrt(np.linalg.det(turn))
        turn = turn / np.where(np.abs(determinant) < 1e-12, 1.0, determinant)[:, None, None]
        off = np.linalg.norm(turn @ turn.transpose(0, 2, 1) - np.eye(3), axis=(1, 2))
        best = max(best, int((off < SETTINGS.still).sum()))
    return best
