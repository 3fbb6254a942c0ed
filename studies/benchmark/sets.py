"""The photos of a scene: rendered, or made from a shared set, each once; and the words that a run is given."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files import write_text
from ...core.photos.load import load_photo, photo_files
from ...core.photos.write import write_png
from ..comparison.degrade import gaussian, photographed
from .scenes import BenchmarkScene, PhotoSet, RenderedSet

#: Written last into a set that was made from another one.
_DONE = "made.txt"


@dataclass(frozen=True)
class PreparedSet:
    """What a run reads.

    Attributes:
        photos: folder of photos; truth: of sharp ones, None where the photos themselves are.
        cameras: model that is given, or None.
        psf: as `--psf` takes it.
    """

    photos: Path
    truth: Path | None
    cameras: Path | None
    psf: str

    def words(self) -> list[str]:
        """The words of `reconstruct` that say what is known."""
        found = [str(self.photos), "--psf", self.psf]
        found += [] if self.truth is None else ["--truth", str(self.truth)]
        return found + ([] if self.cameras is None else ["--cameras", str(self.cameras)])


def prepared(scene: BenchmarkScene, command: Callable[..., None], made: Path, shared: Path) -> PreparedSet | None:
    """The scene's set, made if it is not there; None for a shared set that this machine does not have.

    Args:
        command: runs our own commands.
        made: folder of sets that are made; shared: folder of photo sets.
    """
    source = scene.source
    if isinstance(source, RenderedSet):
        return _rendered(scene, source, command, made)
    folder = shared / source.folder
    if not (folder / source.photos).is_dir():
        return None
    cameras = folder / source.cameras if scene.cameras == "given" else None
    if source.prepare:
        return _derived(source, folder, cameras, made)
    truth = folder / source.truth if source.truth else None
    return PreparedSet(folder / source.photos, truth, cameras, source.psf)


def _rendered(scene: BenchmarkScene, source: RenderedSet, command: Callable[..., None], made: Path) -> PreparedSet:
    """Cameras are given without points, as Blender's exporters give them."""
    folder = made / scene.name.removesuffix("-found")
    base = made / folder.name.removesuffix("-blurred")
    words: list[object] = ["--scene", source.scene, "--path", source.path, "--background", source.background]
    words += ["--views", source.views, "--size", f"{source.width}x{source.height}", "--samples", source.samples]
    words += ["--overscan", source.overscan, "--keep-linear", "--psf"]
    command("synthesize", "--out", base, *words, source.psf if folder == base else "none")
    if folder != base:
        if not (folder / "manifest.json").is_file() and not (folder / "unfinished.json").is_file():
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(base / "linear", folder / "linear", copy_function=os.link)
            shutil.copyfile(base / "manifest.json", folder / "manifest.json")  # says that the frames are the same
        command("synthesize", "--out", folder, *words, source.psf)
    truth = None if source.psf == "none" else folder / "sharp"
    cameras = folder / "transforms.json" if scene.cameras == "given" else None
    return PreparedSet(folder / "photos", truth, cameras, source.psf)


def _derived(source: PhotoSet, folder: Path, cameras: Path | None, made: Path) -> PreparedSet:
    """Photos with alpha over white, and blurred."""
    white = made / f"{source.folder}-white"
    _make(white, folder / source.photos, lambda pixels: pixels)
    if source.prepare == "white":
        return PreparedSet(white, None, cameras, source.psf)
    sigma = float(source.psf.removeprefix("gaussian:"))
    blurred = made / f"{source.folder}-blurred"
    _make(blurred, white, lambda pixels: photographed(pixels, gaussian(sigma)))
    return PreparedSet(blurred, white, cameras, source.psf)


def _make(out: Path, photos: Path, change: Callable[[Any], Any]) -> None:
    if (out / _DONE).is_file():
        return
    out.mkdir(parents=True, exist_ok=True)
    for file in photo_files(photos):
        write_png(out / f"{file.stem}.png", np.asarray(change(load_photo(file).pixels)))
    write_text(out / _DONE, f"made from {photos.name}\n")
