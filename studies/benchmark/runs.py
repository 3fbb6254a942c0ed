"""One run of the product for each scene and each effort, its figures kept on disk and taken up again."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.effort.clock import OthersLoad
from ...core.errors import DgsError
from ...core.files import make_folder, read_json, write_json
from ...core.photos.load import photo_files
from .scenes import BenchmarkScene
from .sets import PreparedSet

ROOT = Path(__file__).resolve().parents[2]
#: Of a row that could not be had: which line of what the command said is kept.
_LAST = -1

#: One line of results: plain names, as they are kept on disk.
Row = dict[str, Any]


@dataclass(frozen=True)
class Effort:
    """How much time a run gets.

    Attributes:
        name: column of the table; words: of `reconstruct`.
    """

    name: str
    words: tuple[str, ...]


def preset(name: str) -> Effort:
    """A preset of `reconstruct`."""
    return Effort(name, ("--preset", name))


def minutes(count: float) -> Effort:
    """A time limit."""
    return Effort(f"{count:g} min", ("--time-limit", f"{60 * count:g}s"))


@dataclass(frozen=True)
class Bench:
    """Where rows are, and how runs are started.

    Attributes:
        out: folder of rows and twins.
        threads: of each run, None for all cores.
        again: rows of another engine are run again.
    """

    out: Path
    threads: int | None = None
    again: bool = False

    def row(self, scene: BenchmarkScene, effort: Effort, data: PreparedSet) -> Row:
        """The row that is there, or a new run's."""
        words = [*data.words(), *effort.words]
        words += [] if self.threads is None else ["--threads", str(self.threads)]
        twin = self.twin(scene.name, effort.name)
        file = self.out / "rows" / f"{twin.name}.json"
        key = _key(words, data.photos)
        there = kept(file, key)
        if there is not None and not (self.again and there["engine"] != engine()):
            return there
        make_folder(self.out / "rows")
        row = {
            "scene": scene.name,
            "part": scene.part,
            "kind": scene.kind,
            "cameras": scene.cameras,
            "psf": data.psf,
            "effort": effort.name,
            "key": key,
            "engine": engine(),
            "at": time.strftime("%Y-%m-%d %H:%M"),
            **_run(words, twin, file.with_suffix(".log")),
        }
        write_json(file, row)
        return row

    def twin(self, scene: str, effort: str) -> Path:
        """Folder of a run's twin."""
        return self.out / "twins" / f"{scene}_{effort.replace(' ', '_')}"

    def rows(self, scenes: Sequence[str], published: Sequence[Row] = ()) -> list[Row]:
        """All rows that are there, scene by scene in this order.

        Args:
            published: rows of the page so far, which stay where this folder has none: a fresh clone has no folder.
        """
        files = sorted((self.out / "rows").glob("*.json"))
        found = {(row["scene"], row["effort"]): row for row in [*published, *(read_json(file) for file in files)]}
        known = [row for row in found.values() if row["scene"] in scenes]
        return sorted(known, key=lambda row: scenes.index(row["scene"]))


def kept(file: Path, key: str) -> Row | None:
    """A row on disk, if it is whole and of the same words."""
    try:
        row = read_json(file)
    except (FileNotFoundError, ValueError):
        return None
    return row if isinstance(row, dict) and row.get("key") == key else None


def _key(words: list[str], photos: Path) -> str:
    """Of a command and its photos; folders count by their names only, so that a clone may be moved."""
    plain = [Path(word).name if os.sep in word else word for word in words]
    digest = hashlib.sha256(json.dumps(plain).encode())
    for file in photo_files(photos):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def engine() -> str:
    """Identifies what computes: the digest of all sources of core/."""
    digest = hashlib.sha256()
    for file in sorted((ROOT / "core").rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _run(words: list[str], out: Path, log: Path) -> Row:
    """A process of its own, as a user starts it; a failure is a row, too."""
    command = [sys.executable, str(ROOT / "run_dgs.py"), "reconstruct", *words, "--out", str(out)]
    load, began = OthersLoad(), time.perf_counter()
    done = subprocess.run(
        [*command, "--overwrite", "--progress", "none"], capture_output=True, text=True, errors="replace", check=False
    )
    wall = round(time.perf_counter() - began, 1)
    log.write_text(done.stdout + done.stderr, "utf-8")
    if done.returncode:
        said = (done.stderr.strip() or "no word").splitlines()[_LAST]
        return {"failed": said, "wall": wall}
    others = load.share()
    try:
        found = figures(read_json(out / "report.json"))
    except DgsError as error:  # no held-out photo got a camera
        return {"failed": error.what, "wall": wall}
    return {"failed": "", "wall": wall, "others": None if others is None else round(others, 2), **found}


def figures(report: Mapping[str, Any]) -> Row:
    """What a row has of report.json.

    Raises:
        DgsError: no held-out view was scored.
    """
    held = report["heldout"]
    views = {view["name"]: (view["sharp"] or view["degraded"])["psnr"] for view in held["views"]}
    if not views:
        raise DgsError("No held-out view was scored", "Give the run more time")
    worst = min(views, key=lambda name: views[name])
    scores = held["sharp"] if held["sharp"]["psnr"] is not None else held["degraded"]
    return {
        "photos": report["photos"]["given"],
        "registered": report["photos"]["registered"],
        "size": report["photos"]["size"],
        "psnr": round(scores["psnr"], 3),
        "ssim": round(scores["ssim"], 4),
        "psnr_halves": held["degraded"]["psnr_halves"],
        "worst": {"name": worst, "psnr": round(views[worst], 3)},
        "views": {name: round(value, 3) for name, value in views.items()},
        "unscored": len(held["names"]) - len(views),
        "level": report["verdict"]["level"],
        "verdict": report["verdict"]["sentence"],
        "explained": [_explained(report["verdict"][which]) for which in ("unseen", "fitted")],
        "worst_words": report["verdict"]["views"],
        "status": report["status"],
        "seconds": round(report["seconds"]["total"], 1),
        "train": report["seconds"]["train"],
        "gaussians": report["gaussians"],
        "steps": report["steps"],
        "peak_memory_mb": report["peak_memory_mb"],
        "sh_degree": report["settings"]["training"]["sh_degree"],
        "machine": {key: report["machine"].get(key) for key in ("processor", "cores", "threads", "device")},
    }


def _explained(left: float | None) -> float | None:
    """Share of the photos' variance in %, of the share that the twin leaves unexplained."""
    return None if left is None else round(100.0 * (1.0 - left), 2)
