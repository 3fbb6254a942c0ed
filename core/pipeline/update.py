"""New photos into a finished twin: a row of the stages, from where the twin stands.

Every second step looks at a new photo, the others at old ones, which keep what the new ones do not see. Old photos
do not count where they show what has changed since. The state before is kept in history/.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import CameraError, DgsError, PhotoError
from ..files import file_digest
from ..gaussians import Gaussians
from ..imaging.formation.exposure import Exposure
from ..imaging.medium import Medium
from ..machine import use_machine
from ..photos.load import Photo, load_photos
from ..photos.undistort import undistorted_views
from ..photos.uniform import like_the_others
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.known import drop_chapter
from ..sfm.child import Waiting, drop_scratch
from ..training.checkpoint import Checkpoint, save_checkpoint
from ..training.kept_state import checkpoint_of
from ..training.warmup import compile_kernels
from ..twin.changes import Changes, find_changes, shows_changed, wider
from ..twin.exposures import without_exposure
from ..twin.folder import TwinChange, TwinFolder
from ..twin.new_exposures import exposure_with
from ..twin.opened import OpenedTwin, StoredTwin, open_files
from ..twin.pictures import draw_changes
from ..twin.placing import Placing
from ..twin.register import corrected, register
from ..views import View, fingerprint
from .continued import ContinuedTraining, Explained, UpdateViews, explained


@dataclass(frozen=True)
class UpdateSettings:
    """One update.

    Attributes:
        twin, photos: folders (or a list of photos).
        cameras: of the new photos in the twin's world; None to find them.
        share: of the twin's own number of steps; None for as many as the new photos ask for.
        threads: None for all cores; seed: of everything random.
    """

    twin: Path
    photos: Path
    cameras: Path | None = None
    share: float | None = None
    threads: int | None = None
    seed: int = 0


def update(settings: UpdateSettings, progress: Progress, waiting: Waiting | None = None) -> dict[str, Any]:
    """Takes new photos into a twin; what came out, as in update.json.

    Args:
        waiting: a child process that was started early to find the new photos' cameras; it is ended here.

    Raises:
        PhotoError: no photo is new. CameraError: none could be placed. DgsError: see the stages.
    """
    folder = TwinFolder(settings.twin)
    folder.report()  # (nothing is written into a folder that is no twin)
    drop_scratch(folder.path, waiting)
    try:
        with folder.changing() as change:
            return _updated(settings, progress, waiting, folder, change)
    finally:
        if waiting is not None:
            waiting.end()


def _updated(
    settings: UpdateSettings, progress: Progress, waiting: Waiting | None, folder: TwinFolder, change: TwinChange
) -> dict[str, Any]:
    began = time.perf_counter()
    threads, report = use_machine(settings.threads), folder.report()
    on = [effect.get("name") for effect in report.get("effects", []) if isinstance(effect, dict) and effect.get("on")]
    if set(on) - {Exposure.name}:
        raise DgsError(
            f"'{folder.path}' was made with effects besides blur and exposure, which updates do not know",
            "Reconstruct it from all photos instead",
        )
    # Kernels become ready while photos are read and placed.
    early = threading.Thread(target=compile_kernels, args=(int(report["settings"]["training"].get("sh_degree", 1)),))
    early.start()
    files = open_files(folder.path, progress)
    photos = _new_photos(settings.photos, files, folder, change, progress)
    twin, found = _placed(settings, files, photos, change.new.features, threads, progress, waiting)
    for photo in photos:
        if photo.name not in found.poses:
            (change.new.new_photo_folder / photo.name).unlink()
    photos = [photo for photo in photos if photo.name in found.poses]
    new = undistorted_views(photos, found)
    early.join()
    twin, new = _exposed_alike(twin, new)
    registered = time.perf_counter()

    progress.stage("changes", len(photos))
    changes = find_changes(twin, twin.on_grid(new, twin.step), twin.medium)
    medium = _medium(twin, [view.name for view in new], changes.width)
    views = UpdateViews([_masked(twin, view, changes) for view in twin.kept], new, medium)
    before = explained(twin, twin.gaussians, views)
    training = ContinuedTraining(twin, views, settings.share, settings.seed, settings.threads)
    gaussians, after = training.run(progress)
    updated = UpdatedTwin(photos, found, gaussians, medium, checkpoint_of(training.trainer, 0.0, []))
    facts = {
        "photos": [photo.name for photo in photos],
        "steps": training.trainer.step,
        "gaussians": len(gaussians),
        **_change_facts(changes, before, after),
        "before": change.keep_state().name,
        "seconds": {"register": round(registered - began, 3), "update": round(time.perf_counter() - registered, 3)},
    }
    save_updated(updated, twin, facts, folder, change)
    draw_changes(change.new.change_folder, new, changes, twin.step)
    return facts


def _exposed_alike(twin: OpenedTwin, new: list[View]) -> tuple[OpenedTwin, list[View]]:
    """The twin and new views with the exposures of all photos undone; the very same ones where it has learned none."""
    if twin.exposure is None:
        return twin, new
    held = [view for view in twin.views if view.name not in twin.exposure.names]
    read = exposure_with(twin, twin.exposure, [*held, *new])
    late = {view.name: view for view in without_exposure(held, read)}
    views = [late.get(view.name, view) for view in twin.views]
    return replace(twin, views=views, exposure=read), without_exposure(new, read)


def _new_photos(
    source: Path, twin: StoredTwin, folder: TwinFolder, change: TwinChange, progress: Progress
) -> list[Photo]:
    """Photos that the twin does not have yet, which will lie in its folder under names of their own."""
    own = folder.new_photo_folder.resolve()
    if source.resolve() == own or own in source.resolve().parents:
        raise PhotoError(
            f"'{source}' is where the twin keeps its photos: what an update takes in is copied there",
            "Put the new photos into a folder of their own",
        )
    there = {fingerprint(photo.pixels) for photo in twin.photos}
    names = {photo.name.casefold() for photo in twin.photos}
    wanted = twin.settings.photos
    loaded = load_photos(source, wanted.max_size, progress, None, minimum=1, background=wanted.background.transparent)
    loaded = like_the_others(loaded, twin.photos)
    new = [photo for photo in loaded if fingerprint(photo.pixels) not in there]
    if not new:
        raise PhotoError(f"'{source}' holds no photo that the twin does not have", "Add new photos to it")
    out = []
    for photo in new:
        name = photo.name
        while name.casefold() in names or _is_another(folder.new_photo_folder / name, photo):
            name = f"new_{name}"
        names.add(name.casefold())
        change.new.save_new_photo(photo.path, name)
        out.append(replace(photo, name=name, path=folder.new_photo_folder / name))
    return out


def _is_another(file: Path, photo: Photo) -> bool:
    """Whether a file of that name is there and shows something else: a kept state of the twin may have it."""
    return file.exists() and file_digest(file) != photo.content


def _placed(
    settings: UpdateSettings,
    files: StoredTwin,
    photos: list[Photo],
    keep: Path,
    threads: int,
    progress: Progress,
    waiting: Waiting | None,
) -> tuple[OpenedTwin, Reconstruction]:
    """The twin, and the new photos' cameras in its world; they are looked for while the twin gets ready.

    Args:
        keep: file for the features by which they are found.
    """
    placing = Placing.begin(files, photos, threads, waiting) if settings.cameras is None else None
    try:
        twin = files.twin()
        found, exact = register(twin, photos, settings.cameras, threads, progress, keep, placing)
    finally:
        if placing is not None:
            placing.end()
    if exact:
        return twin, found
    return twin, corrected(twin, found, [photo for photo in photos if photo.name in found.poses])


def _medium(twin: OpenedTwin, names: Sequence[str], width: float) -> Medium:
    if width == 1.0 or twin.medium.psf is None:
        return twin.medium
    own = {name: wider(twin.medium.psf, width) for name in names}
    return replace(twin.medium, per_view={**twin.medium.per_view, **own})


def _masked(twin: OpenedTwin, view: View, changes: Changes) -> View:
    """An old view without the px that show what has changed."""
    if not bool(changes.splats.any()):
        return view
    (on_grid,) = twin.on_grid([view], twin.step)
    stale = shows_changed(twin, changes.splats, [on_grid])[view.name]
    height, width = view.photo.shape[:2]
    rows = np.minimum(np.arange(height) // twin.step, stale.shape[0] - 1)
    columns = np.minimum(np.arange(width) // twin.step, stale.shape[1] - 1)
    counts = ~stale[rows][:, columns]
    return replace(view, mask=counts if view.mask is None else counts & view.mask)


def _change_facts(changes: Changes, before: Explained, after: Explained) -> dict[str, Any]:
    """What has changed since the old photos, and how well photos are explained before and after; for update.json."""
    return {
        "medium": {"width": changes.width, "gain": round(changes.gain, 4)},
        "object": {
            "changed_share": round(changes.share, 5),
            "changed_splats": int(changes.splats.sum()),
            "unseen_share": round(changes.unseen_share, 5),
        },
        "psnr_new": [before.new, after.new],
        "psnr_old": [before.old, after.old],
    }


@dataclass(frozen=True)
class UpdatedTwin:
    """What an update makes.

    Attributes:
        photos: new ones with a camera; found: their cameras, in the twin's world.
        gaussians: in world units; medium: with the new photos' point spreads; state: of the optimizer.
    """

    photos: Sequence[Photo]
    found: Reconstruction
    gaussians: Gaussians
    medium: Medium
    state: Checkpoint


def save_updated(
    updated: UpdatedTwin, twin: OpenedTwin, facts: dict[str, Any], folder: TwinFolder, change: TwinChange
) -> None:
    """Writes what changes of a twin's folder, and takes away what speaks of the twin as it was.

    Raises:
        OutputError: it cannot be written.
    """
    old, found = twin.reconstruction, updated.found
    poses = {**old.poses, **found.poses}
    lenses = {**old.lenses, **{name: found.lenses[name] for name in found.poses}}
    if len(poses) != len(lenses):
        raise CameraError("Cameras and lenses of the update do not fit", "Report this as a bug")
    new = change.new
    new.save_twin(updated.gaussians.cloud())
    new.save_cameras(replace(old, poses=poses, lenses=lenses))
    save_checkpoint(new.checkpoint, updated.state)
    new.save_photo_list([photo.path for photo in [*twin.photos, *updated.photos]])
    if (inputs := folder.inputs()) is not None:
        new.save_inputs({**inputs[0], **{photo.name: photo.content for photo in updated.photos}}, inputs[1])
    report = folder.report()
    report["settings"]["run"]["photos"] = str(folder.photo_list)
    report["gaussians"] = len(updated.gaussians)
    if twin.exposure is not None:
        row = next(row for row in report["effects"] if row["name"] == Exposure.name and row["on"])
        row["parameters"] = twin.exposure.described()
    new.save_report(report)
    spreads = {name: psf for name, psf in updated.medium.per_view.items() if name not in twin.medium.per_view}
    past = folder.update_log()
    own = {
        **past.get("psf", {}),
        **{name: psf.source for name, psf in spreads.items() if psf is not None and psf.source},
    }
    new.save_update_log({"held": twin.held, "psf": own, "updates": [*past.get("updates", []), facts]})
    new.save_update(facts)
    change.remove_stale()
    if folder.report_page.is_file():
        shutil.copy2(folder.report_page, new.report_page)
        drop_chapter(new.report_page)
