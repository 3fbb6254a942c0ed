"""True points where cameras are known, and how well the cameras fit the photos; starts the child that finds them."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files import explaining, parse_json
from ..npy import read_npz
from ..numbers import number
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from .find import talk
from .job import KNOWN, POINTS, write_job
from .provenance import FIRST_TRIED, LOOKED_AT
from .settings import SfmSettings


@dataclass(frozen=True)
class FitSettings:
    """When given cameras are said not to fit their photos."""

    matches: int = number(200, "count", "matches that a judgement needs", FIRST_TRIED, LOOKED_AT)
    on_lines: float = number(
        0.35,
        "share",
        "of the matches that lie on the epipolar lines: fewer, and the cameras are not those of the photos",
        FIRST_TRIED,
        LOOKED_AT,
    )


SETTINGS = FitSettings()


@dataclass(frozen=True)
class Triangulated:
    """What features at known poses show.

    Attributes:
        positions: [M, 3] float64, world units; colours: [M, 3] uint8, grey.
        observations: [N, 2] int64, point and index into `names`.
        names: photos.
        matches: between photos, by their descriptors alone; on_lines: the share that the given cameras allow.
        reprojection_px: mean reprojection error of the points.
    """

    positions: NDArray[np.float64] = field(repr=False)
    colours: NDArray[np.uint8] = field(repr=False)
    observations: NDArray[np.int64] = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    matches: int = 0
    on_lines: float = 0.0
    reprojection_px: float = float("nan")

    @property
    def contradicts(self) -> bool:
        """Whether the photos say that these are not their cameras."""
        return self.matches >= SETTINGS.matches and self.on_lines < SETTINGS.on_lines


def triangulate(
    photos: Sequence[Photo],
    cameras: Reconstruction,
    pairs: Sequence[tuple[str, str]],
    kernel: NDArray[np.float64] | None,
    settings: SfmSettings,
    work_dir: Path,
    progress: Progress,
) -> Triangulated:
    """Matches features of chosen pairs of photos and triangulates them at the known poses.

    Args:
        photos: those that have a camera; masked px give no features.
        pairs: names of photos to be matched.
        kernel: as of `find.find_cameras`.
        work_dir: where a scratch folder is made; it is removed at the end.

    Raises:
        CameraError: the child took too long. NativeCrash: it ended unexpectedly. Cancelled: the user asked to stop.
        OutputError: no room for the scratch folder.
    """
    made = not work_dir.exists()
    with explaining(work_dir):
        work_dir.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="sfm-", dir=work_dir))
    try:
        names = write_job(list(photos), kernel, settings, folder)
        images = {name: image for image, name in names.items()}
        rows = {image: _row(cameras, name) for image, name in names.items()}
        chosen = [[images[a], images[b]] for a, b in pairs]
        with explaining(folder):
            (folder / KNOWN).write_text(json.dumps({"cameras": rows, "pairs": chosen}), encoding="utf-8")
        _, done = talk(folder, len(photos), settings, progress)
        content = read_npz(folder / POINTS)
        seen = parse_json(str(content["names"]).encode("utf-8"))
        return Triangulated(
            content["positions"],
            content["colours"],
            content["observations"],
            tuple(names[image] for image in seen),
            done["matches"],
            done["on_lines"],
            done["reprojection_px"],
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if made and not any(work_dir.iterdir()):
            work_dir.rmdir()


def _row(cameras: Reconstruction, name: str) -> dict[str, object]:
    lens, pose = cameras.lenses[name], cameras.poses[name]
    return {
        "lens": {"model": lens.model, "width": lens.width, "height": lens.height, "params": list(lens.params)},
        "rotation": pose.rotation.tolist(),
        "translation": pose.translation.tolist(),
    }
