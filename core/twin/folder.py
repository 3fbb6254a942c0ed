"""What lies in a twin's folder, which stage makes it, and its writer.

`PARTS` is the one list: what a run leaves, what an update changes, what its history keeps and what an update makes
stale are read off it. Blender's own Python reads this file too.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cloud import GaussianCloud
from ..errors import FormatError
from ..files import make_folder, output_error, read_json, write_bytes, write_json, write_text
from ..formats.ply import write_ply
from ..json_shape import anything, check_shape, count, number, positive, sentence, text
from ..reconstruction import Reconstruction
from ..transaction import FolderChange, changing, recover


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
        lasting: whether it stays when another run's twin takes the twin's place.
    """

    name: str
    stage: str
    state: bool = False
    stale: bool = False
    folder: bool = False
    lasting: bool = False


PARTS = (
    Part("frames", "photos", folder=True),
    Part("photos.txt", "photos", state=True),
    Part("inputs.json", "photos", state=True),
    Part("photos", "update", folder=True, lasting=True),  # new photos: only ever added
    Part("cameras", "cameras", state=True, folder=True),
    Part("sfm", "cameras", folder=True),
    Part("trials.json", "effects"),
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
    Part("history", "update", folder=True, lasting=True),
    Part("known.npy", "next view", state=True, stale=True),
    Part("next_views.json", "next view", state=True, stale=True),
    Part("next_views", "next view", state=True, stale=True, folder=True),
)

#: The file of a kept state that is a whole twin, which another run replaced.
FORMER = "former-twin.txt"
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
            "background?": text,
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
#: What is read of plan.json.
_PLAN = {"gaussians": positive, "grid_step": (positive,)}
#: What trials.json holds: by trial what `core.pipeline.effects.comparison.Comparison` does; no 'least' is infinity.
_TRIALS = {
    "*": {"differences": [number], "seen": sentence, "least": (number,), "least_lost?": number, "beside?": sentence}
}
#: What inputs.json holds.
_INPUTS = {"photos": {"*": text}, "cameras?": (text,)}
#: What is read of twin.json.
_UPDATE_LOG = {"held?": [text], "psf?": {"*": text}, "updates?": [{"*": anything}]}


class TwinFolder:
    """A twin's folder: names of its files, their readers, and the code that writes them.

    Two files are written by their stages, where this class says: the checkpoint and the cameras' features.

    Every file is written whole or not at all.

    Args:
        path: the folder; need not be there before something is saved.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.photo_list = path / "photos.txt"
        self.new_photo_folder = path / "photos"
        self.camera_folder = path / "cameras"
        self.found_cameras = self.camera_folder / "found"  # of cameras that a training adjusted, as they were found
        self.sfm_folder = path / "sfm"
        self.features = self.sfm_folder / "features.npz"
        self.checkpoint = path / "checkpoint.npz"
        self.twin_file = path / "twin.ply"
        self.report_page = path / "report.html"
        self.change_folder = path / "changes"
        self.next_view_folder = path / "next_views"
        self.next_view_list = path / "next_views.json"

    def save_photo_list(self, photos: Sequence[Path]) -> None:
        """All photos of the twin, line by line; raises OutputError."""
        # Not resolved: a linked photo would get another name, and lose its camera.
        write_text(self.photo_list, "\n".join(str(photo.absolute()) for photo in photos) + "\n")

    def save_inputs(self, photos: Mapping[str, str], cameras: str | None) -> None:
        """What `inputs` reads; raises OutputError."""
        write_json(self.path / "inputs.json", {"photos": dict(photos), "cameras": cameras})

    def inputs(self) -> tuple[dict[str, str], str | None] | None:
        """Digests of the photos by name, and of the cameras that the user gave; None where none were kept.

        Raises:
            FormatError: the file is damaged.
        """
        path = self.path / "inputs.json"
        if not path.is_file():
            return None
        try:
            content = read_json(path)
            check_shape(content, _INPUTS)
        except (OSError, ValueError) as error:
            raise FormatError(f"'{path}' is damaged ({error})", "Start again without --resume") from error
        return content["photos"], content.get("cameras")

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
        """Cameras and points as a COLMAP model, all its files or none; raises OutputError."""
        make_folder(self.path)
        with changing(self.path) as change:
            _write_model(change.new("cameras"), found)

    def save_adjusted(self, found: Reconstruction, adjusted: Reconstruction) -> None:
        """The same of cameras that a training adjusted; those that were found lie in them for a run that goes on.

        Whatever writes other cameras (`save_cameras`) takes both away: what was found is that of this checkpoint only.
        """
        with changing(self.path) as change:
            folder = change.new("cameras")
            _write_model(folder, adjusted)
            _write_model(folder / self.found_cameras.name, found)

    def save_plan(self, plan: Mapping[str, Any]) -> None:
        """What was planned for a time limit; raises OutputError."""
        write_json(self.path / "plan.json", dict(plan))

    def plan(self) -> dict[str, Any]:
        """What `save_plan` kept; empty where there is none, or it is damaged."""
        try:
            content = read_json(self.path / "plan.json")
            check_shape(content, _PLAN)
        except (OSError, ValueError):
            return {}
        return dict(content)

    def save_trials(self, said: Mapping[str, Any]) -> None:
        """What trials of effects said; raises OutputError."""
        write_json(self.path / "trials.json", dict(said))

    def trials(self) -> dict[str, Any]:
        """What `save_trials` kept; empty where there is none, or it is damaged."""
        try:
            content = read_json(self.path / "trials.json")
            check_shape(content, _TRIALS)
        except (OSError, ValueError):
            return {}
        return dict(content)

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

    @property
    def is_twin(self) -> bool:
        """Whether a run was finished here."""
        return self.twin_file.is_file() and (self.path / "report.json").is_file()

    def save_next_views(self, ranking: Mapping[str, Any], known: NDArray[np.float32]) -> None:
        """The ranking of next views, and how far photos fix each Gaussian's colour, [N]; raises OutputError."""
        data = io.BytesIO()
        np.save(data, known)
        write_bytes(self.path / "known.npy", data.getvalue())
        write_json(self.next_view_list, dict(ranking))

    def states(self) -> list[Path]:
        """Folders of the kept states, oldest first; those of other runs' twins that stood here before, too."""
        kept = (self.path / "history").glob("[0-9][0-9][0-9]")
        return sorted(state for state in kept if (state / "twin.ply").is_file())

    def own_states(self) -> list[Path]:
        """Those of the present twin: what it was before each of its updates."""
        states = self.states()
        before = [index for index, state in enumerate(states) if (state / FORMER).is_file()]
        return states[before[-1] + 1 :] if before else states

    @contextmanager
    def changing(self) -> Iterator[TwinChange]:
        """Several parts change together or not at all, when the block ends well; see `core.transaction`.

        Raises:
            OutputError: no room, or no permission; the folder is as it was.
        """
        with changing(self.path) as change:
            made = TwinChange(self, change)
            yield made
            made.place()

    def keep_state(self) -> Path:
        """Copies the present state to history/NNN; a copy that was cut off is never taken for a state.

        Raises:
            OutputError: no room, or no permission.
        """
        with self.changing() as change:
            return change.keep_state()

    def rollback(self) -> Path:
        """Brings the latest kept state back and takes it out of the history; returns what it was called.

        Killed at any moment, the folder is as before or as after when it is opened the next time.

        Raises:
            FormatError: nothing is kept. OutputError: it cannot be written; the folder is as it was.
        """
        recover(self.path)
        kept = self.states()
        if not kept:
            raise FormatError(f"'{self.path}' has no earlier state", "There is nothing to roll back")
        state = kept[-1]
        former = (state / FORMER).is_file()
        with self.changing() as change:
            for part in _of_twin() if former else _state():
                if (state / part.name).exists():
                    link_part(part, state, change.new.path)
                elif former or not part.folder or part.stale:
                    change.remove(part.name)
            change.remove(f"history/{state.name}")
        return state


