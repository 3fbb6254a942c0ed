"""What the engine is asked to do, as its command line."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from ...core.change.files import FILES
from ...core.errors import DgsError, ForeignFiles, FormatError
from ...core.files import make_folder, write_text
from ...core.outputs import check_outputs
from ..engine.process import RUN
from ..paths import absolute, chosen_photos, out_folder, pictures_folder
from ..photos import PhotoFolder, photo_folder
from ..scene.measures import known_of
from ..scene.medium import psf_argument
from ..scene.scene_cameras import write_scene_cameras
from .options import RESUMABLE, Options, job_arguments
from .record import Record

#: The known length of a twin that is compared, for the engine.
_KNOWN = "known_length.json"

Kind = Literal["cameras", "reconstruct", "synthesize", "update", "change"]


@dataclass(frozen=True)
class Request:
    """One job.

    Attributes:
        kind: what the engine does.
        photos, out: absolute folders; `photos` may be a movie, and is the earlier twin that one is compared with.
        arguments: of the engine, but for the resumption.
        resume: whether to go on from the checkpoint in `out`.
        count: photos that count; 0 where only the engine can count them, as of a movie.
        selection: their names, one a line; '' for all in the folder.
        program: what runs the arguments, where it is not the engine's Python.
        twin: folder of the twin that is updated or compared; its own record and log stay as they are.
        reuse_cameras: whether the cameras in `out` belong to these photos; a new run takes them over.
        options: what `arguments` were made from, where the job can be resumed.
        overwrite: whether the user allowed to replace what this program did not write.
    """

    kind: Kind
    photos: Path
    out: Path
    arguments: list[str]
    count: int = 0
    selection: str = ""
    resume: bool = False
    reuse_cameras: bool = False
    options: Options = field(default_factory=dict)
    overwrite: bool = False
    program: tuple[str, ...] = ()
    twin: Path | None = None

    @property
    def home(self) -> Path:
        """The results' folder of the scene that the job belongs to."""
        return self.twin or self.out

    def command(self, python: Path) -> list[str]:
        """The whole command line."""
        program = self.program or (str(python), str(RUN))
        begun = ["--resume"] if self.resume else ["--keep-cameras"] if self.reuse_cameras else []
        return [*program, *self.arguments, *begun, *(["--overwrite"] if self.overwrite else [])]


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
    options = {**_medium(settings), **_images(settings)}
    if found.movie is not None:
        options["frames"] = settings.frames
    if kind == "reconstruct":
        options |= {**_cameras(scene, out), **_effort(settings), "snapshots": True}
    options |= {"device": settings.device, **_positive(settings, "threads")}
    return _run_request(kind, photos, out, options, found, settings.selection)


def shared_options(settings: Any) -> Options:
    """What `scene.dgs` says of any set of photos: medium and effort, and nothing that belongs to certain photos.

    Raises:
        DgsError: the medium cannot be used.
    """
    options = {**_medium(settings), **_positive(settings, "max_size"), **_effort(settings)}
    options.pop("truth", None)
    return options | {"device": settings.device, **_positive(settings, "threads")}


def resumed_request(record: Record, out: Path) -> Request:
    """A job that goes on where it stopped.

    Args:
        record: of the job; its photos and options count.
        out: the results' folder that the user chose; whatever the record says, this is where the job writes.

    Raises:
        DgsError: the photos are not there any more, or this job cannot be resumed.
    """
    if record.kind not in RESUMABLE:
        raise DgsError(f"A job of the kind '{record.kind}' cannot be resumed", "Start it again")
    kind: Kind = "cameras" if record.kind == "cameras" else "reconstruct"
    photos = Path(record.photos)
    found = photo_folder(photos, record.selection)
    if found.problem:
        raise DgsError(f"The job's photos in '{photos}' cannot be used: {found.problem}", "Choose others in step 1")
    request = _run_request(kind, photos, out, record.options, found, record.selection)
    # Cameras alone have no checkpoint: they are sought again.
    return replace(request, count=record.count, resume=kind == "reconstruct")


