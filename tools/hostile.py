"""Hostile requests on the command line: every command and option with values and files that nobody means.

    .venv/bin/python -m tools.hostile             # all of them: a line for each that does not end as promised
    .venv/bin/python -m tools.hostile --only psf  # requests with this word
    .venv/bin/python -m tools.hostile --patience 3 --minutes 30  # what can be sent in half an hour, evenly of all

What the requests need is loaded and compiled before the first is sent. A request ends as promised with status 0, with
2 and one line that explains it, or with 130 soon after it was asked to stop (some are right and long); never with
a traceback, "A bug", the process's end or a hang.
What it wrote lies in its own folder, and nothing else has changed.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

#: Values of numeric options.
NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "-1",
    "0",
    "0.5",
    "1e-320",
    "9223372036854775808",
    "9" * 400,
    "",
    "x",
)
NUMBERS += ("\u0663", "1_000", "0x10", " 1", "1e400", "-0", "1,2")
#: Of the files that an option takes; .json if it is not named.
SUFFIXES: dict[object, str] = {"twin": ".ply", "photo": ".png", "out": ".tif", "markdown": ".txt", "photos": ".txt"}
SUFFIXES |= {
    ("reconstruct", "photos"): ".mp4",
    ("blend", "out"): ".blend",
    ("mesh", "out"): ".glb",
    ("inspect", "photos"): ".png",
}
#: Seconds until a request is asked to stop, and those that it then has.
PATIENCE, ENDING = 15.0, 15.0
#: Commands whose right request compiles kernels, and the seconds that each may take for it before the first request.
COMPILING = ("reconstruct", "render", "next-view", "inspect", "estimate", "mesh", "measure", "change")
COMPILATION = 300.0


@dataclass(frozen=True)
class Request:
    """Arguments, and what is hostile in them."""

    name: str
    arguments: list[str]


def main() -> int:
    """Sends all requests; 1 if one does not end as promised."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--only", default="", metavar="WORD", help="requests whose name holds this word")
    add("--patience", type=float, default=PATIENCE, metavar="S", help="until a request is asked to stop; %(default)s")
    add("--minutes", type=float, default=float("inf"), metavar="N", help="no request is sent after them")
    asked = parser.parse_args()
    from dgs.command_line import run  # late: the package is mounted first

    for heavy in (
        "torch",
        "dgs.core.pipeline.reconstruct",
        "dgs.core.pipeline.update",
        "dgs.core.calibration.pictures",
    ):
        importlib.import_module(heavy)  # once, for all requests
    tried, wrong = collections.Counter[str](), collections.Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_files(folder)
        compile_kernels(run, folder)
        requests = [one for one in all_requests(folder) if asked.only in one.name]
        random.Random(0).shuffle(requests)  # (what can be sent in a given time is evenly of all)
        began = time.perf_counter()
        for request in requests:
            if time.perf_counter() - began > 60 * asked.minutes:
                break
            tried[request.arguments[0]] += 1
            fault = fault_of_request(run, request, folder, asked.patience)
            if fault:
                wrong[request.arguments[0]] += 1
                print(f"{request.name}: {' '.join(request.arguments)[:300]!r}\n    {fault}", flush=True)
    for command in sorted(tried):
        print(f"{command}: {tried[command] - wrong[command]} of {tried[command]} ended as promised")
    good, all_tried = tried.total() - wrong.total(), tried.total()
    print(f"{good} of {all_tried} requests ended as promised; {len(requests) - all_tried} were not sent; ", end="")
    print(f"{time.perf_counter() - began:.0f} s")
    return 1 if wrong else 0


def compile_kernels(run: object, folder: Path) -> None:
    """Sends requests that are right, with time: what they compile is kept for all."""
    for command in COMPILING:
        arguments = [command, *valid(folder)[command]]
        for extra in ([], ["--psf", "gaussian:2"]) if command in ("reconstruct", "render") else ([],):
            fault = fault_of_request(run, Request(command, [*arguments, *extra]), folder, COMPILATION)
            if fault:
                print(f"{' '.join(arguments)}: {fault}", flush=True)


