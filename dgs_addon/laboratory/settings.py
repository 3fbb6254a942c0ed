"""What a synthetic data set is made with; written into its manifest, and readable back."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from ...core.errors import DgsError, FormatError
from .contrast import curve_of
from .media.registry import medium_of
from .scenes import SCENES as BUILT_SCENES

SCENES = ("rugby-ball", *BUILT_SCENES)
#: Counts changes of scenes, paths and render settings: frames of another version are not reused.
SCENE_VERSION = 3
PATH_NAMES = ("rail", "orbit", "dome", "spiral", "front", "patch", "inside", "drone", "scene")
#: What is behind the object: the scene's own surroundings, or nothing; then photos have alpha, or white is there.
BACKGROUNDS = ("scene", "transparent", "white")
#: Settings that came later; where they are as before, manifests and fingerprints are too.
_LATER = (
    "mesh",
    "exposure_drift",
    "normals",
    "aperture",
    "focus",
    "camera_motion",
    "object_motion",
    "fog",
    "fog_anisotropy",
    "full_well",
    "read_noise",
    "jpeg",
    "background",
    "media",
    "sharp_share",
    "holdout_every",
    "medium_samples",
    "contrast",
)
#: px that Blender renders and JPEG files hold at most.
LONGEST_SIDE = 65_500
#: Millimetres, metres, electrons or f-numbers: more fits no scene, and what is computed from it no number.
ENOUGH = 1e9
#: Cycles' paths per pixel of a photo through media, unless others are asked for: each px then averages over a lens, an
#: exposure or a scattering angle. With 16, detail above 0.3 cycles / px is more noise than scene, denoised or not (a
#: path of 10 px over the ball's table against 600 paths: 33.4 dB with 16, 37.0 with 64, 39.1 with 128; denoised).
FEWEST_THROUGH_MEDIA = 128
#: Object index that masks are made from, and that a .blend marks its objects with.
OBJECT_INDEX = 1
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
        aperture: f-number of a lens before a sensor 36 mm wide (of 43 mm on our own paths); 0 is a pinhole.
        focus: depth that is sharp, in the scene's units; 0 is the object's middle.
        camera_motion: millimetres that the camera travels along its path during each exposure.
        object_motion: [3] millimetres that the object moves during each exposure, in Blender's world.
        fog: scattering coefficient of even fog between cameras and object, per unit of length; none is absorbed.
        fog_anisotropy: Henyey and Greenstein's g, -1 (back) to 1 (on).
        full_well: electrons that white is; photons are then counted (Poisson). 0 counts none.
        read_noise: electrons rms that reading the sensor adds.
        jpeg: quality that the photos have been compressed with, 1 to 100; 0 for not at all.
        background: one of `BACKGROUNDS`; 'transparent' writes photos with alpha, and the table is left out of both.
        media: what Cycles renders between object and photo, each 'NAME:VALUES' (`media.registry`), one of each name.
        sharp_share: share of the photos that are taken without shake and defocus, besides the held-out ones.
        holdout_every: views 0, n, 2n ... are to be held out: they have neither shake nor defocus; 0 for none.
        medium_samples: Cycles' paths per pixel of photos through what it renders; 0 for as many as of sharp pictures,
            but at least `FEWEST_THROUGH_MEDIA`.
        contrast: the camera's own curve on sRGB values, of photos and sharp pictures (`degrade.curved`); '' for none.
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
    aperture: float = 0.0
    focus: float = 0.0
    camera_motion: float = 0.0
    object_motion: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fog: float = 0.0
    fog_anisotropy: float = 0.0
    full_well: float = 0.0
    read_noise: float = 0.0
    jpeg: int = 0
    background: Literal["scene", "transparent", "white"] = "scene"
    media: tuple[str, ...] = ()
    sharp_share: float = 0.0
    holdout_every: int = 8
    medium_samples: int = 0
    contrast: str = ""

    def __post_init__(self) -> None:
        self._check_media()
        for name, value, allowed in (
            ("scene", "rugby-ball" if self.from_blend else self.scene, (*SCENES, "FILE.blend")),
            ("path", self.path, PATH_NAMES),
            ("blur space", self.blur_space, ("srgb", "linear")),
            ("number of bits", self.bits, (8, 16)),
            ("background", self.background, BACKGROUNDS),
        ):
            if value not in allowed:
                raise DgsError(f"There is no {name} '{value}'", f"Choose one of {', '.join(map(str, allowed))}")
        for name, amount, least, most in (
            ("views", self.views, 1, 100_000),
            ("width", self.width, 4, LONGEST_SIDE),
            ("height", self.height, 4, LONGEST_SIDE),
            ("samples", self.samples, 1, 2**24),
            ("overscan", self.overscan, 0, LONGEST_SIDE),
            ("noise", self.noise, 0, 100),
            ("seed", self.seed, 0, 2**31 - 1),
            ("exposure drift", self.exposure_drift, 0, 20),
            ("aperture", self.aperture, 0, ENOUGH),
            ("focus", self.focus, 0, ENOUGH),
            ("camera motion", self.camera_motion, 0, ENOUGH),
            ("fog", self.fog, 0, ENOUGH),
            ("fog anisotropy", self.fog_anisotropy, -0.99, 0.99),
            ("full well", self.full_well, 0, ENOUGH),
            ("read noise", self.read_noise, 0, ENOUGH),
            ("JPEG quality", self.jpeg, 0, 100),
            ("share of sharp photos", self.sharp_share, 0, 1),
            ("samples through media", self.medium_samples, 0, 2**24),
            ("distance between held-out views", self.holdout_every, 0, 100_000),
            *(("object motion", abs(one), 0, ENOUGH) for one in self.object_motion),
        ):
            if not least <= amount <= most:
                limit = f"most {most}" if amount > most else f"least {least}"
                given = f"{str(amount)[:20]}..." if len(str(amount)) > 20 else amount
                raise DgsError(f"The laboratory's {name} must be at {limit}, not {given}", "Give another value")
        if self.read_noise > 0 and self.full_well == 0:
            raise DgsError("Read noise is counted in electrons", "Say with --full-well how many electrons white is")
        if self.jpeg and self.bits != 8:
            raise DgsError("A JPEG has 8 bits", "Leave out --bits 16 or --jpeg")
        if self.jpeg and self.background == "transparent":
            raise DgsError("A JPEG has no alpha", "Leave out --jpeg, or use --background white")
        if self.path == "scene" and not self.from_blend:
            raise DgsError("Only a .blend has an animated camera", "Give --scene FILE.blend, or another path")
        if self.mesh and self.from_blend:
            raise DgsError("A set is of a mesh or of a .blend, not of both", "Give --mesh or --scene")

    def _check_media(self) -> None:
        if self.contrast:
            curve_of(self.contrast)
        names = [text.partition(":")[0] for text in self.media]
        media = [medium_of(text) for text in self.media]
        twice = next((name for name in names if names.count(name) > 1), "")
        if twice:
            raise DgsError(f"The medium {twice} is asked for twice", "Give each medium once")
        if media and (self.aperture > 0 or self.fog > 0 or self.moves):
            raise DgsError("Media are given in two ways", "Give --medium, or --aperture, --camera-motion and --fog")
        if self.overscan and any(medium.by_rows for medium in media):
            raise DgsError("A rolling shutter reads the rows of the photo only", "Leave out --overscan, or give 0")
        if self.sharp_share and all(medium.every_photo for medium in media):
            raise DgsError(
                "Photos differ in shake and defocus only", "Leave out --sharp-share, or add --medium shake:8"
            )

    @property
    def from_blend(self) -> bool:
        """Whether the scene is somebody's own .blend."""
        return self.scene.lower().endswith(".blend")

    @property
    def has_ball(self) -> bool:
        """Whether the object is the ball, whose painted lines have known widths."""
        return not self.mesh and self.scene == "rugby-ball"

    @property
    def alone(self) -> bool:
        """Whether nothing is around the object."""
        return self.background != "scene"

    @property
    def moves(self) -> bool:
        """Whether something moves during the exposure."""
        return self.camera_motion > 0 or any(self.object_motion)

    @property
    def samples_through_media(self) -> int:
        """Cycles' paths per pixel of photos that it renders through a medium."""
        usual = max(self.samples, FEWEST_THROUGH_MEDIA) if self.media else self.samples
        return self.medium_samples or usual

    @property
    def rendered_medium(self) -> bool:
        """Whether Cycles renders the photos otherwise than the sharp pictures."""
        return self.aperture > 0 or self.fog > 0 or self.moves or bool(self.media)

    def to_json(self) -> dict[str, Any]:
        """For the manifest; `from_json` reads it back."""
        usual = {item.name: item.default for item in fields(self)}
        return {k: v for k, v in asdict(self).items() if k not in _LATER or v != usual[k]}

    def fingerprint(self) -> str:
        """Identifies the settings; frames of another fingerprint are not reused."""
        return _digest(self.to_json())

    def render_fingerprint(self) -> str:
        """As `fingerprint`, for what happens before the medium."""
        after = {
            "psf",
            "background",
            "blur_space",
            "bits",
            "noise",
            "exposure_drift",
            "full_well",
            "read_noise",
            "jpeg",
            "media",
            "sharp_share",
            "holdout_every",
            "medium_samples",
            "contrast",
            *EXTRAS,
        }
        kept = {key: value for key, value in self.to_json().items() if key not in after}
        return _digest({**kept, "alone": True} if self.alone else kept)

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
        lists: dict[str, Any] = {name: tuple(values[name]) for name in ("object_motion", "media") if name in values}
        return SynthesizeSettings(**{**values, **lists})


def _digest(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps([SCENE_VERSION, values], sort_keys=True).encode()).hexdigest()[:16]
