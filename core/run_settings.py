"""What a reconstruction is asked to do: flat, as options and report.json name it, and split by stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from .background import BackgroundRequest, parse_background
from .devices import BackendName
from .glass import GlassRequest, parse_glass
from .shutter import ShutterRequest, parse_shutter

PresetName = Literal["draft", "balanced", "fine", "best"]
#: Which cameras of shaken photos are adjusted with the twin: those found in photos, and others that photos contradict;
#: none; all.
AdjustCameras = Literal["auto", "never", "always"]
#: Frames of a movie if nobody says how many: dense enough around an object, and a minute of cameras at most.
DEFAULT_FRAMES = 60
_PATHS = ("photos", "out", "cameras", "truth", "masks", "reference_cameras")


#: The effect's name.
FROSTED_GLASS = "glass"
FREE_KERNELS = "kernels"

#: Names that only a run leaves in its folder, and those that it replaces there (of `core.twin.folder.PARTS`).
RUN_MARKS = ("report.json", "checkpoint.npz", "trials.json", "plan.json", "sfm", "job.json")
RUN_REPLACES = (
    "frames",
    "photos.txt",
    "inputs.json",
    "cameras",
    "sfm",
    "trials.json",
    "plan.json",
    "snapshot",
    "checkpoint.npz",
    "twin.ply",
    "renders",
    "report.json",
    "report.html",
    "twin.json",
    "update.json",
    "changes",
    "known.npy",
    "next_views.json",
    "next_views",
)


@dataclass(frozen=True)
class PhotoSettings:
    """Which photos there are: see the fields of the same names in `ReconstructSettings`.

    Attributes:
        memory: bytes that the run should hold at most; photos are then kept on disk. None: in memory.
        background: `ReconstructSettings.background`; where light was blurred, photos are put over it as light.
    """

    photos: Path
    masks: Path | None = None
    frames: int = DEFAULT_FRAMES
    holdout_every: int = 8
    max_size: int | None = None
    background: BackgroundRequest = BackgroundRequest()
    memory: int | None = None


@dataclass(frozen=True)
class MediumSettings:
    """What blurs the photos.

    Attributes:
        psf, blur_space: as in `ReconstructSettings`.
        motion_apart: whether the camera's motion may be simulated as an effect, so that it is no part of the blur.
        decided: whether the photos decide on effects: a blur that they do not show is then none, and no error.
    """

    psf: str = "none"
    blur_space: Literal["srgb", "linear"] = "srgb"
    motion_apart: bool = False
    decided: bool = False


@dataclass(frozen=True)
class CameraSettings:
    """Where the photos were taken from: `ReconstructSettings.cameras`, `.adjust_cameras`, `.refine_cameras` and
    `.reference_cameras`."""

    given: Path | None = None
    adjust: AdjustCameras = "auto"
    refine: bool = False
    reference: Path | None = None


@dataclass(frozen=True)
class TrainingRequest:
    """What is asked of the training: see the fields of the same names in `ReconstructSettings`."""

    preset: PresetName = "balanced"
    loss: Literal["dgs", "paper"] = "dgs"
    until: float | Literal["plateau"] | None = None
    min_steps: int = 0
    max_gaussians: int | None = None
    sh_degree: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class RunSettings:
    """One run by its stages; made by `ReconstructSettings.split`.

    Attributes:
        out, resume, keep_cameras, snapshots, time_limit: as in `ReconstructSettings`.
        effects: as `--effects` takes it; glass, shutter: None for none; truth: folder of sharp photos, only for
            scoring.
        device, threads: as in `ReconstructSettings`.
        asked: every setting by its flat name, as report.json repeats it.
    """

    out: Path
    photos: PhotoSettings
    medium: MediumSettings
    cameras: CameraSettings
    effects: str
    glass: GlassRequest | None
    shutter: ShutterRequest | None
    training: TrainingRequest
    truth: Path | None
    device: BackendName
    threads: int | None
    resume: bool
    keep_cameras: bool
    snapshots: bool
    time_limit: float | None
    asked: dict[str, Any]


@dataclass(frozen=True)
class ReconstructSettings:
    """One run, as the command line asks for it. Stages do not see it: they get their part of `split`.

    Attributes:
        photos: folder of photos, a list of them (.txt), or a movie.
        out: folder for all results.
        psf: point spread function, in px of the photos' files (see `core.imaging.psf.parse_psf`); None: what the photos
            show where they decide on effects, none elsewhere.
        blur_space: the values that the blur acts on.
        cameras: COLMAP model folder or transforms.json; None to find them from the photos.
        truth: folder of sharp photos of the same names, only for scoring.
        masks: folder of images of the same names; black does not count.
        background: what is behind the object: 'auto', 'none' or a colour (`core.background.parse_background`).
        frames: frames of a movie that are used at most.
        holdout_every: views 0, n, 2n ... by sorted name are kept out of the training; 0: none.
        max_size: longest side in px that photos are shrunk to, with cameras and PSF.
        preset, loss: of the training.
        time_limit: seconds from the command to the report, or None; steps, Gaussians and grid are planned for it.
        until: 'plateau', or a PSNR in dB on held-out photos, at which the training may end before; min_steps: not
            before so many.
        max_gaussians, sh_degree: None for the preset's.
        seed, device, threads: threads None for all cores.
        resume: go on from the checkpoint in `out`.
        keep_cameras: take the cameras that are in `out`, and train anew.
        effects: besides the blur: 'usual', 'auto', 'none', 'all' or names (see `effects.decision.parse_effects`).
        glass: frosted glass before the camera (`core.glass.parse_glass`).
        rolling_shutter: rows that are exposed one after the other (`core.shutter.parse_shutter`).
        memory: bytes that the run should hold at most; photos are then kept on disk, in `out`/.run. None: in memory.
        adjust_cameras: where photos were shaken, move the cameras with the twin: 'auto' those that were found, and
            others that the photos contradict; 'never'; 'always'.
        refine_cameras: move the cameras by the loss before the training (`pipeline.refinement`).
        reference_cameras: true cameras, only for reporting errors.
        snapshots: write the twin so far and a picture of it to `out`/.run/snapshot while training.
    """

    photos: Path
    out: Path
    psf: str | None = None
    blur_space: Literal["srgb", "linear"] = "srgb"
    cameras: Path | None = None
    truth: Path | None = None
    masks: Path | None = None
    background: str = "auto"
    frames: int = DEFAULT_FRAMES
    holdout_every: int = 8
    max_size: int | None = None
    preset: PresetName = "balanced"
    loss: Literal["dgs", "paper"] = "dgs"
    time_limit: float | None = None
    until: float | Literal["plateau"] | None = None
    min_steps: int = 0
    max_gaussians: int | None = None
    sh_degree: int | None = None
    seed: int = 0
    device: BackendName = "auto"
    threads: int | None = None
    resume: bool = False
    keep_cameras: bool = False
    effects: str = "usual"
    glass: str | None = None
    rolling_shutter: str | None = None
    snapshots: bool = False
    adjust_cameras: AdjustCameras = "auto"
    refine_cameras: bool = False
    reference_cameras: Path | None = None
    memory: int | None = None

    def plain(self) -> dict[str, Any]:
        """For report.json: paths as text."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}

    @staticmethod
    def from_plain(values: Mapping[str, Any]) -> ReconstructSettings:
        """From what `plain` gave, of this version or another: names that are not known any more are left out."""
        known = {f.name: values[f.name] for f in fields(ReconstructSettings) if f.name in values}
        paths = {name: Path(known[name]) for name in _PATHS if known.get(name) is not None}
        return ReconstructSettings(**{**known, **paths})

    def _glass(self, effects: list[str]) -> GlassRequest | None:
        if self.glass is not None:
            return parse_glass(self.glass)
        return GlassRequest() if FROSTED_GLASS in effects else None

    def _psf(self, effects: list[str], glass: GlassRequest | None) -> str:
        """As given; else asked of the photos where they decide on effects and nothing else says what blurs them."""
        if self.psf is not None:
            return self.psf
        known = FREE_KERNELS in effects or (glass is not None and glass.angle is not None)
        return "auto" if "auto" in effects and not known else "none"

    def split(self) -> RunSettings:
        """Each stage's own settings.

        Raises:
            DgsError: what was asked makes no sense.
        """
        words = [word.strip() for word in self.effects.split(",")]
        motion_apart = "-motion" not in words and bool({"auto", "all", "motion"} & set(words))
        glass = self._glass(words)
        psf = self._psf(words, glass)
        background = parse_background(self.background, "srgb" if psf == "none" else self.blur_space)
        return RunSettings(
            out=self.out,
            photos=PhotoSettings(
                self.photos, self.masks, self.frames, self.holdout_every, self.max_size, background, self.memory
            ),
            medium=MediumSettings(psf, self.blur_space, motion_apart, "auto" in words),
            cameras=CameraSettings(self.cameras, self.adjust_cameras, self.refine_cameras, self.reference_cameras),
            effects=self.effects,
            glass=glass,
            shutter=None if self.rolling_shutter is None else parse_shutter(self.rolling_shutter),
            training=TrainingRequest(
                self.preset, self.loss, self.until, self.min_steps, self.max_gaussians, self.sh_degree, self.seed
            ),
            truth=self.truth,
            device=self.device,
            threads=self.threads,
            resume=self.resume,
            keep_cameras=self.keep_cameras,
            snapshots=self.snapshots,
            time_limit=self.time_limit,
            asked=self.plain(),
        )
