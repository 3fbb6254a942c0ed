"""The readers that `reader_fuzz` damages files for, each with a valid file."""

from __future__ import annotations

import base64
import gzip
import io
import json
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from ...core.camera import Camera
from ...core.cloud import GaussianCloud
from ...core.evaluation.lines import read_lines
from ...core.formats.colmap import read_model, write_model
from ...core.formats.gaussians import read_gaussians, write_gaussians
from ...core.formats.transforms import read_transforms, write_transforms
from ...core.imaging.kernel_files import read_kernel
from ...core.imaging.psf_text import parse_psf
from ...core.photos.load import load_photo, load_photos, photo_files
from ...core.pipeline.blind import given_spreads
from ...core.progress import Silent
from ...core.sfm.features import Features, load_features, save_features
from ...core.sfm.settings import recipes
from ...core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ...core.twin.folder import TwinFolder
from ...core.views import SparsePoints
from .reader_fuzz import Damage, Reader, damaged


def cloud(count: int = 40) -> GaussianCloud:
    """Gaussians of degree 1."""
    random = np.random.default_rng(0)
    draw = lambda *shape: np.asarray(random.normal(size=shape), np.float32)  # noqa: E731
    return GaussianCloud(draw(count, 3), draw(count, 3) - 3, draw(count, 4), draw(count), draw(count, 4, 3))


def cameras() -> dict[str, Camera]:
    """Two cameras."""
    return {
        name: Camera(name, 40, 30, 35.0, 35.0, 20.0, 15.0, np.eye(3), np.array([x, 0.0, 2.0]))
        for name, x in (("a.png", 0.0), ("b.png", 1.0))
    }


def _splats(suffix: str, damage: Damage = damaged) -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        if suffix == ".gltf":
            write_gaussians(place / "a.glb", cloud())
            (place / "a.gltf").write_bytes(_text_gltf((place / "a.glb").read_bytes()))
        else:
            write_gaussians(place / f"a{suffix}", cloud())

    return Reader(suffix[1:], write, lambda place: read_gaussians(place / f"a{suffix}"), f"a{suffix}", damage)


