"""What an update is worth: `python -m benchmarks.update_twin --data FOLDER [--seeds 3]`.

Of a set's photos every eighth is held out, and of the others every tenth comes later. A twin is made of the early
ones and updated with the late ones; another is made of all from nothing. Prints, for each seed: seconds of both
(cameras found, everything counted), PSNR of held-out views against the sharp truth, and of the twin before.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dgs.core.evaluation.metrics import psnr
from dgs.core.photos.truth import TruthFolder
from dgs.core.pipeline.views import Viewer, to_pixels
from dgs.core.progress import Silent
from dgs.core.twin.opened import open_twin

ROOT = Path(__file__).resolve().parents[1]

HOLDOUT, LATE = 8, 10


def ordered(held: list[Path], others: list[Path]) -> list[Path]:
    """Held-out photos in the places in which `--holdout-every` takes them."""
    held, others, out = list(held), list(others), []
    while held or others:
        take_held = len(out) % HOLDOUT == 0 and held
        out.append((held if take_held or not others else others).pop(0))
    return out


def lay_out(photos: list[Path], sharp: dict[str, Path], folder: Path, first: int = 0) -> None:
    """photos/ and sharp/ by number, as links."""
    for kind in ("photos", "sharp"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for index, photo in enumerate(photos, start=first):
        (folder / "photos" / f"{index:04d}{photo.suffix}").symlink_to(photo.resolve())
        truth = sharp[photo.stem]
        (folder / "sharp" / f"{index:04d}{truth.suffix}").symlink_to(truth.resolve())


def timed(*words: str) -> float:
    """Seconds of one command."""
    began = time.perf_counter()
    subprocess.run([sys.executable, str(ROOT / "run_dgs.py"), *words, "--progress", "none"], check=True)
    return time.perf_counter() - began


def score(twin_folder: Path, sharp: Path) -> float:
    """Mean PSNR (dB) of the held-out views against the sharp truth."""
    twin, truth = open_twin(twin_folder, Silent()), TruthFolder(sharp)
    behind = [float(c) for c in twin.background]
    viewer = Viewer(twin.gaussians, twin.scale, "cpu", background=(behind[0], behind[1], behind[2]))
    found = []
    for name in twin.held:
        if name in twin.reconstruction.poses:
            seen = to_pixels(viewer.sharp(twin.reconstruction.lenses[name], twin.reconstruction.poses[name]))
            wanted = truth.pixels(name)
            found.append(psnr(seen / 255.0, wanted / float(np.iinfo(wanted.dtype).max)))
    return statistics.fmean(found)


def one(data: Path, psf: str, seed: int, work: Path) -> dict[str, float]:
    """Both ways with one seed."""
    blurred = data / "photos" if (data / "photos").is_dir() else data / "blur5"
    photos = sorted(p for p in blurred.iterdir() if p.suffix.lower() in (".png", ".jpg", ".jpeg", ".tif"))
    sharp = {p.stem: p for p in (data / "sharp").iterdir()}
    # As many as both runs hold out: the last of a set may find no place among the fewer early ones.
    held = photos[::HOLDOUT]
    while (len(held) - 1) * HOLDOUT >= len(photos) - len(photos) // LATE - 1:
        photos.remove(held.pop())
    others = [p for p in photos if p not in held]
    late = others[LATE // 2 :: LATE]
    early = [p for p in others if p not in late]
    lay_out(ordered(held, early), sharp, work / "early")
    lay_out(late, sharp, work / "late", first=len(held) + len(early))
    lay_out(ordered(held, others), sharp, work / "all")
    medium = ("--psf", psf, "--seed", str(seed), "--holdout-every", str(HOLDOUT))
    first = timed("reconstruct", str(work / "early/photos"), "--out", str(work / "twin"), *medium)
    scratch = timed("reconstruct", str(work / "all/photos"), "--out", str(work / "scratch"), *medium)
    before = score(work / "twin", work / "early/sharp")
    update = timed("update", str(work / "twin"), str(work / "late/photos"), "--seed", str(seed))
    facts = json.loads((work / "twin/update.json").read_text("utf-8"))
    after, wanted = score(work / "twin", work / "early/sharp"), score(work / "scratch", work / "all/sharp")
    return {
        "photos": len(photos),
        "new": len(late),
        "taken": len(facts["photos"]),
        "first_s": first,
        "scratch_s": scratch,
        "update_s": update,
        "share": update / scratch,
        "before": before,
        "updated": after,
        "scratch": wanted,
        "forgotten": facts["psnr_old"][0] - facts["psnr_old"][1],
        "stages": facts["seconds"],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", required=True)
    parser.add_argument("--psf", default="gaussian:5")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    for data in options.data:
        rows = []
        for seed in range(options.seeds):
            with tempfile.TemporaryDirectory() as work:
                rows.append(one(data, options.psf, seed, Path(work)))
            print(
                data.name,
                json.dumps({k: round(v, 2) if isinstance(v, float) else v for k, v in rows[-1].items()}),
                flush=True,
            )
        middle = {k: statistics.median(r[k] for r in rows) for k in rows[0] if k != "stages"}
        print(
            f"{data.name}: {middle['new']:.0f} new of {middle['photos']:.0f}; update {middle['update_s']:.1f} s of "
            f"{middle['scratch_s']:.1f} s ({100 * middle['share']:.0f} %); {middle['updated']:.2f} dB, from nothing "
            f"{middle['scratch']:.2f}, before {middle['before']:.2f}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
