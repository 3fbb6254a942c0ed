"""Reads a folder of photos into memory, whatever the camera or program wrote."""

from __future__ import annotations

import importlib.util
import io
import logging
import math
import os
import unicodedata
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageOps

from ..background import Background
from ..compositing import opacity, under
from ..errors import Cancelled, PhotoError
from ..files import file_digest
from ..names import check_photo_name, shown
from ..numbers import BY_DEFINITION, number
from ..progress import Progress
from .kinds import HEIF, HEIF_PACKAGE, left_out, read_suffixes
from .listing import LIST, listed_files
from .png_whole import check_png
from .scale import resized, resized_mask, size_within
from .store import PhotoStore, kept_beside

#: Bytes of a picture that need not lie in its file, and how many times larger than its file a larger picture may be.
_SMALL_PICTURE, _MOST_PACKED = 2**28, 100
#: What deflate packs at most into a byte (zlib's technical details); a JPEG of nothing but one colour comes close.
_MOST_DEFLATED = 1032
#: Bytes that a PNG's px have in the file, by its colour type, at 8 bits: the PNG standard's channels.
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
# What a photo of a large sensor has is no attack; what has twice as many px is refused all the same.
warnings.filterwarnings("ignore", category=Image.DecompressionBombWarning)


@dataclass(frozen=True)
class LoadSettings:
    """Of reading photos."""

    decoders: int = number(
        4, "count", "photos that are decoded at a time; more would wait for the disk and fill memory"
    )
    half: float = number(0.5, "share", "a pixel counts where the mask is at least this", BY_DEFINITION)
    mask_aspect: float = number(0.02, "share", "by which a mask's width / height may differ from its photo's")
    smallest: int = number(16, "px", "shortest `max_size` that makes sense", BY_DEFINITION)


SETTINGS = LoadSettings()

_EXIF_IFD = 0x8769  # EXIF's tag of its own directory
_FOCAL_35MM = 0xA405  # EXIF's tag FocalLengthIn35mmFilm
#: Diagonal of the 36 x 24 mm frame that EXIF's FocalLengthIn35mmFilm refers to.
_DIAGONAL_35MM = 43.27

#: TIFF's kind of extra sample whose colours are multiplied by it.
_ASSOCIATED_ALPHA = 1

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Photo:
    """One photo as it lies in memory.

    Attributes:
        name: file name, unique in its set, NFC-normalised.
        path: the file.
        pixels: [H, W, 3] uint8 or uint16, sRGB-encoded; upright (EXIF rotation applied); over `background` where
            the file is transparent.
        mask: [H, W] bool, True where a pixel counts; None where all do. Black in the mask folder does not.
        scale: (x, y) size in memory / size in the file, (1, 1) unless `max_size` made it smaller.
        focal_px: focal length in px of `pixels` from EXIF, or None. A hint, never the truth.
        not_finite, clipped: px of a floating-point file that were NaN or infinite (they do not count), and
            those outside [0, 1] (they were cut).
        alpha: [H, W] of the type of `pixels`, 0 where the photo is empty; None where it is opaque everywhere.
        background: what is behind what all photos of the set show; None if that is not known.
        content: SHA-256 of the file, and behind a '+' that of its mask's file.
    """

    name: str
    path: Path
    pixels: Pixels = field(repr=False)
    mask: NDArray[np.bool_] | None = field(default=None, repr=False)
    scale: tuple[float, float] = (1.0, 1.0)
    focal_px: float | None = None
    not_finite: int = 0
    clipped: int = 0
    alpha: Pixels | None = field(default=None, repr=False)
    background: Background | None = None
    content: str = ""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in px."""
        return self.pixels.shape[1], self.pixels.shape[0]

    def transparency(self) -> NDArray[np.float32] | None:
        """[H, W] how far the photo is empty, 1 - alpha; None where it is opaque everywhere."""
        return None if self.alpha is None else 1 - opacity(self.alpha)


@dataclass
class _Decoded:
    """A file's picture, [H, W, 3] and alpha [H, W] of one type, which px are finite, and what was put right."""

    pixels: Pixels
    alpha: Pixels | None = None
    focal_35mm: float | None = None
    finite: NDArray[np.bool_] | None = None
    clipped: int = 0


