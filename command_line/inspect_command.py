"""`inspect`: which effects the photos show."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.background import BackgroundRequest
from ..core.files import check_writable, write_json
from ..core.imports import large_imports
from ..core.outputs import check_outputs, placing_outputs
from ..core.photos.data_set import data_set, photos_in
from .arguments import add_machine, add_masks, add_overwrite, add_progress, show_defaults
from .progress_choice import Reporting

if TYPE_CHECKING:
    from ..core.inspection.evidence import Evidence


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = (
        "Measures blur, defocus, motion, haze, differing exposure, vignetting, noise, clipping and "
        "gloss in the photos, before anything is trained: size, uncertainty and evidence of each."
    )
    show_defaults(parser)
    add = parser.add_argument
    add("photos", type=Path, metavar="PHOTOS", help="folder of photos")
    add(
        "--cameras",
        type=Path,
        metavar="MODEL",
        help="given cameras with points, such as a COLMAP model; found from the photos if not given",
    )
    add(
        "--without-cameras",
        action="store_true",
        help="look for none: quick, but says nothing on what needs the same point in several photos",
    )
    add_masks(parser)
    add("--out", type=Path, metavar="DIR", help="folder for inspection.json and pictures; none if not given")
    add("--json", action="store_true", help="print JSON instead of the table")
    add_overwrite(parser)
    add_machine(parser)
    add_progress(parser)


def inspect_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints a table (or JSON) of every effect, and writes pictures."""
    with large_imports():
        from ..core.effects.inspect import inspect_photos  # heavy: torch
        from ..core.inspection.cameras import with_cameras  # heavy: torch
        from ..core.inspection.photo_set import PhotoSet  # heavy: torch
        from ..core.inspection.pictures import PICTURES, draw_inspection  # heavy: torch
        from ..core.machine import use_machine  # late: slows --help
        from ..core.photos.load import load_photos  # heavy: torch
        from ..core.photos.uniform import before_background  # heavy: torch

    began = time.perf_counter()
    threads = use_machine(options.threads)
    if options.out is not None:
        check_writable(options.out)
        files = [options.out / name for name in ("inspection.json", *PICTURES)]
        check_outputs(files, overwrite=options.overwrite)
    whole = data_set(options.photos)
    model = whole.cameras if whole is not None and options.cameras is None else options.cameras
    loaded = load_photos(photos_in(options.photos), None, progress, options.masks, minimum=1)
    loaded = before_background(loaded, BackgroundRequest(), progress)
    photos = PhotoSet(loaded, why="cameras were not asked for" if options.without_cameras else "")
    seconds_cameras = 0.0
    if not options.without_cameras:
        at = time.perf_counter()
        photos = with_cameras(photos, model, threads, progress)
        seconds_cameras = time.perf_counter() - at
    found = inspect_photos(photos, progress)
    content = {
        "photos": str(options.photos),
        "count": len(loaded),
        "cameras": photos.cameras is not None,
        "why_no_cameras": None if photos.cameras is not None else photos.no_observations,
        "effects": [evidence.plain() for evidence in found],
        "seconds": {"cameras": round(seconds_cameras, 3), "total": round(time.perf_counter() - began, 3)},
    }
    pictures: list[str] = []
    if options.out is not None:
        with placing_outputs(options.out, "inspect", progress.note) as folder:
            pictures = [str(options.out / path.name) for path in draw_inspection(folder, photos, found)]
            content["pictures"] = pictures
            write_json(folder / "inspection.json", content)
    if options.json:
        print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False), flush=True)
        return 0
    if options.progress != "json":
        print("\n".join(table(found)), flush=True)
    progress.finished(
        {
            "needed": ", ".join(e.name for e in found if e.needed) or "none",
            "figures": None if options.out is None else str(options.out / "inspection.json"),
            "pictures": ", ".join(pictures) or None,
            "seconds": content["seconds"]["total"],  # type: ignore[index]
        }
    )
    return 0


def table(found: Sequence[Evidence]) -> list[str]:
    """Lines for a terminal: what is needed first."""
    lines = [f"{'effect':<16} {'needed':<7} {'estimate':>18} {'sure':>5}  evidence"]
    for e in sorted(found, key=lambda e: not e.needed):
        value, error, unit = (e.estimate.get(k) for k in ("value", "error", "unit"))
        size = "not measured" if value is None else f"{value:.3g} +- {error:.2g} {_short(str(unit))}"
        sure = "-" if value is None else f"{100 * e.confidence:.0f} %"
        lines.append(f"{e.name:<16} {'YES' if e.needed else 'no':<7} {size:>18} {sure:>5}  {e.evidence}")
    return lines


def _short(unit: str) -> str:
    return {"relative": "", "share": "", "optical depth": "", "8-bit steps": "steps"}.get(unit, unit)
