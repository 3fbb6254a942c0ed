"""Writes a data set: photos through the medium, sharp pictures, cameras, and how it was made.

photos/NAME     through the medium, sRGB-encoded       sharp/NAME      the truth, same size
cameras/        COLMAP model with points on surfaces   transforms.json the same cameras
psf.json        the medium                             lines.json      painted lines, in the world
masks_ball/     255 where the object is seen           depth/*.npy     metres along the camera's axis
normals/*.npy   unit normals in the engine's world     (lines.json only with the ball)
manifest.json   all settings; `SynthesizeSettings.from_json(manifest["settings"])` repeats them; with media
                also the views to be held out, and what is true of each photo
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import Cancelled, DgsError
from ...core.files import make_folder, read_json, write_json
from ...core.formats.transforms import write_transforms
from ...core.progress import Progress, Silent
from ...core.views import SparsePoints
from ..axes import matrix_to_engine
from . import degrade, files, rail
from .lines import LINES, centre_line
from .settings import EXTRAS, OBJECT_INDEX, SynthesizeSettings
from .shape import SHAPE, ball_pose
from .studio import Studio, source_digest
from .through import Through, plan

#: Views whose depth gives the points of the camera model, and points taken from each.
POINT_VIEWS, POINTS_PER_VIEW = 6, 1000

#: Names of the files that a data set has one of for each view.
_OURS = re.compile(r"view_\d{3,}\.(png|npy|png\.npy)")


def _same(name: str) -> str:
    return name


def _array(name: str) -> str:
    return f"{Path(name).stem}.npy"


#: What can stand beside the photos: its setting, its folder, and how its files are called after the photo's.
_BESIDE = (
    ("masks", "masks_ball", _same),
    ("depth", "depth", _array),
    ("normals", "normals", _array),
    ("keep_linear", "linear", lambda name: f"{name}.npy"),
)


def synthesize(
    settings: SynthesizeSettings, out: Path, progress: Progress = Silent(), only: range | None = None
) -> None:
    """Renders and writes the data set, taking up an interrupted one of the same settings.

    Args:
        only: numbers of the views whose photos and sharp pictures are rendered, and nothing else; several processes
            may do so in one folder, and one without it finishes the set.

    Raises:
        PsfError: the point spread function makes no sense.
        OutputError: a file cannot be written.
        FormatError: Blender cannot read the mesh or the .blend.
        DgsError: this Python has no bpy, or a medium does not fit the scene.
        Cancelled: the user asked to stop; finished frames stay and are taken up again.
    """
    kernel = degrade.kernel_of(settings.psf)
    make_folder(out)
    manifest = _manifest(settings, kernel)
    if max(kernel.shape) // 2 > settings.overscan > 0 and kernel.size > 1:
        progress.note(
            f"The blur reaches {max(kernel.shape) // 2} px, the overscan {settings.overscan} px: "
            "beyond it the outermost pixels are repeated"
        )
    if _finished(out, manifest, rail.names(settings.views)):
        progress.note(f"'{out}' holds this data set already")
        return
    _forget_other_settings(out, manifest)
    write_json(out / "unfinished.json", manifest)
    studio = Studio(settings)
    cameras = studio.cameras()
    through = plan(settings, cameras, studio)
    views = [index for index in range(len(cameras)) if only is None or index in only]
    _photos(_Wanted(cameras, views, through), kernel, out, studio, progress)
    if only is not None:
        return
    points = _geometry(settings, cameras, out, studio, progress)
    progress.stage("save")
    files.write_colmap_text(out / "cameras", cameras, points)
    write_transforms(out / "transforms.json", {f"photos/{camera.name}": camera for camera in cameras})
    write_json(out / "psf.json", _psf(settings, kernel))
    if settings.has_ball:
        write_json(out / "lines.json", _lines())
    write_json(out / "manifest.json", {**manifest, **through.to_json(cameras)})
    (out / "unfinished.json").unlink()


@dataclass(frozen=True)
class _Wanted:
    """What is photographed.

    Attributes:
        cameras: of all views; views: numbers of those that are rendered; through: what each is seen through.
    """

    cameras: list[Camera]
    views: list[int]
    through: Through

    def apart(self, settings: SynthesizeSettings) -> list[int]:
        """Views whose photo is a render of its own, besides the sharp picture's."""
        if not settings.rendered_medium:
            return []
        return [index for index in self.views if not (settings.media and self.through.is_sharp(index))]


