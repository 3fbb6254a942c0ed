"""The whole way in one go: render blurred photos of a ball, reconstruct it, write a .blend.

Every step is a command that a user could type; each is skipped where its result is there already.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUT = Path("demo_output")
SET, TWIN = OUT / "photos_of_a_ball", OUT / "twin"
BLEND = OUT / "twin.blend"

#: A rail of 20 views at 480x320; sigma 3 px there is what 5 px are at 800x533.
PSF = "gaussian:3"
SYNTHESIZE = ["synthesize", "--out", str(SET), "--views", "20", "--size", "480x320", "--psf", PSF]
RECONSTRUCT = [
    "reconstruct",
    str(SET / "photos"),
    "--out",
    str(TWIN),
    "--psf",
    PSF,
    "--truth",
    str(SET / "sharp"),
    "--time-limit",
    "90s",
]
BLENDER = [
    "blend",
    str(TWIN / "twin.ply"),
    "--cameras",
    str(TWIN / "cameras"),
    "--photos",
    str(SET / "photos"),
    "--out",
    str(BLEND),
]


def run(title: str, arguments: list[str]) -> None:
    """Runs one command of run_dgs.py in a process of its own, and ends the demo if it fails."""
    print(f"\n== {title}\n$ run_dgs.py {shlex.join(arguments)}", flush=True)
    began = time.perf_counter()
    code = subprocess.run([sys.executable, "run_dgs.py", *arguments], cwd=ROOT, check=False).returncode
    if code < 0:
        print(
            f"Signal {-code} ended it. What its libraries said is in the newest dgs-*.log in {tempfile.gettempdir()}.",
            file=sys.stderr,
        )
        sys.exit(128 - code)
    if code:
        sys.exit(code)
    print(f"({time.perf_counter() - began:.0f} s)", flush=True)


def report() -> dict[str, Any]:
    """The figures of a finished reconstruction made with these very settings; empty if there is none."""
    path = ROOT / TWIN / "report.json"
    if not path.is_file() or not (ROOT / TWIN / "twin.ply").is_file():
        return {}
    figures = json.loads(path.read_text("utf-8"))
    # Another version of this file may have made it in another way.
    made_with = ROOT / OUT / "command.json"
    same = made_with.is_file() and json.loads(made_with.read_text("utf-8")) == [SYNTHESIZE, RECONSTRUCT]
    return figures if same and figures["status"] != "cancelled" else {}


def main() -> int:
    """Runs what is not there yet and names every result."""
    began = time.perf_counter()
    (ROOT / OUT).mkdir(exist_ok=True)
    figures = report()
    if figures:
        print("The twin is there already; delete demo_output to make it again.")
    else:
        shutil.rmtree(ROOT / TWIN, ignore_errors=True)
        (ROOT / BLEND).unlink(missing_ok=True)
        run("Rendering 20 photos of a ball with Blender, through a medium that blurs", SYNTHESIZE)
        run("Reconstructing the ball from the blurred photos", RECONSTRUCT)
        (ROOT / OUT / "command.json").write_text(json.dumps([SYNTHESIZE, RECONSTRUCT]), "utf-8")
        figures = report()
    if not (ROOT / BLEND).is_file():
        run("Writing a Blender scene", BLENDER)
    show(figures, time.perf_counter() - began)
    return 0


def show(figures: dict[str, Any], seconds: float) -> None:
    """Names the results and says how good they are."""
    sharp = figures["heldout"]["sharp"]
    print(f"\n== Done in {seconds:.0f} s")
    if sharp["psnr"] is not None:
        print(
            f"{len(figures['heldout']['names'])} held-out views against the sharp truth: "
            f"PSNR {sharp['psnr']:.2f} dB, SSIM {sharp['ssim']:.3f}"
        )
    for what, path in (
        ("report", TWIN / "report.html"),
        ("blurred photos", SET / "photos"),
        ("sharp renders", TWIN / "renders"),
        ("twin (any 3DGS viewer)", TWIN / "twin.ply"),
        ("Blender scene", BLEND),
    ):
        print(f"{what:>24}  {path}")


if __name__ == "__main__":
    sys.exit(main())
