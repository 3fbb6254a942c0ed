"""New photos into a finished twin: registered, compared, and fitted from where the twin stands.

Every second step looks at a new photo, the others at old ones, which keep what the new ones do not see. Old photos
do not count where they show what has changed since. The state before is kept in history/.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..errors import CameraError, Cancelled, CheckpointError, DgsError, PhotoError
from ..files import make_folder, output_error, write_json, write_text
from ..formats.colmap import write_lenses
from ..formats.ply import write_ply
from ..forward.compare import mask_of, mean_square, psnr_of
from ..gaussians import Gaussians
from ..imaging.medium import Medium
from ..machine import use_threads
from ..photos.load import Photo, load_photos
from ..photos.undistort import undistorted_views
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.known import drop_chapter
from ..sfm.child import Waiting
from ..training.checkpoint import load_checkpoint, save_checkpoint
from ..training.grid import GridView
from ..training.scale import scene_scale
from ..training.settings import TrainingSettings
from ..training.trainer import Level, Trainer
from ..training.warmup import compile_kernels
from ..twin.changes import Changes, find_changes, shows_changed, wider
from ..twin.folder import TwinFolder
from ..twin.opened import Files, Twin, open_files
from ..twin.pictures import draw_changes
from ..twin.placing import Placing
from ..twin.register import corrected, register
from ..views import View, fingerprint

#: Where in the schedule an update begins: step sizes have fallen, density control still works.
BEGIN = 0.5
#: Steps of a round as a share of the twin's own, and rounds at most: another one follows as long as new photos are
#: explained worse than held-out old ones by so many dB.
ROUND, ROUNDS, BEHIND = 0.06, 4, 1.0
#: Views that say whether anything was forgotten, at most.
WATCHED = 8


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


class Updater(Trainer):
    """A trainer that looks at new photos every second step."""

    fresh: frozenset[str] = frozenset()

    def view_at(self, level: Level, step: int) -> GridView:
        """New and old photos in turn, each group in random order, every photo once per round."""
        group = [v for v in level.views if (v.name in self.fresh) == (step % 2 == 0)] or level.views
        turn = step // 2
        random = np.random.default_rng([self.settings.seed, 4, step % 2, turn // len(group)])
        return group[int(random.permutation(len(group))[turn % len(group)])]


def update(settings: UpdateSettings, progress: Progress, waiting: Waiting | None = None) -> dict[str, Any]:
    """Takes new photos into a twin; what came out, as in update.json.

    Args:
        waiting: a child process that was started early to find the new photos' cameras; it is ended here.

    Raises:
        PhotoError: no photo is new. CameraError: none could be placed. DgsError: see the stages.
    """
    try:
        return _updated(settings, progress, waiting)
    finally:
        if waiting is not None:
            waiting.end()


def _updated(settings: UpdateSettings, progress: Progress, waiting: Waiting | None) -> dict[str, Any]:
    began = time.perf_counter()
    folder = settings.twin
    kept_in = TwinFolder(folder)
    threads = use_threads(settings.threads)
    report = kept_in.report()
    if any(effect.get("on") for effect in report.get("effects", []) if isinstance(effect, dict)):
        raise DgsError(
            f"'{folder}' was made with effects besides the blur, which updates do not know",
            "Reconstruct it from all photos instead",
        )
    # Kernels become ready while photos are read and placed.
    early = threading.Thread(target=compile_kernels, args=(int(report["settings"]["training"].get("sh_degree", 1)),))
    early.start()
    files = open_files(folder, progress)
    photos = _new_photos(settings, files, progress)
    placing = Placing.begin(files, photos, threads, waiting) if settings.cameras is None else None
    try:
        twin = files.twin()
        found, exact = register(twin, photos, settings.cameras, threads, progress, placing)
    finally:
        if placing is not None:
            placing.end()
    photos = [photo for photo in photos if photo.name in found.poses]
    found = found if exact else corrected(twin, found, photos)
    new_views = undistorted_views(photos, found)
    early.join()
    registered = time.perf_counter()
    progress.stage("changes", len(photos))
    changes = find_changes(twin, twin.on_grid(new_views, twin.step), twin.medium)
    medium = _medium(twin, [v.name for v in new_views], changes.width)
    kept = [_masked(twin, view, changes) for view in twin.kept]
    before = (
        _residuals(twin, twin.gaussians, twin.medium, _watched(twin)),
        _residuals(twin, twin.gaussians, medium, new_views),
    )
    trainer, steps = _trainer(twin, kept, new_views, medium, report, settings)
    for _ in range(ROUNDS):
        progress.stage("update", steps)
        _round(trainer, steps, progress)
        gaussians = trainer.result()
        after = _residuals(twin, gaussians, medium, _watched(twin)), _residuals(twin, gaussians, medium, new_views)
        if settings.share is not None or after[1] > after[0] - BEHIND:
            break
    state = kept_in.keep_state()
    facts = {
        "photos": [photo.name for photo in photos],
        "steps": trainer.step,
        "gaussians": len(gaussians),
        "medium": {"width": changes.width, "gain": round(changes.gain, 4)},
        "object": {
            "changed_share": round(changes.share, 5),
            "changed_splats": int(changes.splats.sum()),
            "unseen_share": round(changes.unseen_share, 5),
        },
        "psnr_new": [before[1], after[1]],
        "psnr_old": [before[0], after[0]],
        "before": state.name,
        "seconds": {"register": round(registered - began, 3), "update": round(time.perf_counter() - registered, 3)},
    }
    _write(twin, photos, found, gaussians, trainer, medium, report, facts)
    draw_changes(folder / "changes", new_views, changes, twin.step)
    return facts


def _round(trainer: Updater, steps: int, progress: Progress) -> None:
    for step in range(steps):
        trainer.advance(BEGIN + (1.0 - BEGIN) * step / steps)
        if step % 10 == 9:
            progress.advance(step + 1)
            if progress.cancelled():
                raise Cancelled("Stopped; the twin is as it was")


def _new_photos(settings: UpdateSettings, twin: Files, progress: Progress) -> list[Photo]:
    """Photos that the twin does not have yet, copied into its folder under names of their own."""
    known = {fingerprint(photo.pixels) for photo in twin.photos}
    names = {photo.name.casefold() for photo in twin.photos}
    loaded = load_photos(settings.photos, twin.settings.photos.max_size, progress, None, minimum=1)
    new = [photo for photo in loaded if fingerprint(photo.pixels) not in known]
    if not new:
        raise PhotoError(f"'{settings.photos}' holds no photo that the twin does not have", "Add new photos to it")
    target = make_folder(twin.folder / "photos")
    out = []
    for photo in new:
        name = photo.name
        while name.casefold() in names:
            name = f"new_{name}"
        names.add(name.casefold())
        try:
            shutil.copy2(photo.path, target / name)
        except OSError as error:
            raise output_error(target / name, error) from error
        out.append(replace(photo, name=name, path=target / name))
    return out


def _medium(twin: Twin, names: Sequence[str], width: float) -> Medium:
    if width == 1.0 or twin.medium.psf is None:
        return twin.medium
    own = {name: wider(twin.medium.psf, width) for name in names}
    return replace(twin.medium, per_view={**twin.medium.per_view, **own})


def _masked(twin: Twin, view: View, changes: Changes) -> View:
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


def _trainer(
    twin: Twin,
    kept: Sequence[View],
    new: Sequence[View],
    medium: Medium,
    report: dict[str, Any],
    settings: UpdateSettings,
) -> tuple[Updater, int]:
    """A trainer that stands where the twin's own training ended."""
    whole = int(report["steps"])
    path = twin.folder / "checkpoint.npz"
    if not path.is_file():
        raise CheckpointError(f"'{twin.folder}' has no checkpoint.npz, the optimizer's state", "Reconstruct it again")
    state = load_checkpoint(path, {})
    named = report["settings"]["training"]
    plain = {
        name: named[name]
        for name in ("sh_degree", "loss", "low_pass", "variation_weight", "inverse_weight", "base_weight")
        if name in named
    }
    chosen = replace(TrainingSettings.preset(twin.settings.training.preset), **plain)
    count = len(state.arrays["value.means"])
    room = max(count, round(count * (1.0 + len(new) / max(1, len(kept)))))
    steps = max(20, round((ROUND if settings.share is None else settings.share) * whole))
    chosen = replace(
        chosen,
        steps=steps,
        max_gaussians=room,
        seed=settings.seed,
        threads=settings.threads or 0,
        time_limit=None,
        coarse_share=0.0,
    )
    compile_kernels(chosen.sh_degree)
    photos = set(state.fingerprint.get("photos", []))
    cameras = [view.camera for view in twin.views if view.name in photos] or [view.camera for view in twin.kept]
    scale = scene_scale(cameras, twin.reconstruction.points)
    names = [field.name for field in fields(Gaussians)]
    values = Gaussians(**{name: torch.from_numpy(state.arrays[f"value.{name}"].copy()) for name in names})
    start = scale.to_world(values)
    trainer = Updater([*kept, *new], [], twin.reconstruction.points, medium, chosen, start=start)
    trainer.fresh = frozenset(view.name for view in new)
    for name in names:
        trainer.optimizer.first[name] = torch.from_numpy(state.arrays[f"first.{name}"].copy())
        trainer.optimizer.second[name] = torch.from_numpy(state.arrays[f"second.{name}"].copy())
    trainer.optimizer.steps = int(state.counters["steps"])
    return trainer, steps


