"""`make paper`: renders the ball, compares all methods on it, and writes docs/paper.md.

    python -m studies.paper [--quick] [--real FOLDER ...] [--seeds 3] [--page FILE]

The ball is benchmarks/data/ball, rows are kept in benchmarks/runs/paper (--quick: all in paper_quick), and
everything is taken up again. The whole takes well over an hour; --quick takes minutes, proves that everything
runs, and writes its page beside its data.
FOLDER is a set of real photos with blur5/ (sigma 5 px) and sharp/.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...core.files import write_text
from ..comparison.commands import Failed, Run, checked
from ..comparison.methods import WIENER_MEASURED
from .page import Chapter, page

ROOT = Path(__file__).resolve().parents[2]

_REAL = (
    "Sharp photos of a camera, blurred virtually by 5 px in sRGB values, cut by 24 px afterwards (so that light from"
    " beyond the border is in them), 8 bit. The reference cameras were found from the sharp photos."
)
#: Who took the photos of a real set, and under which licence its pictures are shown.
_CREDITS = {
    "copr": " Photos: Michele M. Tobias and Alex Mandel (OpenDroneMap, odm_data_copr), CC BY-SA 4.0; the pictures of"
    " this chapter, which are made from them, are under the same licence."
}


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text("utf-8"))


def render_sets(command: Callable[..., None], work: Path, quick: bool) -> tuple[Path, Path]:
    """The ball blurred in sRGB, and from the same frames blurred in linear light.

    The large one is benchmarks/data/ball: what is there of it is not rendered again.
    """
    small = ("--views", 10, "--size", "192x128", "--psf", "gaussian:1.5", "--overscan", 10, "--samples", 4)
    size = small if quick else ("--views", 76, "--size", "800x533", "--psf", "gaussian:5")
    data = work if quick else ROOT / "benchmarks" / "data"
    encoded, linear = data / "ball", data / "ball_linear"
    shared = ("--masks", "--depth", "--keep-linear", *size)
    command("synthesize", "--out", encoded, *shared)
    if not (linear / "manifest.json").is_file() and not (linear / "unfinished.json").is_file():
        shutil.rmtree(linear, ignore_errors=True)
        shutil.copytree(encoded / "linear", linear / "linear")
        shutil.copyfile(encoded / "manifest.json", linear / "manifest.json")  # says that the frames are the same
    command("synthesize", "--out", linear, *shared, "--blur-space", "linear")
    return encoded, linear


def compare(
    command: Callable[..., None], data: Path, out: Path, options: argparse.Namespace, *more: object, few: bool = False
) -> dict[str, Any]:
    """The table of one set, taking up what is there; `few` leaves out Richardson-Lucy and every search."""
    rows = ("plain", "paper", "dgs", WIENER_MEASURED, "oracle")
    only = [word for method in rows for word in ("--only", method)] if few else []
    quick = ("--quick", "--cameras", "known", "--steps", 80) if options.quick else ()
    threads = ("--threads", options.threads) if options.threads else ()
    beside = ("--workers", options.workers) if options.workers and "--mismatch" not in more else ()
    words = ("--seeds", options.seeds, "--resume", *quick, *threads, *beside, *only, *more)
    command("compare", data, "--out", out, *words)
    return read(out / ("mismatch.json" if "--mismatch" in more else "compare.json"))


def pictures(out: Path, page: Path, label: str) -> dict[str, str]:
    """Copies the pictures and movies of a comparison beside the page; title by link."""
    folder = page.parent / "images" / "paper"
    folder.mkdir(parents=True, exist_ok=True)
    links = {}
    for file, title in read(out / "pictures.json").items():
        shutil.copyfile(out / file, folder / f"{label}_{file}")
        links[f"images/paper/{label}_{file}"] = title
    return links


def write(options: argparse.Namespace, command: Callable[..., None]) -> None:
    """All sets, all comparisons, the page."""
    work = ROOT / "benchmarks" / "runs" / ("paper_quick" if options.quick else "paper")
    target = options.page or (work / "paper.md" if options.quick else ROOT / "docs" / "paper.md")
    encoded, linear = render_sets(command, work, options.quick)
    content = compare(command, encoded, work / "compare_ball", options)
    views = "{registered} views".format(**content["facts"])
    main = Chapter(
        f"The ball, {views}",
        "Blurred in sRGB values, 8 bit, as the paper most likely did.",
        content,
        pictures(work / "compare_ball", target, "ball"),
    )
    one_seed = argparse.Namespace(**{**vars(options), "seeds": 1})
    more = [
        Chapter(
            "The same ball, blurred in linear light",
            "As a medium blurs: light, not stored values.",
            compare(command, linear, work / "compare_ball_linear", one_seed, few=True),
        )
    ]
    for folder in options.real:
        out = work / f"compare_{folder.name}"
        real = compare(command, folder, out, options, "--psf", "gaussian:5", few=True)
        words = _REAL + _CREDITS.get(folder.name, "")
        more.append(Chapter(f"Real photos: {folder.name}", words, real, pictures(out, target, folder.name)))
    wrong = compare(command, encoded, work / "compare_ball", one_seed, "--mismatch")
    write_text(target, page(main, more, wrong, options.quick))
    print(f"wrote {target.relative_to(ROOT) if target.is_relative_to(ROOT) else target}")


def main(run: Run) -> int:
    """Reads the arguments of this process; `run` runs our own commands."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.paper", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--real", type=Path, action="append", default=[], metavar="FOLDER")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--workers", type=int, metavar="N", help="trainings at the same time")
    parser.add_argument("--page", type=Path, metavar="FILE", help="docs/paper.md if not given")
    options = parser.parse_args()
    options.seeds = options.seeds or (1 if options.quick else 3)
    options.page = options.page.resolve() if options.page else None
    try:
        write(options, checked(run))
    except Failed as stop:
        return int(stop.args[0])
    return 0
