"""What `--effects auto` calls needed and simulates on twenty sharp sets that the laboratory renders: nothing should be.

    python -m benchmarks.rendered_alarms [--only NAME ...]

Each set is rendered once (benchmarks/data/alarms), then given to the product as a user gives it, `reconstruct PHOTOS
--effects auto`: trials are no longer than the training, so that it is the usual one. Writes
benchmarks/rendered_alarms.json and the table between the markers in docs/studies/effects.md. Resumable: sets that the
same engine has decided on are kept.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dgs.studies.benchmark.runs import engine

from .false_alarms import ALARMS

ROOT = Path(__file__).resolve().parents[1]
SETS = ROOT / "benchmarks/data/alarms"
FIRST, LAST = "<!-- rendered sharp sets -->", "<!-- end of rendered sharp sets -->"


@dataclass(frozen=True)
class SharpSet:
    """One set; nothing blurs it.

    Attributes:
        scene, path, background: of `synthesize`; given: whether the true cameras are, else they are found.
        camera: what a camera does to sharp photos as well, as words of `synthesize`.
    """

    scene: str
    path: str
    given: bool = False
    background: str = "scene"
    camera: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Also that of its folder."""
        marks = [word.strip("-") for word in self.camera if word.startswith("--")]
        return "-".join([self.scene, self.path, *([] if self.background == "scene" else [self.background]), *marks])


_NOISE = ("--noise", "0.01")
_JPEG = ("--jpeg", "85")
_DRIFT = ("--exposure-drift", "0.3")

SHARP_SETS = (
    SharpSet("rugby-ball", "rail"),
    SharpSet("rugby-ball", "patch", camera=_NOISE),
    SharpSet("rugby-ball", "orbit", given=True),
    SharpSet("orrery", "front", given=True),
    SharpSet("orrery", "patch", given=True, camera=_JPEG),
    SharpSet("orrery", "dome", given=True, background="transparent"),
    SharpSet("orrery", "spiral", given=True, camera=_DRIFT),
    SharpSet("plant", "front", given=True),
    SharpSet("plant", "patch", camera=(*_NOISE, *_JPEG)),
    SharpSet("plant", "dome", given=True, background="white"),
    SharpSet("plant", "orbit", given=True),
    SharpSet("room", "inside"),
    SharpSet("room", "inside", given=True, camera=(*_NOISE, *_DRIFT)),
    SharpSet("room", "front", camera=_JPEG),
    SharpSet("shelf", "front"),
    SharpSet("shelf", "patch", camera=_NOISE),
    SharpSet("shelf", "front", camera=(*_JPEG, *_DRIFT)),
    SharpSet("village", "drone"),
    SharpSet("village", "drone", camera=(*_NOISE, *_JPEG)),
    SharpSet("village", "spiral", given=True),
)


def _command(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "run_dgs.py"), *words, "--progress", "none"], capture_output=True, text=True
    )


def decided(sharp: SharpSet, folder: Path) -> dict[str, Any]:
    """What the product decides on a set, rendered if it is not there."""
    words = ["--scene", sharp.scene, "--path", sharp.path, "--background", sharp.background, "--psf", "none"]
    words += ["--views", "20", "--size", "320x240", "--samples", "8", "--overscan", "0", *sharp.camera]
    rendered = _command("synthesize", "--out", str(folder), *words)
    if rendered.returncode != 0:
        return {"failed": rendered.stderr[-400:]}
    twin = folder / "twin"
    shutil.rmtree(twin, ignore_errors=True)
    run = ["reconstruct", str(folder / "photos"), "--out", str(twin), "--effects", "auto"]
    run += ["--cameras", str(folder / "transforms.json")] if sharp.given else []
    trained = _command(*run)
    if trained.returncode != 0:
        return {"failed": trained.stderr[-400:]}
    report = json.loads((twin / "report.json").read_text())
    effects = report["effects"]
    return {
        "cameras": "given" if sharp.given else f"found: {report['photos']['registered']}",
        "called": [e["name"] for e in effects if e["evidence"] and e["evidence"]["needed"]],
        "simulated": [e["name"] for e in effects if e["on"]],
        "trials": {e["name"]: [e["gain_db"], e["gain_error_db"]] for e in effects if e["gain_db"] is not None},
        "seconds": report["seconds"]["effects"],
    }


def kept(sharp: SharpSet) -> dict[str, Any]:
    """The set's row, of this engine."""
    folder = SETS / sharp.name
    file = folder.with_suffix(".json")
    if file.is_file():
        row = json.loads(file.read_text())
        if row["engine"] == engine() and "failed" not in row:
            return dict(row)
    row = {"engine": engine(), **decided(sharp, folder)}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(row, indent=1) + "\n")
    return row


def _alarms(names: list[str]) -> list[str]:
    return [name for name in names if name in ALARMS or name in ("glass", "kernels")]


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Markdown."""
    whole = {name: row for name, row in rows.items() if "failed" not in row}
    called = sum(bool(_alarms(row["called"])) for row in whole.values())
    simulated = sum(bool(_alarms(row["simulated"])) for row in whole.values())
    lines = [
        f"{len(whole)} sharp sets: a blur, haze, glass, defocus or motion is called needed in {called}, and simulated "
        f"in {simulated}.",
        "",
        "| sharp photos, 20 of 320 x 240 px | cameras | false calls | simulated | trials, dB | s |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        if "failed" in row:
            lines.append(f"| {name} | failed | | | | |")
            continue
        trials = ", ".join(f"{n} {gain:+.2f} +- {error:.2f}" for n, (gain, error) in row["trials"].items())
        calls, on = _alarms(row["called"]), row["simulated"]
        shown = ", ".join(f"**{n}**" if n in _alarms(on) else n for n in on)
        lines.append(
            f"| {name} | {row['cameras']} | {', '.join(f'**{n}**' for n in calls) or 'none'} | {shown or 'nothing'} | "
            f"{trials or 'none'} | {row['seconds']:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Renders, decides, and writes the table where all sets have been decided on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="NAME")
    options = parser.parse_args()
    rows = {}
    for sharp in SHARP_SETS:
        if options.only and sharp.name not in options.only:
            continue
        rows[sharp.name] = row = kept(sharp)
        print(sharp.name, {key: value for key, value in row.items() if key != "engine"}, flush=True)
    text = table(rows)
    print(text)
    if len(rows) < len(SHARP_SETS):
        return
    (ROOT / "benchmarks/rendered_alarms.json").write_text(json.dumps(rows, indent=1) + "\n")
    page = ROOT / "docs/studies/effects.md"
    head, _, rest = page.read_text().partition(FIRST)
    page.write_text(f"{head}{FIRST}\n{text}\n{LAST}{rest.partition(LAST)[2]}")


if __name__ == "__main__":
    main()
