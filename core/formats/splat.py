"""`.splat` files: 32 bytes a Gaussian, without gloss. Needs numpy only.

Little-endian, no header: position (3 float32), standard deviations (3 float32), colour and opacity
(4 uint8, sRGB), rotation (4 uint8, w x y z as 128 + 128 q). Axes as in 3DGS PLY files. Lossy: colours
beyond [0, 1], harmonics behind the zeroth, and fine rotations are lost.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..cloud import GaussianCloud
from ..constants import SH_C0
from ..errors import FormatError
from ..files import write_bytes
from .spec import FormatSpec

_RECORD = np.dtype(
    [("mean", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 3), ("opacity", "u1"), ("rotation", "u1", 4)]
)


def read_splat(path: Path) -> GaussianCloud:
    """Reads the file.

    Raises:
        FormatError: no such file, or its length is no multiple of 32 bytes.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"'{path}' cannot be read ({error.strerror})", "Give the path of a .splat file") from error
    if not data or len(data) % _RECORD.itemsize:
        raise FormatError(f"'{path}' is no .splat file: its length is not right", "Export or download it again")
    values = np.frombuffer(data, _RECORD)
    opacity = np.clip(values["opacity"] / 255.0, 0.5 / 255, 1 - 0.5 / 255)
    return GaussianCloud(
        means=values["mean"].astype(np.float32),
        log_scales=np.log(np.maximum(values["scale"], 1e-20)).astype(np.float32),
        quaternions=((values["rotation"].astype(np.float32) - 128.0) / 128.0),
        opacity_logits=np.log(opacity / (1.0 - opacity)).astype(np.float32),
        sh=((values["colour"].astype(np.float32) / 255.0 - 0.5) / SH_C0)[:, None, :].astype(np.float32),
    )


def write_splat(path: Path, cloud: GaussianCloud) -> None:
    """Writes the file, whole or not at all.

    Raises:
        OutputError: the disk is full or the folder cannot be written to.
    """
    values = np.zeros(len(cloud), _RECORD)
    values["mean"], values["scale"] = cloud.means, np.exp(cloud.log_scales)
    values["colour"] = _byte((0.5 + SH_C0 * cloud.sh[:, 0]) * 255.0)
    with np.errstate(over="ignore"):
        values["opacity"] = _byte(255.0 / (1.0 + np.exp(-cloud.opacity_logits)))
    length = np.maximum(np.linalg.norm(cloud.quaternions, axis=1, keepdims=True), 1e-12)
    values["rotation"] = _byte(cloud.quaternions / length * 128.0 + 128.0)
    write_bytes(path, values.tobytes())


def _byte(values: np.ndarray) -> np.ndarray:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


SPLAT = FormatSpec(
    name="Splat",
    suffixes=(".splat",),
    holds="32 bytes a splat, without gloss; for viewers in web pages",
    read=read_splat,
    write=write_splat,
)
