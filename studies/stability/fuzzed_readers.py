"""The readers that `reader_fuzz` damages files for, each with a valid file."""

from __future__ import annotations

import base64
import importlib.util
import json
import shutil
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image

from ...core.evaluation.lines import read_lines
from ...core.formats.cameras import read_cameras
from ...core.formats.colmap import write_lenses
from ...core.formats.gaussians import read_gaussians, write_gaussians
from ...core.formats.transforms import write_transforms
from ...core.imaging.kernel_files import read_kernel
from ...core.imaging.psf_text import parse_psf
from ...core.lens import Lens
from ...core.photos.load import Photo, load_photo, load_photos, photo_files
from ...core.photos.movie import extract_frames
from ...core.photos.undistort import Undistortion, undistorted_views
from ...core.pipeline.blind import given_spreads
from ...core.pose import Pose
from ...core.progress import Silent
from ...core.sfm.given import load_cameras
from .damage import Damage, damaged, damaged_npy, inside_gzip, inside_png, png
from .fuzzed_samples import cameras, cloud, points
from .fuzzed_state import state_readers
from .reader_fuzz import Reader

#: EXIF's tags: of its own directory, of the focal length on 35 mm film, of the orientation.
_EXIF, _FOCAL, _ORIENTATION = 0x8769, 0xA405, 0x0112


def _splats(suffix: str, damage: Damage = damaged) -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        if suffix == ".gltf":
            write_gaussians(place / "a.glb", cloud())
            (place / "a.gltf").write_bytes(_text_gltf((place / "a.glb").read_bytes()))
        else:
            write_gaussians(place / f"a{suffix}", cloud())

    return Reader(suffix[1:], write, lambda place: read_gaussians(place / f"a{suffix}"), f"a{suffix}", damage)


def _parts_of_glb(binary: bytes) -> tuple[Any, bytes]:
    """The JSON of an asset, and its buffer."""
    (length,) = struct.unpack_from("<I", binary, 12)
    return json.loads(binary[20 : 20 + length]), binary[28 + length :]


