"""How well photos tell their own blur: sharp pictures are blurred by known Gaussians, and `--psf auto` is asked.

    python -m benchmarks.blind_psf [--data FOLDER_WITH_SHARP ...] [--photos 8] [--scenes 5] [--calibrate]

Three groups, each with its own summary: ray-cast scenes of true steps (drawn once, kept in benchmarks/data), light or
encoded values blurred, every second with noise of one step; photographs, the given sets and single pictures that come
with scikit-image; and clouds, whose power falls as that of edges although there are none. The rules were chosen on the
scenes and pictures that `--calibrate` asks (others of each kind); the given sets had no part in that.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.inspection.blind_psf import BlindPsf, blind_psf
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.load import Photo
from PIL import Image
from scipy import ndimage

from .effect_scenes import MARGIN, make_scene

ROOT = Path(__file__).resolve().parent.parent

WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
#: Photographs among scikit-image's pictures; not charts, drawings, or pictures that show single blobs only. The first
#: ones had no part in choosing anything, the second ones are those that rules were chosen on.
PICTURES = ("astronaut", "brick", "coffee", "grass", "ihc", "hubble_deep_field", "rocket")
CHOSEN_ON = ("camera", "chelsea", "coins", "gravel", "motorcycle_left", "retina")
#: First seed of the scenes, and of those that rules were chosen on; their size and number of photos.
FRESH, USED, SIZE, VIEWS = 206, 200, (768, 512), 6
KEPT = ROOT / "benchmarks/data/blind_psf"


@dataclass
class Material:
    """Sharp pictures of one scene.

    Attributes:
        pictures: [H, W, 3] each: uint8 files' values, or float light.
        linear: whether the blur acts on light; margin: px to cut after blurring, None for five widths.
        noise: standard deviation in 8-bit steps.
    """

    group: str
    name: str
    pictures: list[np.ndarray] = field(repr=False)
    linear: bool = False
    margin: int | None = None
    noise: float = 0.0

    def blurred(self, width: float) -> PhotoSet | None:
        """Photos of it through a Gaussian; None where too little would be left."""
        margin = 5 * int(np.ceil(width)) if self.margin is None else self.margin
        if min(self.pictures[0].shape[:2]) - 2 * margin < 128:
            return None
        photos = []
        for index, picture in enumerate(self.pictures):
            values = picture / np.float32(255) if picture.dtype == np.uint8 else np.clip(picture, 0, None)
            if self.linear and picture.dtype == np.uint8:
                values = srgb_to_linear(values)
            elif not self.linear and picture.dtype != np.uint8:
                values = linear_to_srgb(values)
            values = ndimage.gaussian_filter(np.asarray(values, np.float32), (width, width, 0), truncate=5.0)
            values = values[margin:-margin, margin:-margin]
            encoded = linear_to_srgb(np.clip(values, 0, 1)) if self.linear else values
            noise = np.random.default_rng([17, index]).standard_normal(values.shape) * self.noise / 255
            pixels = np.rint(np.clip(encoded + noise, 0, 1) * 255).astype(np.uint8)
            photos.append(Photo(f"{index}.png", Path(f"{index}.png"), pixels))
        return PhotoSet(photos, linear=self.linear)


@dataclass
class Score:
    """What was estimated for one group."""

    errors: list[float] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    bounds: list[bool] = field(default_factory=list)
    silent: int = 0

    def add(self, found: BlindPsf, width: float) -> str:
        """Counts one answer and gives its cell of the table."""
        if found.verdict == "estimated":
            self.errors.append(found.sigma / width - 1)
            self.scores.append((found.sigma - width) / found.error)
            return f"{found.sigma:.2f}" + ("" if found.low <= width <= found.high else " !")
        if np.isfinite(found.high):
            self.bounds.append(found.high >= width)
            return f"<= {found.high:.2f}" + ("" if found.high >= width else " !")
        self.silent += 1
        return "no answer"

    def __str__(self) -> str:
        e, z = np.abs(self.errors), np.array(self.scores)
        text = f"{len(e)} estimates"
        if len(e):
            text += (
                f": median error {np.median(self.errors):+.1%}, {np.mean(e <= 0.05):.0%} within 5 %,"
                f" {np.mean(e <= 0.1):.0%} within 10 %; the 95 % interval holds the truth in"
                f" {np.mean(np.abs(z) <= 1.96):.0%} (rms of error over its own estimate {np.sqrt(np.mean(z**2)):.2f})"
            )
        return f"{text}; {sum(self.bounds)} of {len(self.bounds)} upper bounds hold; {self.silent} times no answer"


def steps(first: int, count: int) -> Iterator[Material]:
    """Ray-cast scenes, in linear light and encoded, with noise and without."""
    for seed in range(first, first + count):
        path = KEPT / f"scene_{seed}.npy"
        if not path.is_file():
            KEPT.mkdir(parents=True, exist_ok=True)
            np.save(path, make_scene(seed, width=SIZE[0], height=SIZE[1], views=VIEWS).light.astype(np.float16))
        light = list(np.load(path).astype(np.float32))
        linear, noise = seed % 2 == 0, float(seed % 4 in (1, 2))
        name = f"scene {seed}, {'light' if linear else 'encoded'}{', noise' if noise else ''}"
        yield Material("sharp edges", name, light, linear, MARGIN, noise)


def photographs(folders: list[Path], most: int, names: tuple[str, ...]) -> Iterator[Material]:
    """The given sets, and single pictures."""
    import skimage.data

    for folder in folders:
        files = [f for f in sorted((folder / "sharp").iterdir()) if f.suffix.lower() in (".png", ".jpg", ".jpeg")]
        picked = files[:: max(1, len(files) // most)][:most]
        yield Material("photographs", folder.name, [np.asarray(Image.open(f).convert("RGB")) for f in picked])
    for name in names:
        found = sorted(Path(skimage.data.__file__).parent.glob(f"{name}.*g"))
        if found:
            yield Material("photographs", f"{name} (one picture)", [np.asarray(Image.open(found[0]).convert("RGB"))])


def clouds(seed: int) -> Iterator[Material]:
    """Power laws with random phases."""
    for slope in (2.0, 2.4, 3.0):
        f = np.hypot(np.fft.fftfreq(SIZE[1])[:, None], np.fft.rfftfreq(SIZE[0])[None])
        pictures = []
        for index in range(4):
            white = np.fft.rfft2(np.random.default_rng([seed, index]).standard_normal(SIZE[::-1]))
            grey = np.fft.irfft2(white * np.maximum(f, 1 / SIZE[0]) ** (-slope / 2), s=SIZE[::-1])
            grey = 0.4 + 0.12 * (grey - grey.mean()) / grey.std()
            pictures.append(np.repeat(np.clip(grey, 0, 1)[..., None], 3, 2).astype(np.float32))
        yield Material("no edges", f"clouds, f^-{slope:g}", pictures, False, MARGIN)


def main() -> int:
    """Prints the table and the summaries."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, action="append", default=[], help="set with a folder sharp/")
    parser.add_argument("--photos", type=int, default=8)
    parser.add_argument("--scenes", type=int, default=5, help="scenes of true steps")
    parser.add_argument("--calibrate", action="store_true", help="ask what the rules were chosen on")
    options = parser.parse_args()
    used = options.calibrate
    materials = [
        steps(USED if used else FRESH, options.scenes),
        photographs(options.data, options.photos, CHOSEN_ON if used else PICTURES),
        clouds(1 if used else 11),
    ]
    scores: dict[str, Score] = {}
    seconds = []
    print("| scene | " + " | ".join(f"{w:g} px" for w in WIDTHS) + " |\n|" + "---|" * (len(WIDTHS) + 1))
    for material in (one for several in materials for one in several):
        cells = []
        for width in WIDTHS:
            photos = material.blurred(width)
            if photos is None:
                cells.append("-")
                continue
            began = time.process_time()
            found = blind_psf(photos)
            seconds.append(time.process_time() - began)
            cells.append(scores.setdefault(material.group, Score()).add(found, width))
        print(f"| {material.name} | " + " | ".join(cells) + " |", flush=True)
    print()
    for group, score in scores.items():
        print(f"{group}: {score}.")
    print(f"Processor time of one estimate: {np.mean(seconds):.1f} s on average, {max(seconds):.1f} s at most.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
