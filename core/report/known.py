"""The report's chapter on what photos determine and what is guessed: views that nobody took, and how wrong they may be.

`next-view` writes it into the report of `reconstruct`, in place of what it wrote there before.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files import write_text
from ..numbers import number
from .pictures import jpeg

#: What encloses the chapter in the page, and before what it goes.
START, END, BEFORE = "<!-- known -->", "<!-- /known -->", "<h2>Cameras</h2>"
#: Expected errors over the photos' own contrast at the ends and in the middle of the scale: at 1 the photos' mean
#: colour would be as right. Its colours are those of the viewport: blue known, red guessed (distinguished by
#: colour-blind eyes too).
SCALE = (0.0, 0.5, 1.0)
COLOURS = np.array([[34, 112, 181], [242, 230, 153], [214, 48, 38]], float)
#: Guessed px are hatched: lines so many px apart, over so much of the picture's brightness.
HATCH, VEIL = 6, 0.55
#: Pictures in the page: px of the longer side at most, and JPEG quality.
LONGEST_SIDE, QUALITY = 640, 85


@dataclass(frozen=True)
class GuessedSettings:
    """When a px counts as guessed."""

    error: float = number(
        0.7, "share of the photos' contrast", "expected error from which half of the px's variance is not determined"
    )
    observed: float = number(
        0.2, "share", "below it photos say too little, as of splats that no photo saw from within 45 degrees"
    )


GUESSED = GuessedSettings()


@dataclass(frozen=True)
class PredictedView:
    """A view that nobody took.

    Attributes:
        name: of the candidate; order: in which it is suggested.
        image: [H, W, 3] uint8, the twin's sharp view, sRGB.
        error: [H, W] expected rms error of its px over the rms contrast of the photos.
        observed: [H, W] how far photos determine what is seen there, 0 to 1.
    """

    name: str
    order: int
    image: NDArray[np.uint8]
    error: NDArray[np.floating]
    observed: NDArray[np.floating]

    @property
    def guessed(self) -> NDArray[np.bool_]:
        """[H, W] px that the photos do not determine."""
        return np.asarray((self.error > GUESSED.error) | (self.observed < GUESSED.observed))


def painted(error: NDArray[np.floating]) -> NDArray[np.uint8]:
    """[H, W, 3] the expected error (over the contrast) in colours."""
    return np.stack([np.interp(error, SCALE, COLOURS[:, c]) for c in range(3)], axis=2).round().astype(np.uint8)


def hatched(view: PredictedView) -> NDArray[np.uint8]:
    """[H, W, 3] the view, with lines over what is guessed."""
    image = view.image
    rows, columns = np.indices(image.shape[:2])
    line = (rows + columns) % HATCH < HATCH / 3
    grey = image.mean(axis=2, keepdims=True)
    veiled = VEIL * grey + (1.0 - VEIL) * np.where(line[..., None], COLOURS[2], 235.0)
    return np.where(view.guessed[..., None], veiled, image).round().astype(np.uint8)


def chapter(views: Sequence[PredictedView], measured: str) -> str:
    """The chapter's HTML; `measured` says in a sentence where the expected errors come from."""
    parts = [
        START,
        "<h2>Known and guessed</h2>",
        '<p class="soft">Views that nobody took, in the order in which <code>next-view</code> suggests them. Hatched '
        "is what the photos do not show: none saw it from within 45 degrees, or their mean colour would be as right. "
        f"{html.escape(measured)}</p>",
    ]
    for view in views:
        figures = (
            ("The twin's view", view.image),
            ("Guessed parts hatched", hatched(view)),
            ("Expected error: blue none, red as large as the contrast", painted(view.error)),
        )
        parts.append(
            f'<h3>{view.order}. {html.escape(view.name)} <span class="scores">{100 * view.guessed.mean():.0f} % guessed'
            "</span></h3>"
            '<div class="row" style="--count: 3">'
        )
        for title, pixels in figures:
            data = base64.b64encode(jpeg(pixels, LONGEST_SIDE, QUALITY)).decode("ascii")
            height, width = pixels.shape[:2]
            parts.append(
                f'<figure><img alt="{title}" width="{width}" height="{height}" '
                f'src="data:image/jpeg;base64,{data}"><figcaption>{title}</figcaption></figure>'
            )
        parts.append("</div>")
    return "\n".join([*parts, END])


def add_chapter(report: Path, views: Sequence[PredictedView], measured: str) -> bool:
    """Puts the chapter into a report, in place of an earlier one; False if there is no report that could take it.

    Raises:
        OutputError: it cannot be written.
    """
    page = _without(report)
    if page is None or page.count(BEFORE) != 1:
        return False
    write_text(report, page.replace(BEFORE, chapter(views, measured) + "\n" + BEFORE))
    return True


def drop_chapter(report: Path) -> None:
    """Takes the chapter out: the twin is another one now.

    Raises:
        OutputError: it cannot be written.
    """
    page = _without(report)
    if page is not None and page != report.read_text("utf-8", errors="replace"):
        write_text(report, page)


def _without(report: Path) -> str | None:
    """The page without the chapter; None if there is none."""
    if not report.is_file():
        return None
    page = report.read_text("utf-8", errors="replace")
    if START in page and END in page:
        page = page[: page.index(START)] + page[page.index(END) + len(END) :].lstrip("\n")
    return page
