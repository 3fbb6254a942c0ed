"""The worst held-out view of each rendered scene: the sharp truth, the twin, and where they differ."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...core.files import make_folder, write_bytes
from ...core.photos.load import load_photo
from ...core.photos.truth import TruthFolder
from ...core.photos.write import render_names
from .sets import PreparedSet

#: Width in px of one of the pictures side by side, and the quality of the JPEG: a page with many stays small.
WIDTH, QUALITY = 300, 80
#: How much differences are brightened.
BRIGHTER = 3.0


def side_by_side(row: Mapping[str, Any], data: PreparedSet, twin: Path) -> NDArray[np.uint8]:
    """[H, 3 W, 3] truth, twin and three times their difference, of the row's worst view.

    Args:
        twin: the run's folder.
    """
    name = row["worst"]["name"]
    truth = _eight_bit(TruthFolder(data.truth or data.photos).pixels(name))
    seen = load_photo(twin / "renders" / render_names(list(row["views"]))[name]).pixels
    if seen.shape != truth.shape:
        seen = np.asarray(Image.fromarray(_eight_bit(seen)).resize((truth.shape[1], truth.shape[0])))
    apart = np.abs(truth.astype(np.float32) - _eight_bit(seen)) * BRIGHTER
    return np.concatenate([truth, _eight_bit(seen), apart.clip(0, 255).astype(np.uint8)], axis=1)


def write_picture(row: Mapping[str, Any], data: PreparedSet, twin: Path, file: Path) -> None:
    """Writes `side_by_side` as a small JPEG; the largest pictures are shrunk."""
    pixels = side_by_side(row, data, twin)
    height, width = pixels.shape[:2]
    small = Image.fromarray(pixels).resize((3 * WIDTH, round(height * 3 * WIDTH / width)), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    small.save(stream, "JPEG", quality=QUALITY, optimize=True)
    make_folder(file.parent)
    write_bytes(file, stream.getvalue())


def _eight_bit(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    return pixels if pixels.dtype == np.uint8 else (pixels / 257.0).round().astype(np.uint8)
