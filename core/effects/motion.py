"""Motion of the camera while the shutter was open: a straight path of every photo's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..imaging.formation.effect import Effect, Shot, index_of
from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import NOT_CHECKED, number
from .spec import EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..imaging.psf import PointSpread
    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class MotionSettings:
    """Numbers of the simulated motion."""

    shortest: float = number(
        1.0,
        "px",
        "shorter paths blur less than the pixels themselves: such a photo keeps the medium's point spread",
        "judgement: the width of a pixel",
        NOT_CHECKED,
    )


SETTINGS = MotionSettings()


class Motion(Effect):
    """The point spread of each photo, convolved with a uniform straight line.

    `paths` [V, 2]: length (px of the photos as loaded) and direction (degrees from x towards y) of V photos. Photos
    that are not named, or whose path is shorter than `SETTINGS.shortest`, keep the medium's own point spread.
    """

    name = "motion"
    physics = "A camera that moves while its shutter is open smears each photo along the path that it took."
    place = "kernel"

    def __init__(self, names: Sequence[str], paths: Tensor) -> None:
        super().__init__({"paths": paths})
        self.names = tuple(names)

    def point_spread(self, psf: PointSpread | None, name: str) -> PointSpread | None:
        """See `Effect`."""
        from ..imaging.composed import moved  # late: the command line's help reads this file

        length, angle = self._path(name)
        return psf if length < SETTINGS.shortest else moved(psf, length, angle)

    def kernel_text(self, name: str, scale: float) -> str:
        """See `Effect`."""
        length, angle = self._path(name)
        return "" if length < SETTINGS.shortest else f"path:{scale * length:.6g},{angle:.6g}"

    def _path(self, name: str) -> tuple[float, float]:
        index = index_of(self.names, name)
        length, angle = (0.0, 0.0) if index is None else (float(value) for value in self.parameters["paths"][index])
        return length, angle

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """The very same light: the path is in the point spread."""
        return light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """The very same gradient; paths are estimated before the training and stay."""
        return upstream

    @property
    def finest(self) -> float:
        """Median length (px) of the paths that blur: what a photo must be large enough to show."""
        lengths = self.parameters["paths"][:, 0]
        longer = lengths[lengths >= SETTINGS.shortest]
        return float(longer.median()) if len(longer) else 0.0

    def described(self) -> dict[str, object]:
        """Length (px) and direction (degrees) by photo."""
        paths = self.parameters["paths"].detach().cpu()
        return {name: [round(float(v), 2) for v in row] for name, row in zip(self.names, paths, strict=True)}


def motion_from(names: Sequence[str], lengths: Sequence[float], angles: Sequence[float]) -> Motion:
    """The effect from lengths (px) and directions (degrees)."""
    import torch  # heavy

    return Motion(names, torch.tensor([list(pair) for pair in zip(lengths, angles, strict=True)], dtype=torch.float32))


def inspect(photos: PhotoSet) -> Evidence:
    """The camera's own movement during the exposures."""
    from ..inspection.motion_paths import SETTINGS as PATHS  # heavy: scipy

    moved = photos.motion
    if moved is None:
        return unknown("motion", "px", PATHS.smallest_visible, "Not measured: four photos with detail are needed")
    lengths = moved.lengths
    worst = max(lengths, key=lambda name: lengths[name])
    text = f"Paths of {moved.length:.1f} px (rms) of the photos' own, the longest {lengths[worst]:.1f} px in {worst}"
    if lengths[worst] == 0.0:
        text = "No photo has a path of its own that stands clear of its noise"
    evidence = judged("motion", moved.length, moved.error, PATHS.smallest_visible, "px", text)
    evidence.plots.update(lengths=lengths, paths=moved.paths)
    return evidence


def build(photos: PhotoSet) -> Motion | None:
    """Every photo's own path, held-out ones too; None where none stands clear of its noise."""
    paths = photos.motion_paths
    if not any(path.length for path in paths.values()):
        return None
    return motion_from(list(paths), [p.length for p in paths.values()], [p.angle for p in paths.values()])


SPEC = EffectSpec(
    name="motion",
    physics=Motion.physics,
    words=EffectWords(
        label="Camera Motion",
        tooltip="A camera that moved along a straight path of its own during each exposure",
        simulated="Motion of the camera during each exposure: a straight path in that photo's point spread.",
        missing="Blur that changes from photo to photo",
        covered_by_own_blurs=True,
    ),
    inspect=inspect,
    switch=Switch(speakers=("motion",), trial_rank=7, simulation=Motion, build=build, may_be_absent=True),
)
