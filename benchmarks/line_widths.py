"""Widths of the lines painted on a ball, as renders show them, beside the true ones and the photos'.

    python run_dgs.py render TWIN/twin.ply --cameras SET/transforms.json --out RENDERS
    python -m benchmarks.line_widths SET RENDERS [RENDERS ...]

Over all views of which RENDERS has a picture (TWIN/renders: those held out). Concordance: mean true width over the mean
error of the rendered ones.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.evaluation.lines import PaintedLine, concordance, contrast_direction, line_width, read_lines, stations
from dgs.core.evaluation.profiles import Sampler
from dgs.core.formats.cameras import read_cameras
from PIL import Image


def widths(pictures: Path, sharp: Path, line: PaintedLine, lines: list[PaintedLine], cameras: list[Camera]) -> list:
    """[V] pairs of true and shown width in px; NaN where a line cannot be found."""
    found = []
    for camera in cameras:
        read_at = stations(line, camera, lines)
        true, shown = (
            Sampler.of(np.asarray(Image.open(folder / camera.name).convert("RGB"), np.float64) / 255.0)
            for folder in (sharp, pictures)
        )
        if read_at:
            direction = contrast_direction(true, read_at)
            found.append([line_width(one, read_at, direction).value for one in (true, shown)])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("renders", type=Path, nargs="+")
    options = parser.parse_args()
    lines = read_lines(options.set / "lines.json")
    cameras = list(read_cameras(options.set / "transforms.json").pinholes().values())
    seen = [camera for camera in cameras if all((folder / camera.name).is_file() for folder in options.renders)]
    for folder in (options.set / "photos", *options.renders):
        for line in lines:
            pairs = widths(folder, options.set / "sharp", line, lines, seen)
            if not pairs:
                continue
            true, shown = np.array(pairs).T
            said = f"true {np.nanmean(true):.2f}, shown {np.nanmean(shown):.2f} px"
            ratio = concordance(true.tolist(), shown.tolist())
            print(f"{folder} {line.name}: {len(pairs)} views, {said}, concordance {ratio:.1f}")


if __name__ == "__main__":
    main()
