"""Files of Gaussians of any format: the table of formats, and reading and writing by a file's suffix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..cloud import GaussianCloud
from ..errors import FormatError
from .gltf import GLTF
from .ply import PLY
from .spec import FormatSpec
from .splat import SPLAT
from .spz import SPZ

#: Every format, in the order of menus.
SPLAT_FORMATS: tuple[FormatSpec, ...] = (
    PLY,  # first: what an export offers before anything is chosen
    GLTF,
    SPZ,
    SPLAT,
)


def read_suffixes() -> tuple[str, ...]:
    """Suffixes of files that are read."""
    return tuple(suffix for spec in SPLAT_FORMATS for suffix in spec.suffixes)


def dropped_suffixes() -> tuple[str, ...]:
    """Suffixes of files that are ours where they are dropped on a 3D view."""
    return tuple(suffix for spec in SPLAT_FORMATS if spec.dropped for suffix in spec.suffixes)


def written_formats() -> tuple[FormatSpec, ...]:
    """Formats that are written, each with its first suffix."""
    return tuple(spec for spec in SPLAT_FORMATS if spec.write is not None)


def read_gaussians(path: Path) -> GaussianCloud:
    """Reads a file of any format.

    Raises:
        FormatError: a suffix of no format, no such file, or a damaged one.
    """
    return _format_of(path).read(path)


def unusable(cloud: GaussianCloud) -> str:
    """What a user should hear of Gaussians that are not finite, which nothing draws; '' where all are.

    Raises:
        FormatError: there is none that is.
    """
    values = (
        cloud.means,
        cloud.log_scales,
        cloud.quaternions,
        cloud.opacity_logits[:, None],
        cloud.sh.reshape(len(cloud), -1),
    )
    finite = np.all([np.isfinite(array).all(axis=1) for array in values], axis=0)
    missing = int((~finite).sum())
    if missing and missing == len(cloud):
        raise FormatError(f"None of the {len(cloud)} Gaussians is finite", "Export the file again")
    return f"{missing} of {len(cloud)} Gaussians are not finite and are not drawn" if missing else ""


def write_gaussians(path: Path, cloud: GaussianCloud) -> None:
    """Writes a file in the format of its suffix.

    Raises:
        FormatError: a suffix of no format, or of one that is read only.
        OutputError: the file cannot be written.
    """
    spec = _format_of(path)
    if spec.write is None:
        written = ", ".join(other.suffixes[0] for other in written_formats())
        raise FormatError(f"'{path.name}' cannot be written: {spec.name} is read only", f"Use {written}")
    spec.write(path, cloud)


def _format_of(path: Path) -> FormatSpec:
    suffix = path.suffix.lower()
    for spec in SPLAT_FORMATS:
        if suffix in spec.suffixes:
            return spec
    raise FormatError(f"'{path.name}' has no known ending", f"Use {', '.join(read_suffixes())}")
