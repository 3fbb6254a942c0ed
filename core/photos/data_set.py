"""Folders in which photos and their cameras lie together, as other programs write them: photos and cameras are found.

| written by | cameras | photos |
|---|---|---|
| NeRF's synthetic scenes, BlenderNeRF | transforms_train.json, transforms_test.json | train/, test/ |
| instant-ngp, nerfstudio, the laboratory | transforms.json | where its frames say |
| COLMAP, 3DGS, Mip-NeRF 360, Deblur-NeRF | sparse/0, sparse or colmap/sparse/0 | images/, or input/ |

Goes by the names of files, and by what a transforms.json calls its frames; whoever reads the cameras checks them.
Blender's own Python reads this file, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..files import read_json
from ..names import inner_name
from ..progress import Progress
from ..run_settings import ReconstructSettings
from .kinds import HEIF, SUFFIXES

#: Files of cameras that say where their photos lie; the first that is there counts: what is to be trained on.
_TRANSFORMS = ("transforms_train.json", "transforms.json")
#: Files of cameras of photos that others are scored on.
_OTHERS = ("transforms_test.json", "transforms_val.json")
#: Where a COLMAP model lies beside its photos, and where these lie.
_MODELS, _IMAGES = ("sparse/0", "sparse", "colmap/sparse/0"), ("images", "input")
_MODEL_FILES = ("cameras.bin", "cameras.txt")


@dataclass(frozen=True)
class DataSet:
    """A folder in which photos and their cameras lie together.

    Attributes:
        photos: folder of the photos, inside it or itself.
        cameras: what reads as a camera model (`core.formats.cameras`).
        unused: files of cameras whose photos are left to whoever scores the twin.
    """

    photos: Path
    cameras: Path
    unused: tuple[Path, ...] = ()

    def words(self, root: Path) -> str:
        """What was found, in a sentence without a full stop."""
        said = f"Photos of '{self.photos.relative_to(root)}' with the cameras of '{self.cameras.relative_to(root)}'"
        if self.unused:
            said += f"; those of {' and '.join(repr(path.name) for path in self.unused)} are not used"
        return f"{said}. Name '{self.photos}' itself to have the cameras found from the photos"


def data_set(folder: Path) -> DataSet | None:
    """What lies in a folder; None where it holds photos itself, or no layout that is known."""
    try:
        if not folder.is_dir() or _holds_photos(folder):
            return None
        return _by_frames(folder) or _by_model(folder)
    except OSError:  # (whoever reads the folder says what is wrong with it)
        return None


def photos_in(path: Path) -> Path:
    """Where photos lie: the folder inside a data set's, else what was given."""
    found = data_set(path)
    return path if found is None else found.photos


def with_data_set(settings: ReconstructSettings, progress: Progress) -> ReconstructSettings:
    """A run's settings with the photos of a data set's folder, and its cameras unless others are given.

    Args:
        progress: hears what was found.
    """
    found = data_set(settings.photos)
    if found is None:
        return settings
    progress.note(found.words(settings.photos))
    cameras = found.cameras if settings.cameras is None else settings.cameras
    return replace(settings, photos=found.photos, cameras=cameras)


def _holds_photos(folder: Path) -> bool:
    return any(path.suffix.lower() in SUFFIXES | HEIF and not path.name.startswith(".") for path in folder.iterdir())


def _by_frames(folder: Path) -> DataSet | None:
    for name in _TRANSFORMS:
        cameras = folder / name
        photos = _folder_of_frames(cameras) if cameras.is_file() else None
        if photos is not None:
            unused = [folder / other for other in _OTHERS if (folder / other).is_file()]
            return DataSet(photos, cameras, tuple(unused))
    return None


def _folder_of_frames(cameras: Path) -> Path | None:
    """The one folder that all photos of a transforms.json lie in; None where there is no such folder."""
    try:
        names = [Path(inner_name(frame["file_path"])) for frame in _frames(read_json(cameras))]
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    folders = {cameras.parent / name.parent for name in names}
    found = folders.pop() if len(folders) == 1 else None
    return found if found is not None and found.is_dir() and _holds_photos(found) else None


def _frames(content: Any) -> Sequence[Any]:
    frames = content["frames"]
    return frames if isinstance(frames, list) else ()


def _by_model(folder: Path) -> DataSet | None:
    model = next((folder / name for name in _MODELS if _is_model(folder / name)), None)
    images = [folder / name for name in _IMAGES if (folder / name).is_dir()]
    photos = next((path for path in images if _holds_photos(path)), None)
    return None if model is None or photos is None else DataSet(photos, model)


def _is_model(folder: Path) -> bool:
    return any((folder / name).is_file() for name in _MODEL_FILES)
