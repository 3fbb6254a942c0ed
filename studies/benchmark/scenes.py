"""The scenes of the benchmark, split once: `CHOSEN` are the sets that numbers of the engine have been chosen on,
`CHECKED` those that no number ever may be.

A number that is better on `CHOSEN` and worse on `CHECKED` has learned the sets by heart. Whoever looks for a number on
a set of `CHECKED` has to move it to `CHOSEN`, for good.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Part = Literal["chosen on", "checked on"]
Kind = Literal["object on white", "transparent", "all-round indoor", "forward-facing", "drone", "around an object"]


@dataclass(frozen=True)
class RenderedSet:
    """A set that the laboratory renders; `NAME`, `NAME-blurred` and `NAME-found` share their frames.

    Attributes:
        scene, path, background: of `synthesize`.
        views, width, height: photos, and their size in px.
        psf: the medium, 'none' or as `--psf` takes it.
        samples: Cycles' paths per pixel; overscan: px rendered beyond each side, six times the blur's width or nearly.
    """

    scene: str
    path: str
    views: int = 48
    width: int = 400
    height: int = 300
    background: str = "scene"
    psf: str = "none"
    samples: int = 16
    overscan: int = 20


@dataclass(frozen=True)
class PhotoSet:
    """A set of the folder of shared sets (`--data`).

    Attributes:
        folder: its name; photos, truth: folders inside it, no truth for ''.
        cameras: a model inside it, where the benchmark gives the cameras.
        prepare: what is made of the photos before: '' for nothing, 'white' puts them over white, 'blurred' then blurs.
    """

    folder: str
    photos: str = "photos"
    truth: str = ""
    cameras: str = ""
    psf: str = "none"
    prepare: Literal["", "white", "blurred"] = ""


@dataclass(frozen=True)
class BenchmarkScene:
    """One line of the table.

    Attributes:
        cameras: 'given', or 'found' from the photos.
        published: PSNR in dB that others report on the same photos, with their conditions; '' where nobody does.
    """

    name: str
    part: Part
    kind: Kind
    cameras: Literal["given", "found"]
    source: RenderedSet | PhotoSet
    published: str = ""


#: Of 3DGS and its followers on lego: on white, sharp, 100 training views.
_LEGO = "35.4 to 35.8 (3DGS and followers, 30,000 steps)"

_ROOM = RenderedSet("room", "inside", samples=8)
_SHELF = RenderedSet("shelf", "front", 32, samples=8)

CHOSEN = (
    # (where cameras are doubted was chosen on it)
    BenchmarkScene("room-found", "chosen on", "all-round indoor", "found", _ROOM),
    # (on these two, how finely and how deep first surfaces are sought)
    BenchmarkScene("shelf", "chosen on", "forward-facing", "found", _SHELF),
    BenchmarkScene(
        "ball",
        "chosen on",
        "forward-facing",
        "found",
        RenderedSet("rugby-ball", "rail", 76, 800, 533, psf="gaussian:5", samples=8, overscan=24),
    ),
    BenchmarkScene(
        "lego",
        "chosen on",
        "object on white",
        "given",
        PhotoSet("lego", cameras="transforms.json", prepare="white"),
        _LEGO,
    ),
    BenchmarkScene(
        "lego-alpha", "chosen on", "transparent", "given", PhotoSet("lego", cameras="transforms.json"), _LEGO
    ),
    BenchmarkScene(
        "lego-blurred",
        "chosen on",
        "object on white",
        "given",
        PhotoSet("lego", cameras="transforms.json", psf="gaussian:3", prepare="blurred"),
    ),
    BenchmarkScene("copr", "chosen on", "drone", "found", PhotoSet("copr", "blur5", "sharp", psf="gaussian:5")),
    BenchmarkScene("brighton", "chosen on", "drone", "found", PhotoSet("brighton", "blur5", "sharp", psf="gaussian:5")),
    BenchmarkScene(
        "banana", "chosen on", "around an object", "found", PhotoSet("banana", "blur5", "sharp", psf="gaussian:5")
    ),
)

_ORRERY = RenderedSet("orrery", "dome", background="transparent")
_PLANT = RenderedSet("plant", "dome", background="white")
_VILLAGE = RenderedSet("village", "drone", samples=8)


def _pair(
    name: str, kind: Kind, sharp: RenderedSet, cameras: tuple[Literal["given", "found"], Literal["given", "found"]]
) -> tuple[BenchmarkScene, BenchmarkScene]:
    """The set sharp, and through a blur of 3 px."""
    blurred = RenderedSet(**{**vars(sharp), "psf": "gaussian:3"})
    first, second = cameras
    return (
        BenchmarkScene(name, "checked on", kind, first, sharp),
        BenchmarkScene(f"{name}-blurred", "checked on", kind, second, blurred),
    )


CHECKED = (
    *_pair("plant", "object on white", _PLANT, ("given", "given")),
    *_pair("orrery", "transparent", _ORRERY, ("given", "given")),
    *_pair("room", "all-round indoor", _ROOM, ("given", "given")),
    BenchmarkScene(
        "orrery-front", "checked on", "forward-facing", "given", RenderedSet("orrery", "front", 32, samples=8)
    ),
    _pair("shelf", "forward-facing", _SHELF, ("found", "found"))[1],
    *_pair("village", "drone", _VILLAGE, ("given", "found")),
    BenchmarkScene("drinks", "checked on", "forward-facing", "given", PhotoSet("drinks", cameras="cameras")),
    BenchmarkScene("tea", "checked on", "forward-facing", "given", PhotoSet("tea", cameras="cameras")),
)

SCENES = (*CHECKED, *CHOSEN)

#: What `--quick` runs: the same code on pictures that prove nothing else.
QUICK = (
    BenchmarkScene(
        "plant", "checked on", "object on white", "given", RenderedSet("plant", "dome", 10, 96, 72, "white", samples=2)
    ),
    BenchmarkScene(
        "orrery-blurred",
        "checked on",
        "transparent",
        "given",
        RenderedSet("orrery", "dome", 10, 96, 72, "transparent", "gaussian:1", samples=2),
    ),
)