def _text_gltf(binary: bytes) -> bytes:
    """The same asset as JSON with its buffer in a data URI."""
    content, data = _parts_of_glb(binary)
    content["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode("ascii")
    return json.dumps(content).encode("utf-8")


def _two_files(damaged_file: str) -> Reader:
    """A .gltf with its buffer in a file beside it."""

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        write_gaussians(place / "a.glb", cloud())
        content, data = _parts_of_glb((place / "a.glb").read_bytes())
        content["buffers"][0]["uri"] = "a%20b.bin"
        (place / "a.gltf").write_text(json.dumps(content), "utf-8")
        (place / "a b.bin").write_bytes(data)

    return Reader(f"gltf beside {damaged_file}", write, lambda p: read_gaussians(p / "a.gltf"), damaged_file, damaged)


def _damage_of(suffix: str) -> Damage:
    return {".png": inside_png, ".npy": damaged_npy}.get(suffix, damaged)


def _photos_of_cameras() -> list[Photo]:
    return [Photo(name, Path(name), np.zeros((30, 40, 3), np.uint8)) for name in cameras()]


def _placed(path: Path) -> object:
    """Cameras as a run takes them: for its photos, which are straightened."""
    photos = _photos_of_cameras()
    found = load_cameras(path, photos)
    return undistorted_views([photo for photo in photos if photo.name in found.poses], found)


def _straightened(path: Path) -> object:
    """Cameras of a file without points, which a run would scatter: that takes most of the time."""
    model = read_cameras(path, dict.fromkeys(("a", "b"), (40, 30)))
    for lens in set(model.lenses.values()):
        if lens.width * lens.height < 10_000:
            Undistortion(lens).prepare()
    return model.pinholes()


def _colmap(file: str) -> Reader:
    def write(place: Path) -> None:
        lens = Lens("OPENCV", 40, 30, (35.0, 35.0, 20.0, 15.0, 0.01, 0.0, 0.0, 0.001))
        poses = {name: Pose(c.rotation, c.translation) for name, c in cameras().items()}
        write_lenses(place, dict.fromkeys(poses, lens), poses, points(), binary=file.endswith(".bin"))

    return Reader(f"colmap {file}", write, _placed, file, damaged)


def _transforms() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        write_transforms(place / "transforms.json", cameras())
        content = json.loads((place / "transforms.json").read_text("utf-8"))
        content |= {"camera_angle_x": 1.0, "aabb_scale": 4, "k1": 0.01, "k2": 0.0, "p1": 0.0, "p2": 0.001, "k3": 0.0}
        content["frames"][1] |= {"k3": 0.001, "is_fisheye": False, "camera_angle_y": 0.9}
        del content["frames"][1]["fl_y"]
        (place / "transforms.json").write_text(json.dumps(content), "utf-8")

    return Reader("transforms.json", write, _straightened, "transforms.json", damaged)


def _llff() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        rows = []
        for camera in cameras().values():
            down, right, backward = camera.rotation[1], camera.rotation[0], -camera.rotation[2]
            size = np.array([camera.height, camera.width, camera.fx])
            pose = np.stack([down, right, backward, -camera.rotation.T @ camera.translation, size], axis=1)
            rows.append([*pose.ravel(), 0.5, 9.0])
        np.save(place / "poses_bounds.npy", np.array(rows))

    def read(place: Path) -> object:
        return read_cameras(place, {Path(name).stem: (40, 30) for name in cameras()})

    return Reader("poses_bounds.npy", write, read, "poses_bounds.npy", damaged_npy)


def _movie(suffix: str, codec: str) -> Reader:
    name = f"movie{suffix}"

    def write(place: Path) -> None:
        av = importlib.import_module("av")  # an extra package
        place.mkdir(exist_ok=True)
        random = np.random.default_rng(4)
        with av.open(str(place / name), "w") as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = 48, 32, "yuvj420p" if codec == "mjpeg" else "yuv420p"
            frames = (random.integers(0, 255, (32, 48, 3), dtype=np.uint8) for _ in range(6))
            encoded = [stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")) for frame in frames]
            for packet in [packet for packets in [*encoded, stream.encode()] for packet in packets]:
                container.mux(packet)

    def read(place: Path) -> object:
        shutil.rmtree(place / "frames", ignore_errors=True)
        return extract_frames(place / name, place / "frames", 3, Silent())

    return Reader(f"movie {suffix}", write, read, name, damaged)


def _frames() -> Reader:
    """The list of the frames that were taken from a movie before."""
    movie = _movie(".mp4", "mpeg4")

    def write(place: Path) -> None:
        movie.write(place)
        extract_frames(place / "movie.mp4", place / "frames", 3, Silent())

    return Reader(
        "frames.json",
        write,
        lambda place: extract_frames(place / "movie.mp4", place / "frames", 3, Silent()),
        "frames/frames.json",
        damaged,
        forgives=True,
    )


def _kernel(suffix: str) -> Reader:
    name = f"kernel{suffix}"

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        y, x = np.mgrid[-3:4, -3:4]
        values = np.exp(-0.5 * (x**2 + y**2) / 2.0).astype(np.float32)
        if suffix == ".npy":
            np.save(place / name, values)
        elif suffix == ".tif":
            tifffile.imwrite(place / name, values)
        elif suffix == ".png":
            Image.fromarray(np.round(255 * values).astype(np.uint8)).save(place / name)
        else:
            (place / name).write_bytes(_fits(values))

    return Reader(f"kernel {suffix}", write, lambda place: _read_kernel(place / name), name, _damage_of(suffix))


def _read_kernel(path: Path) -> object:
    read_kernel(path)
    return parse_psf(f"file:{path}")


def _fits(values: np.ndarray) -> bytes:
    cards = ["SIMPLE  =                    T", "BITPIX  =                  -32", "NAXIS   =                    2"]
    cards += [f"NAXIS1  = {values.shape[1]:>20}", f"NAXIS2  = {values.shape[0]:>20}", "END"]
    head = "".join(card.ljust(80) for card in cards).ljust(2880).encode("ascii")
    data = values.astype(">f4").tobytes()
    return head + data + bytes(-len(data) % 2880)


def _photo(suffix: str) -> Reader:
    name = f"photo{suffix}"

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        random = np.random.default_rng(2)
        picture = Image.fromarray(random.integers(0, 255, (30, 40, 3), dtype=np.uint8))
        exif = Image.Exif()
        exif[_ORIENTATION] = 6
        exif.get_ifd(_EXIF)[_FOCAL] = 28
        if suffix == ".tif":
            picture.convert("CMYK").save(place / name)
        elif suffix == ".heic":
            importlib.import_module("pillow_heif").register_heif_opener()
            picture.save(place / name)
        else:
            picture.save(place / name, exif=exif.tobytes() if suffix != ".bmp" else b"")

    return Reader(f"photo {suffix}", write, lambda place: load_photo(place / name), name, _damage_of(suffix))


def _spreads() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        given = {"a.png": "gaussian:3", "b.png": "gaussian:3,2,10+path:8,3", "*": "none"}
        (place / "psf.json").write_text(json.dumps(given), "utf-8")

    return Reader("per-photo PSF", write, lambda p: given_spreads(f"per-photo:{p / 'psf.json'}"), "psf.json", damaged)


def _deep_photo(suffix: str) -> Reader:
    """16 bits per value."""
    name = f"photo{suffix}"

    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        values = np.random.default_rng(3).integers(0, 2**16, (30, 40, 3), dtype=np.uint16)
        if suffix == ".tif":
            tifffile.imwrite(place / name, values, photometric="rgb")
        else:
            (place / name).write_bytes(_png16(values))

    return Reader(f"16-bit photo {suffix}", write, lambda place: load_photo(place / name), name, _damage_of(suffix))


def _png16(values: np.ndarray) -> bytes:
    """Rows without a filter."""
    height, width, _ = values.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), values.astype(">u2").view(np.uint8).reshape(height, -1)], 1)
    head = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    return png(((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b"")))


