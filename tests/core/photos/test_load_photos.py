from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from dgs.core.background import Background
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
    photo = load_photo(tmp_path / "a.png", background=None)
    assert photo.pixels.dtype == np.uint16 and photo.alpha is None
    np.testing.assert_array_equal(photo.pixels, values[:, :, :3] if channels > 1 else np.repeat(values, 3, 2))
    if channels == 4:
        np.testing.assert_array_equal(load_photo(tmp_path / "a.png").alpha, values[:, :, 3])


def test_16_bit_tiff_grey_and_rgba(tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(0, 65536, (9, 7)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", values)
    np.testing.assert_array_equal(load_photo(tmp_path / "a.tif").pixels, np.repeat(values[:, :, None], 3, 2))


def test_a_transparent_photo_is_empty_there_and_shown_over_white(tmp_path: Path) -> None:
    rgba = np.concatenate([picture(), np.full((20, 30, 1), 255, np.uint8)], 2)
    rgba[:5, :, 3] = 0
    Image.fromarray(rgba).save(tmp_path / "a.png")
    photo = load_photo(tmp_path / "a.png")
    np.testing.assert_array_equal(photo.pixels[5:], picture()[5:])
    np.testing.assert_array_equal(photo.alpha, rgba[:, :, 3])
    assert (photo.pixels[:5] == 255).all() and photo.mask is None and photo.background == Background()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_half_transparent_px_by_hand(tmp_path: Path, dtype: type) -> None:
    """0.4 of the range at alpha 0.6 over white: 0.24 + 0.4 = 0.64; as light over black it is darker."""
    top = int(np.iinfo(dtype).max)
    rgba = np.full((8, 8, 4), round(0.4 * top), dtype)
    rgba[:, :, 3] = round(0.6 * top)
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=["unassalpha"])
    assert abs(load_photo(tmp_path / "a.tif").pixels / top - 0.64).max() <= 0.51 / top
    black = Background((0.0, 0.0, 0.0), "linear")
    # 0.4 decodes to 0.13287; 0.6 of it is 0.07972, which encodes to 0.31277.
    assert abs(load_photo(tmp_path / "a.tif", background=black).pixels / top - 0.31277).max() <= 0.51 / top + 2e-5
    assert (load_photo(tmp_path / "a.tif").alpha == rgba[0, 0, 3]).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_tiff_whose_colours_are_multiplied_by_alpha(tmp_path: Path, dtype: type) -> None:
    top = int(np.iinfo(dtype).max)
    rgba = np.full((8, 8, 4), round(0.24 * top), dtype)
    rgba[:, :, 3] = round(0.6 * top)
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=["assocalpha"])
    assert abs(load_photo(tmp_path / "a.tif").pixels / top - 0.64).max() <= 1.1 / top


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_a_file_hides_under_alpha_0_makes_no_rim_when_it_is_shrunk(tmp_path: Path, dtype: type) -> None:
    """A red disc, black where it is transparent: no px may be darker than red over white is."""
    top = int(np.iinfo(dtype).max)
    y, x = np.mgrid[:60, :60]
    disc = (x - 29.3) ** 2 + (y - 30.1) ** 2 < 20**2
    rgba = np.zeros((60, 60, 4), dtype)
    rgba[disc] = [top, 0, 0, top]
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=["unassalpha"])
    photo = load_photo(tmp_path / "a.tif", max_size=20)
    assert photo.alpha is not None and photo.alpha.dtype == dtype and photo.alpha.shape == (20, 20)
    assert photo.pixels[:, :, 0].min() >= top - 1
    # Of red over white, green and blue are exactly what alpha leaves.
    assert abs(photo.pixels[:, :, 1] / top - (1 - photo.alpha / top)).max() <= 1.01 / top


