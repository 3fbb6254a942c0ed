"""SPZ files (Niantic, MIT licence), versions 2 and 3: about a tenth of a PLY's size. Needs numpy only.

A gzip stream: header `<IIIBBBB` (magic, version, count, degree, fraction bits, flags, 0), then for all
Gaussians positions (3 x 24-bit fixed point), opacities (uint8), colours (3 x uint8: 0.15 f_dc + 0.5),
scales (3 x uint8: 16 (log s + 10)), rotations, harmonics (uint8: 128 + 128 f; a Gaussian's first
harmonic R G B, then its second ...). Rotations: version 2 has x y z as 127.5 + 127.5 q with w >= 0;
version 3 the three smallest of x y z w with 10 bits each and the place of the largest. Axes are right,
up, back: y and z point against those of PLY files, so harmonics odd in one of them change their sign.

https://github.com/nianticlabs/spz
"""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from ..cloud import GaussianCloud
from ..constants import SH_COEFFICIENTS
from ..errors import FormatError
from ..files import write_bytes
from .spec import FormatSpec
from .turning import FLIP

#: The file's first word: 'NGSP'.
_MAGIC = 0x5053474E
_HEADER = struct.Struct("<IIIBBBB")
#: A byte's range holds zeroth harmonics from -0.5 to 0.5 over this: the format's.
_COLOUR = 0.15
#: Buckets of 8-bit values: harmonics of degree 1 keep 5 bits, the others 4, as the format's own writer.
_FIRST_BUCKET, _OTHER_BUCKET = 8, 16
#: Of a position; small worlds need more than the usual 12.
_MOST_FRACTION_BITS = 20
#: Bytes that are unpacked at a time.
_PIECE = 2**20


def read_spz(path: Path) -> GaussianCloud:
    """Reads the file.

    Raises:
        FormatError: no such file, no SPZ of version 2 or 3, or one that was cut off.
    """
    try:
        with gzip.open(path) as file:
            head = file.read(_HEADER.size)
            if len(head) < _HEADER.size:
                raise FormatError(f"'{path}' was cut off", "Export or download it again")
            magic, version, count, degree, fraction, _, _ = _HEADER.unpack(head)
            if magic != _MAGIC or version not in (2, 3) or degree > 3:
                raise FormatError(f"'{path}' is no SPZ of version 2 or 3", "Export it again, as version 3")
            rest = SH_COEFFICIENTS[degree] - 1
            sizes = (9, 1, 3, 3, version + 1, 3 * rest)
            data = _unpacked(cast("IO[bytes]", file), count * sum(sizes))
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"'{path}' is no readable SPZ ({error})", "Export or download it again") from error
    if len(data) < count * sum(sizes):
        raise FormatError(f"'{path}' holds fewer Gaussians than it declares", "Export or download it again")
    parts, place = [], 0
    for size in sizes:
        parts.append(np.frombuffer(data, np.uint8, count * size, place).reshape(count, size))
        place += count * size
    positions, opacities, colours, scales, rotations, harmonics = parts
    opacity = np.clip(opacities[:, 0] / 255.0, 0.5 / 255, 1 - 0.5 / 255)
    sh = np.empty((count, 1 + rest, 3), np.float32)
    sh[:, 0] = (colours / 255.0 - 0.5) / _COLOUR
    sh[:, 1:] = (harmonics.reshape(count, rest, 3) - 128.0) / 128.0 * FLIP[:rest, None]
    turn = _first_three(rotations) if version == 2 else _smallest_three(rotations)
    return GaussianCloud(
        means=(_fixed(positions) / 2.0**fraction * (1, -1, -1)).astype(np.float32),
        log_scales=(scales / 16.0 - 10.0).astype(np.float32),
        quaternions=(turn[:, [3, 0, 1, 2]] * (1, 1, -1, -1)).astype(np.float32),
        opacity_logits=np.log(opacity / (1.0 - opacity)).astype(np.float32),
        sh=sh,
    )


def _unpacked(file: IO[bytes], size: int) -> bytes:
    """So many bytes, or as many as there are: what a small file unpacks to may be huge, and more than it declares."""
    data = bytearray()
    while len(data) < size:
        piece = file.read(min(_PIECE, size - len(data)))
        if not piece:
            break
        data += piece
    file.read(1)  # (at its end the checksum is compared)
    return bytes(data)


