"""What is promised about time, against what happened: `python -m benchmarks.time_limits --data FOLDER ...`.

    --limit 25s --limit 45s --seeds 3     runs with these limits; wall clock of the whole command, and PSNR against
                                          the sharp truth of ALL held-out views (the run itself scores what it has
                                          time for)
    --preset draft --preset balanced      runs without a limit; seconds that `estimate` predicted, and taken

A line per run as it ends, then medians. FOLDER holds photos/ (or blur5/) and sharp/.
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
from typing import Any

from .update_twin import score

ROOT = Path(__file__).resolve().parents[1]

RUN = [sys.executable, str(ROOT / "run_dgs.py")]


def photos_of(data: Path) -> Path:
    return data / "photos" if (data / "photos").is_dir() else data / "blur5"


def medium_of(data: Path, psf: str | None) -> list[str]:
    """The set's own point spread, if it says one."""
    stated = data / "psf.json"
    if psf is None and stated.is_file():
        content = json.loads(stated.read_text("utf-8"))
        return ["--psf", str(content["psf"]), "--blur-space", str(content.get("blur_space", "srgb"))]
    return ["--psf", psf or "gaussian:5"]


def run(data: Path, words: list[str], predict: bool) -> dict[str, Any]:
    """One command, from start to end."""
    common = [str(photos_of(data)), *words]
    predicted = None
    if predict:
        medium = words[: words.index("--preset")]
        answer = subprocess.run(
            [*RUN, "estimate", common[0], *medium, "--json"], check=True, capture_output=True, text=True
        )
        predicted = json.loads(answer.stdout)["presets"][words[words.index("--preset") + 1]]["seconds"]
    with tempfile.TemporaryDirectory() as out:
        began = time.perf_counter()
        subprocess.run([*RUN, "reconstruct", *common, "--out", out, "--progress", "none"], check=True)
        wall = time.perf_counter() - began
        report = json.loads((Path(out) / "report.json").read_text("utf-8"))
        psnr = score(Path(out), data / "sharp")
    return {
        "wall": round(wall, 1),
        "predicted": predicted,
        "psnr": round(psnr, 2),
        "steps": report["steps"],
        "gaussians": report["gaussians"],
        "sfm": report["seconds"]["sfm"],
        "train": report["seconds"]["train"],
        "notes": report["notes"],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", required=True)
    parser.add_argument("--limit", action="append", default=[])
    parser.add_argument("--preset", action="append", default=[])
    parser.add_argument("--psf")
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    asked = [("--time-limit", limit) for limit in options.limit] + [("--preset", name) for name in options.preset]
    for data in options.data:
        for kind, value in asked:
            rows = []
            for seed in range(options.seeds):
                words = [*medium_of(data, options.psf), kind, value, *(["--seed", str(seed)] if seed else [])]
                rows.append(run(data, words, kind == "--preset"))
                print(f"{data.name} {value} seed {seed}: {json.dumps(rows[-1])}", flush=True)
            walls, psnrs = [row["wall"] for row in rows], [row["psnr"] for row in rows]
            text = f"{data.name} {kind} {value}: {statistics.median(walls):.1f} s ({min(walls)} to {max(walls)}), "
            text += f"{statistics.median(psnrs):.2f} dB ({min(psnrs)} to {max(psnrs)})"
            if kind == "--preset":
                off = [row["wall"] / row["predicted"]["value"] - 1 for row in rows]
                text += f"; predicted {rows[0]['predicted']['value']} s, off {100 * statistics.median(off):+.0f} %"
            print(text, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
