"""Meshes of blurred photos' twins beside those of plain splatting, on the blurred and on the sharp photos.

    python -m benchmarks.meshes FOLDER                # what is missing is rendered, trained and measured
    python -m benchmarks.meshes FOLDER --only shelf   # one scene
    python -m benchmarks.meshes FOLDER --table        # what is there already

FOLDER holds sets NAME-0 (sharp) and NAME-5 (blurred by 5 px) of the laboratory's scenes with depth maps, and the twins
of three ways to use them, the balanced preset, cameras given: `ours` (the blur given), `plain` (blurred photos as if
they were sharp), `sharp` (the sharp photos). All go through the same `run_dgs.py mesh`, with each `--matching`; errors
are those of `benchmarks.measured`. Each row is kept in benchmarks/meshes.json as soon as it is there.
"""

from __future__ import annotations

import argparse
import json
from itertools import product
from pathlib import Path
from typing import Any

from .measured import ROOT, Matching, mesh_errors, run_dgs

ROWS = ROOT / "benchmarks" / "meshes.json"
#: How each scene is rendered: path of the cameras, views, samples, and what else.
SCENES = {
    "shelf": ("front", 32, 8, []),
    "orrery": ("dome", 48, 16, ["--background", "transparent"]),
    "village": ("drone", 48, 8, []),
    "rugby-ball": ("patch", 40, 16, []),
}
#: Which photos each way takes, and what it is said of their blur.
WAYS = {"ours": ("5", "gaussian:5"), "plain": ("5", "none"), "sharp": ("0", "none")}
#: Each `--matching` of `mesh`.
MATCHINGS: tuple[Matching, ...] = ("agreed", "filled", "off")


def photos_of(folder: Path, scene: str, sigma: str) -> Path:
    """A set of the scene, rendered if it is not there."""
    out, (path, views, samples, more) = folder / f"{scene}-{sigma}", SCENES[scene]
    if not (out / "depth").is_dir():
        words = ["--scene", scene, "--path", path, "--views", views, "--size", "400x300", "--samples", samples, *more]
        psf = "none" if sigma == "0" else f"gaussian:{sigma}"
        run_dgs("synthesize", "--out", out, *words, "--overscan", 20, "--psf", psf, "--depth")
    return out


def row(folder: Path, scene: str, way: str, matching: Matching) -> dict[str, Any]:
    """Errors of one way's mesh, and how well its twin shows the sharp truth."""
    sigma, psf = WAYS[way]
    photos, twin = photos_of(folder, scene, sigma), folder / "twins" / f"{scene}-{way}"
    if not (twin / "report.json").is_file():
        given = [
            "--cameras",
            photos / "transforms.json",
            "--psf",
            psf,
            "--effects",
            "none",
            "--truth",
            photos / "sharp",
        ]
        run_dgs("reconstruct", photos / "photos", "--out", twin, *given)
    report = json.loads((twin / "report.json").read_text("utf-8"))
    shown = {"psnr": report["heldout"]["sharp"]["psnr"], "gaussians": report["gaussians"]}
    return mesh_errors(photos, twin, matching) | shown


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Markdown."""
    keys = ("mesh median", "within 1 px", "completeness", "F", "psnr")
    out = ["| set | way | matching | " + " | ".join(keys) + " |", "|" + "---|" * (3 + len(keys))]
    for name, found in rows.items():
        out.append(f"| {' | '.join(name.rsplit(' ', 2))} | " + " | ".join(str(found[key]) for key in keys) + " |")
    return "\n".join(out)


def main() -> None:
    """Measures what is missing, prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", metavar="SCENE", choices=tuple(SCENES))
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    rows = json.loads(ROWS.read_text("utf-8")) if ROWS.is_file() else {}
    for scene in options.only or SCENES:
        for way, matching in product(WAYS, MATCHINGS) if not options.table else ():
            name = f"{scene} {way} {matching}"
            if name not in rows:
                rows[name] = row(options.folder, scene, way, matching)
                ROWS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
                print(name, rows[name], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
