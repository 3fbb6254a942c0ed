"""What a rendered medium is, and what it is given of the photos. Needs numpy only."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ....core.camera import Camera
from ....core.errors import DgsError

#: What is true of one photo, for the manifest: numbers, lists and texts only.
Truth = dict[str, Any]


@dataclass(frozen=True)
class Views:
    """The photos that a medium is planned for.

    Attributes:
        cameras: [V] as the sharp pictures are rendered.
        target: [3] middle of the object in the engine's world.
        clear: [V] which photos are taken without what differs from photo to photo.
        seed: of everything that is random.
        depths: depth maps of all views along the camera's axis, inf in the void; small ones, rendered when called.
    """

    cameras: Sequence[Camera]
    target: NDArray[np.float64]
    clear: Sequence[bool]
    seed: int
    depths: Callable[[], list[NDArray[np.float32]]]


class Stage(Protocol):
    """What can stand in Blender's scene while a photo is taken; `laboratory.stage` is it. Each takes itself away."""

    def lens(self, camera: Camera, aperture: float, focus: float) -> AbstractContextManager[None]:
        """A hole of a diameter in units of the scene, sharp at a depth."""

    def camera_path(self, camera: Camera, poses: NDArray[np.float64]) -> AbstractContextManager[None]:
        """The camera goes through poses [2^n + 1, 3, 4] (world to camera, engine's axes) at even times."""

    def open_shutter(self, readout: float = 0.0) -> AbstractContextManager[None]:
        """What moves blurs; rows are exposed one after the other, the last one `readout` exposures after the first."""

    def sheet(
        self, corners: NDArray[np.float64], thickness: float, slope: float, index: float
    ) -> AbstractContextManager[None]:
        """Glass before the camera, moving with it, [4, 3] corners in its axes (engine's); rough on the other side."""

    def standing_sheet(
        self, corners: NDArray[np.float64], away: NDArray[np.float64], slope: float, index: float
    ) -> AbstractContextManager[None]:
        """Glass that stands where it is, [4, 3] corners (Blender's world); rough on the side `away` ([3]) from them."""

    def fog(
        self, density: float, anisotropy: float, middle: NDArray[np.float64], reach: float
    ) -> AbstractContextManager[None]:
        """A box of even fog around `middle` ([3], Blender's world)."""


class Medium(ABC):
    """One medium with its parameters."""

    #: Whether it stands before every photo, held-out ones included; otherwise photos differ, and some may be clear.
    every_photo: ClassVar[bool]

    @property
    def by_rows(self) -> bool:
        """Whether rows of a photo differ by their place in the frame that is rendered."""
        return False

    @abstractmethod
    def constants(self) -> Truth:
        """What is true of all photos, with units in the names or beside them."""

    @abstractmethod
    def plan(self, views: Views) -> list[Truth]:
        """What is true of each photo ([V]; of clear ones too, unused).

        Raises:
            DgsError: it does not fit the scene.
        """

    def standing(self, stage: Stage, plan: list[Truth]) -> AbstractContextManager[None]:
        """Inside, what stands there for all photos is there."""
        return nullcontext()

    def photo(self, stage: Stage, camera: Camera, truth: Truth) -> AbstractContextManager[None]:
        """Inside, the scene is set for this photo."""
        return nullcontext()


@dataclass(frozen=True)
class MediumSpec:
    """A line of the registry.

    Attributes:
        name: as in `--medium NAME:VALUES`.
        label, description: as the panel shows them.
        form: how the values are written.
        usual: values that suit the laboratory's own scenes.
        parse: values -> the medium; raises `DgsError` that says what to write.
    """

    name: str
    label: str
    description: str
    form: str
    usual: str
    parse: Callable[[str], Medium]


def numbers(name: str, form: str, text: str, least: int, most: int) -> list[float]:
    """`least` to `most` finite numbers of `text`, between commas.

    Raises:
        DgsError: there are more, fewer, or others.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not least <= len(values) <= most or not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > 1e9:
        raise DgsError(f"'{name}:{text[:60]}' is no medium", f"Write {name}:{form}")
    return values


def span(name: str, form: str, text: str) -> tuple[float, float]:
    """'4..16' as (4, 16); '8' as (8, 8).

    Raises:
        DgsError: it is neither.
    """
    low, dots, high = text.partition("..")
    (first,) = numbers(name, form, low, 1, 1)
    (last,) = numbers(name, form, high if dots else low, 1, 1)
    if last < first:
        raise DgsError(f"'{name}:{text[:60]}' is no range", "Write the smaller number first, such as 4..16")
    return first, last


def generator(seed: int, name: str, photo: int) -> np.random.Generator:
    """Random numbers of one photo and one medium."""
    return np.random.default_rng((seed, photo, *name.encode()))
