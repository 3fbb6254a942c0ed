"""A set whose truth is known: blurred photos, sharp ones, and whatever else the set came with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import DgsError, PhotoError
from ...core.evaluation.lines import PaintedLine, read_lines
from ...core.files import read_json, write_json
from ...core.imaging.kernel_samples import disc
from ...core.imaging.medium import Medium
from ...core.imaging.psf import PointSpread, point_spread_from_samples
from ...core.imaging.psf_text import parse_psf
from ...core.json_shape import check_shape, text
from ...core.lens import MODELS, Lens
from ...core.photos.load import Photo, load_photo, photo_files
from ...core.photos.truth import TruthFolder
from ...core.pipeline.blind import Spreads
from ...core.pipeline.cameras import CameraSearch, cameras_of, given_cameras
from ...core.pipeline.medium import medium_of
from ...core.pipeline.photos import read_photos
from ...core.progress import Progress
from ...core.reconstruction import Reconstruction
from ...core.run_settings import MediumSettings, PhotoSettings
from ...core.sfm.given import load_cameras
from ...core.sfm.settings import SfmSettings
from ...core.twin.folder import TwinFolder
from ...core.views import heldout_names
from .settings import EVERY, StudySettings

_PHOTO_FOLDERS = ("photos", "blur5")
_CAMERA_FOLDERS = ("cameras", "reference_cameras")


class CroppedTruth(TruthFolder):
    """Sharp photos without `border` px on every side."""

    def __init__(self, folder: Path, border: int = 0) -> None:
        super().__init__(folder)
        self.folder, self.border = folder, border

    def cropped_by(self, border: int) -> CroppedTruth:
        """The same photos, smaller by `border` px more on every side."""
        return CroppedTruth(self.folder, self.border + border)

    def pixels(self, name: str) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """[H - 2 border, W - 2 border, 3], sRGB-encoded."""
        return cropped_array(super().pixels(name), self.border)


@dataclass(frozen=True)
class Dataset:
    """Everything that a comparison reads.

    Attributes:
        name: of the folder.
        photos: those with a camera, through the medium.
        given: how many photos there are.
        truth: their sharp counterparts.
        medium: what blurred them; `psf` is how it was written.
        cameras: what all methods train with.
        reference: the set's own cameras (exact for a rendered set), or None.
        lines: painted lines in the reference's world; may be empty.
        masks: [H, W] bool by photo name, True on the object.
        depths: files of depth maps by photo name, in the reference's units.
        metres: whether the reference's unit is a metre.
        border: px cut from every side of what the files hold.
    """

    name: str
    photos: list[Photo] = field(repr=False)
    given: int
    truth: CroppedTruth = field(repr=False)
    medium: Medium
    psf: str
    cameras: Reconstruction = field(repr=False)
    reference: Reconstruction | None = field(repr=False)
    lines: list[PaintedLine] = field(repr=False)
    masks: Mapping[str, NDArray[np.bool_]] = field(repr=False)
    depths: Mapping[str, Path] = field(repr=False)
    metres: bool = False
    border: int = 0

    @property
    def heldout(self) -> list[str]:
        """Names of the photos that no method trains on."""
        return heldout_names([photo.name for photo in self.photos], EVERY)

    def reference_cameras(self) -> dict[str, Camera]:
        """By photo name; empty without a reference."""
        return {} if self.reference is None else self.reference.cameras()

    def depth(self, name: str) -> NDArray[np.float32] | None:
        """[H, W] along the camera's axis, inf in the void; None if there is none."""
        file = self.depths.get(name)
        return None if file is None else cropped_array(np.load(file, allow_pickle=False), self.border)

    def cropped(self, border: int, photos: Callable[[Photo], Photo]) -> Dataset:
        """The set without `border` px on every side, with other photos (of the full size, cropped here)."""

        def smaller(photo: Photo) -> Photo:
            new = photos(photo)
            mask = None if new.mask is None else cropped_array(new.mask, border)
            alpha = None if new.alpha is None else cropped_array(new.alpha, border)
            return replace(new, pixels=cropped_array(new.pixels, border), mask=mask, alpha=alpha)

        return replace(
            self,
            photos=[smaller(photo) for photo in self.photos],
            truth=self.truth.cropped_by(border),
            cameras=_without_border(self.cameras, border),
            reference=None if self.reference is None else _without_border(self.reference, border),
            masks={name: cropped_array(mask, border) for name, mask in self.masks.items()},
            border=self.border + border,
        )


