"""Cameras from photos: starts the child process in which pycolmap runs, and reads what it found."""

from __future__ import annotations

import json
import queue
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .. import errors
from ..errors import CameraError, Cancelled, NativeCrash, TooFewPhotos
from ..files import explaining
from ..formats.colmap import read_model
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import CONTRADICTED, Attempt, Figures, Reconstruction
from .child import WORKER, begin
from .features import FEATURES, Features, load_features, save_features
from .job import write_job
from .settings import Recipe, SfmSettings

#: Three views are the least that check one another.
MINIMUM_PHOTOS = 3

_WORKER = WORKER


def find_cameras(
    photos: list[Photo],
    kernel: NDArray[np.float64] | None,
    settings: SfmSettings,
    work_dir: Path,
    progress: Progress,
    keep: Path | None = None,
) -> Reconstruction:
    """Structure from motion on blurred photos.

    Args:
        photos: at least three; masked pixels give no features.
        kernel: [k, k] the point spread function at the photos' size, normalised, centred,
            odd; None if the photos are sharp. The blur is undone (Wiener) before features are sought.
        settings: see `SfmSettings`.
        work_dir: where a scratch folder may be made; it is removed at the end.
        progress: hears of the stages; may cancel, which ends the child process.
        keep: file for the photos' features (`core.sfm.features`), by the photos' names and digests; None to drop them.

    Returns:
        Cameras of the photos that could be placed, and the log of what was tried.

    Raises:
        TooFewPhotos, NoOverlap, DegenerateMotion, CameraError: no trustworthy cameras.
        NativeCrash: the native library ended its process.
        OutputError: no room for the scratch folder.
        Cancelled: the user asked to stop.
    """
    if len(photos) < MINIMUM_PHOTOS:
        raise TooFewPhotos(
            f"{len(photos)} photos are too few to find cameras",
            f"Give at least {MINIMUM_PHOTOS} overlapping photos (20 or more are better), or your"
            " own cameras with --cameras",
        )
    started = time.perf_counter()
    progress.stage("cameras", len(photos))
    made = not work_dir.exists()
    with explaining(work_dir):
        work_dir.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="sfm-", dir=work_dir))
    try:
        names = write_job(photos, kernel, settings, folder)
        attempts, done = talk(folder, len(photos), settings, progress)
        if keep is not None:
            by_name = {photo.name: photo for photo in photos}
            keep_features(folder / "best" / FEATURES, keep, {image: by_name[name] for image, name in names.items()})
        found = _found(folder / "best", names, attempts, Attempt(**done), time.perf_counter() - started)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if made and not any(work_dir.iterdir()):
            work_dir.rmdir()
    missing = sorted(set(names.values()) - set(found.poses))
    if missing:
        listed = ", ".join(missing[:8]) + (", ..." if len(missing) > 8 else "")
        progress.note(f"{len(missing)} of {len(photos)} photos could not be placed: {listed}")
    return found


def _found(
    model: Path, names: Mapping[str, str], attempts: Sequence[Attempt], chosen: Attempt, seconds: float
) -> Reconstruction:
    """The child's model, with the photos' own names (by those of its images) and what was tried."""
    lenses, poses, points = read_model(model)
    figures = Figures(
        "sfm",
        len(names),
        chosen.registered,
        chosen.focal_px,
        chosen.reprojection_px,
        chosen.angle_deg,
        seconds,
        tuple(attempts),
        doubted=chosen.contradicted if chosen.verdict == CONTRADICTED else 0.0,
        from_photos=True,
    )
    return Reconstruction(
        {names[n]: p for n, p in poses.items()}, {names[n]: v for n, v in lenses.items()}, points, figures
    )


def keep_features(
    found: Path, keep: Path, photos: Mapping[str, Photo], earlier: tuple[Mapping[str, Features], Recipe] | None = None
) -> None:
    """Features that the child found, to where a twin has them, by the photos' own names and digests.

    Args:
        photos: by image name in the job.
        earlier: features that stay beside them, if they were found by the same recipe.

    Raises:
        OutputError: they cannot be written.
    """
    new = load_features(found)
    if new is None:
        return
    features = {photos[image].name: replace(one, content=photos[image].content) for image, one in new[0].items()}
    if earlier is not None and earlier[1] == new[1]:
        features = {**earlier[0], **features}
    save_features(keep, features, new[1])


def talk(
    folder: Path, given: int, settings: SfmSettings, progress: Progress, child: subprocess.Popen[bytes] | None = None
) -> tuple[list[Attempt], dict[str, Any]]:
    """Runs the child (or one that was started before) on a job folder to its end; its attempts and what it says then.

    Raises:
        CameraError: as of `find_cameras`. NativeCrash, Cancelled: likewise.
    """
    with explaining(folder):
        child = child or begin(folder, settings.threads, worker=_WORKER)
    try:
        attempts: list[Attempt] = []
        last: dict[str, Any] | None = None
        assert child.stdout is not None
        for message in _messages(child.stdout, progress, settings.hard_limit):
            if "joined" in message:
                progress.advance(min(given, int(message["joined"])))
            elif "attempt" in message:
                attempts.append(_tried(message["attempt"], given, progress))
            elif "failed" in message:
                failure = message["failed"]
                raise getattr(errors, failure["kind"])(failure["what"], failure["way_out"])
            last = message.get("done", last)
        status = child.wait()
        if last is None or status != 0:
            raise _crash(status, folder / "native.log")
        return attempts, last
    finally:
        if child.poll() is None:
            child.kill()
        child.wait()
        for stream in (child.stdin, child.stdout):
            if stream is not None:
                stream.close()


def _tried(values: dict[str, Any], given: int, progress: Progress) -> Attempt:
    """An attempt as the child reports it; one that is not trusted is worth a note."""
    tried = Attempt(**values)
    if tried.verdict != "trusted":
        progress.note(f"Cameras, attempt '{tried.name}': {tried.verdict} ({tried.registered} of {given})")
    return tried


def _messages(stream: IO[bytes], progress: Progress, limit: float) -> Any:
    """JSON lines of the child as they come; looks for the user's wish to stop ten times a second."""
    lines: queue.Queue[bytes | None] = queue.Queue()

    def read() -> None:
        for line in stream:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    deadline = time.perf_counter() + limit
    while True:
        if progress.cancelled():
            raise Cancelled("Stopped while finding the cameras")
        if time.perf_counter() > deadline:
            raise CameraError(
                f"No cameras were found within {limit:g} s",
                "Give fewer or smaller photos (--max-size), or your own cameras with --cameras",
            )
        try:
            line = lines.get(timeout=0.1)
        except queue.Empty:
            continue
        if line is None:
            return
        if line.startswith(b"{"):  # native code may write lines of its own
            try:
                yield json.loads(line)
            except ValueError:
                continue


def _crash(status: int, log: Path) -> CameraError:
    tail = log.read_text(errors="replace").strip().splitlines()[-1:] if log.exists() else []
    said = f"; it last said: {tail[0][:200]}" if tail else ""
    if status < 0:
        try:
            reason = f"signal {signal.Signals(-status).name}"
        except ValueError:
            reason = f"signal {-status}"
    else:
        reason = f"exit status {status}"
    return NativeCrash(
        f"The structure-from-motion process ended unexpectedly ({reason}{said})",
        "Try again with fewer or smaller photos (--max-size), or give your own cameras with --cameras",
    )
