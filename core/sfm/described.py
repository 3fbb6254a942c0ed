"""Features of photos and nothing else: what the child process does for `describe`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from . import mapping
from .attempts import DATABASE, SfmResult, lighter
from .features import FEATURES, read_features, save_features
from .job import SfmJob
from .settings import recipes


def run(job: SfmJob, say: Callable[..., None]) -> SfmResult:
    """Writes the largest features of each image into the job's folder."""
    recipe = lighter(recipes(job.kernel is not None)[0], replace(job, settings=replace(job.settings, many=0)))
    images, database = job.folder / "images", job.folder / DATABASE
    mapping.write_images(mapping.filtered_greys(job, recipe.noise_to_signal), images, job.settings.threads)
    mapping.extract(job, recipe, database, images)
    save_features(job.folder / FEATURES, read_features(database), recipe)
    return SfmResult("done", {})
