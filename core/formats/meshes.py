"""Files of meshes: GLB and OBJ with y up, PLY in the twin's own world.

Colours of a GLB's corners are linear, as glTF wants them; those of the others and all textures are sRGB. A GLB and a
PLY also hold each corner's standard deviation along the normal (`_DEVIATION`, `deviation`), in the positions' unit.
A texture is a PNG: within a GLB, beside an OBJ and its MTL, not in a PLY. It takes the place of the corners' colours,
which viewers multiply with it (glTF) or show in front of it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, PngImagePlugin
from plyfile import PlyData, PlyElement

from ..colour import srgb_to_linear
from ..errors import FormatError
from ..files import replacing, write_bytes
from ..triangles import Mesh, Texture
from ..version import VERSION
from .gltf_file import glb_bytes

#: Endings of the files that can be written.
SUFFIXES = (".glb", ".obj", ".ply")
#: Those that take a texture.
TEXTURED = (".glb", ".obj")
#: Component types as glTF numbers them.
_TYPES = {"<f4": 5126, "<u2": 5123, "<u4": 5125}
#: What a part of a buffer is for, as glTF numbers it.
_TARGETS = {"corners": 34962, "faces": 34963}
#: Linear between texels and between smaller pictures of them; nothing repeats. As glTF numbers it.
_SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
#: The engine's y points down and its z away: half a turn about x has y up, as glTF and OBJ want it.
_TURNED = np.array([1.0, -1.0, -1.0])


def check_mesh_name(path: Path, textured: bool = False) -> None:
    """Raises FormatError where a name has no ending that can be written, or none that takes a texture."""
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(f"'{path.name}' is no mesh that can be written", f"End its name with {', '.join(SUFFIXES)}")
    if textured and path.suffix.lower() not in TEXTURED:
        raise FormatError(
            f"'{path.name}' would hold colours of the corners, and no texture",
            f"End its name with {' or '.join(TEXTURED)}, or leave the texture out",
        )


def files_of(path: Path, textured: bool) -> list[Path]:
    """All files that a mesh is written to; the named one is the last."""
    beside = (".png", ".mtl") if textured and path.suffix.lower() == ".obj" else ()
    return [*(path.with_suffix(suffix) for suffix in beside), path]


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Writes a mesh in the format of the file's ending; `files_of` says what else is written beside it.

    Raises:
        FormatError: another ending, or none for a texture. OutputError: the file cannot be written.
    """
    check_mesh_name(path, mesh.texture is not None)
    {".glb": _write_glb, ".obj": _write_obj, ".ply": _write_ply}[path.suffix.lower()](path, mesh)


def _write_glb(path: Path, mesh: Mesh) -> None:
    arrays, faces = _glb_arrays(mesh), mesh.faces if mesh.texture is None else mesh.texture.faces
    stored = [*arrays.values(), faces.astype("<u4").reshape(-1)]
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
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    content: dict[str, Any] = {"asset": {"version": "2.0", "generator": f"DGS {VERSION}"}}
    if mesh.texture is not None:
        picture = png_bytes(mesh.texture)
        surface["baseColorTexture"] = {"index": 0}
        content |= {"textures": [{"source": 0, "sampler": 0}], "samplers": [_SAMPLER]}
        content["images"] = [{"bufferView": len(views), "mimeType": "image/png", "name": "texture"}]
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(picture)})
        data += picture
    attributes = {name: index for index, name in enumerate(arrays)}
    primitive = {"mode": 4, "attributes": attributes, "indices": len(arrays), "material": 0}
    content |= {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "twin", "mesh": 0}],
        "meshes": [{"name": "twin", "primitives": [primitive]}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": surface}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    write_bytes(path, glb_bytes(content, data))


def _glb_arrays(mesh: Mesh) -> dict[str, NDArray[Any]]:
    """What there is at each corner; a corner on a seam of a texture is there for each of its places."""
    arrays: dict[str, NDArray[Any]] = {"POSITION": (mesh.vertices * _TURNED).astype("<f4")}
    arrays["NORMAL"] = (mesh.normals() * _TURNED).astype("<f4")
    if mesh.colours is not None and mesh.texture is None:
        linear = np.ones((len(mesh.vertices), 4))
        linear[:, :3] = srgb_to_linear(mesh.colours.astype(np.float64) / 255.0)
        arrays["COLOR_0"] = np.round(linear * 65535).astype("<u2")
    if mesh.deviation is not None:
        arrays["_DEVIATION"] = mesh.deviation.astype("<f4")
    if mesh.texture is not None:
        arrays = {name: values[mesh.texture.vertices] for name, values in arrays.items()}
        arrays["TEXCOORD_0"] = (mesh.texture.places * [1.0, -1.0] + [0.0, 1.0]).astype("<f4")  # (glTF's v points down)
    return arrays


def png_bytes(texture: Texture) -> bytes:
    """The picture as a PNG that says that it is sRGB."""
    said, stream = PngImagePlugin.PngInfo(), io.BytesIO()
    said.add(b"sRGB", b"\0")  # perceptual, the intent of pictures
    Image.fromarray(texture.image).save(stream, "PNG", pnginfo=said)
    return stream.getvalue()


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
    """With colours behind the coordinates, as Blender and MeshLab read them, or a texture."""
    if mesh.texture is not None:
        _write_textured_obj(path, mesh, mesh.texture)
        return
    places = mesh.vertices * _TURNED
    colours = np.full((len(places), 3), 0.5) if mesh.colours is None else mesh.colours / 255.0
    corners = np.concatenate([places, colours], axis=1)
    lines = ["# a twin's surface: y up, colours sRGB"]
    lines += [f"v {x:.7g} {y:.7g} {z:.7g} {r:.4f} {g:.4f} {b:.4f}" for x, y, z, r, g, b in corners.tolist()]
    lines += _obj_normals(mesh)
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (mesh.faces + 1).tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _write_textured_obj(path: Path, mesh: Mesh, texture: Texture) -> None:
    picture, material, _ = files_of(path, True)
    write_bytes(picture, png_bytes(texture))
    shade = ["# the texture is sRGB", "newmtl surface", "Ka 0 0 0", "Kd 1 1 1", "Ks 0 0 0", f"map_Kd {picture.name}"]
    write_bytes(material, ("\n".join(shade) + "\n").encode())
    lines = ["# a twin's surface: y up", f"mtllib {material.name}", "usemtl surface"]
    lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in (mesh.vertices * _TURNED).tolist()]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in texture.places.tolist()]
    lines += _obj_normals(mesh)
    corners = np.concatenate([mesh.faces, texture.faces], axis=1) + 1
    lines += [f"f {a}/{i}/{a} {b}/{j}/{b} {c}/{k}/{c}" for a, b, c, i, j, k in corners.tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _obj_normals(mesh: Mesh) -> list[str]:
    return [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in (mesh.normals() * _TURNED).tolist()]