def _run_request(kind: Kind, photos: Path, out: Path, options: Options, found: PhotoFolder, selection: str) -> Request:
    source = photos if not selection else _list(found, out)
    arguments = job_arguments(kind, source, out, options)
    return Request(kind, photos, out, arguments, len(found.files), selection, options=options)


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


def change_request(settings: Any, twin: Any, later: Path, earlier: Path) -> Request:
    """What has changed of a twin since an earlier one; all that is written goes to a folder of its own in the twin's.

    Args:
        twin: its object, whose known length counts; later, earlier: folders of both.

    Raises:
        DgsError: there is no earlier twin, or it is the same.
    """
    if not (earlier / "twin.ply").is_file():
        raise FormatError(f"There is no twin in '{earlier}'", "Choose the folder of an earlier twin's results")
    if earlier.resolve() == later.resolve():
        raise FormatError(f"'{earlier}' is the folder of this very twin", "Choose that of an earlier one")
    own = make_folder(_free_folder(later))
    arguments = ["change", str(earlier), str(later), "--out", str(own), *_number("--threads", settings.threads)]
    known = known_of(twin)
    if known is not None:
        write_text(own / _KNOWN, json.dumps(known, indent=1))
        arguments += ["--measures-after", str(own / _KNOWN)]
    return Request("change", earlier, own, [*arguments, "--progress", "json", "--control"], twin=later)


def _free_folder(twin: Path) -> Path:
    """Where no file of somebody else stands in the way."""
    names = itertools.chain(["change"], (f"change-{number}" for number in itertools.count(2)))
    return next(twin / name for name in names if _is_free(twin / name))


def _is_free(folder: Path) -> bool:
    try:
        check_outputs([folder / name for name in FILES])
    except ForeignFiles:
        return False
    return True


def _list(found: PhotoFolder, out: Path) -> Path:
    """The chosen photos, for the engine: a list named by its content, so that a twin's list stays what it was."""
    text = "".join(f"{file}\n" for file in found.files)
    path = make_folder(out) / f"chosen_{sha256(text.encode()).hexdigest()[:12]}.txt"
    write_text(path, text)
    return path


def _medium(settings: Any) -> Options:
    return {"psf": psf_argument(settings), "blur_space": settings.blur_space}


def _images(settings: Any) -> Options:
    return {**_path(settings, "masks"), **_positive(settings, "max_size")}


def _cameras(scene: Any, out: Path) -> Options:
    settings = scene.dgs
    if settings.cameras == "model":
        model = absolute(settings.model)
        if model is None or not model.exists():
            raise DgsError("The camera model is not there", "Choose it in step 2")
        return {"cameras": str(model)}
    if settings.cameras == "scene":
        return {"cameras": str(write_scene_cameras(scene, pictures_folder(settings), out, settings.selection))}
    return {}


def _effort(settings: Any) -> Options:
    options: Options = {"preset": settings.preset, "holdout_every": settings.holdout_every, "seed": settings.seed}
    options |= _positive(settings, "max_gaussians")
    if settings.effects != "usual":
        options["effects"] = settings.effects
    if settings.background != "auto":
        options["background"] = settings.background
    if settings.adjust_cameras != "auto":
        options["adjust_cameras"] = settings.adjust_cameras
    if settings.refine_cameras:
        options["refine_cameras"] = True
    if settings.time_limit > 0:
        options["time_limit"] = round(settings.time_limit * 60, 1)
    if settings.sh_degree != "preset":
        options["sh_degree"] = int(settings.sh_degree)
    return {**options, **_path(settings, "truth")}


def _positive(settings: Any, name: str) -> Options:
    value: int = getattr(settings, name)
    return {name: value} if value > 0 else {}


def _path(settings: Any, name: str) -> Options:
    path = absolute(getattr(settings, name))
    return {name: str(path)} if path else {}


def _number(name: str, value: int) -> list[str]:
    return [name, str(value)] if value > 0 else []
