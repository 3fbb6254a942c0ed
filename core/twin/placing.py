"""The search for new photos' places, in a child process that works while this one gets the twin ready."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files import explaining, write_json
from ..lens import Lens
from ..numbers import number
from ..photos.load import Photo
from ..pose import Pose
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..sfm.child import Waiting
from ..sfm.features import FEATURES, Features, load_features, save_features
from ..sfm.find import keep_features, talk
from ..sfm.job import KEPT, PLAN, REFERENCES, write_job
from ..sfm.settings import Recipe, SfmSettings
from .folder import TwinFolder
from .opened import OpenedTwin, StoredTwin
from .surface import surface_depth

#: By photo name, and how they were found.
KeptFeatures = tuple[dict[str, Features], Recipe]


@dataclass(frozen=True)
class ReferenceSettings:
    """Of the twin's own photos that new ones are placed by."""

    photos: int = number(
        24, "count", "old photos that new ones are matched with: enough to tie them to the world; more take longer"
    )


SETTINGS = ReferenceSettings()


@dataclass(frozen=True)
class Placing:
    """A search that has begun.

    Attributes:
        photos: the new ones; images: photo by image name in the job.
        earlier: features of the twin's photos that were kept.
        references: old photo by the name that the child has for it.
        child: the process and its folder; settings: its own.
    """

    photos: list[Photo]
    images: dict[str, Photo]
    earlier: KeptFeatures | None
    references: dict[str, str]
    child: Waiting
    settings: SfmSettings

    @staticmethod
    def begin(
        twin: StoredTwin | OpenedTwin,
        photos: list[Photo],
        threads: int,
        waiting: Waiting | None = None,
        kept: bool = True,
    ) -> Placing | None:
        """Lets the child look for the photos' features and match them with old ones.

        Args:
            waiting: a child to use; None to start one.
            kept: match with the features that the twin kept; else the old photos come along.

        Returns:
            None where it cannot be done: no features were kept, or the new photos have a lens of their own.
        """
        lens = shared_lens(twin.reconstruction)
        earlier = _kept_features(twin)
        placed = [photo.name for photo in twin.photos if photo.name in twin.reconstruction.poses]
        old = [name for name in placed if not kept or earlier is not None and name in earlier[0]]
        if lens is None or not old or any(photo.size != (lens.width, lens.height) for photo in photos):
            return None
        old = [old[round(i)] for i in np.linspace(0, len(old) - 1, min(SETTINGS.photos, len(old)))]
        psf, settings = twin.medium.psf, SfmSettings(threads=threads)
        kernel = None if psf is None or psf.is_identity else psf.kernel()
        with explaining(twin.folder):
            child = waiting or Waiting(twin.folder, threads)
        by_name = {photo.name: photo for photo in twin.photos}
        given = [*([] if kept else [by_name[name] for name in old]), *photos]
        names = write_job(given, kernel, settings, child.folder)
        images = {photo: image for image, photo in names.items()}
        references = {name if kept else images[name]: name for name in old}
        if kept and earlier is not None:
            save_features(child.folder / KEPT, {name: earlier[0][name] for name in old}, earlier[1])
        write_json(child.folder / REFERENCES, list(references))
        with explaining(child.folder):
            child.go()
        of_job = {photo.name: photo for photo in given}
        in_job = {image: of_job[name] for image, name in names.items()}
        return Placing(photos, in_job, earlier, references, child, settings)

    def poses(self, twin: OpenedTwin, keep: Path, progress: Progress) -> dict[str, Pose] | None:
        """All new photos' poses in the twin's world, from where their matches lie on its surface; None if any lacks.

        Args:
            keep: file for their features, beside those of the twin's photos.
        """
        folder = self.child.folder
        by_name, rows = {view.name: view for view in twin.views}, {}
        shown = twin.on_grid([by_name[name] for name in self.references.values()], twin.step)
        gaussians = twin.scale.to_unit(twin.gaussians)
        usual = twin.raster_settings()
        for index, (name, view) in enumerate(zip(self.references, shown, strict=True)):
            camera = view.camera
            depth = surface_depth(gaussians, camera, usual)
            with explaining(folder):
                np.save(folder / f"depth{index}.npy", depth, allow_pickle=False)
            rows[name] = {
                "rotation": camera.rotation.tolist(),
                "translation": camera.translation.tolist(),
                "focal": [camera.fx, camera.fy],
                "centre": [camera.cx, camera.cy],
                "depth": f"depth{index}.npy",
            }
        lens = shared_lens(twin.reconstruction)
        assert lens is not None
        write_json(
            folder / PLAN,
            {
                "references": rows,
                "lens": {"model": lens.model, "width": lens.width, "height": lens.height, "params": list(lens.params)},
            },
        )
        _, done = talk(folder, len(self.photos), self.settings, progress, self.child.process)
        if len(done["poses"]) < len(self.photos):
            return None
        keep_features(folder / FEATURES, keep, self.images, self.earlier)
        poses = {}
        for image, pose in done["poses"].items():
            rotation = np.array(pose["rotation"], float)
            translation = np.array(pose["translation"], float) * twin.scale.size - rotation @ twin.scale.origin
            poses[self.images[image].name] = Pose(rotation, translation)
        return poses

    def end(self) -> None:
        """Ends the child and removes its folder."""
        self.child.end()


def _kept_features(twin: StoredTwin | OpenedTwin) -> KeptFeatures | None:
    """Features that were kept of the twin's photos as they are now: not of others that had their names."""
    held = load_features(TwinFolder(twin.folder).features)
    if held is None:
        return None
    found = {photo.name: held[0].get(photo.name) for photo in twin.photos}
    contents = {photo.name: photo.content for photo in twin.photos}
    return {name: one for name, one in found.items() if one is not None and one.shown_by(contents[name])}, held[1]


def shared_lens(cameras: Reconstruction) -> Lens | None:
    """The lens that all photos share, or None."""
    lenses = set(cameras.lenses.values())
    return lenses.pop() if len(lenses) == 1 else None
