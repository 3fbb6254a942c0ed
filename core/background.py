"""The colour behind the object of a set of photos: what is known of it, and what may be asked of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from .errors import PhotoError

Colour = tuple[float, float, float]

#: Transparent photos are shown and scored over white, as the field does it.
WHITE: Colour = (1.0, 1.0, 1.0)
#: What renders have behind them if nobody says otherwise.
BLACK: Colour = (0.0, 0.0, 0.0)


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