def test_masks_still_mask_transparent_photos(tmp_path: Path) -> None:
    (tmp_path / "masks").mkdir()
    (tmp_path / "photos").mkdir()
    rgba = np.concatenate([picture(), np.full((20, 30, 1), 255, np.uint8)], 2)
    rgba[:5, :, 3] = 0
    drawn = np.full((20, 30, 3), 255, np.uint8)
    drawn[:, :10] = 0
    for name in ("a", "b"):
        Image.fromarray(rgba).save(tmp_path / "photos" / f"{name}.png")
        Image.fromarray(drawn).save(tmp_path / "masks" / f"{name}.png")
    Image.fromarray(picture()).save(tmp_path / "photos" / "c.png")
    notes = Notes()
    photos = load_photos(tmp_path / "photos", None, notes, masks=tmp_path / "masks")
    assert photos[0].mask is not None and not photos[0].mask[:, :10].any() and photos[0].mask[:, 10:].all()
    assert photos[0].alpha is not None and (photos[0].alpha[:5] == 0).all()
    assert photos[2].alpha is None and photos[2].background == Background()  # one background behind all
    assert any("of 2 photos count as empty; they are shown over white" in note for note in notes.notes)


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


def declaring(content: bytes, mark: bytes, offset: int, size: bytes) -> bytes:
    """A picture whose header says another size."""
    at = content.index(mark) + offset
    return content[:at] + size + content[at + len(size) :]


def test_a_picture_that_its_file_cannot_hold(tmp_path: Path) -> None:
    """The decoders would fill gigabytes with black."""
    for name in ("a.png", "b.jpg"):
        Image.new("RGB", (64, 48), (200, 10, 10)).save(tmp_path / name)
    png, jpeg = ((tmp_path / name).read_bytes() for name in ("a.png", "b.jpg"))
    chunk = b"IHDR" + struct.pack(">II", 9000, 9000) + png[24:29]
    (tmp_path / "a.png").write_bytes(png[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[33:])
    (tmp_path / "b.jpg").write_bytes(declaring(jpeg, b"\xff\xc0", 5, struct.pack(">HH", 9000, 9000)))
    for name in ("a.png", "b.jpg"):
        with pytest.raises(PhotoError, match=f"'{name}' declares 9000 x 9000 px, which its file cannot hold"):
            load_photo(tmp_path / name)


def test_pictures_of_one_colour_are_packed_as_far_as_can_be_and_read(tmp_path: Path) -> None:
    Image.new("1", (4000, 4000), 1).save(tmp_path / "a.png", optimize=True)
    Image.new("L", (2000, 2000), 255).save(tmp_path / "b.png", compress_level=9)
    Image.new("RGB", (4000, 2000), (9, 9, 9)).save(tmp_path / "c.jpg", optimize=True, progressive=True, quality=1)
    assert (tmp_path / "c.jpg").stat().st_size < 4000 * 2000 * 3 / 400
    for name, size in (("a.png", (4000, 4000)), ("b.png", (2000, 2000)), ("c.jpg", (4000, 2000))):
        photo = load_photo(tmp_path / name)
        assert photo.size == size and np.ptp(photo.pixels) == 0


def test_a_lack_of_memory_is_called_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> str:
        raise MemoryError

    Image.new("L", (8, 6)).save(tmp_path / "a.png")
    monkeypatch.setattr("dgs.core.photos.load.file_digest", full)
    with pytest.raises(PhotoError, match="'a.png' is too large for the memory"):
        load_photo(tmp_path / "a.png")


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


@pytest.mark.parametrize("bits", [8, 16])
def test_a_png_that_was_cut_off_is_refused_wherever(tmp_path: Path, bits: int) -> None:
    path = tmp_path / "a.png"
    if bits == 8:
        Image.fromarray(picture()).save(path)
    else:
        png16(path, picture().astype(np.uint16) * 257, 1)
    whole = path.read_bytes()
    load_photo(path)
    for size in (*range(len(whole) // 2, len(whole) // 2 + 3), *range(len(whole) - 30, len(whole))):
        path.write_bytes(whole[:size])
        with pytest.raises(PhotoError, match=r"'a\.png' is truncated"):
            load_photo(path)
    path.write_bytes(whole + b"what another program added")
    load_photo(path)


def test_px_of_a_png_that_are_not_those_that_were_written_are_refused(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "c.png"):
        Image.fromarray(picture()).save(tmp_path / name)
    whole = bytearray((tmp_path / "b.png").read_bytes())
    whole[whole.index(b"IEND") - 8] ^= 1  # (of the px' checksum)
    (tmp_path / "b.png").write_bytes(whole)
    heard = Notes()
    assert [photo.name for photo in load_photos(tmp_path, None, heard)] == ["a.png", "c.png"]
    assert any(
        "Left out: 'b.png' is damaged (the checksum of its part 'IDAT' is wrong)" in note for note in heard.notes
    )