def load_dataset(settings: StudySettings, threads: int, progress: Progress) -> Dataset:
    """The stages photos, medium and cameras on a set; cameras that are found are kept in `settings.out`/cameras.

    Raises:
        PhotoError: no blurred or no sharp photos.
        DgsError: the point spread function is not given, or too few photos have a camera.
        CameraError: no trustworthy cameras.
    """
    folder, kept = settings.dataset, TwinFolder(settings.out)
    names = [settings.photos] if settings.photos else list(_PHOTO_FOLDERS)
    source = next((folder / name for name in names if (folder / name).is_dir()), None)
    if source is None or not (folder / "sharp").is_dir():
        raise PhotoError(
            f"'{folder}' needs a folder of blurred photos ({' or '.join(names)}) and one named sharp",
            "Make a set with 'run_dgs.py synthesize', or name the folder with --photos",
        )
    loaded = read_photos(PhotoSettings(source), kept, progress)
    truth = CroppedTruth(folder / "sharp")
    photos = [photo for photo in loaded.photos if photo.name in truth]
    psf, blur = _medium_given(settings)
    medium = medium_of(blur, Spreads.alike(point_spread(psf)), photos, progress).medium
    own = next((folder / name for name in _CAMERA_FOLDERS if (folder / name).is_dir()), None)
    if settings.cameras == "found":
        search = CameraSearch(SfmSettings(threads=threads), settings.resume)
        cameras, _ = kept_cameras(kept, photos, medium, search, progress)
    else:
        cameras = given_cameras(_camera_file(settings, own), photos, progress)
        if cameras.figures.scattered:
            progress.note("The cameras came without points: random ones stand where the cameras look")
    reference = None if own is None else load_cameras(own, photos)
    registered = [photo for photo in photos if photo.name in cameras.poses]
    if len(registered) < 2:
        raise DgsError(f"'{folder.name}' has too few photos to hold some out", "Give a set of 9 photos or more")
    rendered = (folder / "manifest.json").is_file()
    lines = read_lines(folder / "lines.json") if (folder / "lines.json").is_file() and reference else []
    return Dataset(
        name=folder.name,
        photos=registered,
        given=len(photos),
        truth=truth,
        medium=medium,
        psf=psf,
        cameras=cameras,
        reference=reference,
        lines=lines,
        masks=_object_masks(folder / "masks_ball", registered),
        depths=_depth_files(folder / "depth", registered),
        metres=rendered,
    )


def kept_cameras(
    folder: TwinFolder, photos: list[Photo], medium: Medium, search: CameraSearch, progress: Progress
) -> tuple[Reconstruction, float]:
    """Cameras found from the photos, as the folder keeps them: the same to the bit now and when a study is resumed.

    Returns:
        The cameras, and the seconds that finding them took.

    Raises:
        CameraError: no trustworthy cameras.
    """
    recorded = folder.camera_folder / "seconds.json"
    if not (search.resume and recorded.is_file()):
        found = cameras_of(None, photos, medium, replace(search, resume=False), folder, progress)
        write_json(recorded, round(found.reconstruction.figures.seconds, 2))
    return load_cameras(folder.camera_folder, photos), float(read_json(recorded))


def point_spread(text: str) -> PointSpread | None:
    """As `parse_psf`, and 'disk:RADIUS', which synthesize takes, too.

    Raises:
        PsfError: the text makes no sense.
    """
    kind, _, rest = text.partition(":")
    if kind == "disk":
        try:
            return point_spread_from_samples(disc(float(rest)), text)
        except ValueError:
            pass
    return parse_psf(text)


def cropped_array(array: NDArray[Any], border: int) -> NDArray[Any]:
    """[H, W, ...] without `border` rows and columns on every side."""
    height, width = array.shape[:2]
    return np.ascontiguousarray(array[border : height - border, border : width - border])


def _medium_given(settings: StudySettings) -> tuple[str, MediumSettings]:
    """What blurred the photos, and where the blur acts: asked for, or as the set says."""
    given: dict[str, Any] = {}
    file = settings.dataset / "psf.json"
    if file.is_file():
        try:
            given = read_json(file)
            check_shape(given, {"psf?": (text,), "blur_space?": (text,)})
        except (OSError, ValueError) as error:
            raise DgsError(f"'{file}' cannot be read: {error}", "Give --psf") from error
    psf = settings.psf or given.get("psf")
    if not psf:
        raise DgsError(f"Nobody says what blurred the photos of '{settings.dataset.name}'", "Give --psf gaussian:SIGMA")
    return str(psf), MediumSettings(str(psf), settings.blur_space or given.get("blur_space", "srgb"))


def _camera_file(settings: StudySettings, own: Path | None) -> Path:
    if settings.cameras != "known":
        return Path(settings.cameras)
    if own is None:
        raise DgsError(f"'{settings.dataset}' has no cameras of its own", "Use --cameras found")
    return own


def _object_masks(folder: Path, photos: list[Photo]) -> dict[str, NDArray[np.bool_]]:
    if not folder.is_dir():
        return {}
    files = {path.stem: path for path in photo_files(folder)}
    found = {photo.name: files[Path(photo.name).stem] for photo in photos if Path(photo.name).stem in files}
    return {name: load_photo(path, background=None).pixels.max(axis=2) > 0 for name, path in found.items()}


def _depth_files(folder: Path, photos: list[Photo]) -> dict[str, Path]:
    files = {photo.name: folder / f"{Path(photo.name).stem}.npy" for photo in photos}
    return {name: file for name, file in files.items() if file.is_file()}


def _without_border(cameras: Reconstruction, border: int) -> Reconstruction:
    return replace(cameras, lenses={name: _smaller_lens(lens, border) for name, lens in cameras.lenses.items()})


def _smaller_lens(lens: Lens, border: int) -> Lens:
    """The same lens on a frame without `border` px on every side."""
    values = list(lens.params)
    first = 1 if MODELS[lens.model][0] else 2  # behind f, or behind fx and fy
    values[first] -= border
    values[first + 1] -= border
    return replace(lens, width=lens.width - 2 * border, height=lens.height - 2 * border, params=tuple(values))
