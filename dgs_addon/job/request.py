"""What the engine is asked to do, as its command line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ...core.errors import DgsError
from ...core.files import make_folder, write_text
from ..engine.process import RUN
from ..paths import absolute, chosen_photos, out_folder, pictures_folder
from ..photos import PhotoFolder
from ..scene.scene_cameras import write_scene_cameras

Kind = Literal["cameras", "reconstruct", "synthesize", "update"]

#: Media that the engine estimates from the photos.
ESTIMATED_FROM_PHOTOS = ("auto", "auto-each")


@dataclass(frozen=True)
class Request:
    """One job.

    Attributes:
        kind: what the engine does.
        photos, out: absolute folders; `photos` may be a movie.
        arguments: of the engine, but for the resumption.
        resume: whether to go on from the checkpoint in `out`.
        count: photos that count; 0 where only the engine can count them, as of a movie.
        selection: their names, one a line; '' for all in the folder.
        program: what runs the arguments, where it is not the engine's Python.
        twin: folder of the twin that is updated; its own record and log stay as they are.
        reuse_cameras: whether the cameras in `out` belong to these photos; a new run takes them over.
    """

    kind: Kind
    photos: Path
    out: Path
    arguments: list[str]
    count: int = 0
    selection: str = ""
    resume: bool = False
    reuse_cameras: bool = False
    program: tuple[str, ...] = ()
    twin: Path | None = None

    @property
    def home(self) -> Path:
        """The results' folder of the scene that the job belongs to."""
        return self.twin or self.out

    def command(self, python: Path) -> list[str]:
        """The whole command line."""
        program = self.program or (str(python), str(RUN))
        return [*program, *self.arguments, *(["--resume"] if self.resume or self.reuse_cameras else [])]


def request_of(kind: Kind, scene: Any) -> Request:
    """A job from `scene.dgs`; the cameras of the scene are written to the results if they are asked for.

    Raises:
        DgsError: something is missing; it says what.
    """
    settings = scene.dgs
    photos, out, found = absolute(settings.photos), out_folder(settings), chosen_photos(settings)
    if photos is None or out is None or found is None:
        raise DgsError("No photos are chosen", "Choose their folder in step 1")
    if found.problem:
        raise DgsError(found.problem, "Choose others in step 1")
    source = photos if not settings.selection else _list(found, out)
    arguments = [kind, str(source), "--out", str(out), *_medium(settings), *_images(settings)]
    if found.movie is not None:
        arguments += ["--frames", str(settings.frames)]
    if kind == "reconstruct":
        arguments += [*_cameras(scene, out), *_effort(settings), "--snapshots"]
    arguments += ["--device", settings.device, *_number("--threads", settings.threads)]
    arguments += ["--progress", "json", "--control"]
    return Request(kind, photos, out, arguments, len(found.files), settings.selection)


def update_request(settings: Any, photos: Sequence[Path]) -> Request:
    """New photos for the twin of `scene.dgs`; record and log go to a folder of their own in the twin's.

    Raises:
        DgsError: there is no twin.
    """
    out = out_folder(settings)
    if out is None or not (out / "twin.ply").is_file():
        raise DgsError("There is no twin yet", "Press Optimize (step 4)")
    own = make_folder(out / "update")
    listed = own / "photos.txt"
    write_text(listed, "".join(f"{path.resolve()}\n" for path in photos))
    arguments = ["update", str(out), str(listed), *_number("--threads", settings.threads)]
    model = absolute(settings.model) if settings.cameras == "model" else None
    if model is not None:  # it holds the new photos' cameras as well
        arguments += ["--cameras", str(model)]
    arguments += ["--progress", "json", "--control"]
    return Request("update", photos[0].parent, own, arguments, len(photos), twin=out)


def _list(found: PhotoFolder, out: Path) -> Path:
    """OUT/photos.txt with the chosen photos, for the engine."""
    path = make_folder(out) / "photos.txt"
    write_text(path, "".join(f"{file}\n" for file in found.files))
    return path


def with_truth(arguments: list[str], truth: Path) -> list[str]:
    """The arguments of a run, with these sharp photos to be scored against."""
    kept = list(arguments)
    if "--truth" in kept:
        place = kept.index("--truth")
        del kept[place : place + 2]
    return [*kept, "--truth", str(truth)]


def psf_argument(settings: Any) -> str:
    """The medium of `scene.dgs` as the engine's `--psf` takes it.

    Raises:
        DgsError: a measured point spread function is wanted and none is chosen.
    """
    if settings.medium == "gaussian":
        return f"gaussian:{settings.sigma:g}"
    if settings.medium == "ellipse":
        return f"gaussian:{settings.sigma:g},{settings.sigma_minor:g},{math.degrees(settings.angle):g}"
    if settings.medium == "file":
        path = absolute(settings.psf_file)
        if path is None or not path.is_file():
            raise DgsError("The file of the point spread function is not there", "Choose it in step 3")
        return f"file:{path}"
    return str(settings.medium)  # none, or estimated from the photos


def _medium(settings: Any) -> list[str]:
    return ["--psf", psf_argument(settings), "--blur-space", settings.blur_space]


def _images(settings: Any) -> list[str]:
    masks = absolute(settings.masks)
    return [*(["--masks", str(masks)] if masks else []), *_number("--max-size", settings.max_size)]


def _cameras(scene: Any, out: Path) -> list[str]:
    settings = scene.dgs
    if settings.cameras == "model":
        model = absolute(settings.model)
        if model is None or not model.exists():
            raise DgsError("The camera model is not there", "Choose it in step 2")
        return ["--cameras", str(model)]
    if settings.cameras == "scene":
        return ["--cameras", str(write_scene_cameras(scene, pictures_folder(settings), out, settings.selection))]
    return []


def _effort(settings: Any) -> list[str]:
    arguments = ["--preset", settings.preset, "--holdout-every", str(settings.holdout_every)]
    arguments += ["--seed", str(settings.seed), *_number("--max-gaussians", settings.max_gaussians)]
    if settings.effects != "none":
        arguments += ["--effects", settings.effects]
    if settings.refine_cameras:
        arguments.append("--refine-cameras")
    if settings.time_limit > 0:
        arguments += ["--time-limit", f"{settings.time_limit * 60:.1f}s"]
    if settings.sh_degree != "preset":
        arguments += ["--sh-degree", settings.sh_degree]
    truth = absolute(settings.truth)
    return [*arguments, *(["--truth", str(truth)] if truth else [])]


def _number(name: str, value: int) -> list[str]:
    return [name, str(value)] if value > 0 else []
