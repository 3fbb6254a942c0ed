"""A plain background is noticed where there is one, through noise, JPEG and blur, and nowhere else."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.background import Background, BackgroundRequest, parse_background
from dgs.core.camera import Camera
from dgs.core.errors import PhotoError
from dgs.core.photos.empty import background_shows, empty_pixels
from dgs.core.photos.load import Photo
from dgs.core.photos.uniform import before_background, like_the_others, uniform_background
from dgs.core.progress import Silent
from dgs.core.views import View
from PIL import Image
from scipy.ndimage import gaussian_filter

HEIGHT, WIDTH = 120, 160


class Notes(Silent):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def objects(behind: np.ndarray | float, count: int = 6, blur: float = 0.0, noise: float = 0.0) -> list[np.ndarray]:
    """[H, W, 3] in [0, 1]: a textured disc that wanders, before something."""
    random, out = np.random.default_rng(0), []
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for index in range(count):
        disc = (x - 60 - 6 * index) ** 2 + (y - 58) ** 2 < 33**2
        texture = random.uniform(0.1, 0.7, (HEIGHT, WIDTH, 3))
        planes = np.where(disc[:, :, None], texture, behind)
        planes = gaussian_filter(planes, (blur, blur, 0), mode="nearest") if blur else planes
        out.append((planes + noise * random.standard_normal(planes.shape)).clip(0, 1))
    return out


def photos(pictures: list[np.ndarray], jpeg: int | None = None) -> list[Photo]:
    out = []
    for index, picture in enumerate(pictures):
        pixels = np.round(picture * 255).astype(np.uint8)
        if jpeg is not None:
            stream = io.BytesIO()
            Image.fromarray(pixels).save(stream, "JPEG", quality=jpeg)
            pixels = np.asarray(Image.open(stream)).copy()
        out.append(Photo(f"{index}.png", Path(f"{index}.png"), pixels))
    return out


@pytest.mark.parametrize("level", [1.0, 0.0, 0.5, [0.9, 0.95, 0.2]])
@pytest.mark.parametrize(
    ("blur", "noise", "jpeg"), [(0.0, 0.0, None), (3.0, 0.0, None), (0.0, 0.02, None), (0.0, 0.0, 75), (3.0, 0.01, 85)]
)
def test_a_plain_background(level, blur: float, noise: float, jpeg: int | None) -> None:
    made = photos(objects(np.asarray(level), blur=blur, noise=noise), jpeg)
    found = uniform_background(made)
    assert found is not None
    np.testing.assert_allclose(found.colour, np.broadcast_to(level, 3), atol=0.012 + 0.4 * noise)
    for index, photo in enumerate(replace(photo, background=found) for photo in made):
        empty = empty_pixels(photo)
        assert empty is not None
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        far = np.hypot(x - 60 - 6 * index, y - 58) - 33
        assert empty[far > 20].mean() > 0.98  # rings of JPEG reach as far
        assert not empty[far < -3].any()


def grain(planes: np.ndarray) -> np.ndarray:
    texture = gaussian_filter(np.random.default_rng(1).standard_normal((HEIGHT, WIDTH)), 2.0)
    return planes + 0.02 * (texture / texture.std())[:, :, None]


X = np.linspace(0, 1, WIDTH)[None, :, None] * np.ones((HEIGHT, 1, 1))
Y = np.linspace(0, 1, HEIGHT)[:, None, None] * np.ones((1, WIDTH, 1))


@pytest.mark.parametrize(
    ("what", "behind"),
    [
        ("a table that light falls off on", 0.8 - 0.1 * X),
        ("sky above ground", np.where(Y < 0.6, 1.0, 0.4 + 0.1 * np.sin(40 * X))),
        ("a rough table", grain(0.7 * np.ones((HEIGHT, WIDTH, 1)))),
        ("vignetting", 0.9 - 0.2 * ((X - 0.5) ** 2 + (Y - 0.5) ** 2)),
    ],
)
def test_no_plain_background(what: str, behind: np.ndarray) -> None:
    assert uniform_background(photos(objects(behind, noise=0.005))) is None, what


def test_photos_that_disagree_have_none() -> None:
    exposures = [photo for level in (0.7, 0.75, 0.8) for photo in photos(objects(level, count=2))]
    assert uniform_background(exposures) is None
    assert uniform_background(photos(objects(1.0))[:2]) is None  # too few to prove it


def test_a_frame_is_no_background() -> None:
    pictures = [
        np.pad(part[20:-20, 20:-20], ((20, 20), (20, 20), (0, 0))) for part in objects(0.5 + 0.3 * np.sin(9 * X))
    ]
    assert uniform_background(photos(pictures)) is None


def test_masked_borders_do_not_speak() -> None:
    """A rod that holds the object crosses the border: masked, it hides no background."""
    pictures = objects(1.0)
    for picture in pictures:
        picture[-40:, 30:90] = 0.3
    assert uniform_background(photos(pictures)) is None
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[-48:, 22:98] = False
    masked = [replace(photo, mask=mask) for photo in photos(pictures)]
    found = uniform_background(masked)
    assert found is not None and found.name == "white"
    empty = empty_pixels(replace(masked[0], background=found))
    assert empty is not None and empty[2, 2] and not empty[~mask].any()


def test_what_is_asked_for() -> None:
    plain, notes = photos(objects(1.0)), Notes()
    assert [p.background for p in before_background(plain, parse_background("none"), notes)] == [None] * 6
    assert before_background(plain, parse_background("none"), notes)[0] is plain[0] and not notes.notes
    black = before_background(plain, parse_background("black"), notes)[0].background
    assert black is not None and black.colour == (0.0, 0.0, 0.0) and black.tolerance is not None and not notes.notes
    white = before_background(plain, BackgroundRequest(), notes)
    assert notes.notes == ["All photos show the same plain white behind the object; it is taken for empty space"]
    assert parse_background("#ff8000").colour == (1.0, 128 / 255, 0.0)
    for wrong in ("grey-ish", "#12345", ""):
        with pytest.raises(PhotoError):
            parse_background(wrong)
    new = like_the_others(photos([*objects(1.0, count=1), *objects(0.5, count=1)]), white)
    assert new[0].background == white[0].background and new[1].background is None


def test_empty_px_of_a_transparent_photo_are_those_of_alpha_0() -> None:
    alpha = np.array([[0, 1, 100, 200]] * 4, np.uint8)
    photo = Photo("a", Path("a"), np.full((4, 4, 3), 255, np.uint8), alpha=alpha, background=Background())
    view = View(Camera("a", 4, 4, 4, 4, 2, 2, np.eye(3), np.zeros(3)), photo.pixels, None, 255, alpha, Background())
    for either in (photo, view):
        np.testing.assert_array_equal(empty_pixels(either), alpha == 0)
        np.testing.assert_array_equal(background_shows(either), alpha < 128)
    assert empty_pixels(replace(photo, alpha=None)) is None
    half = np.zeros((4, 4), bool)
    assert not empty_pixels(replace(photo, mask=half)).any()
