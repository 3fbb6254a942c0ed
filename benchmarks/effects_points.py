"""Do the same points in different photos tell a blur that varies from one that does not?

    python -m benchmarks.effects_points [--scenes 12]

Every scene of benchmarks/effects.py behind a medium (sigma 2 px), without and with 2 px of defocus or of field blur.
Where an effect is there, the size that the photos tell is asked for (`registry.built`), where it is not, 2 px of it are
claimed all the same. Prints the table in docs/studies/effects.md.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch
from dgs.core.effects.defocus import Defocus, shared_focus
from dgs.core.effects.depth_unit import depth_unit
from dgs.core.effects.field_blur import FieldBlur
from dgs.core.effects.registry import built
from dgs.core.imaging.formation.spreading import SpreadingEffect
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.pipeline.effects.confirmed import confirmed_by_points

from .effect_scenes import Truth, degrade, kept_scene
from .effects import KEPT, photo_set

SIGMA, PX = 2.0, 2.0
SETS = {"clean": {}, "defocus": {"defocus": PX}, "field_blur": {"field": PX}}


def claimed(name: str, photos: PhotoSet) -> SpreadingEffect:
    """An effect of 2 px that is not there: in the corners, or at both ends of the depths."""
    diagonal = float(np.hypot(*photos.greys[0].shape))
    if name == "field_blur":
        return FieldBlur(torch.tensor(PX / diagonal))
    unit = depth_unit(photos)
    far, near = np.quantile(1.0 / photos.observations.depth / unit, [0.05, 0.95])
    return Defocus(torch.tensor(PX / diagonal / ((near - far) / 2)), torch.tensor((near + far) / 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=12)
    shares = {(name, there): [] for name in ("defocus", "field_blur") for there in SETS}
    seconds = []
    for seed in range(parser.parse_args().scenes):
        scene = kept_scene(seed, KEPT)
        for there, done in SETS.items():
            photos = photo_set(scene, degrade(scene, Truth(psf=(SIGMA, SIGMA, 0.0), **done), seed))
            for name in ("defocus", "field_blur"):
                made = shared_focus(photos) if name == "defocus" else built(name, photos)
                effect = made if name == there else claimed(name, photos)
                if effect is None:
                    print(f"scene {seed}, {there}: no size of {name}", flush=True)
                    continue
                began = time.process_time()
                confirmed = confirmed_by_points(effect, photos)
                seconds.append(time.process_time() - began)
                shares[name, there].append(confirmed)
                print(f"scene {seed}, {there}: {name} {confirmed}", flush=True)
    print("| asked for | photos with | share that the points show | confirmed |\n|---|---|---|---|")
    for (name, there), confirmed in shares.items():
        known = [t for t in confirmed if t is not None]
        values = [t.share for t in known] or [float("nan")]
        print(
            f"| {name} | {there} | {min(values):.2f} to {max(values):.2f} | "
            f"{sum(t.confirms for t in known)} of {len(confirmed)} |"
        )
    print(f"{np.mean(seconds):.2f} s of processor time each.")


if __name__ == "__main__":
    main()