def fault_of_request(run: object, request: Request, folder: Path, patience: float = PATIENCE) -> str:
    """How a request failed; '' if it ended as promised."""
    said = folder / "said.txt"
    shutil.rmtree(folder / "out", ignore_errors=True)
    process = os.fork()
    if process == 0:
        _child(run, request, said, folder)
    status = _waited(process, patience)
    if status is None:
        os.killpg(process, signal.SIGINT)
        status = _waited(process, ENDING)
        if status is None:
            os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return f"hangs: {_end(said)}"
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process, signal.SIGKILL)  # whatever children it has left
    words = said.read_text("utf-8", "replace")
    if os.WIFSIGNALED(status):
        return f"ended by signal {os.WTERMSIG(status)}: {_end(said)}"
    code = os.WEXITSTATUS(status)
    if code not in (0, 2, 130) or "Traceback" in words or "A bug" in words or "Warning:" in words:
        return f"status {code}: {_end(said)}"
    errors = [line for line in words.splitlines() if line.strip()]
    if code == 2 and (not errors or len(errors[-1]) < 10):
        return f"status 2 without a reason: {_end(said)}"
    return ""


def _child(run: object, request: Request, said: Path, folder: Path) -> None:
    """Runs a request; never returns."""
    code = 99
    try:
        os.setsid()
        os.chdir(folder / "here")
        output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
        code = run(request.arguments)  # type: ignore[operator]
    except BaseException as error:  # noqa: BLE001  (nothing may come out of it)
        with contextlib.suppress(Exception):
            os.write(2, f"Traceback: {type(error).__name__}: {error}".encode("utf-8", "replace"))
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _waited(process: int, seconds: float) -> int | None:
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        ended, status = os.waitpid(process, os.WNOHANG)
        if ended:
            return status
        time.sleep(0.02)
    return None


def _end(said: Path) -> str:
    lines = [line for line in said.read_text("utf-8", "replace").splitlines() if line.strip()]
    return " | ".join(line.strip()[:200] for line in lines[-3:])


