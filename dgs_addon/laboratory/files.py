"""Pictures and camera models on disk, each file whole or not there. Needs numpy only."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.conventions import quaternion_from_rotation
from ...core.files import make_folder, write_bytes, write_text
from ...core.views import SparsePoints


def write_png(path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Writes [H, W, 3], [H, W, 4] (with alpha) or [H, W] integers of 8 or 16 bits (Pillow has no 16-bit colour)."""
    height, width = pixels.shape[:2]
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    depth = pixels.dtype.itemsize
    rows = pixels.astype(f">u{depth}").reshape(height, -1).view(np.uint8).reshape(height, -1)
    step = channels * depth
    filtered = rows.copy()
    filtered[:, step:] -= rows[:, :-step]  # PNG's filter 1: each byte minus its left neighbour
    lines = np.concatenate([np.ones((height, 1), np.uint8), filtered], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8 * depth, {1: 0, 3: 2, 4: 6}[channels], 0, 0, 0)
    chunks = ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b""))
    write_bytes(path, b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks))


def write_array(path: Path, array: NDArray[np.float32]) -> None:
    """Writes a .npy file."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    write_bytes(path, buffer.getvalue())


def write_colmap_text(folder: Path, cameras: Sequence[Camera], points: SparsePoints) -> None:
    """Writes cameras.txt, images.txt and points3D.txt; all views share one PINHOLE camera."""
    make_folder(folder)
    first = cameras[0]
    lens = " ".join(repr(float(value)) for value in (first.fx, first.fy, first.cx, first.cy))
    write_text(folder / "cameras.txt", f"1 PINHOLE {first.width} {first.height} {lens}\n")
    images = []
    for index, camera in enumerate(cameras, start=1):
        values = [*quaternion_from_rotation(camera.rotation), *camera.translation]
        # The second line of each image lists its 2D points: none.
        images.append(f"{index} {' '.join(repr(float(v)) for v in values)} 1 {camera.name}\n\n")
    write_text(folder / "images.txt", "".join(images))
    lines = [
        f"{index} {x!r} {y!r} {z!r} {r} {g} {b} 0\n"
        for index, ((x, y, z), (r, g, b)) in enumerate(
            zip(points.positions.tolist(), points.colours.tolist(), strict=True), start=1
        )
    ]
    write_text(folder / "points3D.txt", "".join(lines))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def read_png(path: Path) -> NDArray[np.uint8]:
    """Reads a picture that `write_png` wrote in colour, as [H, W, 3] uint8 (the high byte of 16), without its alpha."""
    data = path.read_bytes()
    width, height, bits, kind = struct.unpack(">IIBB", data[16:26])
    start = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[start - 4 : start])
    step = (4 if kind == 6 else 3) * bits // 8
    lines = np.frombuffer(zlib.decompress(data[start + 4 : start + 4 + length]), np.uint8)
    pixels = lines.reshape(height, 1 + width * step)[:, 1:].reshape(height, width, step)
    return np.cumsum(pixels, axis=1, dtype=np.uint8)[:, :, :: bits // 8][:, :, :3]
