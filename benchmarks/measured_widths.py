"""Widths of painted lines, measured on twins of a set with lines.json: errors, and how many 95 % intervals hold.

    python -m benchmarks.lined_wall wall.blend
    python run_dgs.py synthesize --scene wall.blend --path scene --views 24 --size 480x320 --overscan 30 --samples 32
        --noise 0.005 --psf gaussian:5 --out SET         (then wall.json is copied to SET/lines.json)
    python run_dgs.py reconstruct SET/photos --cameras SET/transforms.json --psf gaussian:5 --preset draft --out TWIN
    python -m benchmarks.measured_widths SET TWIN [--photos 0 12]

Each line is measured across its middle on each of the photos, as `run_dgs.py measure` does. Both points are set 5 to 10
px beside it, and not quite upright (4 degrees, standard deviation). True widths are those of the geometry.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.evaluation.lines import PaintedLine, read_lines
from dgs.core.formats.cameras import read_cameras
from dgs.core.measure.measured import measure
from dgs.core.measure.rays import projected
from dgs.core.measure.request import AskedMeasure, MeasureRequest
from dgs.core.progress import Silent
from dgs.core.twin.opened import open_twin

BESIDE, ASKEW = (5.0, 10.0), 4.0
#: Narrower lines than this, px, are not among those that 3 % were asked for.
ASKED_FROM = 5.5


def asked(line: PaintedLine, camera: Camera, random: np.random.Generator) -> tuple[AskedMeasure, float]:
    """A width across the middle of a line, and what it truly is, px."""
    at = len(line.points) // 2
    middle, reach = line.points[at], line.width / 2 * line.across[at]
    places = (middle - reach, middle + reach, middle, line.points[at + 1])
    left, right, here, on = (np.array(projected(camera, place)) for place in places)
    along = (on - here) / np.linalg.norm(on - here)
    across = np.array([along[1], -along[0]]) * np.sign((right - left) @ [along[1], -along[0]])
    width = float(abs((right - left) @ across))
    turn = np.radians(random.normal(0.0, ASKEW))
    way = np.cos(turn) * across + np.sin(turn) * along
    before, behind = random.uniform(*BESIDE, 2) + width / 2
    points = tuple((float(x), float(y)) for x, y in (here - before * way, here + behind * way))
    return AskedMeasure(f"{camera.name} {line.name}", "width", (), camera.name, (points[0], points[1])), width


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("twin", type=Path)
    parser.add_argument("--photos", type=int, nargs="+", default=[0, 12], help="numbers of those measured on")
    options = parser.parse_args()
    twin, random = open_twin(options.twin, Silent()), np.random.default_rng(0)
    cameras = list(read_cameras(options.set / "transforms.json").pinholes().values())
    lines, measures, truth = read_lines(options.set / "lines.json"), list[AskedMeasure](), list[float]()
    for photo in options.photos:
        for line in lines:
            one, width = asked(line, cameras[photo], random)
            measures.append(one)
            truth.append(width)
    begun = time.perf_counter()
    found = measure(twin, MeasureRequest({}, tuple(measures), None), 0.0, Silent()).measures
    print(f"{(time.perf_counter() - begun) / len(found):.1f} s each")
    rows = []
    for one, true in zip(found, truth, strict=True):
        said = one.reason if one.value is None else f"{one.value:.2f} +- {one.deviation:.2f} px"
        print(f"{one.name}: {true:.2f} px, {said}")
        if one.value is not None and one.deviation is not None:
            rows.append((one.name.split()[1], true, one.value - true, one.deviation))
    for ground in (*dict.fromkeys(row[0] for row in rows), "all"):
        true, error, deviation = np.array([row[1:] for row in rows if ground in (row[0], "all")]).T
        asked_for = true > ASKED_FROM
        share = np.abs(error / true)
        print(
            f"{ground}: {len(true)} widths, {np.mean(np.abs(error) <= 1.96 * deviation):.1%} of the intervals hold;"
            f" median error {np.median(share):.1%}, from {ASKED_FROM} px on {np.median(share[asked_for]):.1%}"
            f" ({np.mean(share[asked_for] < 0.03):.0%} within 3 %); median deviation {np.median(deviation):.2f} px"
        )


if __name__ == "__main__":
    main()
