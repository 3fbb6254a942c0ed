"""What is asked of the picture server and what it answers: one JSON object a line, numbers in bulk in shared memory.

    {"areas": [TWINS, PICTURES]}      first of all: the addresses of the areas
    {"twin": {...}}                   a twin's Gaussians lie in the area of twins  -> {"event": "twin", "key": ...}
    {"forget": KEY}                   it is needed no more                         -> {"event": "forgotten", ...}
    {"view": {...}}                   a picture, please                            -> {"event": "picture", ...}
    {"seen": {...}}                   px of each Gaussian in such a view           -> {"event": "seen", "count": ...}

Every line is answered by one line; {"event": "error", "text": ...} where it cannot be done. Needs numpy only.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..constants import SH_COEFFICIENTS
from ..json_shape import check_shape, count, number, positive, text, truth

Floats = NDArray[np.float32]

#: Sides of a picture, in px, and splats of a twin: more is a mistake or an attack.
_LARGEST_SIDE, _LARGEST_TWIN = 65536, 2**28
#: Planes in front of the harmonics: positions, scales, rotations, zeroth harmonics with opacities.
_WIDTHS = (3, 3, 4, 4)

_MATRIX = [number]
_TWIN = {"key": text, "count": positive, "harmonics": positive}
_PLACED = {"key": text, "matrix": _MATRIX, "size": number, "faintest": number, "most?": (count,), "box?": (_MATRIX,)}
_CAMERA = {"width": positive, "height": positive, **dict.fromkeys(("fx", "fy", "cx", "cy"), number)}
_VIEW = {
    "twins": [_PLACED],
    "camera": {**_CAMERA, "rotation": [number], "translation": [number]},
    "depth": truth,
    "light": truth,
    "power": number,
    "solid": number,
    "background?": ([number],),
    "blur?": ({"psf": text, "space": text, "step": number},),
}


@dataclass(frozen=True)
class SharedTwin:
    """A twin whose Gaussians lie in shared memory, as Blender's attributes hold them.

    Attributes:
        key: names this state of the twin.
        count, harmonics: N and K.
    """

    key: str
    count: int
    harmonics: int

    @property
    def bytes(self) -> int:
        """How many bytes the Gaussians take."""
        return 4 * self.count * (sum(_WIDTHS) + 3 * (self.harmonics - 1))

    def planes(self, memory: memoryview) -> list[Floats]:
        """Positions [N, 3], scales [N, 3] (standard deviations), rotations [N, 4] (w x y z), zeroth harmonics with
        opacities (0..1) [N, 4], and K - 1 further harmonics [N, 3]: views of the memory."""
        values = np.frombuffer(memory, np.float32, self.bytes // 4)
        planes, at = [], 0
        for width in (*_WIDTHS, *([3] * (self.harmonics - 1))):
            planes.append(values[at : at + self.count * width].reshape(self.count, width))
            at += self.count * width
        return planes

    @staticmethod
    def parse(value: Any) -> SharedTwin:
        """Of a message; raises ValueError."""
        check_shape(value, _TWIN)
        if value["harmonics"] not in SH_COEFFICIENTS or value["count"] > _LARGEST_TWIN:
            raise ValueError("no twin has so many Gaussians or harmonics")
        return SharedTwin(value["key"], value["count"], value["harmonics"])


@dataclass(frozen=True)
class PlacedTwin:
    """A twin as it stands in the scene.

    Attributes:
        key: of a `SharedTwin` that was handed over.
        matrix: 16 numbers, rows of the twin's own axes to the scene's (both the engine's).
        size: factor on the size of all splats.
        faintest: opacity below which splats are not shown.
        most: splats that are shown at most, spread evenly over the twin; None for all.
        box: 16 numbers, rows of the twin's own axes to those of a box from -1 to 1: splats outside are not shown.
    """

    key: str
    matrix: tuple[float, ...]
    size: float = 1.0
    faintest: float = 0.0
    most: int | None = None
    box: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Blur:
    """What a medium does to a picture.

    Attributes:
        psf: point spread as `imaging.psf_text` reads it, in px of the photos.
        space: what it mixes, 'srgb' values or 'linear' light.
        step: px of the photos that a px of the picture is wide.
    """

    psf: str
    space: Literal["srgb", "linear"] = "srgb"
    step: float = 1.0


@dataclass(frozen=True)
class View:
    """A picture that is asked for.

    Attributes:
        twins: what is seen; camera: by whom.
        depth: whether depths are wanted too.
        light: linear light instead of sRGB values.
        background: [3] sRGB behind the twins; None for none, where the picture has alpha.
        solid: alpha of the twins from which on a px has a depth.
        power: of the curve that decodes sRGB values for `light`; 0 for sRGB's own.
        blur: of the medium that the twins are seen through; depths stay those of the sharp picture.
    """

    twins: tuple[PlacedTwin, ...]
    camera: Camera
    depth: bool = False
    light: bool = False
    background: tuple[float, float, float] | None = None
    solid: float = 0.0
    power: float = 0.0
    blur: Blur | None = None

    def resized(self, width: int, height: int) -> View:
        """The same view as a picture of `width` x `height` px."""
        blur = self.blur
        if blur is not None:
            blur = replace(blur, step=blur.step * self.camera.width / width)
        return replace(self, camera=self.camera.resized(width, height), blur=blur)

    def message(self) -> dict[str, Any]:
        """As JSON has it."""
        camera = {name: getattr(self.camera, name) for name in _CAMERA}
        camera["rotation"] = [float(value) for value in self.camera.rotation.reshape(9)]
        camera["translation"] = [float(value) for value in self.camera.translation]
        return {
            "twins": [asdict(twin) for twin in self.twins],
            "camera": camera,
            "depth": self.depth,
            "light": self.light,
            "background": self.background,
            "solid": self.solid,
            "power": self.power,
            "blur": None if self.blur is None else asdict(self.blur),
        }

    @staticmethod
    def parse(value: Any) -> View:
        """Of a message; raises ValueError."""
        check_shape(value, _VIEW)
        given, background = value["camera"], value.get("background")
        if max(given["width"], given["height"]) > _LARGEST_SIDE or len(background or [0] * 3) != 3:
            raise ValueError("no picture is so large, or has such a background")
        rotation, translation = np.array(given["rotation"], float), np.array(given["translation"], float)
        lens = {name: given[name] for name in _CAMERA}
        camera = Camera("", **lens, rotation=rotation.reshape(3, 3), translation=translation.reshape(3))
        twins = tuple(_placed(twin) for twin in value["twins"])
        behind = None if background is None else tuple(background)
        plain = value["depth"], value["light"], behind, value["solid"], value["power"]
        return View(twins, camera, *plain, None if value.get("blur") is None else _blur(value["blur"]))


@dataclass(frozen=True)
class Drawn:
    """A picture in shared memory.

    Attributes:
        width, height: px.
        depth: whether depths follow the pixels.
        seconds: that it took.
        missing: keys of twins that were asked for and are not there.
    """

    width: int
    height: int
    depth: bool
    seconds: float
    missing: tuple[str, ...] = field(default=())

    @property
    def bytes(self) -> int:
        """How many bytes it takes."""
        return 4 * self.width * self.height * (5 if self.depth else 4)

    def planes(self, memory: memoryview) -> tuple[Floats, Floats | None]:
        """Pixels [H, W, 4], colours multiplied by alpha, and depths [H, W] (scene's units) or None, rows upwards:
        views of the memory."""
        values = np.frombuffer(memory, np.float32, self.bytes // 4)
        colours = 4 * self.width * self.height
        depth = values[colours:].reshape(self.height, self.width) if self.depth else None
        return values[:colours].reshape(self.height, self.width, 4), depth

    @staticmethod
    def parse(value: Any) -> Drawn:
        """Of a message; raises ValueError."""
        check_shape(
            value, {"width": positive, "height": positive, "depth": truth, "seconds": number, "missing": [text]}
        )
        missing = tuple(value["missing"])
        return Drawn(value["width"], value["height"], value["depth"], value["seconds"], missing)


def _blur(value: Any) -> Blur:
    if value["space"] not in ("srgb", "linear") or not 0.0 < value["step"] < np.inf:
        raise ValueError("no medium blurs so")
    return Blur(value["psf"], value["space"], value["step"])


def _placed(value: Any) -> PlacedTwin:
    box = value.get("box")
    if len(value["matrix"]) != 16 or len(box or [0] * 16) != 16:
        raise ValueError("a matrix has 16 numbers")
    return PlacedTwin(
        value["key"],
        tuple(value["matrix"]),
        value["size"],
        value["faintest"],
        value.get("most"),
        None if box is None else tuple(box),
    )