def photo_files(source: Path) -> list[Path]:
    """The photos in a folder, sorted by name; hidden files do not count. Or those that a list (.txt) names.

    Raises:
        PhotoError: the folder is missing, is no folder, or holds no photo; or the list is wrong.
    """
    if source.suffix.lower() == LIST and source.is_file():
        return listed_files(source)
    if not source.exists():
        raise PhotoError(f"There is no folder '{source}'", "Check the path of the photos")
    if not source.is_dir():
        raise PhotoError(f"'{source}' is not a folder", "Name the folder that holds the photos")
    try:
        entries = sorted(source.iterdir(), key=lambda p: unicodedata.normalize("NFC", p.name))
    except OSError as error:
        raise PhotoError(f"The folder '{source}' cannot be read ({error.strerror})", "Check its permissions") from error
    suffixes = read_suffixes(_reads_heif())
    files = [p for p in entries if p.suffix.lower() in suffixes and not _hidden(p)]
    if not files:
        others = _left_out(source)
        raise PhotoError(
            f"The folder '{source}' holds no photos" + (f" ({others})" if others else ""),
            "Put PNG, JPEG, TIFF, WebP or BMP files directly into it",
        )
    for file in files:
        check_photo_name(file)
    return files


def _reads_heif() -> bool:
    return importlib.util.find_spec(HEIF_PACKAGE) is not None


def _hidden(path: Path) -> bool:
    return path.name.startswith(".") or not path.is_file()


def _left_out(source: Path) -> str:
    """Which pictures of a folder are of kinds that are not read: '3 files of kinds that are not read: a.gif, ...'."""
    if not source.is_dir():
        return ""
    names = [shown(name) for name in left_out([p.name for p in source.iterdir() if p.is_file()], _reads_heif())]
    listed = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
    heif = "; install pillow-heif for HEIC" if any(name.lower().endswith(tuple(HEIF)) for name in names) else ""
    return f"{len(names)} of kinds that are not read: {listed}{heif}" if names else ""


def load_photos(
    source: Path,
    max_size: int | None,
    progress: Progress,
    masks: Path | None = None,
    minimum: int = 2,
    background: Background = Background(),
    store: PhotoStore | None = None,
) -> list[Photo]:
    """Reads every photo of a folder.

    Grey becomes three equal channels; CMYK and palettes are converted; 8 or 16 bit stays 8 or 16 bit. Where a file is
    transparent, the photo is empty, and its colours are put over the background. Files that cannot be read are named
    in a note and left out.

    Args:
        source: folder of photos, or a list of them.
        max_size: longest side in px; larger photos are scaled down (area average in the sRGB
            encoding, as blur and loss work there). None keeps every pixel.
        progress: hears of each photo; may cancel.
        masks: folder with one image per photo of the same stem; white counts, black does not.
        minimum: how many readable photos are enough to go on.
        background: behind transparent photos.
        store: where their px are kept; None: in memory.

    Returns:
        The photos, sorted by name.

    Raises:
        PhotoError: nothing there, or fewer than `minimum` readable photos. OutputError: no room in the store.
        Cancelled: the user asked to stop.
    """
    files = photo_files(source)
    if max_size is not None and max_size < SETTINGS.smallest:
        raise PhotoError(f"A longest side of {max_size} px is too small", f"Ask for at least {SETTINGS.smallest} px")
    others = _left_out(source)
    if others:
        progress.note(f"Pictures left out: {others}")
    mask_files = _masks(masks) if masks is not None else {}
    progress.stage("photos", len(files))
    reader = partial(_stored, store=store, max_size=max_size, background=background)
    photos, failures = _read_all(files, reader, mask_files if masks is not None else None, progress)
    if masks is not None and not any(_stem(p.path) in mask_files for p in photos):
        raise PhotoError(f"No mask in '{masks}' has the name of a photo", "Give each mask its photo's name")
    for count, what in (
        (sum(p.not_finite for p in photos), "are not finite and do not count"),
        (sum(p.clipped for p in photos), "lie outside [0, 1] and were cut"),
    ):
        if count:
            progress.note(f"{count} px of the photos {what}")
    if len(photos) < minimum:
        listed = ", ".join(failures[:5]) + (", ..." if len(failures) > 5 else "")
        named = f" (could not be read: {listed})" if failures else ""
        raise PhotoError(
            f"'{source}' holds {len(photos)} readable photo{'' if len(photos) == 1 else 's'}{named}",
            f"Add photos from other viewpoints; at least {minimum} are needed",
        )
    return _behind_all(photos, background, progress)


