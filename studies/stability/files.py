"""Files: what is damaged, cut off, NaN or extreme is refused by name, left out and counted, or kept exactly."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image

from ...core.cloud import GaussianCloud
from ...core.errors import DgsError, FormatError, PhotoError, PsfError
from ...core.files import plain, write_json
from ...core.formats.colmap import read_model, write_model
from ...core.formats.ply import read_ply, write_ply
from ...core.formats.splat import read_splat, write_splat
from ...core.formats.spz import read_spz, write_spz
from ...core.formats.transforms import read_transforms
from ...core.gaussians import Gaussians
from ...core.imaging.psf_text import parse_psf
from ...core.photos.load import load_photo, load_photos
from ...core.progress import Silent
from ...core.rasterizer import render
from ...core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from ...core.views import SparsePoints
from .case import Site, Unexplained, case, explained
from .scenes import make_camera, random_scene

#: Shares of a file that are kept.
SHARES = (0.0, 0.01, 0.3, 0.7, 0.95, 0.999)


def _read_whole_or_refused(read: Callable[[Path], Any], path: Path, content: bytes) -> int:
    """How many of the damaged copies of a file were read as if nothing had happened, or crashed."""
    violations, random = 0, np.random.default_rng(0)
    damaged = [content[: int(len(content) * share)] for share in SHARES]
    damaged += [bytes(200), b"not a file of any kind\n" * 9]
    for number, data in enumerate(damaged):
        path.write_bytes(data)
        try:
            read(path)
        except DgsError as error:
            violations += not error.way_out or path.name not in str(error)
        else:
            violations += number < len(SHARES) - 1  # (the last few bytes may be padding)
    for _ in range(20):  # a flipped byte may go unnoticed, but nothing else may come than an explained error
        flipped = bytearray(content)
        for at in random.integers(0, len(flipped), 3):
            flipped[at] ^= int(random.integers(1, 256))
        path.write_bytes(bytes(flipped))
        try:
            read(path)
        except DgsError:
            continue
        except Exception as error:
            raise Unexplained(f"{path.name} with a flipped byte: {type(error).__name__}: {error}") from error
    return violations


@case(
    "files",
    "NaN and infinite px of a photo",
    "do not count, are reported, and reach no pixel that counts",
    0.0,
    "a count of violations",
)
def nan_pixels(site: Site) -> float:
    """Floating-point TIFFs hold NaN where a program found nothing. Read as black, they are a hole in the scene."""
    random = np.random.default_rng(0)
    planes = random.uniform(0.2, 0.8, (40, 50, 3)).astype(np.float32)
    bad = random.random((40, 50)) < 0.01
    planes[bad] = math.nan
    planes[3, 4, 1] = math.inf
    bad[3, 4] = True
    for name in ("a.tif", "b.tif"):
        tifffile.imwrite(site.folder / name, planes, photometric="rgb")

    class Notes(Silent):
        texts: list[str] = []

        def note(self, text: str) -> None:
            self.texts.append(text)

    notes = Notes()
    photo = load_photos(site.folder, None, notes)[0]
    if photo.mask is None:
        return math.inf
    violations = int((photo.mask != ~bad).sum()) + (photo.not_finite != int(bad.sum()))
    violations += not any("not finite" in text for text in notes.texts)
    kept = np.abs(photo.pixels[~bad] / 65535.0 - planes[~bad]).max() > 1e-4
    return float(violations + kept)


@case("files", "HDR photos", "cut to [0, 1], and reported", 0.0, "a count of violations")
def hdr_photo(site: Site) -> float:
    """Values of 1e4 and below 0 in a floating-point file."""
    planes = np.full((20, 30, 3), 0.5, np.float32)
    planes[0, 0], planes[0, 1, 2] = 1e4, -3.0
    tifffile.imwrite(site.folder / "a.tif", planes, photometric="rgb")
    photo = load_photo(site.folder / "a.tif")
    right = photo.pixels[0, 0, 0] == 65535 and photo.pixels[0, 1, 2] == 0 and photo.mask is None
    return float(photo.clipped != 2) + float(not right)


@case("files", "damaged photos", "left out by name, or a typed error", 0.0, "a count of violations")
def damaged_photos(site: Site) -> float:
    """PNG, TIFF and JPEG cut off at any site, and files of something else."""
    pixels, violations = np.random.default_rng(0).integers(0, 255, (30, 40, 3)).astype(np.uint8), 0
    for name in ("a.png", "a.tif", "a.jpg", "a.webp", "a.bmp"):
        path = site.folder / name
        Image.fromarray(pixels).save(path)
        content = path.read_bytes()
        for share in SHARES[:-2]:
            path.write_bytes(content[: int(len(content) * share)])
            with explained(PhotoError):
                load_photo(path)
    return float(violations)


def _cloud(count: int = 40) -> GaussianCloud:
    return random_scene(count, 1).cloud()


@case("files", "extreme values through a PLY", "the very bits", 0.0, "a count of values that differ")
def ply_bits(site: Site) -> float:
    """NaN, infinity, denormals and the largest float are kept as they are: a file repairs nothing in silence."""
    cloud, path = _cloud(), site.folder / "a.ply"
    for values in (cloud.means, cloud.log_scales, cloud.quaternions, cloud.sh):
        values.reshape(40, -1)[:6, 0] = [math.nan, math.inf, -math.inf, 1e-45, 3.4e38, -0.0]
    write_ply(path, cloud)
    again = read_ply(path)
    differing = 0
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        left, right = (np.ascontiguousarray(getattr(c, name)).view(np.uint32) for c in (cloud, again))
        differing += int((left != right).sum())
    return float(differing)


@case("files", "a twin with poison in it", "drawn without it, culled and counted", 0.0, "a count of violations")
def poisoned_twin(site: Site) -> float:
    """PLY files of other programs hold NaN Gaussians."""
    cloud = _cloud()
    cloud.means[3], cloud.log_scales[7, 1], cloud.sh[9, 0, 2] = math.nan, math.inf, -math.inf
    write_ply(site.folder / "a.ply", cloud)
    view = render(Gaussians.from_cloud(read_ply(site.folder / "a.ply")), make_camera())
    return float(not view.image.isfinite().all()) + float(view.screen.culled.get("non_finite", 0) != 3)


@case("files", "damaged twins", "a typed error that names the file", 0.0, "a count of violations")
def damaged_twins(site: Site) -> float:
    """PLY, SPZ and .splat cut off, flipped, or of another kind."""
    violations = 0
    for name, write, read in (("a.ply", write_ply, read_ply), ("a.spz", write_spz, read_spz)):
        path = site.folder / name
        write(path, _cloud())
        violations += _read_whole_or_refused(read, path, path.read_bytes())
    path = site.folder / "a.splat"
    write_splat(path, _cloud())
    content = path.read_bytes()
    for length in (0, 31, 33, len(content) - 1):
        path.write_bytes(content[:length])
        with explained(FormatError):
            read_splat(path)
    return float(violations)


@case("files", "extreme twins in small formats", "written and read back finite", 0.0, "a count of non-finite values")
def extreme_small_formats(site: Site) -> float:
    """Formats of few bits have no NaN: what does not fit must end at the format's limits."""
    cloud, bad = _cloud(), 0
    cloud.log_scales[0], cloud.log_scales[1] = 80.0, -200.0
    cloud.opacity_logits[2:4] = [500.0, -500.0]
    cloud.quaternions[4], cloud.sh[5, 0] = 0.0, 1e6
    for write, read in ((write_spz, read_spz), (write_splat, read_splat)):
        write(site.folder / "a.any", cloud)
        again = read(site.folder / "a.any")
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
            bad += int((~np.isfinite(getattr(again, name))).sum())
    return float(bad)