def make_files(folder: Path) -> None:
    """A small set, and files that are none."""
    from dgs.studies.stability.fuzzed_state import write_twin  # late: the package is mounted first

    (folder / "here").mkdir()
    write_twin(folder)
    places = {name: {"photo": "a.png", "at": at} for name, at in (("a", [8, 9]), ("b", [20, 12]))}
    measures = [{"name": "edge", "kind": "length", "of": ["a", "b"]}]
    (folder / "points.json").write_text(json.dumps({"places": places, "measures": measures}))
    for index in range(2, 5):
        pixels = np.random.default_rng(index).integers(0, 255, (30, 40, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / "photos" / f"{index}.png")
    shutil.copytree(folder / "photos", folder / "sharp")
    bad = folder / "bad"
    bad.mkdir()
    (bad / "empty").write_bytes(b"")
    for suffix in (
        ".ply",
        ".txt",
        ".json",
        ".png",
        ".npy",
        ".tif",
        ".mp4",
        ".glb",
        ".spz",
        ".splat",
        ".blend",
        ".fits",
    ):
        (bad / f"empty{suffix}").write_bytes(b"")
        (bad / f"noise{suffix}").write_bytes(np.random.default_rng(0).bytes(3000))
        (bad / f"folder{suffix}").mkdir()
        (bad / f"loop{suffix}").symlink_to(f"loop{suffix}")
        (bad / f"gone{suffix}").symlink_to("nowhere")
        (bad / f"zero{suffix}").symlink_to("/dev/zero")
        os.mkfifo(bad / f"fifo{suffix}")
    (bad / "folder").mkdir()
    (bad / "loop").symlink_to("loop")
    os.mkfifo(bad / "fifo")
    (bad / "inside").mkdir()
    (bad / "inside" / "again").symlink_to("..")
    photos = bad / "photos"
    photos.mkdir()
    for name, target in (("loop.png", "loop.png"), ("zero.png", "/dev/zero"), ("gone.jpg", "nowhere")):
        (photos / name).symlink_to(target)
    os.mkfifo(photos / "fifo.png")
    (photos / "folder.png").mkdir()
    (photos / "empty.png").write_bytes(b"")


def bad_paths(folder: Path) -> Iterator[tuple[str, str]]:
    """Files and folders that are none, by what is wrong with them."""
    for path in sorted((folder / "bad").iterdir()):
        yield path.name, str(path)
    long = str(folder / ("a" * 300))
    yield from (("long name", long), ("long name.json", f"{long}.json"), ("long path", "a/" * 3000), ("no name", ""))
    yield from (("device", "/dev/zero"), ("null", "/dev/null"), ("standard input", "/dev/stdin"), ("dash", "-"))
    yield from (("below a file", str(folder / "bad" / "empty" / "x")), ("here", "."), ("above", ".."))
    yield from (
        ("process", "/proc/self/mem"),
        ("home", "~"),
        ("blank", " "),
        ("newline", "a\nb"),
        ("no text", "a\udcff"),
    )


def valid(folder: Path) -> dict[str, list[str]]:
    """For each command a request that would run."""
    twin, photos, out = str(folder / "twin"), str(folder / "photos"), str(folder / "out")
    ply, cameras = str(folder / "twin" / "twin.ply"), str(folder / "twin" / "cameras")
    return {
        "reconstruct": [photos, "--out", out, "--cameras", cameras, "--preset", "draft"],
        "batch": [photos, "--out", out, "--cameras", cameras, "--preset", "draft"],
        "cameras": [photos, "--out", out],
        "render": [ply, "--cameras", cameras, "--out", out],
        "doctor": [],
        "stress": ["--only", "half a circle"],
        "blend": [ply, "--out", str(folder / "out" / "a.blend")],
        "synthesize": ["--views", "2", "--samples", "1", "--size", "16x16", "--out", out],
        "compare": [str(folder), "--out", out, "--cameras", cameras, "--psf", "gaussian:1", "--quick"],
        "inspect": [photos],
        "estimate": [photos],
        "tradeoff": [str(folder), "--out", out, "--cameras", cameras, "--psf", "gaussian:1", "--quick"],
        "measure-psf": [str(folder / "photos" / "a.png"), "--out", str(folder / "out" / "k.tif")],
        "measure-glass": [str(folder / "photos" / "a.png"), "--distances", "1", "--focal", "480"],
        "next-view": [twin],
        "update": [twin, photos],
        "measure": [twin, str(folder / "points.json")],
        "board": ["aruco:40mm", "--out", str(folder / "out" / "board.png")],
        "mesh": [twin, "--out", str(folder / "out" / "a.glb")],
        "change": [twin, twin, "--out", out],
        "serve": [],
    }


def all_requests(folder: Path) -> Iterator[Request]:
    """Every option of every command with every hostile value of its kind."""
    from dgs.command_line.table import COMMANDS  # late: the package is mounted first

    paths = list(bad_paths(folder))
    for command in COMMANDS:
        parser = argparse.ArgumentParser()
        command.add_arguments(parser)
        base = valid(folder)[command.name]
        for action in parser._actions:
            label = action.option_strings[-1] if action.option_strings else action.dest
            if action.nargs == 0:
                continue
            values = [(f"number {n[:20]}", n) for n in NUMBERS] if action.type not in (None, Path) else []
            if action.type is Path:
                own = SUFFIXES.get((command.name, action.dest)) or SUFFIXES.get(action.dest, ".json")
                values = [(name, path) for name, path in paths if "." not in name or name.endswith(own)]
            elif action.type is None and not action.choices:
                values = [*((f"number {n[:20]}", n) for n in NUMBERS), *paths[:10]]
                values += [(f"text {t[:20]}", t) for t in texts(folder)]
            for what, value in values:
                yield Request(f"{command.name} {label} {what}", [command.name, *replaced(base, action, label, value)])


def replaced(base: list[str], action: argparse.Action, label: str, value: str) -> list[str]:
    """A request with another value of one argument."""
    if action.option_strings:
        kept = list(base)
        if label in kept:
            at = kept.index(label)
            del kept[at : at + 2]
        return [*kept, f"{label}={value}"]
    rest = base[1:] if action.dest != "photos" or len(base) < 2 or base[1].startswith("-") else [base[0], *base[2:]]
    return [value, *rest] if rest == base[1:] else [base[0], value, *rest[1:]]


def texts(folder: Path) -> list[str]:
    """Texts for options that take one, such as a point spread."""
    bad = folder / "bad"
    return [
        *("gaussian:1e9", "gaussian:-1", "gaussian:nan", "gaussian:1,2", "gaussian:0", "gaussian:1e-300", "gaussian:"),
        *("path:1e9,0", "path:nan,1", "path:-1,0", "gaussian:3" + "+path:2,0" * 2000, "gaussian:999+path:500,1"),
        *(
            f"file:{bad / name}"
            for name in ("zero.npy", "fifo.npy", "folder.png", "loop.tif", "noise.fits", "empty.npy")
        ),
        *(f"per-photo:{bad / name}" for name in ("zero.json", "fifo.json", "folder.json", "noise.json", "empty.json")),
        *("per-photo:", "file:", "auto", "auto-each", "all,all", "-motion", "a,,b", "none,none", "rail", "dome"),
    ]


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from run_dgs import mount_package

    mount_package()
    sys.exit(main())