def _read_all(
    files: list[Path], reader: Callable[[Path], Photo], mask_files: dict[str, Path] | None, progress: Progress
) -> tuple[list[Photo], list[str]]:
    """The photos that can be read, with their masks, and the names of the others, each with a note."""
    photos: list[Photo] = []
    failures: list[str] = []
    pool = ThreadPoolExecutor(min(SETTINGS.decoders, os.cpu_count() or 1))
    try:
        read = [pool.submit(reader, path) for path in files]
        for index, (path, one) in enumerate(zip(files, read, strict=True)):
            if progress.cancelled():
                raise Cancelled("Stopped while reading photos")
            try:
                photo = one.result()
                if mask_files is not None:
                    photo = _with_mask(photo, mask_files.get(_stem(path)), progress)
            except PhotoError as error:
                failures.append(path.name)
                progress.note(f"Left out: {error}")
            else:
                photos.append(photo)
            progress.advance(index + 1)
    finally:
        pool.shutdown(cancel_futures=True)
    return photos, failures


def _behind_all(photos: list[Photo], background: Background, progress: Progress) -> list[Photo]:
    """The photos of a set; if any is transparent, the background is behind the opaque ones, too."""
    transparent = sum(photo.alpha is not None for photo in photos)
    if not transparent:
        return photos
    progress.note(f"Transparent px of {transparent} photos count as empty; they are shown over {background.name}")
    return [replace(photo, background=background) for photo in photos]


def load_photo(path: Path, max_size: int | None = None, background: Background | None = Background()) -> Photo:
    """Reads one photo; see `load_photos`.

    Args:
        background: behind a transparent photo; None for the colours as filed, whatever the alpha says.

    Raises:
        PhotoError: the file is unreadable, truncated or holds no picture.
    """
    try:
        read, content = _read(path), file_digest(path)
    except PhotoError:
        raise
    except MemoryError as error:
        raise PhotoError(f"'{path.name}' is too large for the memory", "Make it smaller, or free memory") from error
    except Exception as error:  # decoders raise whatever they like; the file's name is what helps
        reason = str(error).strip().splitlines()[0][:120] if str(error).strip() else type(error).__name__
        raise PhotoError(f"'{path.name}' cannot be read as a photo ({reason})", "Replace or remove the file") from error
    pixels, alpha, focal_35mm, mask = read.pixels, read.alpha, read.focal_35mm, read.finite
    height, width = pixels.shape[:2]
    if alpha is None or background is None or bool((alpha == np.iinfo(alpha.dtype).max).all()):
        alpha = background = None
    else:  # before anything is averaged: what a file hides under alpha 0 must not bleed
        pixels = under(background, pixels, alpha)
    new_width, new_height = size_within(width, height, max_size)
    if (new_width, new_height) != (width, height):
        pixels = resized(pixels, new_width, new_height)
        alpha = None if alpha is None else resized(alpha, new_width, new_height)
        mask = None if mask is None else resized_mask(mask, new_width, new_height)
    focal = None if focal_35mm is None else focal_35mm / _DIAGONAL_35MM * float(np.hypot(new_width, new_height))
    name = unicodedata.normalize("NFC", path.name)
    scale = new_width / width, new_height / height
    not_finite = 0 if read.finite is None else int((~read.finite).sum())
    return Photo(name, path, pixels, mask, scale, focal, not_finite, read.clipped, alpha, background, content)


