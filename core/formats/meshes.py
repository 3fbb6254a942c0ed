"""Files of meshes: GLB and OBJ with y up, PLY in the twin's own world. Needs numpy and plyfile only.

Colours of a GLB are linear, as glTF wants them; those of the others are sRGB. A GLB and a PLY also hold each corner's
standard deviation along the normal (`_DEVIATION`, `deviation`), in the unit of the positions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from ..colour import srgb_to_linear
from ..errors import FormatError
from ..files import replacing, write_bytes
from ..triangles import Mesh
from ..version import VERSION
from .gltf_file import glb_bytes

#: Endings of the files that can be written.
SUFFIXES = (".glb", ".obj", ".ply")
#: Component types as glTF numbers them.
_TYPES = {"<f4": 5126, "<u2": 5123, "<u4": 5125}
#: What a part of a buffer is for, as glTF numbers it.
_TARGETS = {"corners": 34962, "faces": 34963}
#: The engine's y points down and its z away: half a turn about x has y up, as glTF and OBJ want it.
_TURNED = np.array([1.0, -1.0, -1.0])


def check_mesh_name(path: Path) -> None:
    """Raises FormatError where a name has no ending that can be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(f"'{path.name}' is no mesh that can be written", f"End its name with {', '.join(SUFFIXES)}")


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Writes a mesh in the format of the file's ending.

    Raises:
        FormatError: another ending. OutputError: the file cannot be written.
    """
    check_mesh_name(path)
    {".glb": _write_glb, ".obj": _write_obj, ".ply": _write_ply}[path.suffix.lower()](path, mesh)


def _write_glb(path: Path, mesh: Mesh) -> None:
    arrays: dict[str, NDArray[Any]] = {"POSITION": (mesh.vertices * _TURNED).astype("<f4")}
    arrays["NORMAL"] = (mesh.normals() * _TURNED).astype("<f4")
    if mesh.colours is not None:
        linear = np.ones((len(mesh.vertices), 4))
        linear[:, :3] = srgb_to_linear(mesh.colours.astype(np.float64) / 255.0)
        arrays["COLOR_0"] = np.round(linear * 65535).astype("<u2")
    if mesh.deviation is not None:
        arrays["_DEVIATION"] = mesh.deviation.astype("<f4")
    stored = [*arrays.values(), mesh.faces.astype("<u4").reshape(-1)]
    views, accessors, data = list[dict[str, int]](), list[dict[str, Any]](), bytearray()
    for index, values in enumerate(stored):
        packed = np.ascontiguousarray(values).tobytes()
        accessor: dict[str, Any] = {"bufferView": index, "componentType": _TYPES[values.dtype.newbyteorder("<").str]}
        accessor |= {"count": len(values), "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"}
        if values.dtype.kind == "u" and values.ndim == 2:
            accessor["normalized"] = True
        if index == 0 and len(values):
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        accessors.append(accessor)
        part = {"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)}
        views.append(part | {"target": _TARGETS["corners" if index < len(arrays) else "faces"]})
        data += packed  # rows of 4, 8 or 12 bytes: everything stays aligned
    attributes = {name: index for index, name in enumerate(arrays)}
    primitive = {"mode": 4, "attributes": attributes, "indices": len(arrays), "material": 0}
    content = {
        "asset": {"version": "2.0", "generator": f"DGS {VERSION}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "twin", "mesh": 0}],
        "meshes": [{"name": "twin", "primitives": [primitive]}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    write_bytes(path, glb_bytes(content, data))


def _write_ply(path: Path, mesh: Mesh) -> None:
    kinds: list[tuple[str, str]] = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    kinds += [] if mesh.colours is None else [(name, "u1") for name in ("red", "green", "blue")]
    kinds += [] if mesh.deviation is None else [("deviation", "<f4")]
    corners = np.empty(len(mesh.vertices), kinds)
    columns = np.concatenate([mesh.vertices, mesh.normals()], axis=1)
    for index, name in enumerate(("x", "y", "z", "nx", "ny", "nz")):
        corners[name] = columns[:, index]
    for index, name in enumerate(("red", "green", "blue") if mesh.colours is not None else ()):
        corners[name] = mesh.colours[:, index]  # type: ignore[index]
    if mesh.deviation is not None:
        corners["deviation"] = mesh.deviation
    faces = np.empty(len(mesh.faces), [("vertex_indices", "<i4", (3,))])
    faces["vertex_indices"] = mesh.faces
    parts = [PlyElement.describe(corners, "vertex"), PlyElement.describe(faces, "face")]
    with replacing(path) as temporary:
        PlyData(parts, byte_order="<").write(str(temporary))


def _write_obj(path: Path, mesh: Mesh) -> None:
    """With colours behind the coordinates, as Blender and MeshLab read them."""
    places = mesh.vertices * _TURNED
    colours = np.full((len(places), 3), 0.5) if mesh.colours is None else mesh.colours / 255.0
    corners = np.concatenate([places, colours], axis=1)
    lines = ["# a twin's surface: y up, colours sRGB"]
    lines += [f"v {x:.7g} {y:.7g} {z:.7g} {r:.4f} {g:.4f} {b:.4f}" for x, y, z, r, g, b in corners.tolist()]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in (mesh.normals() * _TURNED).tolist()]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (mesh.faces + 1).tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
