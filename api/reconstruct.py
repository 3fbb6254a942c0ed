"""Photos in, twin out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.effort.described import RunDescription
from ..core.effort.timing import RunTiming
from ..core.errors import DgsError
from ..core.files import make_folder, replacing
from ..core.outputs import check_output_folder
from ..core.photos.data_set import with_data_set
from ..core.pipeline.reconstruct import reconstruct as run_stages
from ..core.progress import Progress, Silent
from ..core.run_settings import RUN_MARKS, RUN_REPLACES, ReconstructSettings
from .arrays import Picture, write_photos
from .twin import Twin

#: What `reconstruct` takes by names of its own.
_APART = ("photos", "out", "psf", "cameras")


def reconstruct(
    photos: Path | str | Mapping[str, Picture] | Sequence[Picture],
    out: Path | str,
    psf: str | float | NDArray[np.floating] | None = None,
    cameras: Path | str | None = None,
    options: Mapping[str, object] | None = None,
    progress: Progress = Silent(),
) -> Twin:
    """Finds the cameras, fits sharp Gaussians that explain the blurred photos, and leaves what `dgs reconstruct` does.

    Args:
        photos: a folder, a list or a movie; or arrays [H, W, 3] (uint8, uint16, floats in [0, 1]; sRGB-encoded) by
            name or in a row, which are written to `OUT-photos`.
        out: folder for twin.ply, cameras/, report.json and the rest.
        psf: as `--psf` takes it; or a Gaussian's standard deviation in px; or a kernel [h, w], which is written to
            `OUT-psf.npy`.
        cameras: a COLMAP model or transforms.json; found from the photos if not given.
        options: all else by the names of `core.run_settings.ReconstructSettings`, such as {"preset": "draft"}.
        progress: hears of every stage and may cancel; the twin so far is then returned.

    Raises:
        DgsError: one of its subclasses says what is wrong and the way out.
    """
    place, options = Path(out), dict(options or {})
    known = {field.name for field in fields(ReconstructSettings)} - set(_APART)
    unknown = sorted(set(options) - known)
    if unknown:
        raise DgsError(f"There is no option '{unknown[0]}'", f"Choose from {', '.join(sorted(known))}")
    if not options.get("resume"):
        check_output_folder(place, RUN_MARKS, replaced=RUN_REPLACES)
    if not isinstance(photos, (str, Path)):
        photos = write_photos(place.with_name(f"{place.name}-photos"), photos)
    given = {"photos": str(photos), "out": str(place), "psf": _written(psf, place), "cameras": cameras}
    run = with_data_set(ReconstructSettings.from_plain({**options, **given}), progress).split()
    run_stages(run, progress, time.perf_counter(), partial(RunTiming, RunDescription.of(run)))
    return Twin.open(place)


def _written(psf: str | float | NDArray[np.floating] | None, out: Path) -> str | None:
    """The point spread as `--psf` takes it."""
    if psf is None or isinstance(psf, str):
        return psf
    if not isinstance(psf, np.ndarray):
        return f"gaussian:{float(psf)}"
    file = out.with_name(f"{out.name}-psf.npy")
    make_folder(file.parent)
    with replacing(file) as temporary, temporary.open("wb") as stream:
        np.save(stream, psf)
    return f"file:{file}"
