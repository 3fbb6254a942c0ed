"""Files of Gaussians of any kind, by their ending."""

from __future__ import annotations

from pathlib import Path

from ..cloud import GaussianCloud
from ..errors import FormatError
from .gltf import read_gltf, write_gltf
from .ply import read_ply, write_ply
from .splat import read_splat, write_splat
from .spz import read_spz, write_spz

_READERS = {".ply": read_ply, ".spz": read_spz, ".splat": read_splat, ".glb": read_gltf, ".gltf": read_gltf}
_WRITERS = {".ply": write_ply, ".spz": write_spz, ".splat": write_splat, ".glb": write_gltf, ".gltf": write_gltf}
#: Endings that are understood.
ENDINGS = tuple(_READERS)


def read_gaussians(path: Path) -> GaussianCloud:
    """Reads a .ply (3DGS), .spz, .splat, .glb or .gltf.

    Raises:
        FormatError: another ending, no such file, or a damaged one.
    """
    return _READERS[_ending(path)](path)


def write_gaussians(path: Path, cloud: GaussianCloud) -> None:
    """Writes a .ply (3DGS, every value kept), .glb (the same for programs of all kinds), .spz (lossy, small) or
    .splat (lossy, no gloss).

    Raises:
        FormatError: another ending, or .gltf, which is read only.
        OutputError: the file cannot be written.
    """
    _WRITERS[_ending(path)](path, cloud)


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in _READERS:
        raise FormatError(f"'{path.name}' has no known ending", f"Use {', '.join(ENDINGS)}")
    return ending