def _photos(wanted: _Wanted, kernel: NDArray[np.float64], out: Path, studio: Studio, progress: Progress) -> None:
    """Sharp pictures and photos; where Cycles renders the medium, sharp ones first and photos of their own after."""
    settings, apart = studio.settings, wanted.apart(studio.settings)
    for folder in ("photos", "sharp", *(["linear"] if settings.keep_linear else [])):
        make_folder(out / folder)
    progress.stage("render", len(wanted.views) + len(apart))
    with tempfile.TemporaryDirectory(prefix="dgs-render-") as scratch:
        for count, index in enumerate(wanted.views):
            camera = wanted.cameras[index]
            kept = out / "linear" / f"{camera.name}.npy"
            done = [out / "sharp" / camera.name, *([] if index in apart else [out / "photos" / camera.name])]
            if not all(path.is_file() for path in [*done, *([kept] if settings.keep_linear else [])]):
                if progress.cancelled():
                    raise Cancelled(f"Stopped after {count} of {len(wanted.views)} frames", "Run it again to go on")
                if kept.is_file():
                    linear = np.load(kept, allow_pickle=False)
                else:
                    linear = _frame(settings, camera, index, studio, Path(scratch))
                if settings.keep_linear and not kept.is_file():
                    files.write_array(kept, linear)
                files.write_png(done[0], _sharp(settings, linear))
                if index not in apart:
                    files.write_png(done[1], _photo(settings, linear, kernel, index))
            progress.advance(count + 1)
    if not all((out / "photos" / wanted.cameras[index].name).is_file() for index in apart):
        _through_the_medium(wanted, kernel, out, studio, progress)


def _through_the_medium(
    wanted: _Wanted, kernel: NDArray[np.float64], out: Path, studio: Studio, progress: Progress
) -> None:
    """Photos that Cycles renders through a medium; the rest of the medium comes on top."""
    settings, cameras, through = studio.settings, wanted.cameras, wanted.through
    apart = wanted.apart(settings)
    studio.enter().prepare(settings.samples_through_media, settings.denoise, alone=settings.alone)
    from . import effects, stage  # late: needs bpy

    ways = effects.travel(cameras)
    with (
        tempfile.TemporaryDirectory(prefix="dgs-render-") as scratch,
        effects.rendered_medium(settings, cameras, studio.target),
        through.standing(stage),
    ):
        for done, index in enumerate(apart):
            camera = cameras[index]
            file = out / "photos" / camera.name
            if not file.is_file():
                if progress.cancelled():
                    raise Cancelled(f"Stopped after {done} of {len(apart)} photos", "Run it again to go on")
                wide = camera.with_margin(settings.overscan)
                moment = effects.frame(settings, camera, ways[index], studio.target)
                with moment, through.photo(stage, wide, index):
                    linear = _frame(settings, camera, index, studio, Path(scratch))
                files.write_png(file, _photo(settings, linear, kernel, index))
            progress.advance(len(wanted.views) + done + 1)


def _frame(
    settings: SynthesizeSettings, camera: Camera, index: int, studio: Studio, scratch: Path
) -> NDArray[np.float32]:
    """[H + 2 overscan, W + 2 overscan, 3] linear light, rendered with a seed of the view's own."""
    wide = camera.with_margin(settings.overscan)
    linear: NDArray[np.float32] = studio.enter().picture(wide, _frame_seed(settings.seed, index), scratch)
    return linear


