"""How well photos tell their own blur: sharp pictures are blurred by known Gaussians, and `--psf auto` is asked.

    python benchmarks/blind_psf.py [--data FOLDER_WITH_SHARP ...] [--photos 8]

Besides the sets that are given, single pictures that come with scikit-image are asked: they had no part in choosing
anything. Prints a table in Markdown: per set and width the estimate, and over all the errors and how often the 95 %
interval holds the truth.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads would spin on the small fits

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import run_dgs  # noqa: E402

WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
#: Photographs among scikit-image's pictures; not charts, drawings, or pictures that show single blobs only.
PICTURES = ("astronaut", "brick", "camera", "chelsea", "coffee", "coins", "grass", "gravel", "ihc", "motorcycle_left",
            "hubble_deep_field", "retina", "rocket")  # fmt: skip


def sets(folders: list[Path], most: int) -> Iterator[tuple[str, list]]:
    """(name, photos) of every set."""
    import skimage.data
    from dgs.core.photos.load import load_photo
    from PIL import Image

    for folder in folders:
        files = [f for f in sorted((folder / "sharp").iterdir()) if f.suffix.lower() in (".png", ".jpg", ".jpeg")]
        yield folder.name, [load_photo(file) for file in files[:: max(1, len(files) // most)][:most]]
    with tempfile.TemporaryDirectory() as room:
        for name in PICTURES:
            found = sorted(Path(skimage.data.__file__).parent.glob(f"{name}.*g"))
            if found:
                copy = Path(room) / f"{name}.png"
                Image.open(found[0]).convert("RGB").save(copy)
                yield f"{name} (one picture)", [load_photo(copy)]


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, action="append", default=[], help="set with a folder sharp/")
    parser.add_argument("--photos", type=int, default=8)
    options = parser.parse_args()
    run_dgs.mount_package()
    from dgs.core.comparison import degrade
    from dgs.core.inspection.blind_psf import blind_psf
    from dgs.core.inspection.photo_set import PhotoSet

    errors, held, bounds, silent = [], [], [], 0
    print("| set | " + " | ".join(f"{w:g} px" for w in WIDTHS) + " |\n|" + "---|" * (len(WIDTHS) + 1))
    for name, photos in sets(options.data, options.photos):
        cells = []
        for width in WIDTHS:
            kernel = degrade.gaussian(width)
            cut = kernel.shape[0] // 2
            if min(photos[0].size) - 2 * cut < 128:
                cells.append("-")
                continue
            blurred = [
                replace(p, pixels=degrade.photographed(p.pixels, kernel, 0.0, None, (17, i))[cut:-cut, cut:-cut].copy())
                for i, p in enumerate(photos)
            ]
            found = blind_psf(PhotoSet(blurred))
            if found.verdict == "estimated":
                errors.append(found.sigma / width - 1)
                held.append(found.low <= width <= found.high)
                cells.append(f"{found.sigma:.2f}")
            elif np.isfinite(found.high):
                bounds.append(found.high >= width)
                cells.append(f"<= {found.high:.2f}")
            else:
                silent += 1
                cells.append("not told")
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    e = np.array(errors)
    print(
        f"\n{len(e)} estimates: median error {np.median(e):+.1%}, half within {np.median(np.abs(e)):.1%},"
        f" {np.mean(np.abs(e) <= 0.05):.0%} within 5 %, {np.mean(np.abs(e) <= 0.1):.0%} within 10 %;"
        f" the 95 % interval holds the truth in {np.mean(held):.0%}. {len(bounds)} upper bounds, {sum(bounds)} of them"
        f" hold; {silent} times the photos did not tell."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
