"""What is behind an object that photos show without surroundings: one colour, and how photos are put over it.

A file's alpha says where it is empty. Whoever needs a picture needs a colour there, and wherever photos are compared
with a twin it has to be the same one behind both. All of that is here:

    over(c) = alpha colour + (1 - alpha) c                   (straight alpha, as PNG files have it)
    over(d) = over(c) + (1 - alpha) (d - c)                  (so that another colour needs no division)

Both are linear in what lies over the colour, and so are averages, interpolation and blur: a photo over a colour may be
shrunk, undistorted and averaged as it is, if its alpha is treated alike, and no rim of what a file hides under
alpha 0 appears. A blur keeps this only in the space it is linear in: where light is blurred, the px between object and
nothing are mixtures of light, so that the photo is put over its background in linear light. A sharp photo is put over
it in sRGB values, as viewers of PNG files do it and as the splats of a twin are blended.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .colour import linear_to_srgb, srgb_to_linear
from .errors import PhotoError

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
Planes = NDArray[np.float32]
Colour = tuple[float, float, float]

#: Transparent photos are shown and scored over white, as the field does it.
WHITE: Colour = (1.0, 1.0, 1.0)
#: Less alpha than any file can have but none: a step of 16 bits.
_LEAST_ALPHA = 1.0 / 65535.0


@dataclass(frozen=True)
class Background:
    """The colour behind all photos of a set.

    Attributes:
        colour: sRGB in [0, 1].
        space: the values in which photos are put over it: 'linear' where a blur of light made their edges.
        tolerance: by which px of opaque photos may differ from it (sRGB) and show nothing else; None where alpha says
            what is empty, or nothing does.
    """

    colour: Colour = WHITE
    space: Literal["srgb", "linear"] = "srgb"
    tolerance: float | None = None

    @property
    def name(self) -> str:
        """For sentences: 'white', 'black' or '#rrggbb'."""
        written = "#" + "".join(f"{round(255 * value):02x}" for value in self.colour)
        return {"#ffffff": "white", "#000000": "black"}.get(written, written)

    def under(self, straight: Pixels, alpha: Pixels) -> Pixels:
        """A file's colours over the background.

        Args:
            straight: [H, W, 3] sRGB-encoded, not multiplied by alpha; alpha: [H, W] of the same dtype.

        Returns:
            [H, W, 3] of the same dtype, rounded.
        """
        top = np.float32(np.iinfo(straight.dtype).max)
        planes = self.blended(straight.transpose(2, 0, 1).astype(np.float32) / top, 1 - opacity(alpha))
        shown: Pixels = np.round(planes.clip(0.0, 1.0) * top).astype(straight.dtype).transpose(1, 2, 0).copy()
        opaque = alpha == top  # to the bit as filed
        shown[opaque] = straight[opaque]
        return shown

    def blended(self, straight: Planes, empty: Planes) -> Planes:
        """Colours [3, H, W] (sRGB, not multiplied by alpha) over the background; empty: [H, W], 1 - alpha."""
        colour = self._plane
        return self._encoded((1 - empty) * self._decoded(straight) + empty * self._decoded(colour))

    def straight(self, planes: Planes, empty: Planes) -> Planes:
        """What `blended` was given; black where the photo is empty."""
        share = np.maximum(1 - empty, np.float32(_LEAST_ALPHA))
        before = self._decoded(planes) - empty * self._decoded(self._plane)
        return np.where(empty < 1, self._encoded(before / share), np.float32(0)).clip(0.0, 1.0)

    def changed(self, planes: Planes, empty: Planes, colour: Colour | Planes) -> Planes:
        """A photo over the background, put over another colour instead.

        Args:
            planes: [3, H, W] sRGB over `self.colour`; empty: [H, W], 1 - alpha.
            colour: sRGB in [0, 1]: one, or [3, H, W] of each px.

        Returns:
            [3, H, W] float32 sRGB.
        """
        new = colour if isinstance(colour, np.ndarray) else np.asarray(colour, np.float32)[:, None, None]
        return self._encoded(self._decoded(planes) + empty * (self._decoded(new) - self._decoded(self._plane)))

    @property
    def _plane(self) -> Planes:
        return np.asarray(self.colour, np.float32)[:, None, None]

    def _decoded(self, planes: Planes) -> Planes:
        return planes if self.space == "srgb" else np.asarray(srgb_to_linear(planes), np.float32)

    def _encoded(self, values: Planes) -> Planes:
        return values if self.space == "srgb" else np.asarray(linear_to_srgb(values), np.float32)


@dataclass(frozen=True)
class BackgroundRequest:
    """What is asked of the background of a set.

    Attributes:
        colour: behind all photos; None for white behind transparent ones, and behind opaque ones what they show.
        looked_for: whether opaque photos may show a plain background.
        space: as of `Background`.
    """

    colour: Colour | None = None
    looked_for: bool = True
    space: Literal["srgb", "linear"] = "srgb"

    @property
    def transparent(self) -> Background:
        """What stands behind transparent photos."""
        return Background(WHITE if self.colour is None else self.colour, self.space)


def parse_background(text: str, space: Literal["srgb", "linear"] = "srgb") -> BackgroundRequest:
    """'auto', 'none' or a colour, as `--background` takes it.

    Raises:
        PhotoError: none of them.
    """
    if text in ("auto", "none"):
        return BackgroundRequest(None, text == "auto", space)
    return BackgroundRequest(parse_colour(text), False, space)


def parse_colour(text: str) -> Colour:
    """'white', 'black' or '#rrggbb' as sRGB in [0, 1].

    Raises:
        PhotoError: neither.
    """
    written = {"white": "#ffffff", "black": "#000000"}.get(text.strip().lower(), text.strip())
    if re.fullmatch(r"#[0-9a-fA-F]{6}", written) is None:
        raise PhotoError(f"'{text}' is no colour", "Write white, black or such as '#80ff00'")
    red, green, blue = (int(written[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def opacity(alpha: Pixels) -> NDArray[np.float32]:
    """[H, W] alpha in [0, 1]."""
    return alpha.astype(np.float32) / np.float32(np.iinfo(alpha.dtype).max)
