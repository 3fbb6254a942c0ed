"""The readers that `reader_fuzz` damages files for, each with a valid file."""

from __future__ import annotations

import base64
import gzip
import io
import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from ...core.camera import Camera
from ...core.cloud import GaussianCloud
from ...core.formats.colmap import read_model, write_model
from ...core.formats.gaussians import read_gaussians, write_gaussians
from ...core.formats.transforms import read_transforms, write_transforms
from ...core.imaging.kernel_files import read_kernel
from ...core.imaging.psf_text import parse_psf
from ...core.photos.load import load_photo
from ...core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ...core.twin.folder import TwinFolder
from ...core.views import SparsePoints
from .reader_fuzz import Damage, Reader, damaged


def cloud(count: int = 40) -> GaussianCloud:
    """Gaussians of degree 1."""
    random = np.random.default_rng(0)
    draw = lambda *shape: random.normal(size=shape).astype(np.float32)  # noqa: E731
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
    name = sorted(arrays)[int(random.integers(len(arrays)))]
    if random.random() < 0.4:
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

    return Reader(f"kernel {suffix}", write, lambda place: _read_kernel(place / name), name, damaged)


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

    return Reader(f"photo {suffix}", write, lambda place: load_photo(place / name), name, damaged)


def _checkpoint() -> Reader:
    def write(place: Path) -> None:
        place.mkdir(exist_ok=True)
        c = cloud()
        values = {"means": c.means, "log_scales": c.log_scales, "quaternions": c.quaternions}
        values |= {"opacity_logits": c.opacity_logits, "sh": c.sh}
        arrays = {f"{kind}.{name}": value for kind in ("value", "first", "second") for name, value in values.items()}
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


def readers() -> list[Reader]:
    """All of them."""
    return [
        *(_splats(suffix) for suffix in (".ply", ".splat", ".gltf", ".glb")),
        _splats(".spz", _inside_gzip),
        *(_colmap(f"{name}{suffix}") for suffix in (".bin", ".txt") for name in ("cameras", "images", "points3D")),
        _transforms(),
        *(_kernel(suffix) for suffix in (".npy", ".tif", ".png", ".fits")),
        *(_photo(suffix) for suffix in (".png", ".jpg", ".tif")),
        _checkpoint(),
        _report(),
        _facts(),
    ]