@case("files", "damaged checkpoints", "a typed error that names the file", 0.0, "a count of violations")
def damaged_checkpoints(site: Site) -> float:
    """A run that was killed while it wrote; a bit that fell over."""
    path, fingerprint = site.folder / "checkpoint.npz", {"photos": ["a", "b"]}
    sides = {"means": (3,), "log_scales": (3,), "quaternions": (4,), "opacity_logits": (), "sh": (4, 3)}
    arrays = {
        f"{kind}.{name}": np.random.default_rng(0).uniform(0.1, 1.0, (60, *side)).astype(np.float32)
        for kind in ("value", "first", "second")
        for name, side in sides.items()
    }
    arrays |= {name: np.ones(60, np.float32) for name in ("pull", "views")}
    save_checkpoint(path, Checkpoint(arrays, fingerprint, 7, 1.5, counters={"steps": 7}))
    content = path.read_bytes()
    again = load_checkpoint(path, fingerprint)
    same = all(np.array_equal(again.arrays[n], a, equal_nan=True) for n, a in arrays.items())
    return float(not same) + _read_whole_or_refused(lambda p: load_checkpoint(p, fingerprint), path, content)


@case("files", "damaged cameras", "a typed error that names the file", 0.0, "a count of violations")
def damaged_cameras(site: Site) -> float:
    """transforms.json with NaN, singular and mirrored poses, cut off; COLMAP models cut off."""
    path = site.folder / "transforms.json"
    identity = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
    for pose in (
        "[[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        "[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]",
        "[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        "[[1,0],[0,1]]",
        '"none"',
        "[]",
    ):
        text = f'{{"w": 64, "h": 48, "fl_x": 60, "frames": [{{"file_path": "a.png", "transform_matrix": {pose}}}]}}'
        path.write_text(text, "utf-8")
        with explained(FormatError):
            read_transforms(path)
    for focal in ("0", "-5", "NaN", "1e999", '"x"', "null"):
        frame = f'{{"file_path": "a.png", "transform_matrix": {identity}}}'
        text = f'{{"w": 64, "h": 48, "fl_x": {focal}, "frames": [{frame}]}}'
        path.write_text(text, "utf-8")
        with explained(FormatError):
            read_transforms(path)
    cameras = {f"{i}.png": replace(make_camera(), name=f"{i}.png") for i in range(3)}
    write_model(site.folder, cameras, SparsePoints(np.zeros((4, 3)), np.zeros((4, 3), np.uint8)))
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        content = (site.folder / name).read_bytes()
        for share in (0.0, 0.3, 0.9):
            (site.folder / name).write_bytes(content[: int(len(content) * share)])
            with explained(FormatError):
                read_model(site.folder)
        (site.folder / name).write_bytes(content)
    return 0.0