def write_spz(path: Path, cloud: GaussianCloud) -> None:
    """Writes version 3, whole or not at all; what is beyond the format's ranges is clipped.

    Raises:
        OutputError: the disk is full or the folder cannot be written to.
    """
    count, coefficients, _ = cloud.sh.shape
    reach = max(float(np.abs(cloud.means).max(initial=0.0)), 1e-6)
    fraction = int(np.clip(np.floor(np.log2((2**23 - 1) / reach)), 0, _MOST_FRACTION_BITS))
    with np.errstate(over="ignore"):
        opacities = _byte(255.0 / (1.0 + np.exp(-cloud.opacity_logits)))
    rest = cloud.sh[:, 1:] * FLIP[: coefficients - 1, None]
    bucket = np.where(np.arange(coefficients - 1) < 3, _FIRST_BUCKET, _OTHER_BUCKET)[:, None]
    harmonics = np.clip((np.round(rest * 128.0) + 128 + bucket // 2) // bucket * bucket, 0, 255).astype(np.uint8)
    turn = cloud.quaternions[:, [1, 2, 3, 0]] * np.array((1, -1, -1, 1), np.float32)
    parts = (
        _HEADER.pack(_MAGIC, 3, count, SH_COEFFICIENTS.index(coefficients), fraction, 0, 0),
        _bytes_of_fixed(np.round(cloud.means.astype(np.float64) * (1, -1, -1) * 2.0**fraction)),
        opacities.tobytes(),
        _byte((cloud.sh[:, 0] * _COLOUR + 0.5) * 255.0).tobytes(),
        _byte((cloud.log_scales + 10.0) * 16.0).tobytes(),
        _pack_smallest_three(turn).tobytes(),
        harmonics.tobytes(),
    )
    write_bytes(path, gzip.compress(b"".join(parts), 6, mtime=0))


def _fixed(data: NDArray[np.uint8]) -> NDArray[np.float64]:
    """[N, 9] bytes -> [N, 3] signed 24-bit numbers."""
    low, middle, high = (data[:, i::3].astype(np.int32) for i in range(3))
    value = low | middle << 8 | high << 16
    return np.where(value >= 1 << 23, value - (1 << 24), value).astype(np.float64)


def _bytes_of_fixed(values: NDArray[np.float64]) -> bytes:
    numbers = np.clip(values, -(2**23), 2**23 - 1).astype("<i4")
    return np.ascontiguousarray(numbers.view(np.uint8).reshape(len(values), 3, 4)[:, :, :3]).tobytes()


def _first_three(data: NDArray[np.uint8]) -> NDArray[np.float64]:
    xyz = data / 127.5 - 1.0
    w = np.sqrt(np.maximum(0.0, 1.0 - (xyz**2).sum(axis=1, keepdims=True)))
    return np.concatenate([xyz, w], axis=1)


def _smallest_three(data: NDArray[np.uint8]) -> NDArray[np.float64]:
    """[N, 4] bytes -> [N, 4] unit quaternions x y z w."""
    packed = np.ascontiguousarray(data).view("<u4")[:, 0].copy()
    largest = packed >> 30
    turn = np.zeros((len(data), 4))
    for component in (3, 2, 1, 0):
        there = largest != component
        size = (packed & 511) / 511.0 * np.sqrt(0.5)
        turn[there, component] = np.where(packed >> 9 & 1, -size, size)[there]
        packed = np.where(there, packed >> 10, packed)
    turn[np.arange(len(data)), largest] = np.sqrt(np.maximum(0.0, 1.0 - (turn**2).sum(axis=1)))
    return turn


def _pack_smallest_three(turn: NDArray[np.float32]) -> NDArray[np.uint32]:
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    unit = np.where(length > 1e-12, turn / np.maximum(length, 1e-12), np.array((0, 0, 0, 1), np.float32))
    largest = np.abs(unit).argmax(axis=1)
    unit = unit * np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1.0, 1.0)
    packed = largest.astype(np.uint32)
    for component in range(4):
        there = largest != component
        size = np.minimum(511, np.floor(511 * np.abs(unit[:, component]) / np.sqrt(0.5) + 0.5)).astype(np.uint32)
        sign = (unit[:, component] < 0).astype(np.uint32)
        packed = np.where(there, packed << 10 | sign << 9 | size, packed).astype("<u4")
    return packed


def _byte(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


SPZ = FormatSpec(
    name="SPZ",
    suffixes=(".spz",),
    holds="About a tenth of the size; colours, sizes and gloss are rounded",
    read=read_spz,
    write=write_spz,
)
