"""A run's folder inside the twin's: what a run makes until it is finished, and how it takes the old twin's place.

A run writes into TWIN/.run only: what stands in the folder stays readable as it was. At the end one change puts the
new twin there and keeps the old one in history/. A run that was cut off is gone on with from .run (`--resume`).
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

from ..errors import CheckpointError
from ..files import file_digest, make_folder, output_error, write_text
from ..sfm.child import drop_scratch
from ..transaction import recover
from .folder import PARTS, TwinFolder, link_part

#: Where a run writes, and where its folder is made ready.
RUN, RUN_NEXT = ".run", ".run-next"
#: Where an earlier run that was cut off waits until the new one has begun, and where it is deleted.
RUN_OLD, RUN_DROPPED = ".run-old", ".run-dropped"
#: In .run from when its photos were found good; and, where a finished run is gone on with, which twin that was.
BEGUN, CONTINUES = ".begun", ".continues"
#: How a run begins: with nothing, with the cameras that are there, or where the last one stopped.
Start = Literal["anew", "cameras", "resume"]

_CAMERAS = ("cameras", "sfm", "inputs.json")
#: Parts that each kind of start takes over; frames, which only a movie's run has, are compared with the movie again.
_TAKEN: dict[Start, tuple[str, ...]] = {
    "anew": (),
    "cameras": _CAMERAS,
    "resume": (*_CAMERAS, "photos.txt", "checkpoint.npz", "trials.json", "plan.json"),
}


class BegunRun:
    """One run into a twin's folder, from its start to the change that puts its results in place.

    Args:
        out: the twin's folder; this process holds its lock.
        start: see `Start`.
        movie: whether the photos are a movie's frames.

    Attributes:
        folder: where the run writes.

    Raises:
        OutputError: it cannot be made.
    """

    def __init__(self, out: TwinFolder, start: Start, movie: bool = False) -> None:
        self._out, self._path = out, out.path / RUN
        self.folder = TwinFolder(self._path)
        self._accepted = False
        try:
            self._tidy()
            if start != "resume" or not self._is_begun:
                self._make_ready([*_TAKEN[start], *(["frames"] if movie else [])], start == "resume")
            else:
                self._accepted = True
        except OSError as error:
            raise output_error(self._path, error) from error

    @property
    def _is_begun(self) -> bool:
        return (self._path / BEGUN).is_file()

    def finish(self, inputs: Sequence[Path] = ()) -> None:
        """The results take the place of what the folder held, as one change.

        Args:
            inputs: what the run read; a file of the folder among them stays as it is, and
                so does a part that one lies in, unless the run has such a part, too.

        Raises:
            OutputError: the folder is as it was before the run, which can be resumed.
        """
        read = [path.resolve() for path in inputs]
        with self._out.changing() as change:
            if self._out.is_twin and not self._continues():
                change.keep_former()
            for part in PARTS:
                target = (self._out.path / part.name).resolve()
                if target in read and target.is_file():
                    continue  # a list of photos that the run read: it stays as it is
                if (self._path / part.name).exists():
                    link_part(part, self._path, change.new.path)
                elif not part.lasting and not any(path == target or target in path.parents for path in read):
                    change.remove(part.name)
            change.remove(RUN)

    def final(self, path: Path) -> Path:
        """Where a file of the run will be when it is finished; other paths stay."""
        return self._out.path / path.relative_to(self._path) if path.is_relative_to(self._path) else path

    @contextlib.contextmanager
    def until_finished(self, inputs: Sequence[Path]) -> Iterator[None]:
        """Around the run's work: `finish` when it ends well, `leave` when it does not."""
        try:
            yield
            self.finish(inputs)
        except BaseException:
            self.leave()
            raise

    def leave(self) -> None:
        """After an error: what a resumption can use stays; of a run that did not come to work, nothing."""
        kept = (self.folder.camera_folder, self.folder.checkpoint, self._path / "frames")
        if not self._accepted or not any(path.exists() for path in kept):
            shutil.rmtree(self._path, ignore_errors=True)
        if not self._accepted:
            with contextlib.suppress(OSError):
                self._bring_back()

    def check_photos(self, photos: dict[str, str], cameras: str | None) -> None:
        """Keeps what the run is made from; a run that is gone on with must be made from the same.

        Args:
            photos: digests by name; cameras: digest of those that the user gave, None where there are none.

        Raises:
            CheckpointError: it was made from something else, or does not say from what.
            FormatError: what it says is damaged.
        """
        if self.folder.camera_folder.is_dir() or self.folder.checkpoint.is_file():
            self._compare(photos, cameras)
        self.folder.save_inputs(photos, cameras)
        write_text(self._path / BEGUN, "")
        try:
            self._drop_old()
        except OSError as error:
            raise output_error(self._path, error) from error
        self._accepted = True

    def _compare(self, photos: dict[str, str], cameras: str | None) -> None:
        kept = self.folder.inputs()
        if kept is None:
            raise CheckpointError(
                f"The run in '{self._out.path}' is of an earlier version, which did not keep what its photos were",
                "Start again without --resume",
            )
        for name, content in sorted(photos.items()):
            if kept[0].get(name, content) != content:
                raise CheckpointError(
                    f"'{name}' (or its mask) is not the photo that the run in '{self._out.path}' was begun with",
                    "Bring that photo back, or start again without --resume and --keep-cameras",
                )
        if self.folder.checkpoint.is_file() and cameras is not None and cameras != kept[1]:
            raise CheckpointError(
                f"The run in '{self._out.path}' was begun with other cameras than those of --cameras",
                "Give those, or start again without --resume",
            )

    def _tidy(self) -> None:
        """What a kill left of a beginning, or of a search for cameras."""
        self._bring_back()
        drop_scratch(self._out.path)
        for name in (RUN_DROPPED, RUN_NEXT):
            shutil.rmtree(self._out.path / name, ignore_errors=True)
        if self._path.is_dir():
            recover(self._path)
        for scratch in self.folder.sfm_folder.glob("sfm-*"):
            shutil.rmtree(scratch, ignore_errors=True)

    def _make_ready(self, taken: Sequence[str], resumed: bool) -> None:
        """A folder with what is taken over of a run that was cut off, else of what stands in the twin's folder."""
        earlier = self.folder if self._is_begun and self.folder.camera_folder.is_dir() else self._out
        fresh, old = make_folder(self._out.path / RUN_NEXT), self._out.path / RUN_OLD
        for part in PARTS:
            if part.name in taken and (earlier.path / part.name).exists():
                link_part(part, earlier.path, fresh)
        if resumed and self._out.is_twin:
            write_text(fresh / CONTINUES, _identity(self._out))
        if self._is_begun:
            self._path.rename(old)
        else:
            shutil.rmtree(self._path, ignore_errors=True)
        fresh.rename(self._path)

    def _bring_back(self) -> None:
        """The earlier run that was cut off, where a new one never came to work."""
        old = self._out.path / RUN_OLD
        if old.is_dir():
            shutil.rmtree(self._path, ignore_errors=True)
            old.rename(self._path)

    def _drop_old(self) -> None:
        old, dropped = self._out.path / RUN_OLD, self._out.path / RUN_DROPPED
        if old.is_dir():
            old.rename(dropped)
            shutil.rmtree(dropped, ignore_errors=True)

    def _continues(self) -> bool:
        """Whether the run goes on with the very twin that stands in the folder, untouched since."""
        try:
            return (self._path / CONTINUES).read_text("utf-8") == _identity(self._out)
        except (OSError, ValueError):
            return False


def _identity(folder: TwinFolder) -> str:
    """Of a finished twin; raises OSError."""
    parts = [folder.twin_file, folder.path / "report.json"]
    log = folder.path / "twin.json"  # one that was updated since is another
    digests = [file_digest(path) for path in [*parts, *([log] if log.is_file() else [])]]
    return hashlib.sha256("".join(digests).encode("ascii")).hexdigest()
