"""Frames of a movie: spread over it, the sharpest of each stretch, upright, in the right colours."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from dgs.core.errors import Cancelled, PhotoError
from dgs.core.photos import movie as module
from dgs.core.photos.load import photo_files
from dgs.core.photos.movie import extract_frames, is_movie, sharpness
from dgs.core.progress import Silent
from PIL import Image, ImageFilter

RATE, LENGTH = 25, 100


def scene(index: int, width: int = 320, height: int = 180) -> Image.Image:
    """A textured wall past which the camera moves."""
    noise = np.random.default_rng(0).integers(0, 256, (height // 4, width // 4 + LENGTH, 3), dtype=np.uint8)
    part = noise[:, index : index + width // 4]
    return Image.fromarray(part).resize((width, height), Image.Resampling.BICUBIC)


def blurred_but_every_tenth(index: int) -> Image.Image:
    return scene(index) if index % 10 == 5 else scene(index).filter(ImageFilter.GaussianBlur(3))


def write_movie(
    path: Path,
    picture: Callable[[int], Image.Image],
    codec: str = "mpeg4",
    frames: int = LENGTH,
    pixels: str = "yuv420p",
) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE)
        first = picture(0)
        stream.width, stream.height, stream.pix_fmt = first.width, first.height, pixels
        if codec == "mpeg4":
            stream.bit_rate = 8_000_000
        for index in range(frames):
            for packet in stream.encode(av.VideoFrame.from_image(picture(index))):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def test_the_sharpest_frame_of_each_stretch_is_taken(tmp_path: Path) -> None:
    movie = write_movie(tmp_path / "walk.mp4", blurred_but_every_tenth)
    folder = extract_frames(movie, tmp_path / "frames", 10, Silent())
    names = [path.name for path in photo_files(folder)]
    assert names == [f"frame_{index:06}.png" for index in range(5, 100, 10)]
    assert Image.open(folder / names[0]).size == (320, 180)
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    extract_frames(movie, tmp_path / "frames", 10, Silent())  # at once: nothing is written anew
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before
    extract_frames(movie, tmp_path / "frames", 5, Silent())
    assert len(photo_files(folder)) == 5


def test_a_camera_that_stands_still_gives_one_frame(tmp_path: Path) -> None:
    movie = write_movie(tmp_path / "stop.mp4", lambda index: scene(max(index - 50, 0)))
    chosen = [int(path.stem[-6:]) for path in photo_files(extract_frames(movie, tmp_path / "a", 20, Silent()))]
    assert len([index for index in chosen if index <= 50]) == 1 and len(chosen) == 11
    still = write_movie(tmp_path / "still.mp4", lambda _: scene(0))
    with pytest.raises(PhotoError, match=r"still\.mp4.*1 view only"):
        extract_frames(still, tmp_path / "b", 20, Silent())


def test_colours_are_those_of_the_movie(tmp_path: Path) -> None:
    colours = [(200, 60, 40), (40, 180, 70), (50, 70, 190)]

    def picture(index: int) -> Image.Image:
        return Image.new("RGB", (64, 64), colours[index // 10])

    movie = write_movie(tmp_path / "colours.mkv", picture, "ffv1", 30, "yuv444p")
    files = photo_files(extract_frames(movie, tmp_path / "frames", 3, Silent()))
    for path, colour in zip(files, colours, strict=True):
        assert np.abs(np.asarray(Image.open(path)).reshape(-1, 3).mean(axis=0) - colour).max() < 3


def test_a_movie_held_upright_stands_upright(tmp_path: Path) -> None:
    """A phone's portrait: the frames lie on their side, and the file says 'turn me clockwise by 90 degrees'."""

    def picture(index: int) -> Image.Image:
        image = Image.new("RGB", (96, 64), (10 + index, 10, 10))
        image.paste((255, 255, 255), (0, 0, 32, 32))  # the upper left corner as it is stored
        return image

    path = write_movie(tmp_path / "portrait.mp4", picture, "mpeg4", 40)
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 44
    one = 1 << 16
    data[matrix : matrix + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(data)
    frame = np.asarray(Image.open(photo_files(extract_frames(path, tmp_path / "frames", 2, Silent()))[0]))
    assert frame.shape[:2] == (96, 64)
    assert frame[16, 48].min() > 200 and frame[16, 8].max() < 80  # turned clockwise, it is the upper right one


def test_what_is_no_movie_is_named(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="nowhere"):
        extract_frames(tmp_path / "nowhere.mp4", tmp_path / "f", 5, Silent())
    (tmp_path / "text.mp4").write_text("this is no movie")
    with pytest.raises(PhotoError, match=r"text\.mp4"):
        extract_frames(tmp_path / "text.mp4", tmp_path / "f", 5, Silent())
    whole = write_movie(tmp_path / "whole.mp4", scene).read_bytes()
    (tmp_path / "half.mp4").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PhotoError, match=r"half\.mp4"):
        extract_frames(tmp_path / "half.mp4", tmp_path / "f", 5, Silent())
    assert is_movie(Path("a.MOV")) and not is_movie(Path("a.png"))


