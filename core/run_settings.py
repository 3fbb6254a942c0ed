"""What a reconstruction is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from .devices import BackendName

#: Frames of a movie if nobody says how many: dense enough around an object, and a minute of cameras at most.
DEFAULT_FRAMES = 60


@dataclass(frozen=True)
class ReconstructSettings:
    """One run, as the command line asks for it.

    Attributes:
        photos: folder of photos, a list of them (.txt), or a movie.
        out: folder for all results.
        psf: point spread function, in px of the photos' files (see `core.imaging.psf.parse_psf`).
        blur_space: the values that the blur acts on.
        cameras: COLMAP model folder or transforms.json; None to find them from the photos.
        truth: folder of sharp photos of the same names, only for scoring.
        masks: folder of images of the same names; black does not count.
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
        effects: besides the blur: 'auto', 'none', 'all' or names (see `effects.decision.parse_effects`).
        refine_cameras: move the cameras by the loss before the training (`pipeline.refined`).
        reference_cameras: true cameras, only for reporting errors.
        snapshots: write the twin so far and a picture of it to `out`/snapshot while training.
    """

    photos: Path
    out: Path
    psf: str = "none"
    blur_space: Literal["srgb", "linear"] = "srgb"
    cameras: Path | None = None
    truth: Path | None = None
    masks: Path | None = None
    frames: int = DEFAULT_FRAMES
    holdout_every: int = 8
    max_size: int | None = None
    preset: Literal["draft", "balanced", "fine"] = "balanced"
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
    effects: str = "none"
    snapshots: bool = False
    refine_cameras: bool = False
    reference_cameras: Path | None = None

    def plain(self) -> dict[str, Any]:
        """For report.json: paths as text."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}
