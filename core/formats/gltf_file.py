"""glTF 2.0 files as such: JSON, buffers, accessors, the places of meshes. Needs numpy only.

https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..files import parse_json
from ..json_shape import any_text, anything, check_shape, count, number, text
from ..names import shown

#: The file's first word ('glTF'), and the types of its chunks ('JSON', 'BIN').
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
#: Components of each element type.
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: Nodes below nodes; more is a circle.
_DEEPEST_NODE = 100
_NODE = {"mesh?": count, "children?": [count]}
_NODE |= {f"{name}?": [number] for name in ("matrix", "rotation", "scale", "translation")}
_ACCESSOR = {"bufferView?": count, "byteOffset?": count, "componentType": count, "count": count, "type": text}
#: What is read of the JSON.
_CONTENT = {
    "asset": {"version": text},
    "scene?": count,
    "scenes?": [{"nodes?": [count]}],
    "nodes?": [_NODE],
    "meshes?": [{"primitives?": [{"attributes?": {"*": count}, "extensions?": {"*": anything}}]}],
    "accessors?": [_ACCESSOR],
    "bufferViews?": [{"buffer": count, "byteOffset?": count, "byteStride?": count}],
    "buffers?": [{"uri?": any_text}],
}


class Asset:
    """One file, read.

    Args:
        path: of the file, for buffers beside it and for messages.
        content: the JSON.
        binary: the binary chunk of a .glb, or None.
    """

    def __init__(self, path: Path, content: dict[str, Any], binary: bytes | None) -> None:
        self.path, self._content, self._binary = path, content, binary
        self._buffers: dict[int, bytes] = {}

    def placed_meshes(self) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
        """Every mesh of the scene with its world matrix [4, 4]; of all nodes where no scene is named.

        Raises:
            FormatError: the nodes are damaged.
        """
        try:
            scenes = self._content.get("scenes", [])
            roots = scenes[self._content.get("scene", 0)].get("nodes", []) if scenes else self._roots()
            seen: set[int] = set()
            for root in roots:
                yield from self._below(root, np.eye(4), 0, seen)
        except (IndexError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise self._damaged(error) from error

    def array(self, index: int) -> NDArray[np.float64]:
        """[count, width] of an accessor; normalised integers come as the numbers that they stand for.

        Raises:
            FormatError: the accessor is damaged, points beyond its buffer, or is sparse.
        """
        try:
            accessor = self._content["accessors"][index]
            if "sparse" in accessor or "bufferView" not in accessor:
                raise FormatError(f"'{self.path}' stores values sparsely", "Export it without sparse accessors")
            view = self._content["bufferViews"][accessor["bufferView"]]
            kind, width = np.dtype(_COMPONENTS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
            rows, row = accessor["count"], kind.itemsize * width
            stride = view.get("byteStride", row)
            start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
            strides, buffer = (stride, kind.itemsize), self._buffer(view["buffer"])
            if stride < row or start + rows * stride - (stride - row) > len(buffer):
                raise ValueError("values beyond their buffer")
            values: NDArray[Any] = np.ndarray((rows, width), kind, buffer, start, strides)
            whole = values.astype(np.float64)
        except (IndexError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise self._damaged(error) from error
        if accessor.get("normalized") and kind.kind in "iu":
            whole = np.maximum(whole / np.iinfo(kind).max, -1.0)
        return whole

    def _roots(self) -> list[int]:
        nodes = self._content.get("nodes", [])
        below = {child for node in nodes for child in node.get("children", [])}
        return [index for index in range(len(nodes)) if index not in below]

    def _below(
        self, index: int, above: NDArray[np.float64], depth: int, seen: set[int]
    ) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
        if depth > _DEEPEST_NODE or index in seen:
            raise ValueError("nodes in a circle, or below two others")
        seen.add(index)
        node = self._content["nodes"][index]
        matrix = above @ _matrix(node)
        if "mesh" in node:
            yield self._content["meshes"][node["mesh"]], matrix
        for child in node.get("children", []):
            yield from self._below(child, matrix, depth + 1, seen)

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self._content["buffers"][index].get("uri")
            if uri is None:
                if self._binary is None or index:
                    raise ValueError("a buffer has no content")
                self._buffers[index] = self._binary
            elif uri.startswith("data:"):
                self._buffers[index] = base64.b64decode(uri.partition(",")[2], validate=True)
            else:
                self._buffers[index] = self._beside(uri)
        return self._buffers[index]

    def _beside(self, uri: str) -> bytes:
        name, folder = unquote(uri), self.path.parent.resolve()
        if "\\" in name or ":" in name or "\0" in name or not (folder / name).resolve().is_relative_to(folder):
            raise FormatError(
                f"'{self.path}' names a buffer outside its folder ('{shown(uri[:80])}')", "Export it as one .glb file"
            )
        file = self.path.parent / name
        try:
            return file.read_bytes()
        except OSError as error:
            raise FormatError(f"'{self.path}' needs '{file.name}', which is not there", "Copy it beside") from error

    def _damaged(self, error: Exception) -> FormatError:
        return FormatError(f"'{self.path}' is damaged ({type(error).__name__}: {error})", "Export it again")


def open_gltf(path: Path) -> Asset:
    """Reads a .glb or .gltf.

    Raises:
        FormatError: no such file, or no glTF 2.0.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"'{path}' cannot be read ({error.strerror})", "Give the path of a glTF file") from error
    words, binary = data, None
    try:
        if data[:4] == b"glTF":
            words, binary = _chunks(data)
        content = parse_json(words)
        check_shape(content, _CONTENT)
        if not content["asset"]["version"].startswith("2."):
            raise ValueError("another version")
    except (ValueError, KeyError, TypeError, struct.error, binascii.Error) as error:
        raise FormatError(f"'{path}' is no glTF 2.0 file ({error})", "Export or download it again") from error
    return Asset(path, content, binary)


def glb_bytes(content: dict[str, Any], data: bytes | bytearray) -> bytes:
    """A .glb of its JSON and its only buffer."""
    words = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
    words += b" " * (-len(words) % 4)
    whole = bytes(data) + b"\0" * (-len(data) % 4)
    head = struct.pack("<III", _MAGIC, 2, 12 + 8 + len(words) + 8 + len(whole))
    chunks = struct.pack("<II", len(words), _JSON) + words + struct.pack("<II", len(whole), _BIN)
    return head + chunks + whole


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON and the binary chunk."""
    magic, version, length = struct.unpack_from("<III", data)
    if magic != _MAGIC or version != 2 or length > len(data):
        raise ValueError("cut off, or another version")
    place, chunks = 12, dict[int, bytes]()
    while place + 8 <= length:
        size, kind = struct.unpack_from("<II", data, place)
        chunks.setdefault(kind, data[place + 8 : place + 8 + size])
        place += 8 + size
    return chunks[_JSON], chunks.get(_BIN)


def _matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ) * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
