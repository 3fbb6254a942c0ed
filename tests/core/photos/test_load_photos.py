from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from dgs.core.errors import PhotoError
from dgs.core.photos.load import load_photo, load_photos
from dgs.core.progress import Silent
from PIL import Image


class Notes(Silent):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def picture(height: int = 20, width: int = 30) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def png16(path: Path, values: np.ndarray, row_filter: int) -> None:
    """A 16-bit PNG whose rows all use one of the five filters."""
    height, width, channels = values.shape
    rows = values.astype(">u2").view(np.uint8).reshape(height, -1).astype(int)
    step, packed = 2 * channels, b""
    for y in range(height):
        left = np.concatenate([np.zeros(step, int), rows[y, :-step]])
        up = rows[y - 1] if y else np.zeros_like(rows[y])
        corner = np.concatenate([np.zeros(step, int), up[:-step]])
        base = left + up - corner
        second = np.where(abs(base - up) <= abs(base - corner), up, corner)
        first = (abs(base - left) <= abs(base - up)) & (abs(base - left) <= abs(base - corner))
        paeth = np.where(first, left, second)
        guess = [0, left, up, (left + up) // 2, paeth][row_filter]
        packed += bytes([row_filter]) + ((rows[y] - guess) & 255).astype(np.uint8).tobytes()

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    colour = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", width, height, 16, colour, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(packed)) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".webp"])
def test_lossless_files_come_back_bitwise(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"blé d'été{suffix}"
    Image.fromarray(picture()).save(path, lossless=True) if suffix == ".webp" else Image.fromarray(picture()).save(path)
    photo = load_photo(path)
    np.testing.assert_array_equal(photo.pixels, picture())
    assert photo.mask is None and photo.size == (30, 20)


@pytest.mark.parametrize("row_filter", range(5))
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_16_bit_png(tmp_path: Path, row_filter: int, channels: int) -> None:
    values = np.random.default_rng(1).integers(0, 65536, (9, 7, channels)).astype(np.uint16)
    png16(tmp_path / "a.png", values, row_filter)
    photo = load_photo(tmp_path / "a.png")
    assert photo.pixels.dtype == np.uint16
    np.testing.assert_array_equal(photo.pixels, values[:, :, :3] if channels > 1 else np.repeat(values, 3, 2))
    if channels == 4:
        np.testing.assert_array_equal(photo.mask, values[:, :, 3] >= 32768)


def test_16_bit_tiff_grey_and_rgba(tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(0, 65536, (9, 7)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", values)
    np.testing.assert_array_equal(load_photo(tmp_path / "a.tif").pixels, np.repeat(values[:, :, None], 3, 2))


def test_alpha_becomes_the_mask(tmp_path: Path) -> None:
    rgba = np.concatenate([picture(), np.full((20, 30, 1), 255, np.uint8)], 2)
    rgba[:5, :, 3] = 0
    Image.fromarray(rgba).save(tmp_path / "a.png")
    photo = load_photo(tmp_path / "a.png")
    np.testing.assert_array_equal(photo.pixels, picture())
    assert photo.mask is not None and not photo.mask[:5].any() and photo.mask[5:].all()


def test_cmyk_grey_and_palette_become_rgb(tmp_path: Path) -> None:
    Image.new("CMYK", (8, 6), (0, 255, 255, 0)).save(tmp_path / "a.jpg")
    red = load_photo(tmp_path / "a.jpg").pixels
    assert red[..., 0].min() > 200 and red[..., 1:].max() < 60
    Image.new("L", (8, 6), 77).save(tmp_path / "b.png")
    assert (load_photo(tmp_path / "b.png").pixels == 77).all()
    Image.fromarray(picture()).quantize(4).save(tmp_path / "c.png")
    assert load_photo(tmp_path / "c.png").pixels.shape == (20, 30, 3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_rotation_is_undone_alike_in_jpeg_and_tiff(tmp_path: Path, orientation: int) -> None:
    image = Image.fromarray(picture(16, 24))
    exif = Image.Exif()
    exif[0x0112] = orientation
    image.save(tmp_path / "a.png", exif=exif)
    image.save(tmp_path / "a.tif", tiffinfo={0x0112: orientation})
    expected = load_photo(tmp_path / "a.png").pixels
    assert expected.shape[:2] == ((16, 24) if orientation < 5 else (24, 16))
    np.testing.assert_array_equal(load_photo(tmp_path / "a.tif").pixels, expected)


def test_max_size_scales_and_says_so(tmp_path: Path) -> None:
    Image.fromarray(picture(100, 201)).save(tmp_path / "a.png")
    photo = load_photo(tmp_path / "a.png", 50)
    assert photo.size == (50, 25) and photo.scale == (50 / 201, 25 / 100)


def test_broken_files_are_named_and_left_out(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "c.png"):
        Image.fromarray(picture()).save(tmp_path / name)
    (tmp_path / "b.png").write_bytes((tmp_path / "a.png").read_bytes()[:700])
    (tmp_path / "d.jpg").write_bytes(b"")
    (tmp_path / "e.tif").write_bytes(b"II*\0junk")
    (tmp_path / "notes.txt").write_text("no photo")
    progress = Notes()
    assert [p.name for p in load_photos(tmp_path, None, progress)] == ["a.png", "c.png"]
    for name in ("b.png", "d.jpg", "e.tif"):
        assert any(name in note for note in progress.notes)
    with pytest.raises(PhotoError, match=r"b\.png"):
        load_photos(tmp_path, None, Silent(), minimum=3)


def test_missing_and_empty_folders(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="no folder"):
        load_photos(tmp_path / "nowhere", None, Silent())
    with pytest.raises(PhotoError, match="holds no photos"):
        load_photos(tmp_path, None, Silent())


def test_masks_by_stem(tmp_path: Path) -> None:
    photos, masks = tmp_path / "photos", tmp_path / "masks"
    photos.mkdir()
    masks.mkdir()
    for name in ("a", "b"):
        Image.fromarray(picture()).save(photos / f"{name}.jpg")
    white = np.zeros((40, 60), np.uint8)
    white[:, 30:] = 255
    Image.fromarray(white).save(masks / "A.png")
    progress = Notes()
    first, second = load_photos(photos, None, progress, masks)
    assert first.mask is not None and first.mask[:, 15:].all() and not first.mask[:, :15].any()
    assert second.mask is None and any("b.jpg" in note for note in progress.notes)


def test_a_list_names_photos_wherever_they_lie(tmp_path: Path) -> None:
    for name in ("a/1.png", "b/2.png", "b/1.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        Image.fromarray(picture()).save(tmp_path / name)
    chosen = tmp_path / "chosen.txt"
    chosen.write_text(f"# some\nb/2.png\n\n{tmp_path / 'a' / '1.png'}\nb/2.png\n", "utf-8")
    assert [photo.name for photo in load_photos(chosen, None, Silent())] == ["1.png", "2.png"]
    for words, expected in (("a/1.png\nb/1.png", "two photos"), ("a/3.png", "a/3.png"), ("#\n", "no photos")):
        chosen.write_text(words, "utf-8")
        with pytest.raises(PhotoError, match=expected):
            load_photos(chosen, None, Silent())


def test_only_a_movie_is_turned_into_frames(tmp_path: Path) -> None:
    from dgs.core.photos.source import photo_source

    assert photo_source(tmp_path, tmp_path / "out", 5, Silent()) == tmp_path
    (tmp_path / "a folder.mp4").mkdir()
    assert photo_source(tmp_path / "a folder.mp4", tmp_path / "out", 5, Silent()) == tmp_path / "a folder.mp4"
    with pytest.raises(PhotoError, match=r"gone\.mov"):
        photo_source(tmp_path / "gone.mov", tmp_path / "out", 5, Silent())
