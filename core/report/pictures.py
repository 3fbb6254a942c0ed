"""Pictures of a report: what is compared for each view, and how they get into one HTML file."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image

#: Longest side of an embedded picture in px.
LONGEST_SIDE = 1200
#: All pictures together stay below this many bytes (before base64 adds a third).
BUDGET = 6_500_000

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class ViewPictures:
    """The pictures of one view, all [H, W, 3] uint8, sRGB-encoded and of one size.

    Attributes:
        name: the photo's file name.
        heldout: False for a view that was trained on (shown where nothing was held out).
        photo: as taken.
        twin: the sharp render.
        degraded: the render through the medium.
        truth: the sharp truth, if given.
        scores: 'degraded' and 'sharp' with 'psnr' and 'ssim'.
    """

    name: str
    heldout: bool
    photo: Pixels = field(repr=False)
    twin: Pixels = field(repr=False)
    degraded: Pixels = field(repr=False)
    truth: Pixels | None = field(default=None, repr=False)
    scores: dict[str, dict[str, float | None] | None] = field(default_factory=dict)

    def named(self) -> list[tuple[str, str, Pixels]]:
        """(key, title, pixels) of the pictures that are there, in the order of the light's way."""
        pictures = [
            ("photo", "Photo", self.photo),
            ("twin", "Twin", self.twin),
            ("degraded", "Twin through the medium", self.degraded),
        ]
        return pictures if self.truth is None else [*pictures, ("truth", "Sharp truth", self.truth)]


def jpeg(pixels: Pixels, longest_side: int, quality: int) -> bytes:
    """A JPEG without chroma subsampling (which would soften coloured lines)."""
    image = Image.fromarray(pixels)
    if max(image.size) > longest_side:
        image.thumbnail((longest_side, longest_side), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=quality, subsampling=0)
    return stream.getvalue()


def embedded(views: list[ViewPictures], budget: int = BUDGET) -> list[dict[str, str]]:
    """Data URIs by key for each view; quality, then size, give way until all fit into `budget`."""
    encoded: list[dict[str, bytes]] = []
    for longest_side, quality in ((LONGEST_SIDE, 92), (LONGEST_SIDE, 85), (800, 85), (600, 80), (400, 70)):
        encoded = [{key: jpeg(p, longest_side, quality) for key, _, p in view.named()} for view in views]
        if sum(len(data) for view in encoded for data in view.values()) <= budget:
            break
    return [
        {key: "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii") for key, data in view.items()}
        for view in encoded
    ]


def spread(count: int, most: int) -> list[int]:
    """Up to `most` indices, evenly spread over range(count)."""
    if count <= most:
        return list(range(count))
    return sorted({round(i * (count - 1) / (most - 1)) for i in range(most)})