def _text_gltf(binary: bytes) -> bytes:
    """The same asset as JSON with its buffer in a data URI."""
    (length,) = struct.unpack_from("<I", binary, 12)
    content, data = json.loads(binary[20 : 20 + length]), binary[28 + length :]
    content["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode("ascii")
    return json.dumps(content).encode("utf-8")


def _inside_gzip(content: bytes, random: np.random.Generator) -> bytes:
    if random.random() < 0.3:
        return damaged(content, random)
    return gzip.compress(damaged(gzip.decompress(content), random), 1)


def _inside_npz(content: bytes, random: np.random.Generator) -> bytes:
    if random.random() < 0.2:
        return damaged(content, random)
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    names = sorted(name for name, array in arrays.items() if array.ndim)
    name = names[int(random.integers(len(names)))]
    if "__facts__" in arrays and random.random() < 0.4:
        text = damaged(arrays["__facts__"].tobytes(), random)
        arrays["__facts__"] = np.frombuffer(text, np.uint8)
    else:
        changed = _changed(arrays[name], int(random.integers(8)))
        if changed is None:
            del arrays[name]
        else:
            arrays[name] = changed
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _inside_png(content: bytes, random: np.random.Generator) -> bytes:
    """One chunk is changed, its length and checksum fit: of pixels what is packed, or what it unpacks to."""
    if random.random() < 0.2:
        return damaged(content, random)
    chunks, at = list[tuple[bytes, bytes]](), 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    chosen = int(random.integers(len(chunks)))
    kind, data = chunks[chosen]
    if kind == b"IDAT" and random.random() < 0.5:
        data = zlib.compress(damaged(zlib.decompress(data), random))
    else:
        data = damaged(data, random)
    chunks[chosen] = kind, data
    return _png(chunks)


def _damage_of(suffix: str) -> Damage:
    return _inside_png if suffix == ".png" else damaged


def _png(chunks: Iterable[tuple[bytes, bytes]]) -> bytes:
    packed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def _changed(array: np.ndarray, how: int) -> np.ndarray | None:
    """Of another length, shape, kind or content; None to leave it out."""
    flat = array.reshape(-1)
    return (
        None,
        array[:-1],
        array[:0],
        array.astype(np.float64),
        array.astype(np.int16),
        np.repeat(array, 2, axis=0),
        flat.reshape(1, -1),
        np.full_like(array, 255 if array.dtype.kind == "u" else np.nan),
    )[how]


def _colmap(file: str) -> Reader:
    def write(place: Path) -> None:
        points = SparsePoints(np.random.default_rng(1).normal(size=(20, 3)), np.full((20, 3), 100, np.uint8))
        write_model(place, cameras(), points, binary=file.endswith(".bin"))

    return Reader(f"colmap {file}", write, read_model, file, damaged)


def _transforms() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        write_transforms(place / "transforms.json", cameras())

    return Reader("transforms.json", write, read_transforms, "transforms.json", damaged)


def _kernel(suffix: str) -> Reader:
    name = f"kernel{suffix}"

    def write(place: Path) -> None:
        import tifffile  # late: only for this file

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
        Image.fromarray(random.integers(0, 255, (30, 40, 3), dtype=np.uint8)).save(place / name)

    return Reader(f"photo {suffix}", write, lambda place: load_photo(place / name), name, _damage_of(suffix))


def _checkpoint() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        c = cloud()
        values = {"means": c.means, "log_scales": c.log_scales, "quaternions": c.quaternions}
        values |= {"opacity_logits": c.opacity_logits, "sh": c.sh}
        arrays = {f"{kind}.{name}": value for kind in ("value", "first") for name, value in values.items()}
        arrays |= {f"second.{name}": np.square(value) for name, value in values.items()}
        arrays |= {name: np.ones(len(c.means), np.float32) for name in ("pull", "views")}
        state = Checkpoint(arrays, {"photos": ["a.png"]}, 7, 1.5, [{"step": 7.0, "loss": 0.1}], {"steps": 7})
        save_checkpoint(place / "checkpoint.npz", state)

    return Reader(
        "checkpoint", write, lambda p: load_checkpoint(p / "checkpoint.npz", {}), "checkpoint.npz", _inside_npz
    )


def _report() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        write_gaussians(place / "twin.ply", cloud())
        run = {"photos": "photos", "out": "twin", "psf": "gaussian:2", "blur_space": "srgb", "holdout_every": 8}
        report = {"settings": {"run": run, "training": {"sh_degree": 1}}, "steps": 300, "medium": {"per_photo": None}}
        (place / "report.json").write_text(json.dumps(report), "utf-8")

    return Reader("report.json", write, lambda path: TwinFolder(path).report(), "report.json", damaged)


def _facts() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        facts = {"held": ["a.png"], "psf": {"b.png": "gaussian:2"}, "updates": [{"photos": ["c.png"], "steps": 20}]}
        (place / "twin.json").write_text(json.dumps(facts), "utf-8")

    return Reader("twin.json", write, lambda path: TwinFolder(path).update_log(), "twin.json", damaged)


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
        import tifffile  # late: only for this file

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
    return _png(((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b"")))


def _masked() -> Reader:
    def write(place: Path) -> None:
        for folder in ("photos", "masks"):
            (place / folder).mkdir(parents=True, exist_ok=True)
            for name in ("a.png", "b.png"):
                Image.fromarray(np.full((30, 40), 255, np.uint8)).save(place / folder / name)

    def read(place: Path) -> object:
        return load_photos(place / "photos", None, Silent(), place / "masks", minimum=1)

    return Reader("mask", write, read, "masks/a.png", damaged)


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


def _features() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        one = Features(np.ones((5, 2), np.float32), np.ones((5, 128), np.uint8))
        found = {"a.png": one, "b.png": one}
        save_features(place / "features.npz", found, recipes(False)[0])

    return Reader("features", write, lambda place: load_features(place / "features.npz"), "features.npz", _inside_npz)


def readers() -> list[Reader]:
    """All of `core`."""
    return [
        *(_splats(suffix) for suffix in (".ply", ".splat", ".gltf", ".glb")),
        _splats(".spz", _inside_gzip),
        *(_colmap(f"{name}{suffix}") for suffix in (".bin", ".txt") for name in ("cameras", "images", "points3D")),
        _transforms(),
        *(_kernel(suffix) for suffix in (".npy", ".tif", ".png", ".fits")),
        *(_photo(suffix) for suffix in (".png", ".jpg", ".tif")),
        *(_deep_photo(suffix) for suffix in (".png", ".tif")),
        _masked(),
        _list(),
        _spreads(),
        _lines(),
        _features(),
        _checkpoint(),
        _report(),
        _facts(),
    ]