def test_it_can_be_stopped_and_leaves_no_list(tmp_path: Path) -> None:
    class Stopped(Silent):
        def cancelled(self) -> bool:
            return True

    movie = write_movie(tmp_path / "walk.mp4", scene)
    with pytest.raises(Cancelled):
        extract_frames(movie, tmp_path / "frames", 5, Stopped())
    assert not (tmp_path / "frames" / "frames.json").exists()


def test_sharpness_ignores_exposure_and_contrast() -> None:
    sharp = np.asarray(scene(0).convert("L"), np.float32)
    soft = np.asarray(scene(0).convert("L").filter(ImageFilter.GaussianBlur(2)), np.float32)
    assert sharpness(sharp) > 2 * sharpness(soft)
    assert sharpness(0.3 * sharp + 40) == pytest.approx(sharpness(sharp), rel=1e-4)
    assert sharpness(np.full((9, 9), 7.0, np.float32)) == 0.0


def test_a_table_that_declares_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    whole = write_movie(tmp_path / "whole.mp4", scene).read_bytes()
    for kind, at in ((b"stts", 8), (b"stsc", 8), (b"stsz", 12), (b"stco", 8)):
        damaged = bytearray(whole)
        struct.pack_into(">I", damaged, whole.rindex(kind) + at, 0x61760000)
        (tmp_path / "table.mp4").write_bytes(damaged)
        with pytest.raises(PhotoError, match=f"table.mp4.*'{kind.decode()}' declares 16"):
            extract_frames(tmp_path / "table.mp4", tmp_path / "f", 5, Silent())
    nested = b"".join(struct.pack(">I4s", 8 * (20_000 - n), b"moov") for n in range(20_000))
    (tmp_path / "nested.mp4").write_bytes(nested)
    with pytest.raises(PhotoError, match=r"nested\.mp4"):
        extract_frames(tmp_path / "nested.mp4", tmp_path / "f", 5, Silent())


def test_an_unknown_way_of_coding_is_named(tmp_path: Path) -> None:
    whole = write_movie(tmp_path / "whole.mp4", scene).read_bytes()
    at = whole.index(b"stsd") + 16
    (tmp_path / "odd.mp4").write_bytes((whole[:at] + b"qqqq" + whole[at + 4 :]).replace(b"esds", b"none"))
    with pytest.raises(PhotoError, match=r"'odd\.mp4' is coded in a way that is not known"):
        extract_frames(tmp_path / "odd.mp4", tmp_path / "f", 5, Silent())


def test_frames_that_no_memory_holds_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    movie = write_movie(tmp_path / "large.mp4", scene)
    monkeypatch.setattr(module, "_MOST_PIXELS", 1000)
    with pytest.raises(PhotoError, match=r"large\.mp4' declares frames of 320 x 180 px"):
        extract_frames(movie, tmp_path / "f", 5, Silent())
