"""Which files a twin's splats come from, so that deleted ones can be brought back.

A mesh keeps its sources as JSON: the file, how many splats it had, a checksum of their centres, the row that its first
splat has in the mesh, and the motion that they have made since they were read. Each point has its row (`twin.ROW`).
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud
from ...core.errors import FormatError
from ...core.formats.gaussians import read_gaussians
from ...core.formats.turning import moved
from ...core.json_shape import check_shape, count, number, positive, text
from ...core.npy import load_npy

#: Property of the mesh.
SOURCES = "dgs_sources"
#: Beside a run's twin.ply: how far photos determine each splat.
_KNOWN_FILE = "known.npy"
_SHAPE = [{"file": text, "count": positive, "checksum": count, "first": count, "matrix": [number]}]
_AT_REST = tuple(float(value) for value in np.eye(4).reshape(16))


@dataclass(frozen=True)
class Source:
    """A file.

    Attributes:
        file: its absolute path.
        count, checksum: of the splats when they were read.
        first: the row of the file's first splat in the mesh.
        matrix: 16 numbers, rows, an evenly scaled motion: from the file's axes to the mesh's.
    """

    file: str
    count: int
    checksum: int
    first: int = 0
    matrix: tuple[float, ...] = _AT_REST

    def cloud(self) -> GaussianCloud:
        """The splats as the file has them, where they are in the mesh.

        Raises:
            FormatError: the file is gone, damaged, or another one by now.
        """
        cloud = read_gaussians(Path(self.file))
        if len(cloud) != self.count or _checksum(cloud) != self.checksum:
            raise FormatError(f"'{self.file}' has changed since the twin was added", "Import it again")
        return self.placed(cloud)

    def placed(self, cloud: GaussianCloud) -> GaussianCloud:
        """The file's splats where they are in the mesh."""
        if self.matrix == _AT_REST:
            return cloud
        matrix = np.array(self.matrix, np.float64).reshape(4, 4)
        size = float(np.linalg.det(matrix[:3, :3]) ** (1 / 3))
        return moved(cloud, matrix[:3, :3] / size, size, matrix[:3, 3])


def remember_source(mesh: Any, path: Path, cloud: GaussianCloud) -> None:
    """Says that a new mesh shows this file's splats."""
    write_sources(mesh, [source_of(path, cloud, [])])


def source_of(path: Path, cloud: GaussianCloud, before: list[Source]) -> Source:
    """A file as the only source of a mesh; its splats are moved as those of an earlier state of the file were."""
    file = str(path.absolute())
    matrix = next((source.matrix for source in before if source.file == file), _AT_REST)
    return Source(file, len(cloud), _checksum(cloud), matrix=matrix)


def read_sources(mesh: Any) -> list[Source]:
    """A mesh's sources; none where an earlier version has made it, or the property is damaged."""
    try:
        value = json.loads(str(mesh.get(SOURCES, "[]")))
        check_shape(value, _SHAPE)
        sources = [Source(**{**entry, "matrix": tuple(entry["matrix"])}) for entry in value]
    except (ValueError, TypeError, RecursionError):
        return []
    return sources if all(len(source.matrix) == 16 for source in sources) else []


def write_sources(mesh: Any, sources: list[Source]) -> None:
    """Keeps them with the mesh."""
    mesh[SOURCES] = json.dumps([asdict(source) for source in sources])


def moved_sources(sources: list[Source], matrix: NDArray[np.float64]) -> list[Source]:
    """The sources of splats that make a motion `matrix` [4, 4]."""
    return [
        replace(source, matrix=tuple(float(x) for x in (matrix @ np.array(source.matrix).reshape(4, 4)).reshape(16)))
        for source in sources
    ]


def rows_of(sources: list[Source]) -> int:
    """How many rows all sources have together."""
    return max((source.first + source.count for source in sources), default=0)


def known_of(mesh: Any, rows: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """[N] how far the photos determine each splat, from the files beside the sources; None where one is missing.

    Args:
        rows: [N] of the splats.
    """
    sources = read_sources(mesh)
    known = np.full(rows_of(sources), np.nan, np.float32)
    for source in sources:
        path = Path(source.file).with_name(_KNOWN_FILE)
        try:
            values = load_npy(path)
        except (OSError, ValueError):
            return None
        if values.shape != (source.count,):
            return None
        known[source.first : source.first + source.count] = values
    if not len(rows) or not len(known) or rows.min() < 0 or rows.max() >= len(known):
        return None
    found = known[rows]
    return None if np.isnan(found).any() else found


def _checksum(cloud: GaussianCloud) -> int:
    return zlib.crc32(np.ascontiguousarray(cloud.means, np.float32).tobytes())