def _sharp(settings: SynthesizeSettings, linear: NDArray[np.float32]) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The picture that a perfect camera of the same contrast takes in clear air."""
    return degrade.photograph(
        _before_background(settings, linear),
        np.ones((1, 1)),
        degrade.Sensor(settings.bits, contrast=settings.contrast),
        blur_space="linear",
        margin=settings.overscan,
        seed=(settings.seed, 0),
    )


def _before_background(settings: SynthesizeSettings, linear: NDArray[np.float32]) -> NDArray[np.float32]:
    return degrade.over_white(linear) if settings.background == "white" else linear


def _photo(
    settings: SynthesizeSettings, linear: NDArray[np.float32], kernel: NDArray[np.float64], index: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    gains = degrade.exposures(settings.views, settings.exposure_drift, settings.seed)
    photo = degrade.photograph(
        _before_background(settings, linear),
        kernel,
        degrade.Sensor(settings.bits, settings.noise, settings.full_well, settings.read_noise, settings.contrast),
        blur_space=settings.blur_space,
        margin=settings.overscan,
        seed=(settings.seed, index),
        gain=float(gains[index]),
    )
    if not settings.jpeg:
        return photo
    from .jpeg import compressed  # late: needs bpy

    return compressed(photo, settings.jpeg)


def _geometry(
    settings: SynthesizeSettings, cameras: list[Camera], out: Path, studio: Studio, progress: Progress
) -> SparsePoints:
    """Masks and depth where asked, and points on the surfaces that some views see."""
    chosen = set(np.linspace(0, len(cameras) - 1, min(POINT_VIEWS, len(cameras))).astype(int).tolist())
    everything = settings.masks or settings.depth
    wanted = [i for i in range(len(cameras)) if everything or i in chosen]
    generator = np.random.default_rng((settings.seed, 7))
    positions, colours = [], []
    progress.stage("geometry", len(wanted))
    render = studio.enter()
    for folder in (["masks_ball"] if settings.masks else []) + (["depth"] if settings.depth else []):
        make_folder(out / folder)
    with tempfile.TemporaryDirectory(prefix="dgs-render-") as scratch, render.geometry_only():
        for done, index in enumerate(wanted, start=1):
            camera = cameras[index]
            if progress.cancelled():
                raise Cancelled(f"Stopped after {done - 1} of {len(wanted)} depth maps", "Run it again to go on")
            mask, kept = out / "masks_ball" / camera.name, out / "depth" / _array(camera.name)
            there = (mask.is_file() or not settings.masks) and kept.is_file() and settings.depth
            if there:
                depth = np.load(kept, allow_pickle=False)
            else:
                depth, objects = render.depth_and_index(camera, Path(scratch))
                if settings.masks:
                    files.write_png(mask, np.uint8(255) * (objects == OBJECT_INDEX).astype(np.uint8))
                if settings.depth:
                    files.write_array(kept, depth)
            if index in chosen:
                rows, columns = np.nonzero(np.isfinite(depth))
                pick = generator.choice(len(rows), min(POINTS_PER_VIEW, len(rows)), replace=False)
                rows, columns = rows[pick], columns[pick]
                positions.append(_unproject(camera, rows, columns, depth[rows, columns]))
                colours.append(files.read_png(out / "photos" / camera.name)[rows, columns])
            progress.advance(done)
    if settings.normals:
        _normals(cameras, out, render, progress)
    return SparsePoints(np.concatenate(positions), np.concatenate(colours))


def _normals(cameras: list[Camera], out: Path, render: Any, progress: Progress) -> None:
    make_folder(out / "normals")
    progress.stage("normals", len(cameras))
    with tempfile.TemporaryDirectory(prefix="dgs-render-") as scratch, render.geometry_only("normals"):
        for done, camera in enumerate(cameras, start=1):
            if progress.cancelled():
                raise Cancelled(f"Stopped after {done - 1} of {len(cameras)} normal maps", "Run it again to go on")
            file = out / "normals" / _array(camera.name)
            if not file.is_file():
                files.write_array(file, render.surface_normals(camera, Path(scratch)))
            progress.advance(done)


def _unproject(
    camera: Camera, rows: NDArray[np.int64], columns: NDArray[np.int64], depth: NDArray[np.float32]
) -> NDArray[np.float64]:
    z = depth.astype(np.float64)
    x = (columns + 0.5 - camera.cx) / camera.fx * z
    y = (rows + 0.5 - camera.cy) / camera.fy * z
    return (np.stack([x, y, z], -1) - camera.translation) @ camera.rotation


def _frame_seed(seed: int, index: int) -> int:
    return int(np.random.default_rng((seed, index)).integers(2**31 - 1))


def _manifest(settings: SynthesizeSettings, kernel: NDArray[np.float64]) -> dict[str, Any]:
    digest = hashlib.sha256(np.ascontiguousarray(kernel).tobytes()).hexdigest()[:16]
    gains = degrade.exposures(settings.views, settings.exposure_drift, settings.seed)
    more: dict[str, Any] = {} if settings.exposure_drift == 0 else {"exposure_gains": gains.round(6).tolist()}
    source = source_digest(settings)
    rendered = settings.render_fingerprint() + (f"-{source}" if source else "")
    if source:
        digest, more["source_sha256"] = f"{digest}-{source}", source
    return {
        "kind": "dgs synthetic data set",
        "version": 1,
        "settings": settings.to_json(),
        "fingerprint": f"{settings.fingerprint()}-{digest}",
        "render_fingerprint": rendered,
        "world": "engine (COLMAP): x right, y down, z away; metres",
        "photos": f"sRGB-encoded, {settings.bits} bit",
        "blur_space": settings.blur_space,
        **more,
    }


def _psf(settings: SynthesizeSettings, kernel: NDArray[np.float64]) -> dict[str, Any]:
    y, x = (np.arange(side) - side // 2 for side in kernel.shape)
    variance = [float((kernel.sum(0) * x**2).sum()), float((kernel.sum(1) * y**2).sum())]
    return {
        "psf": settings.psf,
        "blur_space": settings.blur_space,
        "size": list(kernel.shape[::-1]),
        "sigma_px": np.sqrt(variance).tolist(),
        "sampled": "at pixel centres, sum 1",
        "overscan_px": settings.overscan,
    }


def _lines() -> list[dict[str, Any]]:
    matrix = matrix_to_engine(ball_pose())
    result = []
    for line in LINES:
        points, across = centre_line(line, SHAPE)
        normal = points / np.array([SHAPE.half_length, SHAPE.radius, SHAPE.radius]) ** 2
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        result.append(
            {
                "name": line.name,
                "width_m": line.width,
                "points": (points @ matrix[:3, :3].T + matrix[:3, 3]).tolist(),
                "across": (across @ matrix[:3, :3].T).tolist(),
                "normals": (normal @ matrix[:3, :3].T).tolist(),
            }
        )
    return result


def _finished(out: Path, manifest: dict[str, Any], names: list[str]) -> bool:
    there = _read_own(out / "manifest.json")
    if (out / "unfinished.json").exists() or not _same_photos(there, manifest):
        return False
    wanted = ["photos", "sharp", *(folder for extra, folder, _ in _BESIDE if manifest["settings"].get(extra))]
    if any(manifest["settings"].get(extra) and not there["settings"].get(extra) for extra in EXTRAS):
        return False
    endings = {folder: ending for _, folder, ending in _BESIDE}
    return all((out / folder / endings.get(folder, _same)(name)).is_file() for folder in wanted for name in names)


def _same_photos(earlier: dict[str, Any], manifest: dict[str, Any]) -> bool:
    """Whether two manifests describe the same photos, whatever is written beside them."""
    try:
        before, now = (SynthesizeSettings.from_json(one["settings"]) for one in (earlier, manifest))
        first, second = earlier["fingerprint"], manifest["fingerprint"]
    except (KeyError, TypeError, DgsError):
        return False
    if first.partition("-")[0] != before.fingerprint():  # made by another version of the scenes
        return False
    return before.photos_fingerprint() == now.photos_fingerprint() and first.split("-")[1:] == second.split("-")[1:]


def _read_own(path: Path) -> dict[str, Any]:
    """Content of a file of ours; empty if it is missing or was cut off (then nothing is trusted)."""
    try:
        content = read_json(path)
    except (FileNotFoundError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _forget_other_settings(out: Path, manifest: dict[str, Any]) -> None:
    """Removes what an earlier run with other settings left under names that will be written."""
    earlier = _read_own(out / "unfinished.json") or _read_own(out / "manifest.json")
    if _same_photos(earlier, manifest):
        return
    stale = ["photos", "sharp", "masks_ball", "depth", "normals"]
    if earlier.get("render_fingerprint") != manifest["render_fingerprint"]:
        stale.append("linear")
    for folder in stale:
        for path in sorted((out / folder).glob("view_*")):
            if _OURS.fullmatch(path.name):  # and not a file of the user's that is called view_of_the_lake.png
                path.unlink()
    (out / "manifest.json").unlink(missing_ok=True)
