"""Structure from motion, in its own process: what it cannot solve is a typed error, and what it solves repeats."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from ...core.camera import Camera
from ...core.errors import CameraError, DegenerateMotion, NativeCrash, TooFewPhotos
from ...core.evaluation.poses import pose_errors
from ...core.imaging.psf import PointSpread
from ...core.photos.load import Photo
from ...core.progress import Silent
from ...core.reconstruction import Reconstruction
from ...core.sfm import find
from ...core.sfm.settings import SfmSettings
from .case import Site, case, explained
from .photographed import looking, sharp_photo, small_set, texture, trained_steps

WIDTH, HEIGHT, FOCAL, SIGMA = 280, 210, 290.0, 2.0
SETTINGS = SfmSettings(time_limit=20.0, hard_limit=240.0)  # (a busy machine must not fail)


def _photo(name: str, planes: np.ndarray) -> Photo:
    eight = np.clip(planes * 255 + 0.5, 0, 255).astype(np.uint8)
    return Photo(name, Path(name), np.ascontiguousarray(eight.transpose(1, 2, 0)))


def _cameras(count: int) -> dict[str, Camera]:
    centres = [
        3.2 * np.array([math.sin(a), 0.15 * math.cos(5 * a), -math.cos(a)]) for a in np.linspace(-0.4, 0.4, count)
    ]
    return {f"{i}.png": looking(c, np.zeros(3), f"{i}.png", WIDTH, HEIGHT, FOCAL) for i, c in enumerate(centres)}


def _photos(cameras: dict[str, Camera], sigma: float = SIGMA, flat: bool = False) -> list[Photo]:
    textures = (texture(1, 1000), texture(2, 1000))
    return [
        _photo(name, gaussian_filter(sharp_photo(camera, textures, flat), (0, sigma, sigma)))
        for name, camera in cameras.items()
    ]


def _found(photos: list[Photo], site: Site, sigma: float = SIGMA) -> Reconstruction:
    kernel = PointSpread("gaussian", sigma, sigma).kernel() if sigma else None
    return find.find_cameras(photos, kernel, SETTINGS, site.folder, Silent())


@contextmanager
def _another_worker(code: str, site: Site) -> Iterator[None]:
    """Another program in the place of the child process."""
    before, script = find._WORKER, site.folder / "worker.py"
    script.write_text(code, "utf-8")
    find._WORKER = script
    try:
        yield
    finally:
        find._WORKER = before


@case("sfm", "two photos", "a typed error with a way out", 0.0, "a count of violations")
def too_few(site: Site) -> float:
    """Three views are the least that check one another."""
    with explained(TooFewPhotos):
        _found(_photos(_cameras(2)), site)
    return 0.0


@case("sfm", "photos of nothing, photos without overlap", "a typed error with a way out", 0.0, "a count of violations")
def no_overlap(site: Site) -> float:
    """Noise, all black, and four different textures: no matches, or matches by chance."""
    noise = np.random.default_rng(0)
    grey = [_photo(f"{i}.png", np.full((3, 60, 80), 0.5) + 0.01 * noise.standard_normal((3, 60, 80))) for i in range(4)]
    black = [_photo(f"{i}.png", np.zeros((3, 60, 80))) for i in range(4)]
    other = [_photo(f"{i}.png", texture(10 + i, 200)[:, :150]) for i in range(4)]
    for photos in (grey, black, other):
        with explained(CameraError):
            _found(photos, site, 0.0)
    return 0.0


@case("sfm", "panorama: the camera only turns", "DegenerateMotion with a way out", 0.0, "a count of violations")
def panorama(site: Site) -> float:
    """Rays from one place meet nowhere: there is no depth to be found, yet a model may come out."""
    middle, cameras = _cameras(3)["1.png"], {}
    for i, angle in enumerate(np.linspace(-0.15, 0.15, 5)):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        rotation = turn @ middle.rotation
        cameras[f"{i}.png"] = middle.moved(rotation, -rotation @ middle.centre)
    with explained(DegenerateMotion):
        _found(_photos(cameras, 0.0), site, 0.0)
    return 0.0


@case(
    "sfm",
    "planar scene",
    "right cameras (a tenth of the distance), or a typed error",
    0.1,
    "share of the viewing distance",
)
def planar(site: Site) -> float:
    """A wall leaves two solutions per pair; COLMAP may abort the process on such sets."""
    truth = _cameras(6)
    try:
        found = _found(_photos(truth, 0.0, flat=True), site, 0.0)
    except CameraError as error:
        return 0.0 if error.way_out else math.inf
    errors = pose_errors(found.cameras(), truth)
    return float(np.median(errors.centre)) / 3.2


@case("sfm", "native code aborts", "a typed error; this process lives", 0.0, "a count of violations")
def abort(site: Site) -> float:
    """An abort in native code ends the process that it runs in."""
    photos = _photos(_cameras(3), 0.0)
    for code in ("import os; os.abort()", "print('{broken', flush=True)", "raise SystemExit(3)"):
        if code.startswith("import os") and os.name != "posix":
            continue
        with _another_worker(code, site):
            if "broken" in code:
                try:
                    _found(photos, site, 0.0)
                except Exception as error:  # noqa: BLE001 (which kind is what is tested)
                    if not isinstance(error, CameraError):
                        return 1.0
            else:
                with explained(NativeCrash):
                    _found(photos, site, 0.0)
    return 0.0


@case(
    "sfm",
    "one photo ten times",
    "the others' cameras stay, in px of the photo",
    1.5,
    "SfM's own scatter on this set is 0.3 px",
)
def repeated_photo(site: Site) -> float:
    """Copies look like the best matches of all: false confidence."""
    truth = _cameras(7)
    photos = _photos(truth)
    copies = [replace(photos[3], name=f"copy {i}.png", path=Path(f"copy {i}.png")) for i in range(9)]
    found = _found([*photos, *copies], site)
    named = {name: camera for name, camera in found.cameras().items() if name in truth}
    if len(named) < 6:
        return math.inf
    errors = pose_errors(named, truth, np.zeros((1, 3)))
    # Copies must stand where their original stands.
    middle = found.poses["3.png"].centre
    spread = np.ptp([found.poses[n].centre for n in named], axis=0).max()
    away = max(
        (np.linalg.norm(found.poses[c.name].centre - middle) for c in copies if c.name in found.poses), default=0.0
    )
    return max(float(np.median(errors.centre_px)), float(away / spread) * 100.0)


@case("sfm", "copies of photos in training", "count once in the trust in photos", 0.0, "a count of violations")
def copies_in_training(site: Site) -> float:
    """Ten copies of every photo average no noise away."""
    views, points, medium = small_set(4)
    tenfold = [replace(v, camera=replace(v.camera, name=f"{k} {v.name}")) for k in range(10) for v in views]
    one, ten = (trained_steps(v, points, medium, 0) for v in (views, tenfold))
    ratios = [t.levels[-1].ratio for t in (one, ten)]
    assert ratios[0] is not None and ratios[1] is not None
    apart = float(np.abs(ratios[0].brightness / ratios[1].brightness - 1).max())
    return float(apart > 0.05) + float(one.settings.variation_weight != ten.settings.variation_weight)


@case("sfm", "the same photos twice", "the same bits of cameras and points", 0.0, "a count of values that differ")
def repeats_itself(site: Site) -> float:
    """Threads that finish in any order, and sums of several threads: other cameras at every run."""
    photos = _photos(_cameras(6))
    one, two = (_found(photos, site) for _ in range(2))
    if one.names != two.names or one.points.positions.shape != two.points.positions.shape:
        return math.inf
    differing = int((one.points.positions != two.points.positions).sum())
    for name in one.names:
        differing += int((one.poses[name].rotation != two.poses[name].rotation).sum())
        differing += int((one.poses[name].translation != two.poses[name].translation).sum())
        differing += one.lenses[name].params != two.lenses[name].params
    return float(differing)
