"""Photos whose exposure differs: sets made from sharp ones, how their twins compare, and how often nothing is there.

    python -m benchmarks.exposure change PHOTOS OUT [--stops 0.75] [--seed 1]   # in linear light
    python -m benchmarks.exposure score TWIN PHOTOS [--width 400]   # held-out renders against the photos as they were
    python -m benchmarks.exposure alarms [--scenes 6]   # what an ordinary run decides on drawn sets, 240 x 160 px

`change` draws every photo's gain from [-stops, stops], and a tint of 4 % for each channel, and writes OUT.gains.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.evaluation.halves import exposed_by_halves
from dgs.core.evaluation.metrics import psnr
from dgs.core.imaging.medium import Medium
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects.choose import usual_effects
from dgs.core.progress import Silent
from PIL import Image

from .effect_scenes import Truth, degrade, make_scene
from .effects import MADE, photo_set

#: Standard deviation of a channel's own gain, natural log.
TINT = 0.04


def change(photos: Path, out: Path, stops: float, seed: int) -> None:
    """Writes the photos with gains of their own; their mean log gain is 0."""
    out.mkdir(parents=True, exist_ok=True)
    files = sorted(file for file in photos.iterdir() if file.suffix.lower() in (".png", ".jpg"))
    random = np.random.default_rng(seed)
    gains = np.log(2.0) * random.uniform(-stops, stops, (len(files), 1)) + random.normal(0.0, TINT, (len(files), 3))
    gains -= gains.mean(axis=0)
    for file, gain in zip(files, gains, strict=True):
        light = srgb_to_linear(np.asarray(Image.open(file).convert("RGB")) / 255.0) * np.exp(gain)
        pixels = np.round(linear_to_srgb(light).clip(0.0, 1.0) * 255.0).astype(np.uint8)
        Image.fromarray(pixels).save(out / f"{file.stem}.png")
    rows = {f"{file.stem}.png": gain.tolist() for file, gain in zip(files, gains, strict=True)}
    Path(f"{out}.gains.json").write_text(json.dumps(rows, indent=1))


def score(twin: Path, photos: Path, width: int) -> None:
    """PSNR (dB) of held-out renders against photos: as they are, and by halves."""
    plain, halves = [], []
    for file in sorted((twin / "renders").glob("*.png")):
        truth = Image.open(photos / file.name).convert("RGB")
        size = width, round(width * truth.height / truth.width)
        shown, wanted = (
            np.asarray(picture.resize(size, Image.Resampling.LANCZOS), np.float64) / 255.0
            for picture in (Image.open(file).convert("RGB"), truth)
        )
        exposed = exposed_by_halves(shown.transpose(2, 0, 1), wanted.transpose(2, 0, 1)).transpose(1, 2, 0)
        plain.append(psnr(shown, wanted))
        halves.append(psnr(exposed, wanted))
    print(f"{twin.name}: {np.mean(plain):.2f} dB as it is, {np.mean(halves):.2f} dB by halves, {len(plain)} views")


def alarms(scenes: int) -> None:
    """How often exposures are learned on drawn sets: clean ones, with another effect, and with exposures."""
    drawn = [make_scene(seed, width=240, height=160, views=12, finer=2) for seed in range(scenes)]
    made = {"clean": lambda x: Truth(), **{name: MADE[name] for name in MADE if name != "saturation"}}
    for name, truth in made.items():
        for level in (0.0,) if name == "clean" else (2.0, 4.0):
            on = 0
            for seed in range(scenes):
                photos = photo_set(drawn[seed], degrade(drawn[seed], truth(level), seed=seed))
                assert photos.cameras is not None
                views = undistorted_views(list(photos.photos), photos.cameras)
                on += bool(usual_effects(photos.photos, photos.cameras, views, Medium(), Silent()).formation)
            print(f"{name} x {level:g}: learned on {on} of {scenes} sets", flush=True)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    changing, scoring, alarming = (parts.add_parser(name) for name in ("change", "score", "alarms"))
    changing.add_argument("photos", type=Path)
    changing.add_argument("out", type=Path)
    changing.add_argument("--stops", type=float, default=0.75)
    changing.add_argument("--seed", type=int, default=1)
    scoring.add_argument("twin", type=Path)
    scoring.add_argument("photos", type=Path)
    scoring.add_argument("--width", type=int, default=400)
    alarming.add_argument("--scenes", type=int, default=6)
    options = parser.parse_args()
    if options.part == "change":
        change(options.photos, options.out, options.stops, options.seed)
    elif options.part == "score":
        score(options.twin, options.photos, options.width)
    else:
        alarms(options.scenes)


if __name__ == "__main__":
    main()
