"""Every error that a user may meet: what happened, and the way out.

Code raises the narrowest class below; the command line prints `str(error)` as one line and ends
with `error.exit_code`; the panel shows the same line. Anything else that escapes is a bug.
"""

from __future__ import annotations


class DgsError(Exception):
    """Base of all errors that are explained to the user.

    Args:
        what: what happened, naming the file or photo concerned.
        way_out: what the user can do about it, as an imperative sentence.
    """

    exit_code = 2

    def __init__(self, what: str, way_out: str = "") -> None:
        self.what = what.rstrip(". ")
        self.way_out = way_out.rstrip(". ")
        super().__init__(f"{self.what}. {self.way_out}." if way_out else f"{self.what}.")


class PhotoError(DgsError):
    """A folder or file of photos that cannot be used."""


class FormatError(DgsError):
    """A PLY, camera model, PSF or settings file that does not hold what it says."""


class PsfError(DgsError):
    """A point spread function that makes no sense."""


class CameraError(DgsError):
    """Structure from motion found no trustworthy cameras; the subclass says why."""


class TooFewPhotos(CameraError):
    """Fewer photos than a reconstruction needs."""


class NoOverlap(CameraError):
    """The photos do not see enough of the same surface."""


class DegenerateMotion(CameraError):
    """Pure rotation or a planar scene: depth cannot be found."""


class NativeCrash(CameraError):
    """Native code of the structure-from-motion library ended its process."""


class TrainingError(DgsError):
    """The optimization could not go on."""


class NonFiniteParameter(TrainingError):
    """A named parameter became NaN or infinite and could not be repaired."""


class CheckpointError(DgsError):
    """A checkpoint that is damaged or belongs to other settings."""


class OutputError(DgsError):
    """The result cannot be written (full disk, no permission)."""


class ForeignFiles(OutputError):
    """Files of others stand where something would be written; a user may allow to replace them."""


class FolderInUse(OutputError):
    """Another process works on the same folder."""


class DeviceError(DgsError):
    """The asked device or back end is not there."""


class Cancelled(DgsError):
    """The user asked to stop; what was finished is kept."""

    exit_code = 130
