"""glTF 2.0 with KHR_gaussian_splatting, ratified by the Khronos Group. Needs numpy only.

A primitive of mode POINTS whose attributes are POSITION, KHR_gaussian_splatting:ROTATION (unit x y z w),
:SCALE (standard deviations, not logarithms), :OPACITY (0..1) and :SH_DEGREE_l_COEF_n (RGB; harmonics of
degree l in the order of 3DGS files). glTF's y points up and its z backward, so that y and z change their
signs against 3DGS files. COLOR_0, linear, is for programs that know no splats and show points.

https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cloud import GaussianCloud
from ..colour import srgb_to_linear
from ..constants import SH_C0, SH_COEFFICIENTS
from ..errors import FormatError
from ..files import write_bytes
from ..json_shape import anything, check_shape, text
from ..version import VERSION
from .gltf_file import Asset, glb_bytes, open_gltf
from .spec import FormatSpec
from .turning import flipped, moved

EXTENSION = "KHR_gaussian_splatting"
_PREFIX = f"{EXTENSION}:"
_NEEDED = ("POSITION", *(f"{_PREFIX}{name}" for name in ("ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0")))
#: Values of each splat; all others, which are colours, have 3.
_WIDTHS = {f"{_PREFIX}ROTATION": 4, f"{_PREFIX}OPACITY": 1}
#: What the harmonics' sums are encoded in: sRGB, as photos. 'BT.709' was a draft's name for it.
_COLOUR_SPACES = ("srgb_rec709_display", "BT.709")
#: Component types and the primitive mode, as the format numbers them.
_FLOAT, _USHORT = 5126, 5123
_POINTS = 0  # the primitive mode
#: Opacities are kept this far from 0 and 1, whose logits are infinite.
_OPACITY_MARGIN = 1e-7


def read_gltf(path: Path) -> GaussianCloud:
    """Reads all splats of a .glb or .gltf, where its scene places them.

    Raises:
        FormatError: no such file, no glTF, no splats in it, compressed ones, ones whose colours are
            linear, or a node that stretches or mirrors them.
    """
    asset = open_gltf(path)
    clouds = [
        _placed(_primitive(asset, primitive), matrix, path)
        for mesh, matrix in asset.placed_meshes()
        for primitive in mesh.get("primitives", [])
        if EXTENSION in primitive.get("extensions", {})
    ]
    if not clouds:
        raise FormatError(f"'{path}' holds no Gaussian splats ({EXTENSION})", "Choose another file")
    return flipped(_joined(clouds))


def write_gltf(path: Path, cloud: GaussianCloud) -> None:
    """Writes a .glb; every value is kept as float32, but for opacities and sizes, which are stored activated.

    Raises:
        FormatError: the ending is not .glb.
        OutputError: the file cannot be written.
    """
    if path.suffix.lower() != ".glb":
        raise FormatError(f"'{path.name}' cannot be written: one file holds everything", "Use the ending .glb")
    cloud = flipped(cloud)
    with np.errstate(over="ignore"):
        opacity = 1.0 / (1.0 + np.exp(-cloud.opacity_logits.astype(np.float64)))
    length = np.linalg.norm(cloud.quaternions, axis=1, keepdims=True)
    unit = np.where(length > 1e-12, cloud.quaternions / np.maximum(length, 1e-12), [1.0, 0.0, 0.0, 0.0])
    shown = srgb_to_linear(np.clip(0.5 + SH_C0 * cloud.sh[:, 0].astype(np.float64), 0.0, 1.0))
    colour = np.round(np.concatenate([shown, opacity[:, None]], axis=1) * 65535)
    arrays = {
        "POSITION": cloud.means,
        "COLOR_0": colour.astype("<u2"),
        f"{_PREFIX}ROTATION": unit[:, [1, 2, 3, 0]],
        f"{_PREFIX}SCALE": np.exp(np.clip(cloud.log_scales.astype(np.float64), -80.0, 80.0)),
        f"{_PREFIX}OPACITY": opacity,
    }
    for index in range(cloud.sh.shape[1]):
        degree = int(np.sqrt(index))
        arrays[f"{_PREFIX}SH_DEGREE_{degree}_COEF_{index - degree**2}"] = cloud.sh[:, index]
    write_bytes(path, _binary(arrays, path.stem))


def _binary(arrays: dict[str, NDArray[Any]], name: str) -> bytes:
    views, accessors = list[dict[str, int]](), list[dict[str, Any]]()
    attributes, data = dict[str, int](), bytearray()
    for attribute, values in arrays.items():
        kind = _USHORT if values.dtype == np.dtype("<u2") else _FLOAT
        stored = values if kind == _USHORT else values.astype("<f4")
        packed = np.ascontiguousarray(stored).tobytes()
        width = 1 if values.ndim == 1 else values.shape[1]
        accessor: dict[str, Any] = {
            "bufferView": len(views),
            "componentType": kind,
            "count": len(values),
            "type": "SCALAR" if width == 1 else f"VEC{width}",
        }
        if kind == _USHORT:
            accessor["normalized"] = True
        if attribute == "POSITION":
            accessor |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        attributes[attribute] = len(accessors)
        accessors.append(accessor)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        data += packed  # rows of 4, 8, 12 or 16 bytes: everything stays aligned
    extension = {"kernel": "ellipse", "colorSpace": _COLOUR_SPACES[0], "projection": "perspective"}
    content = {
        "asset": {"version": "2.0", "generator": f"DGS {VERSION}"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [
            {
                "name": name,
                "primitives": [{"mode": _POINTS, "attributes": attributes, "extensions": {EXTENSION: extension}}],
            }
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    return glb_bytes(content, data)


def _primitive(asset: Asset, primitive: dict[str, Any]) -> GaussianCloud:
    """In glTF's axes and the node's own place."""
    extension, attributes = primitive["extensions"][EXTENSION], primitive.get("attributes", {})
    try:
        check_shape(extension, {"extensions?": {"*": anything}, "colorSpace?": text}, EXTENSION)
    except ValueError as error:
        raise FormatError(f"'{asset.path}' is damaged ({error})", "Export it again") from error
    packed = extension.get("extensions", {})
    if packed:
        raise FormatError(f"'{asset.path}' holds compressed splats ({', '.join(packed)})", "Export it uncompressed")
    space = extension.get("colorSpace", _COLOUR_SPACES[0])
    if space not in _COLOUR_SPACES:
        raise FormatError(f"The colours of '{asset.path}' are encoded as '{space}'", "Export it with sRGB colours")
    arrays = {name: asset.array(index) for name, index in attributes.items() if name.startswith((_PREFIX, "POSITION"))}
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        raise FormatError(f"The splats of '{asset.path}' lack {', '.join(missing)}", "Export it again")
    for name, values in arrays.items():
        width = _WIDTHS.get(name, 3)
        if values.shape != (len(arrays["POSITION"]), width):
            raise FormatError(f"'{asset.path}' has {name} of shape {values.shape}", "Export it again")
    scale = arrays[f"{_PREFIX}SCALE"]
    # A draft of the extension stored logarithms, which the published one cannot hold: it has no negative scales.
    logarithms = scale if (scale < 0).any() else np.log(np.maximum(scale, 1e-30))
    opacity = np.clip(arrays[f"{_PREFIX}OPACITY"].reshape(-1), _OPACITY_MARGIN, 1.0 - _OPACITY_MARGIN)
    return GaussianCloud(
        arrays["POSITION"].astype(np.float32),
        logarithms.astype(np.float32),
        arrays[f"{_PREFIX}ROTATION"][:, [3, 0, 1, 2]].astype(np.float32),
        np.log(opacity / (1.0 - opacity)).astype(np.float32),
        np.stack(_harmonics(arrays), axis=1).astype(np.float32),
    )


def _harmonics(arrays: dict[str, NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Degree by degree, as far as a degree is complete."""
    found: list[NDArray[np.float64]] = []
    for degree in range(len(SH_COEFFICIENTS)):
        names = [f"{_PREFIX}SH_DEGREE_{degree}_COEF_{index}" for index in range(2 * degree + 1)]
        if any(name not in arrays for name in names):
            break
        found += [arrays[name] for name in names]
    return found


