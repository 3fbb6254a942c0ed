"""When do photos contradict the blur that was given? (`core/imaging/contradiction.py`)

    python -m benchmarks.wrong_blur --data FOLDER_WITH_SHARP ... [--photos 6]

Sharp photos are blurred as in the mismatch study. Prints, on the training's grids (2 and 4 px): how many times the
explained power they hold at fine scales, and the largest share of the given width that they would not contradict.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

SIGMA, GRIDS = 5.0, (2, 4)


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, action="append", required=True, help="set with a folder sharp/")
    parser.add_argument("--photos", type=int, default=6)
    options = parser.parse_args()
    from dgs.core.imaging.contradiction import CONTRADICTION
    from dgs.core.imaging.psf import PointSpread
    from dgs.core.imaging.spectrum import noise_to_signal
    from dgs.core.photos.load import load_photo
    from dgs.core.training.grid import averaged
    from dgs.studies.comparison import degrade, mismatch

    cases = mismatch.cases(SIGMA)
    cut = max(case.kernel.shape[0] // 2 for case in cases)
    print(f"contradicted from {CONTRADICTION.limit:g} on\n")
    print("| set | case | " + " | ".join(f"excess, width (grid {g} px)" for g in GRIDS) + " |\n|---|---|---|---|")
    for folder in options.data:
        files = [f for f in sorted((folder / "sharp").iterdir()) if f.suffix.lower() in (".png", ".jpg", ".jpeg")]
        sharp = [load_photo(f).pixels for f in files[:: max(1, len(files) // options.photos)][: options.photos]]
        sharp = [p if p.dtype == np.uint8 else (p // 257).astype(np.uint8) for p in sharp]
        for case in cases:
            photos = [
                degrade.photographed(p, case.kernel, case.noise, case.jpeg, (17, i))[cut:-cut, cut:-cut]
                for i, p in enumerate(sharp)
            ]
            planes = [np.ascontiguousarray(p.transpose(2, 0, 1), np.float32) / np.float32(255) for p in photos]
            given, cells = PointSpread("gaussian", case.given, case.given), []
            for grid in GRIDS:
                rounding = 1 / 255 / 12**0.5 / grid
                found = noise_to_signal((averaged(p, grid) for p in planes), given.on_grid(grid), rounding)
                cells.append(f"{found.excess:.1f}, {found.widest:.2f}")
            print(f"| {folder.name} | {case.name} | " + " | ".join(cells) + " |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