def _stored(path: Path, store: PhotoStore | None, max_size: int | None, background: Background) -> Photo:
    """`load_photo`, with the px in the store at once: those who read ahead would fill the memory."""
    photo = load_photo(path, max_size, background)
    if store is None:
        return photo
    alpha = None if photo.alpha is None else store.kept(photo.alpha)
    mask = None if photo.mask is None else store.kept(photo.mask)
    return replace(photo, pixels=store.kept(photo.pixels), alpha=alpha, mask=mask)


def _read(path: Path) -> _Decoded:
    if path.suffix.lower() in {".tif", ".tiff"}:
        # Pillow has no 16-bit RGB; tifffile does, but reads no EXIF rotation of its own.
        return _read_tiff(path)
    check_png(path)
    if path.suffix.lower() == ".png" and _png_depth(path) == 16:
        from .png16 import read_png16  # heavy: numba; Pillow would cut 16 bits to 8

        return _from_array(read_png16(path))
    if path.suffix.lower() in HEIF:
        importlib.import_module(HEIF_PACKAGE).register_heif_opener()  # an extra package
    # (of a file Pillow takes as much memory as a PNG chunk declares to be long)
    with Image.open(io.BytesIO(path.read_bytes()) if path.suffix.lower() == ".png" else path) as opened:
        _check_packed(opened, path)
        exif = opened.getexif()
        focal = exif.get_ifd(_EXIF_IFD).get(_FOCAL_35MM)
        opened.load()
        image: Image.Image = opened
        ImageOps.exif_transpose(image, in_place=True)  # (a large photo should lie in memory no more often than it must)
        if image.mode in {"I;16", "I;16B", "I;16L", "I", "F"}:
            grey = np.asarray(image)
            return _from_array(grey.astype(np.uint16) if grey.dtype.kind in "iu" else grey)
        alpha = None
        if image.mode in {"RGBA", "LA", "PA", "RGBa", "La"} or "transparency" in image.info:
            rgba = image.convert("RGBA")
            alpha = np.asarray(rgba.getchannel("A")).copy()
            image = rgba
        image = image if image.mode == "RGB" else image.convert("RGB")
        return _Decoded(np.asarray(image).copy(), alpha, float(focal) if focal else None)


def _check_packed(opened: Image.Image, path: Path) -> None:
    """Refuses a PNG or JPEG whose file cannot hold as many px as it declares: decoders fill the rest with black."""
    declared = opened.width * opened.height * 3
    if opened.format == "PNG":
        with path.open("rb") as stream:
            depth, kind = stream.read(26)[24:]
        declared = opened.width * opened.height * depth * _PNG_CHANNELS.get(kind, 1) // 8
    if opened.format in ("PNG", "JPEG") and declared > _MOST_DEFLATED * path.stat().st_size:
        size = f"{opened.width} x {opened.height} px"
        raise PhotoError(f"'{path.name}' declares {size}, which its file cannot hold", "Replace or remove the file")


def _png_depth(path: Path) -> int:
    with path.open("rb") as stream:
        header = stream.read(26)
    return header[24] if len(header) == 26 else 0


def _read_tiff(path: Path) -> _Decoded:
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # its complaints come as our PhotoError
    with tifffile.TiffFile(path) as tiff:
        page = tiff.pages[0]
        assert isinstance(page, tifffile.TiffPage)
        photometric = int(page.photometric)
        orientation = page.tags.get("Orientation")
        _check_declared(page, path)
        if photometric not in (0, 1, 2):  # palette, CMYK, YCbCr, Lab: Pillow converts them
            with Image.open(path) as opened:
                opened.load()
                upright = ImageOps.exif_transpose(opened) or opened
                return _Decoded(np.asarray(upright.convert("RGB")).copy())
        array = page.asarray()
        if int(page.planarconfig) == 2 and array.ndim == 3:
            array = array.transpose(1, 2, 0)
    if photometric == 0:  # white is zero
        array = np.iinfo(array.dtype).max - array if array.dtype.kind == "u" else 1.0 - array
    read = _from_array(array)
    if read.alpha is not None and _ASSOCIATED_ALPHA in page.extrasamples:
        read.pixels = _divided(read.pixels, read.alpha)
    turn = int(orientation.value) if orientation is not None else 1
    read.pixels = _upright(read.pixels, turn)
    read.alpha = None if read.alpha is None else _upright(read.alpha, turn)
    read.finite = None if read.finite is None else _upright(read.finite, turn)
    return read


