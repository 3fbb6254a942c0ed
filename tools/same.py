#!/usr/bin/env python3
"""Proves that a change of the code changed no result: the same twins, to the bit, as an earlier commit's.

    .venv/bin/python tools/same.py [--against COMMIT] [--only NAME ...] [--work FOLDER]

Fixed runs on photos that this file makes itself (a textured ball on a textured table, traced with numpy), with the
code of the earlier commit (in a worktree of its own) and with the code here, on this machine: blurred, plain, with two
effects, with motion, with cameras found from the photos and the blur estimated, with refined cameras, an update, the
next view. Twins, cameras, renders and checkpoints must be identical to the bit, and so must every figure of the
reports but times and memory. Digests would not do: processors and libraries differ in their last bits.

The earlier commit is named in tools/same_reference.txt; a change that is meant to change twins moves it there, and says
why. Its results are kept in the work folder, so that only the first call runs them.

What differs is run again, with the code here and, if that says the same twice, with the earlier code: where one of them
differs from itself, it is not the change that made the difference, and the run is called unsteady. Status 0: all the
same, or unsteady.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter, uniform_filter1d

ROOT = Path(__file__).resolve().parent.parent
REFERENCE = ROOT / "tools" / "same_reference.txt"
WIDTH, HEIGHT, FOCAL = 240, 160, 260.0
VIEWS, NEW = 12, 2
#: Parts of reports that differ from run to run whatever the code does, and what only this tool's folders name.
UNLIKE = {
    "seconds",
    "machine",
    "memory",
    "peak_memory_mb",
    "predicted",
    "versions",
    "software",
    "folder",
    "out",
    "photos",
    "path",
}
#: The array of a checkpoint that holds text (and times) as bytes.
FACTS = "__facts__"
#: Files that must be identical to the bit.
EXACT = ("*.ply", "*.npy", "*.bin", "cameras/*.txt", "renders/*.png", "again/*.png")


@dataclass(frozen=True)
class Run:
    """One fixed run.

    Attributes:
        name: of its folder.
        photos: which set it reads.
        options: of `reconstruct`.
        then: further commands on its twin.
    """

    name: str
    photos: str
    options: tuple[str, ...]
    then: tuple[tuple[str, ...], ...] = ()


CAMERAS = ("--cameras", "{data}/model")
RUNS = (
    Run("plain", "sharp", (*CAMERAS, "--psf", "none")),
    Run(
        "blurred",
        "blurred",
        (*CAMERAS, "--psf", "gaussian:2", "--max-gaussians", "4000", "--truth", "{data}/sharp"),
        (
            ("render", "{twin}/twin.ply", "--cameras", "{twin}/cameras", "--out", "{twin}/again"),
            ("update", "{twin}", "{data}/new"),
            ("next-view", "{twin}", "--samples", "2"),
        ),
    ),
    Run("effects", "hazy", (*CAMERAS, "--psf", "gaussian:2", "--blur-space", "linear", "--effects", "haze,vignetting")),
    Run("motion", "shaken", (*CAMERAS, "--psf", "none", "--effects", "auto,motion,-defocus")),
    Run("found", "blurred", ("--psf", "auto", "--refine-cameras", "--sh-degree", "2")),
    Run("paper", "blurred", (*CAMERAS, "--psf", "gaussian:2", "--loss", "paper", "--sh-degree", "0")),
)


def noise(points: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """[M] smooth random values in [0, 1] at [M, 3] points: four octaves on a hashed lattice."""
    random = np.random.default_rng(seed)
    table = random.random(4096)
    total, weight = np.zeros(len(points)), 0.0
    for octave in range(4):
        p = points * 3.0 * 2**octave + 17.0 * octave
        cell = np.floor(p).astype(np.int64)
        f = p - cell
        f = f * f * (3 - 2 * f)
        value = np.zeros(len(points))
        for corner in range(8):
            offset = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
            key = (cell + offset) @ np.array([73856093, 19349663, 83492791]) % 4096
            value += table[key] * np.where(offset == 1, f, 1 - f).prod(axis=1)
        total += value * 0.7**octave
        weight += 0.7**octave
    return total / weight


def colour(points: NDArray[np.float64], ball: NDArray[np.bool_]) -> NDArray[np.float64]:
    """[M, 3] sRGB of surface points."""
    shades = np.stack([noise(points + 5.0 * c, 11 + c) for c in range(3)], axis=1)
    shades = np.clip(0.5 + 1.8 * (shades - 0.5), 0.02, 0.98)
    return np.where(ball[:, None], shades * [0.9, 0.6, 0.4], shades * [0.5, 0.7, 0.8])


def hit(origin: NDArray[np.float64], rays: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Where rays [M, 3] meet the ball (radius 0.5) or the table (y = 0.5), and whether it is the ball."""
    b = rays @ origin
    a = (rays * rays).sum(axis=1)
    root = b * b - a * (origin @ origin - 0.25)
    ball = root > 0
    t_ball = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    t_table = (0.5 - origin[1]) / np.where(rays[:, 1] > 1e-3, rays[:, 1], 1e-3)
    t = np.where(ball & (t_ball < t_table), t_ball, np.minimum(t_table, 30.0))
    return origin + t[:, None] * rays, ball & (t_ball < t_table)


