"""What lies in a twin's folder, which stage makes it, and the one writer of it.

`PARTS` is the one list: what a run leaves, what an update changes, what its history keeps and what an update makes
stale are read off it. Blender's own Python reads this file too.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..cloud import GaussianCloud
from ..errors import FormatError
from ..files import make_folder, output_error, read_json, write_bytes, write_json, write_text
from ..formats.ply import write_ply
from ..json_shape import anything, check_shape, count, text
from ..reconstruction import Reconstruction


@dataclass(frozen=True)
class Part:
    """One file or folder of a twin's folder.

    Attributes:
        name: inside the folder.
        stage: which makes it.
        state: whether it is part of the twin's state, which an update keeps in history/ first, and `rollback` brings
            back.
        stale: whether it speaks of the twin as it was, so that an update takes it away.
        folder: whether it is one.
    """

    name: str
    stage: str
    state: bool = False
    stale: bool = False
    folder: bool = False


PARTS = (
    Part("frames", "photos", folder=True),
    Part("photos.txt", "photos", state=True),
    Part("photos", "update", folder=True),  # new photos: only ever added
    Part("cameras", "cameras", state=True, folder=True),
    Part("sfm", "cameras", folder=True),
    Part("plan.json", "training"),
    Part("snapshot", "training", folder=True),
    Part("checkpoint.npz", "training", state=True),
    Part("twin.ply", "training", state=True),
    Part("renders", "scores", folder=True),
    Part("report.json", "report", state=True),
    Part("report.html", "report"),
    Part("twin.json", "update", state=True),
    Part("update.json", "update", state=True),
    Part("changes", "update", folder=True),
    Part("history", "update", folder=True),
    Part("known.npy", "next view", state=True, stale=True),
    Part("next_views.json", "next view", state=True, stale=True),
    Part("next_views", "next view", stale=True, folder=True),
)

#: What is read of report.json; a field that another version lacks may be missing.
_REPORT = {
    "settings": {
        "run": {
            "psf": text,
            "photos": text,
            "out": text,
            "blur_space?": frozenset(("srgb", "linear")),
            "cameras?": (text,),
            "truth?": (text,),
            "masks?": (text,),
            "frames?": count,
            "holdout_every?": count,
            "max_size?": (count,),
            "preset?": text,
            "effects?": text,
            "seed?": count,
        },
        "training?": {"sh_degree?": count},
    },
    "steps?": count,
    "medium?": {"per_photo?": ({"*": text},)},
    "effects?": [anything],
}
#: What is read of twin.json.
_UPDATE_LOG = {"held?": [text], "psf?": {"*": text}, "updates?": [{"*": anything}]}


class TwinFolder:
    """A twin's folder: names of its files, their readers, and the only code that writes them.

    Every file is written whole or not at all.

    Args:
        path: the folder; need not be there before something is saved.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.photo_list = path / "photos.txt"
        self.new_photo_folder = path / "photos"
        self.camera_folder = path / "cameras"
        self.sfm_folder = path / "sfm"
        self.checkpoint = path / "checkpoint.npz"
        self.twin_file = path / "twin.ply"
        self.report_page = path / "report.html"
        self.change_folder = path / "changes"

    def save_photo_list(self, photos: Sequence[Path]) -> None:
        """All photos of the twin, line by line; raises OutputError."""
        # Not resolved: a linked photo would get another name, and lose its camera.
        write_text(self.photo_list, "\n".join(str(photo.absolute()) for photo in photos) + "\n")

    def save_new_photo(self, source: Path, name: str) -> Path:
        """Copies a photo that an update takes in; returns where it lies now.

        Raises:
            OutputError: it cannot be written.
        """
        target = make_folder(self.new_photo_folder) / name
        try:
            shutil.copy2(source, target)
        except OSError as error:
            raise output_error(target, error) from error
        return target

    def save_cameras(self, found: Reconstruction) -> None:
        """Cameras and points as a COLMAP model; raises OutputError."""
        from ..formats.colmap import write_lenses  # late: not in Blender's Python

        write_lenses(self.camera_folder, found.lenses, found.poses, found.points)

    def save_plan(self, plan: Mapping[str, Any]) -> None:
        """What was planned for a time limit; raises OutputError."""
        write_json(self.path / "plan.json", dict(plan))

    def plan(self) -> dict[str, Any]:
        """What `save_plan` kept; empty where there is none, or it is damaged."""
        try:
            content = read_json(self.path / "plan.json")
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def save_twin(self, cloud: GaussianCloud) -> None:
        """The Gaussians; raises OutputError."""
        write_ply(self.twin_file, cloud)

    def save_snapshot(self, picture: bytes, preview: bytes, cloud: GaussianCloud) -> None:
        """The twin so far and what it looks like, for whoever watches a training; raises OutputError.

        Args:
            picture: a PNG file; preview: a .npy file, [H, W, 3] uint8 sRGB.
        """
        folder = make_folder(self.path / "snapshot")
        write_bytes(folder / "picture.png", picture)
        write_bytes(folder / "preview.npy", preview)
        write_ply(folder / "twin.ply", cloud)

    def save_render(self, file: str, png: bytes) -> None:
        """A held-out view as the twin shows it, in renders/; raises OutputError."""
        write_bytes(self.path / "renders" / file, png)

    def save_report(self, report: Mapping[str, Any]) -> None:
        """report.json; raises OutputError."""
        write_json(self.path / "report.json", dict(report))

    def report(self) -> dict[str, Any]:
        """The content of report.json.

        Raises:
            FormatError: the folder is no twin, or its report is damaged.
        """
        path = self.path / "report.json"
        if not path.is_file() or not self.twin_file.is_file():
            raise FormatError(
                f"'{self.path}' is no twin folder (it lacks report.json or twin.ply)",
                "Give the --out folder of 'reconstruct'",
            )
        try:
            content = read_json(path)
            check_shape(content, _REPORT)
        except (OSError, ValueError) as error:
            raise FormatError(f"'{path}' is damaged ({error})", "Reconstruct the twin again") from error
        return dict(content)

    def save_update(self, report: Mapping[str, Any]) -> None:
        """update.json, what the last update found; raises OutputError."""
        write_json(self.path / "update.json", dict(report))

    def save_update_log(self, log: Mapping[str, Any]) -> None:
        """Writes what `update_log` reads; raises OutputError."""
        write_json(self.path / "twin.json", dict(log))

    def update_log(self) -> dict[str, Any]:
        """What updates noted about the twin: 'held' names, 'psf' by photo name, 'updates'; empty before the first.

        Raises:
            FormatError: the file is damaged.
        """
        path = self.path / "twin.json"
        if not path.is_file():
            return {}
        try:
            content = read_json(path)
            check_shape(content, _UPDATE_LOG)
        except (OSError, ValueError) as error:
            raise FormatError(
                f"'{path}' is damaged ({error})", "Bring an earlier state back: update TWIN --rollback"
            ) from error
        return dict(content)

    def drop_stale(self) -> None:
        """Takes away what speaks of the twin as it was."""
        for part in PARTS:
            if part.stale and part.folder:
                shutil.rmtree(self.path / part.name, ignore_errors=True)
            elif part.stale:
                (self.path / part.name).unlink(missing_ok=True)

    def states(self) -> list[Path]:
        """Folders of the kept states, oldest first."""
        kept = (self.path / "history").glob("[0-9][0-9][0-9]")
        return sorted(state for state in kept if (state / "twin.ply").is_file())

    def keep_state(self) -> Path:
        """Copies the present state to history/NNN; a copy that was cut off is never taken for a state.

        Raises:
            OutputError: no room, or no permission.
        """
        numbers = [int(state.name) for state in self.states()]
        target = self.path / "history" / f"{max(numbers, default=-1) + 1:03d}"
        half = target.with_name(f".{target.name}.part")
        try:
            shutil.rmtree(half, ignore_errors=True)
            make_folder(half)
            for part in _state():
                source = self.path / part.name
                if part.folder and source.is_dir():
                    shutil.copytree(source, half / part.name)
                elif not part.folder and source.is_file():
                    shutil.copy2(source, half / part.name)
            half.rename(target)
        except OSError as error:
            raise output_error(target, error) from error
        return target

    def rollback(self) -> Path:
        """Brings the latest kept state back and takes it out of the history; returns what it was called.

        Raises:
            FormatError: nothing is kept. OutputError: it cannot be written.
        """
        kept = self.states()
        if not kept:
            raise FormatError(f"'{self.path}' has no earlier state", "There is nothing to roll back")
        state = kept[-1]
        try:
            for part in _state():
                self._bring_back(part, state / part.name)
            shutil.rmtree(state)
        except OSError as error:
            raise output_error(self.path, error) from error
        return state

    def _bring_back(self, part: Part, kept: Path) -> None:
        target = self.path / part.name
        if part.folder and kept.is_dir():
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(kept, target)
        elif not part.folder and kept.is_file():
            half = target.with_name(f".{part.name}.part")
            shutil.copy2(kept, half)
            half.replace(target)
        elif not part.folder:
            target.unlink(missing_ok=True)


def _state() -> list[Part]:
    """Files before folders."""
    return sorted((part for part in PARTS if part.state), key=lambda part: part.folder)