def _divided(pixels: Pixels, alpha: Pixels) -> Pixels:
    """Colours that a file holds multiplied by alpha, as they are without; black where it is empty."""
    top = np.iinfo(pixels.dtype).max
    straight = pixels * (np.float32(top) / np.maximum(alpha, 1)[:, :, None].astype(np.float32))
    divided: NDArray[Any] = np.clip(straight + 0.5, 0, top).astype(pixels.dtype)
    return divided


def _check_declared(page: tifffile.TiffPage, path: Path) -> None:
    """Refuses a picture that would fill the memory though its file holds next to nothing of it."""
    declared = max(math.prod(page.shape), math.prod(page.chunks)) * 2
    if declared > max(_SMALL_PICTURE, _MOST_PACKED * path.stat().st_size):
        raise PhotoError(f"'{path.name}' declares a picture of {declared // 2**20} MiB", "Replace or remove the file")


def _upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """EXIF orientation 1..8 undone."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    return np.ascontiguousarray(array)


def _from_array(array: NDArray[Any]) -> _Decoded:
    """Any [H, W] or [H, W, 1..4] array; px that are not finite are found."""
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 2, 3, 4) or 0 in array.shape:
        raise PhotoError(f"A picture of shape {array.shape} is no photo")
    if array.dtype == np.bool_:
        array = array.astype(np.uint8) * np.uint8(255)
    finite, clipped = None, 0
    if array.dtype.kind == "f":
        finite = np.isfinite(array).all(axis=2)
        mean = array[finite].mean(axis=0, dtype=np.float64) if finite.any() else 0.0  # it may bleed into neighbours
        filled = np.where(finite[:, :, None], array, mean).astype(np.float64)
        clipped = int(((filled < 0.0) | (filled > 1.0)).any(axis=2)[finite].sum())
        array = (np.clip(filled, 0.0, 1.0) * 65535.0 + 0.5).astype(np.uint16)
    if array.dtype not in (np.uint8, np.uint16):
        raise PhotoError(f"Pixels of type {array.dtype} are not understood")
    alpha = None
    if array.shape[2] in (2, 4):
        alpha = np.ascontiguousarray(array[:, :, -1])
        array = array[:, :, :-1]
    if array.shape[2] == 1:
        array = np.repeat(array, 3, axis=2)
    if finite is not None and bool(finite.all()):
        finite = None
    return _Decoded(np.ascontiguousarray(array), alpha, None, finite, clipped)


def _stem(path: Path) -> str:
    return unicodedata.normalize("NFC", path.stem).casefold()


def _masks(folder: Path) -> dict[str, Path]:
    try:
        return {_stem(p): p for p in photo_files(folder)}
    except PhotoError as error:
        raise PhotoError(f"Masks: {error.what}", error.way_out) from error


def _with_mask(photo: Photo, path: Path | None, progress: Progress) -> Photo:
    if path is None:
        progress.note(f"'{photo.name}' has no mask: all its pixels count")
        return photo
    drawn = load_photo(path, background=None)
    width, height = photo.size
    given = drawn.size
    if abs(given[0] * height - given[1] * width) > SETTINGS.mask_aspect * given[0] * height:
        raise PhotoError(
            f"The mask '{path.name}' is {given[0]} x {given[1]} px, its photo {width} x {height}",
            "Give the mask its photo's size",
        )
    white = drawn.pixels[:, :, 1] >= SETTINGS.half * np.iinfo(drawn.pixels.dtype).max
    mask = resized_mask(white, width, height)
    if photo.mask is not None:
        mask &= photo.mask
    mask = kept_beside(photo.pixels, mask)
    if not mask.any():
        progress.note(f"The mask '{path.name}' leaves no pixel of '{photo.name}'")
    return replace(photo, mask=mask, content=f"{photo.content}+{drawn.content}")