@case("files", "damaged kernels", "a typed error with a way out", 0.0, "a count of violations")
def damaged_kernels(site: Site) -> float:
    """A point spread from a file that is cut off, coloured, complex or NaN."""
    good = np.outer(np.hanning(9), np.hanning(9))
    for name, values in (
        ("nan.npy", np.full((5, 5), math.nan)),
        ("complex.npy", good.astype(complex)),
        ("cube.npy", np.ones((3, 3, 7))),
        ("empty.npy", np.zeros((0, 5))),
    ):
        np.save(site.folder / name, values)
        with explained(PsfError):
            parse_psf(f"file:{site.folder / name}")
    np.save(site.folder / "good.npy", good)
    content = (site.folder / "good.npy").read_bytes()
    for share in (0.0, 0.1, 0.9):
        (site.folder / "cut.npy").write_bytes(content[: int(len(content) * share)])
        with explained(PsfError):
            parse_psf(f"file:{site.folder / 'cut.npy'}")
    return 0.0


@case("files", "NaN in a report", "valid JSON, null", 0.0, "a count of violations")
def nan_in_json(site: Site) -> float:
    """JSON has no NaN; many programs write one all the same."""
    write_json(site.folder / "a.json", plain({"a": math.nan, "b": [math.inf, np.float32("nan"), 1.5]}))

    def refuse(text: str) -> float:
        raise ValueError(text)

    read = json.loads((site.folder / "a.json").read_text("utf-8"), parse_constant=refuse)
    return float(read != {"a": None, "b": [None, None, 1.5]})