def _masked() -> Reader:
    def write(place: Path) -> None:
        for folder in ("photos", "masks"):
            (place / folder).mkdir(parents=True, exist_ok=True)
            for name in ("a.png", "b.png"):
                Image.fromarray(np.full((30, 40), 255, np.uint8)).save(place / folder / name)

    def read(place: Path) -> object:
        return load_photos(place / "photos", None, Silent(), place / "masks", minimum=1)

    return Reader("mask", write, read, "masks/a.png", inside_png, forgives=True)


def _list() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        for name in ("a.png", "b.png"):
            Image.fromarray(np.full((30, 40), 255, np.uint8)).save(place / name)
        (place / "list.txt").write_text("# photos\na.png\nb.png\n", "utf-8")

    return Reader("list of photos", write, lambda place: photo_files(place / "list.txt"), "list.txt", damaged)


def _lines() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        line = {"name": "a", "width_m": 0.1, **{key: [[0.0, 1.0, 2.0]] * 2 for key in ("points", "across", "normals")}}
        (place / "lines.json").write_text(json.dumps([line]), "utf-8")

    return Reader("lines.json", write, lambda place: read_lines(place / "lines.json"), "lines.json", damaged)


def readers() -> list[Reader]:
    """All of `core`."""
    photos = [".png", ".jpg", ".tif", ".webp", ".bmp"]
    if importlib.util.find_spec("pillow_heif"):
        photos.append(".heic")
    movies = [(".mp4", "mpeg4"), (".mkv", "ffv1"), (".avi", "mjpeg")] if importlib.util.find_spec("av") else []
    return [
        *(_splats(suffix) for suffix in (".ply", ".splat", ".gltf", ".glb")),
        _splats(".spz", inside_gzip),
        *(_two_files(file) for file in ("a.gltf", "a b.bin")),
        *(_colmap(f"{name}{suffix}") for suffix in (".bin", ".txt") for name in ("cameras", "images", "points3D")),
        _transforms(),
        _llff(),
        *(_kernel(suffix) for suffix in (".npy", ".tif", ".png", ".fits")),
        *(_photo(suffix) for suffix in photos),
        *(_deep_photo(suffix) for suffix in (".png", ".tif")),
        _masked(),
        *(_movie(*movie) for movie in movies),
        *([_frames()] if movies else []),
        _list(),
        _spreads(),
        _lines(),
        *state_readers(),
    ]