def _placed(cloud: GaussianCloud, matrix: NDArray[np.float64], path: Path) -> GaussianCloud:
    """The node's own transform, applied to the Gaussians."""
    linear = matrix[:3, :3]
    if np.array_equal(matrix, np.eye(4)):
        return cloud
    scale = float(np.cbrt(np.linalg.det(linear)))
    if not 0 < scale < np.inf or not np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-4 * scale**2):
        raise FormatError(f"'{path}' stretches or mirrors its splats", "Apply the node's scale before the export")
    return moved(cloud, linear / scale, scale, matrix[:3, 3])


def _joined(clouds: list[GaussianCloud]) -> GaussianCloud:
    width = max(cloud.sh.shape[1] for cloud in clouds)
    wide = [np.pad(cloud.sh, ((0, 0), (0, width - cloud.sh.shape[1]), (0, 0))) for cloud in clouds]
    return GaussianCloud(
        np.concatenate([cloud.means for cloud in clouds]),
        np.concatenate([cloud.log_scales for cloud in clouds]),
        np.concatenate([cloud.quaternions for cloud in clouds]),
        np.concatenate([cloud.opacity_logits for cloud in clouds]),
        np.concatenate(wide),
    )


GLTF = FormatSpec(
    name="glTF",
    suffixes=(".glb", ".gltf"),
    holds="KHR_gaussian_splatting in one file (.glb): for web pages, game engines and archives",
    read=read_gltf,
    write=write_gltf,
    dropped=False,  # Blender's own importer takes them
)