def pose(index: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation (world to camera) and centre of a camera on an arc around the ball."""
    turn, tilt = np.deg2rad(-28.0 + 5.0 * index), np.deg2rad(28.0 + 5.0 * np.sin(1.7 * index))
    centre = 2.6 * np.array([np.sin(turn) * np.cos(tilt), -np.sin(tilt), -np.cos(turn) * np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward]), centre


def traced(index: float, margin: int) -> NDArray[np.float64]:
    """[H + 2 margin, W + 2 margin, 3] sRGB, 2 x 2 rays a px."""
    rotation, centre = pose(index)
    x = (np.arange(2 * (WIDTH + 2 * margin)) + 0.5) / 2 - margin
    y = (np.arange(2 * (HEIGHT + 2 * margin)) + 0.5) / 2 - margin
    u, v = np.meshgrid((x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL)
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1) @ rotation
    points, ball = hit(centre, rays)
    shades = colour(points, ball).reshape(len(y) // 2, 2, len(x) // 2, 2, 3)
    return np.asarray(shades.mean(axis=(1, 3)))


def make_photos(data: Path) -> None:
    """The sets that the runs read, and the cameras as a COLMAP text model."""
    margin = 16
    crop = np.s_[margin:-margin, margin:-margin]
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    radius2 = ((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / (WIDTH**2 + HEIGHT**2) * 4
    for index in range(VIEWS + NEW):
        name, full = f"{index:02d}.png", traced(float(index), margin)
        blurred = gaussian_filter(full, (2, 2, 0))[crop]
        sets = {"sharp": full[crop], "blurred": blurred}
        sets["hazy"] = (0.75 * blurred + 0.25 * 0.8) * (1 - 0.3 * radius2)[..., None]
        sets["shaken"] = uniform_filter1d(full, 5 + 2 * (index % 3), axis=index % 2)[crop]
        if index >= VIEWS:
            sets = {"new": blurred}
        for folder, image in sets.items():
            (data / folder).mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)).save(data / folder / name)
    write_model(data / "model")


def write_model(folder: Path) -> None:
    """cameras.txt, images.txt and points3D.txt."""
    folder.mkdir(parents=True)
    (folder / "cameras.txt").write_text(f"1 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n")
    lines = []
    for index in range(VIEWS):
        rotation, centre = pose(float(index))
        w = 0.5 * np.sqrt(max(1e-12, 1 + np.trace(rotation)))
        skew = rotation - rotation.T
        q = (w, skew[2, 1] / (4 * w), skew[0, 2] / (4 * w), skew[1, 0] / (4 * w))
        values = " ".join(repr(float(value)) for value in (*q, *(-rotation @ centre)))
        lines.append(f"{index + 1} {values} 1 {index:02d}.png\n\n")
    (folder / "images.txt").write_text("".join(lines))
    random = np.random.default_rng(3)
    rays = np.concatenate([random.uniform(-0.4, 0.4, (1500, 2)), np.ones((1500, 1))], axis=1)
    rotation, centre = pose(VIEWS / 2)
    points, ball = hit(centre, rays @ rotation)
    rgb = np.round(colour(points, ball) * 255).astype(int)
    rows = [
        f"{i + 1} {p[0]!r} {p[1]!r} {p[2]!r} {c[0]} {c[1]} {c[2]} 0.5\n"
        for i, (p, c) in enumerate(zip(points.tolist(), rgb.tolist(), strict=True))
    ]
    (folder / "points3D.txt").write_text("".join(rows))


def perform(tree: Path, run: Run, data: Path, twin: Path) -> None:
    """One run with the code of `tree`; its folder is begun anew."""
    shutil.rmtree(twin, ignore_errors=True)
    fill: Callable[[str], str] = lambda text: text.format(data=data, twin=twin)  # noqa: E731
    first = (
        "reconstruct",
        str(data / run.photos),
        "--out",
        str(twin),
        *run.options,
        "--preset",
        "draft",
        "--seed",
        "7",
    )
    environment = {**os.environ, "OMP_WAIT_POLICY": "passive"}
    for command in (first, *run.then):
        words = [sys.executable, str(tree / "run_dgs.py"), *map(fill, command), "--threads", "2", "--progress", "none"]
        done = subprocess.run(words, env=environment, cwd=tree, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(
                f"{run.name}: '{' '.join(map(fill, command))}' ended with {done.returncode}\n{done.stderr[-3000:]}"
            )


def plain(value: Any) -> Any:
    """A report without what is unlike from run to run."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items() if key not in UNLIKE and "seconds" not in key}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value


def differing(old: Any, new: Any, where: str = "") -> list[str]:
    """Where two reports differ; what only the new one has is no difference."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [line for key in old for line in differing(old[key], new.get(key, "missing"), f"{where}.{key}")]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [
            line for i, (a, b) in enumerate(zip(old, new, strict=True)) for line in differing(a, b, f"{where}[{i}]")
        ]
    if isinstance(old, str) and isinstance(new, str):
        return []  # words may be mended
    return [] if old == new or (old != old and new != new) else [f"{where}: {old} -> {new}"]


def differences(old: Path, new: Path) -> list[str]:
    """What differs between two folders of one run."""
    found: list[str] = []
    names = {file.relative_to(old) for pattern in EXACT for file in old.rglob(pattern)}
    for name in sorted(names):
        if not (new / name).is_file():
            found.append(f"{name} is missing")
        elif digest(old / name) != digest(new / name):
            found.append(f"{name} differs")
    for name in sorted(file.relative_to(old) for file in old.rglob("*.npz")):
        found += [f"{name}: {key} differs" for key in unlike_arrays(old / name, new / name)]
    for name in ("report.json", "update.json", "next_views.json"):
        if (old / name).is_file():
            if not (new / name).is_file():
                found.append(f"{name} is missing")
                continue
            read = [plain(json.loads((folder / name).read_text("utf-8"))) for folder in (old, new)]
            found += [f"{name}{line}" for line in differing(*read)]
    return found


def digest(file: Path) -> str:
    """Of a file's content."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def unlike_arrays(old: Path, new: Path) -> list[str]:
    """Names of numeric arrays that differ between two .npz files."""
    if not new.is_file():
        return ["(the file is missing, so every array)"]
    with np.load(old) as a, np.load(new) as b:
        numeric = [key for key in a.files if a[key].dtype.kind in "fiub" and a[key].ndim > 0 and key != FACTS]
        return [key for key in numeric if key not in b.files or not same_array(a[key], b[key])]


def same_array(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Equal to the bit, type and shape included."""
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def earlier_tree(commit: str, work: Path) -> Path:
    """A checkout of the earlier commit, in the work folder."""
    tree = work / f"tree-{commit}"
    if not (tree / "run_dgs.py").is_file():
        tree.mkdir(parents=True, exist_ok=True)
        archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=False)
        if archive.returncode:
            sys.exit(f"'{commit}' is no commit of this clone: {archive.stderr.decode().strip()}")
        subprocess.run(["tar", "-x", "-C", str(tree)], input=archive.stdout, check=True)
    return tree


@dataclass(frozen=True)
class Trees:
    """What a run is made with: the earlier code and the code here, the photos, and where results go."""

    earlier: Path
    data: Path
    kept: Path
    here: Path

    def compared(self, run: Run) -> tuple[str, list[str]]:
        """'the same', 'DIFFERS' or 'UNSTEADY', and in what."""
        old, done, new = self.kept / run.name, self.kept / f"{run.name}.done", self.here / run.name
        if not done.is_file():
            perform(self.earlier, run, self.data, old)
            done.touch()
        perform(ROOT, run, self.data, new)
        found = differences(old, new)
        if not found:
            return "the same", []
        again = self.here / "again" / run.name
        perform(ROOT, run, self.data, again)
        if not differences(old, again):
            return "UNSTEADY", found
        if not differences(new, again):
            done.unlink()
            shutil.rmtree(old)
            perform(self.earlier, run, self.data, old)
            done.touch()
            if not differences(old, new):
                return "UNSTEADY", found
        return "DIFFERS", found


def compare(commit: str, names: list[str], work: Path) -> int:
    """Runs, compares, prints a line for each run; how many differ."""
    data = work / "data"
    if not (data / "model" / "points3D.txt").is_file():
        shutil.rmtree(data, ignore_errors=True)
        make_photos(data)
    wrong = 0
    trees = Trees(
        earlier_tree(commit, work), data, work / f"runs-{commit}", Path(tempfile.mkdtemp(prefix="here-", dir=work))
    )
    try:
        for run in (r for r in RUNS if not names or r.name in names):
            began = time.perf_counter()
            verdict, found = trees.compared(run)
            wrong += verdict == "DIFFERS"
            print(f"{run.name:10s} {verdict} ({time.perf_counter() - began:.0f} s)", flush=True)
            for line in found[:20]:
                print(f"    {line}", flush=True)
    finally:
        shutil.rmtree(trees.here, ignore_errors=True)
    return wrong


def main() -> int:
    """Parses the arguments; 0 if nothing changed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="COMMIT", default=REFERENCE.read_text("utf-8").split()[0])
    parser.add_argument("--only", metavar="NAME", nargs="+", default=[], choices=[run.name for run in RUNS])
    parser.add_argument("--work", metavar="FOLDER", type=Path, default=Path(tempfile.gettempdir()) / "dgs-same")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    wrong = compare(options.against, options.only, options.work.resolve())
    print("No run differs by the change" if not wrong else f"{wrong} runs differ")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