class TwinChange:
    """A change of a twin's folder that is being prepared; made by `TwinFolder.changing`.

    Args:
        folder: as it is.
        change: of its files.
    """

    #: Folders that new files join; others are replaced whole.
    GROWING = ("photos", "history", "snapshot", "sfm")

    def __init__(self, folder: TwinFolder, change: FolderChange) -> None:
        self._folder, self._change = folder, change
        #: Where the new parts are saved.
        self.new = TwinFolder(change.content)

    def keep_state(self) -> Path:
        """The present state will be in history/NNN as well; where that will be."""
        return self._keep(_state(), copy_part)

    def keep_former(self) -> Path:
        """Another run's twin comes: all that the present one is will be in history/NNN only; where that will be."""
        kept = self._keep(_of_twin(), link_part)
        write_text(self.new.path / "history" / kept.name / FORMER, "The whole twin that another run replaced\n")
        return kept

    def _keep(self, parts: Sequence[Part], put: Callable[[Part, Path, Path], None]) -> Path:
        name = f"{max((int(state.name) for state in self._folder.states()), default=-1) + 1:03d}"
        for part in parts:
            if (self._folder.path / part.name).exists():
                put(part, self._folder.path, make_folder(self.new.path / "history" / name))
        return self._folder.path / "history" / name

    def remove(self, name: str) -> None:
        """A part, or a file of one, will be gone."""
        self._change.remove(name)

    def remove_stale(self) -> None:
        """What speaks of the twin as it was will be gone."""
        for part in PARTS:
            if part.stale:
                self.remove(part.name)

    def place(self) -> None:
        """All that was saved will stand in the folder."""
        for entry in sorted(path for path in self._change.content.iterdir() if not path.name.startswith(".")):
            inside = sorted(entry.iterdir()) if entry.name in self.GROWING else [entry]
            for found in inside:
                self._change.new(found.relative_to(self._change.content).as_posix())


def copy_part(part: Part, source: Path, target: Path) -> None:
    """Copies one part from a folder into another; raises OSError."""
    if part.folder:
        shutil.copytree(source / part.name, target / part.name)
    else:
        shutil.copy2(source / part.name, target / part.name)


def link_part(part: Part, source: Path, target: Path) -> None:
    """As `copy_part`, by links where the disk has them: whoever writes a part makes new files and renames them."""
    if part.folder:
        shutil.copytree(source / part.name, target / part.name, copy_function=_link)
    else:
        _link(source / part.name, target / part.name)


def _link(source: str | Path, target: str | Path) -> None:
    try:
        os.link(os.path.realpath(source), target)
    except OSError:  # a disk without links, or another one
        shutil.copy2(source, target)


def _state() -> list[Part]:
    """Files before folders."""
    return sorted((part for part in PARTS if part.state), key=lambda part: part.folder)


def _of_twin() -> list[Part]:
    """All that one run's twin is, files before folders."""
    return sorted((part for part in PARTS if not part.lasting), key=lambda part: part.folder)


def _write_model(path: Path, cameras: Reconstruction) -> None:
    from ..formats.colmap import write_lenses  # late: not in Blender's Python

    write_lenses(path, cameras.lenses, cameras.poses, cameras.points)
