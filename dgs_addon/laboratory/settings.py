"""What a synthetic data set is made with; written into its manifest, and readable back."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from ...core.errors import DgsError, FormatError

SCENES = ("rugby-ball",)
#: Counts changes of scenes, paths and render settings: frames of another version are not reused.
SCENE_VERSION = 3
PATH_NAMES = ("rail", "orbit", "dome", "spiral", "scene")
#: Settings that came later; where they are as before, manifests and fingerprints are too.
_LATER = ("mesh", "exposure_drift", "normals")
#: What is written beside the photos and changes none of them: it can be added to a set that is there.
EXTRAS = ("masks", "depth", "normals", "keep_linear")


@dataclass(frozen=True)
class SynthesizeSettings:
    """Everything that decides the pixels of a data set.

    Attributes:
        scene: one of `SCENES`, or a .blend file with objects, lights and materials of its own.
        path: one of `PATH_NAMES`; 'scene' is the animated camera of a .blend.
        views: number of photos.
        width, height: px.
        psf: 'none', 'gaussian:SIGMA' or 'gaussian:SX,SY,ANGLE' (px, degrees from x towards y).
        blur_space: 'srgb' blurs encoded values (most likely what the paper did), 'linear' light.
        bits: 8 or 16 per channel of the photos; the sharp pictures have the same.
        noise: standard deviation of Gaussian noise on encoded values, full scale being 1.
        overscan: px rendered beyond each side before the blur, so that borders are physical.
        samples: Cycles' paths per pixel.
        denoise: clean the render with OpenImageDenoise.
        seed: of the ball's pebbles, the table, the path tracer and the noise.
        masks: also write where the ball is seen.
        depth: also write depth along the camera's axis.
        keep_linear: keep the rendered float pictures, so that another medium needs no rendering.
        mesh: file of an object that takes the ball's place (scaled to its length); '' for the ball.
        exposure_drift: stops that the photos' exposure drifts up or down at most, from view to view.
        normals: also write normals of the surfaces.
    """

    scene: str = "rugby-ball"
    path: str = "rail"
    views: int = 76
    width: int = 800
    height: int = 533
    psf: str = "gaussian:5"
    blur_space: Literal["srgb", "linear"] = "srgb"
    bits: int = 8
    noise: float = 0.0
    overscan: int = 24
    samples: int = 8
    denoise: bool = True
    seed: int = 0
    masks: bool = False
    depth: bool = False
    keep_linear: bool = False
    mesh: str = ""
    exposure_drift: float = 0.0
    normals: bool = False

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("scene", "rugby-ball" if self.from_blend else self.scene, (*SCENES, "FILE.blend")),
            ("path", self.path, PATH_NAMES),
            ("blur space", self.blur_space, ("srgb", "linear")),
            ("number of bits", self.bits, (8, 16)),
        ):
            if value not in allowed:
                raise DgsError(f"There is no {name} '{value}'", f"Choose one of {', '.join(map(str, allowed))}")
        for name, amount, least in (
            ("views", self.views, 1), ("width", self.width, 4), ("height", self.height, 4),
            ("samples", self.samples, 1), ("overscan", self.overscan, 0), ("noise", self.noise, 0),
            ("seed", self.seed, 0), ("exposure drift", self.exposure_drift, 0),
        ):  # fmt: skip
            if not amount >= least:
                raise DgsError(f"The laboratory's {name} must be at least {least}, not {amount}", "Give another value")

        if self.path == "scene" and not self.from_blend:
            raise DgsError("Only a .blend has an animated camera", "Give --scene FILE.blend, or another path")
        if self.mesh and self.from_blend:
            raise DgsError("A set is of a mesh or of a .blend, not of both", "Give --mesh or --scene")

    @property
    def from_blend(self) -> bool:
        """Whether the scene is somebody's own .blend."""
        return self.scene.lower().endswith(".blend")

    @property
    def has_ball(self) -> bool:
        """Whether the object is the ball, whose lines are known."""
        return not self.mesh and not self.from_blend

    def to_json(self) -> dict[str, Any]:
        """For the manifest; `from_json` reads it back."""
        usual = {item.name: item.default for item in fields(self)}
        return {k: v for k, v in asdict(self).items() if k not in _LATER or v != usual[k]}

    def fingerprint(self) -> str:
        """Identifies the settings; frames of another fingerprint are not reused."""
        return _digest(self.to_json())

    def render_fingerprint(self) -> str:
        """As `fingerprint`, for what happens before the medium."""
        after = {"psf", "blur_space", "bits", "noise", "exposure_drift", *EXTRAS}
        return _digest({key: value for key, value in self.to_json().items() if key not in after})

    def photos_fingerprint(self) -> str:
        """As `fingerprint`, whatever is written beside the photos."""
        return replace(self, masks=False, depth=False, normals=False, keep_linear=False).fingerprint()

    @staticmethod
    def from_json(values: dict[str, Any]) -> SynthesizeSettings:
        """The settings of a manifest.

        Raises:
            FormatError: a key is unknown.
        """
        unknown = set(values) - {item.name for item in fields(SynthesizeSettings)}
        if unknown:
            raise FormatError(f"Unknown settings in the manifest: {', '.join(sorted(unknown))}", "Remove them")
        return SynthesizeSettings(**values)


def _digest(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps([SCENE_VERSION, values], sort_keys=True).encode()).hexdigest()[:16]
