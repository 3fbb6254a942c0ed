"""What `inspect` calls needed and `--effects auto` would simulate, on any sets of photos with cameras.

    python -m benchmarks.false_alarms NAME=PHOTOS:CAMERAS ... [--max-size 400] [--inspect-only] [--out rows.json]

The decision is all that is run: inspection and trials as `reconstruct --effects auto` has them, every eighth photo held
out, no training after. On sharp photos whatever is called or simulated is a false alarm, but for what cameras do to
sharp photos as well (exposure, white balance, vignetting, gloss, clipping, noise, lens distortion).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from dgs.core.background import BackgroundRequest
from dgs.core.effects.inspect import inspect_photos
from dgs.core.imaging.medium import Medium
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.load import load_photos
from dgs.core.photos.undistort import undistorted_views
from dgs.core.photos.uniform import before_background
from dgs.core.pipeline.effects.ablation import TrialTerms
from dgs.core.pipeline.effects.choose import choose_effects
from dgs.core.progress import Silent
from dgs.core.sfm.given import load_cameras
from dgs.core.training.settings import TrainingSettings

#: Effects that only something between camera and scene, or a camera that moved or is out of focus, brings about.
ALARMS = ("blur", "haze", "defocus", "field_blur", "motion")


def looked_at(photos: Path, cameras: Path, max_size: int | None, inspect_only: bool) -> dict[str, Any]:
    """What is called needed, what would be simulated, gains of trials, and seconds of processor time of each."""
    loaded = before_background(load_photos(photos, max_size, Silent(), None, minimum=1), BackgroundRequest(), Silent())
    known = load_cameras(cameras, list(loaded))
    used = [photo for photo in loaded if photo.name in known.poses]
    began = time.process_time()
    found = inspect_photos(PhotoSet(used, known), Silent())
    row: dict[str, Any] = {
        "photos": len(used),
        "size": list(used[0].size),
        "called": [e.name for e in found if e.needed],
        "haze": next(e.plain() for e in found if e.name == "haze"),
        "inspect_s": time.process_time() - began,
    }
    if inspect_only:
        return row
    held = {photo.name for photo in used[::8]}
    fitted = [view for view in undistorted_views(used, known) if view.name not in held]
    began = time.process_time()
    chosen = choose_effects(
        "auto", used, known, fitted, Medium(), TrialTerms(TrainingSettings.preset("balanced")), Silent()
    )
    row["simulated"] = [d.name for d in chosen.decisions if d.on]
    row["auto_s"] = time.process_time() - began
    row["trials"] = {
        d.name: {"gain": d.gain_db, "error": d.gain_error_db, "seconds": d.seconds, "why": d.why, "on": d.on}
        for d in chosen.decisions
        if d.gain_db is not None
    }
    return row


def main() -> None:
    """Prints a line for each set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", metavar="NAME=PHOTOS:CAMERAS")
    parser.add_argument("--max-size", type=int)
    parser.add_argument("--inspect-only", action="store_true")
    parser.add_argument("--out", type=Path, help="all rows as JSON")
    options = parser.parse_args()
    rows = {}
    for text in options.sets:
        name, _, folders = text.partition("=")
        photos, _, cameras = folders.partition(":")
        rows[name] = row = looked_at(Path(photos), Path(cameras), options.max_size, options.inspect_only)
        alarms = sorted({*row["called"], *row.get("simulated", [])} & set(ALARMS))
        print(
            f"{name}: {row['photos']} photos, called {row['called']}, haze {row['haze']['estimate']['value']}", end=""
        )
        if "simulated" in row:
            print(f", simulated {row['simulated']}, {row['auto_s']:.0f} s of processor time", end="")
            for effect, trial in row["trials"].items():
                print(f"; {effect} {trial['gain']:+.2f} +- {trial['error']:.2f} dB, {trial['seconds']:.0f} s", end="")
        print(f"; alarms: {alarms or 'none'}", flush=True)
        if options.out is not None:
            options.out.write_text(json.dumps(rows, indent=1) + "\n")
    print(f"{sum(bool(set(r['called']) & set(ALARMS)) for r in rows.values())} of {len(rows)} sets with a false call")


if __name__ == "__main__":
    main()
