"""Sharp photos of the same views, where there are any: only to compare with."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .load import load_photo, photo_files
from .write import photo_stem


class TruthFolder:
    """Sharp photos by the names of the blurred ones, whatever their extension.

    Raises:
        PhotoError: the folder is missing or holds no photo.
    """

    def __init__(self, folder: Path) -> None:
        self._files = {photo_stem(path.name): path for path in photo_files(folder)}
        self._files.update({unicodedata.normalize("NFC", path.name): path for path in photo_files(folder)})

    def __contains__(self, name: str) -> bool:
        return name in self._files or photo_stem(name) in self._files

    def pixels(self, name: str) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """[H, W, 3], sRGB-encoded; PhotoError if it cannot be read."""
        return load_photo(self._files.get(name) or self._files[photo_stem(name)]).pixels