def _watched(twin: Twin) -> list[View]:
    old = [view for view in twin.views if view.name in twin.held] or twin.views
    return old[:: max(1, -(-len(old) // WATCHED))]


def _residuals(twin: Twin, gaussians: Gaussians, medium: Medium, views: Sequence[View]) -> float:
    """PSNR (dB) of the twin through the blur against photos."""
    changed = replace(twin, medium=medium)
    unit, model = twin.scale.to_unit(gaussians), changed.model(twin.margin(twin.step))
    errors = []
    for view in changed.on_grid(list(views), twin.step):
        with torch.no_grad():
            exposed = model.expose(unit, view, twin.background)
            errors.append(mean_square(exposed.residual(torch.from_numpy(view.planes())), mask_of(view.valid)))
    return round(psnr_of(errors), 3)


def _write(
    twin: Twin,
    photos: Sequence[Photo],
    found: Reconstruction,
    gaussians: Gaussians,
    trainer: Trainer,
    medium: Medium,
    report: dict[str, Any],
    facts: dict[str, Any],
) -> None:
    folder = twin.folder
    poses = {**twin.reconstruction.poses, **found.poses}
    lenses = {**twin.reconstruction.lenses, **{name: found.lenses[name] for name in found.poses}}
    if len(poses) != len(lenses):
        raise CameraError("Cameras and lenses of the update do not fit", "Report this as a bug")
    write_ply(folder / "twin.ply", gaussians.cloud())
    write_lenses(folder / "cameras", lenses, poses, twin.reconstruction.points)
    save_checkpoint(folder / "checkpoint.npz", trainer.state(0.0, []))
    # Not resolved: a linked photo would get another name, and lose its camera.
    lines = [str(photo.path.absolute()) for photo in [*twin.photos, *photos]]
    write_text(folder / "photos.txt", "\n".join(lines) + "\n")
    report["settings"]["run"]["photos"] = str(folder / "photos.txt")
    report["gaussians"] = len(gaussians)
    write_json(folder / "report.json", report)
    new = {name: psf for name, psf in medium.per_view.items() if name not in twin.medium.per_view}
    past = TwinFolder(folder).update_log()
    own = {**past.get("psf", {}), **{name: psf.source for name, psf in new.items() if psf is not None and psf.source}}
    TwinFolder(folder).save_update_log({"held": twin.held, "psf": own, "updates": [*past.get("updates", []), facts]})
    write_json(folder / "update.json", facts)
    for name in ("known.npy", "next_views.json"):  # of the twin as it was
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / "next_views", ignore_errors=True)
    drop_chapter(folder / "report.html")
