"""3DGS PLY files, the layout that every splat viewer reads (Kerbl et al. 2023).

One vertex per Gaussian: `x y z`, `nx ny nz` (unused), `f_dc_0..2` (zeroth harmonic, R G B),
`f_rest_*` (the other harmonics, all of red first, then green, then blue), `opacity` (logit),
`scale_0..2` (natural logarithm), `rot_0..3` (w x y z). Needs numpy and plyfile only.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyParseError

from ..cloud import GaussianCloud
from ..errors import FormatError
from ..files import replacing
from .spec import FormatSpec

_MEANS = ("x", "y", "z")
_BASE = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_COEFFICIENTS = 16  #: harmonics up to degree 3; files of higher degree are cut to it


def read_ply(path: Path | str) -> GaussianCloud:
    """Reads a 3DGS PLY: ASCII or binary of either byte order, any harmonics, extra fields ignored.

    Args:
        path: the file; `f_rest` may be missing (degree 0), degrees above 3 are cut to 3.

    Returns:
        Arrays of their own (the file is closed), float32, in the file's world units.

    Raises:
        FormatError: no such file, no 3DGS PLY, or fewer Gaussians than the header declares.
    """
    path = Path(path)
    try:
        vertices = _vertices(path)
    except FileNotFoundError as error:
        raise FormatError(f"There is no file '{path}'", "Give the path of a 3DGS PLY") from error
    except KeyError as error:
        raise FormatError(f"'{path}' has no vertices", "Give a PLY of 3D Gaussian splats") from error
    except PlyParseError as error:
        if "end-of-file" in str(error):
            raise FormatError(
                f"'{path}' declares more Gaussians than it holds; it was cut off", "Export or download it again"
            ) from error
        raise FormatError(f"'{path}' is no readable PLY: {_one_line(error)}", "Export it again") from error
    except (OSError, ValueError, MemoryError, OverflowError) as error:
        raise FormatError(f"'{path}' cannot be read as a PLY: {_one_line(error)}", "Export it again") from error
    names = vertices.dtype.names or ()
    if "packed_position" in names:
        raise FormatError(f"'{path}' is a compressed PLY", "Export it as an uncompressed 3DGS PLY")
    missing = [n for n in (*_MEANS, *_BASE, "opacity", *_SCALES, *_ROTATION) if n not in names]
    if missing:
        raise FormatError(
            f"'{path}' is not a PLY of 3D Gaussian splats: it lacks {', '.join(missing)}",
            "Give a PLY in the 3DGS layout, for example a twin.ply",
        )
    return GaussianCloud(
        means=_columns(path, vertices, _MEANS),
        log_scales=_columns(path, vertices, _SCALES),
        quaternions=_columns(path, vertices, _ROTATION),
        opacity_logits=_columns(path, vertices, ("opacity",))[:, 0].copy(),
        sh=_harmonics(path, vertices),
    )


def write_ply(path: Path | str, cloud: GaussianCloud) -> None:
    """Writes a binary little-endian 3DGS PLY, whole or not at all.

    Raises:
        OutputError: the disk is full or the folder cannot be written to.
    """
    count, coefficients, _ = cloud.sh.shape
    rest = [f"f_rest_{i}" for i in range(3 * (coefficients - 1))]
    names = [*_MEANS, "nx", "ny", "nz", *_BASE, *rest, "opacity", *_SCALES, *_ROTATION]
    values = np.concatenate(
        [
            cloud.means,
            np.zeros((count, 3)),
            cloud.sh[:, 0],
            cloud.sh[:, 1:].transpose(0, 2, 1).reshape(count, len(rest)),
            cloud.opacity_logits[:, None],
            cloud.log_scales,
            cloud.quaternions,
        ],
        axis=1,
    ).astype("<f4")
    vertices = np.ascontiguousarray(values).view([(name, "<f4") for name in names])[:, 0]
    with replacing(Path(path)) as temporary:
        PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(temporary))


def _vertices(path: Path) -> NDArray[np.void]:
    """The vertices, in memory; mapped only while they are copied: value by value takes 27 s for a million."""
    try:
        return np.array(PlyData.read(str(path))["vertex"].data)
    except ValueError:  # no values to map: no vertices, or text
        return np.array(PlyData.read(str(path), mmap=False)["vertex"].data)


def _columns(path: Path, vertices: NDArray[np.void], names: tuple[str, ...]) -> NDArray[np.float32]:
    """The named fields side by side, [N, len(names)] float32."""
    for name in names:
        if vertices.dtype[name].kind not in "fiu":
            raise FormatError(f"Field '{name}' of '{path}' holds no numbers", "Export it again")
    columns = np.empty((len(vertices), len(names)), np.float32)
    for index, name in enumerate(names):
        columns[:, index] = vertices[name]
    return columns


def _harmonics(path: Path, vertices: NDArray[np.void]) -> NDArray[np.float32]:
    """Spherical harmonics [N, K, 3]; in the file each channel's coefficients stand together."""
    base = _columns(path, vertices, _BASE)[:, None, :]
    present = {name for name in vertices.dtype.names or () if name.startswith("f_rest_")}
    names = tuple(f"f_rest_{i}" for i in range(len(present)))
    per_channel, left_over = divmod(len(names), 3)
    if set(names) != present or left_over or math.isqrt(per_channel + 1) ** 2 != per_channel + 1:
        raise FormatError(
            f"'{path}' has {len(present)} f_rest fields, which is no full set of spherical harmonics",
            "Export it again with harmonics of degree 0, 1, 2 or 3",
        )
    if not names:
        return base
    rest = _columns(path, vertices, names).reshape(len(vertices), 3, per_channel).transpose(0, 2, 1)
    return np.ascontiguousarray(np.concatenate([base, rest], axis=1)[:, :_COEFFICIENTS])


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


PLY = FormatSpec(
    name="3DGS PLY",
    suffixes=(".ply",),
    holds="Every value as it is; every viewer reads it",
    read=read_ply,
    write=write_ply,
)
