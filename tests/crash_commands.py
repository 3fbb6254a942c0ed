"""Every command that changes files, on a tiny set, from a known folder to a known folder; see `tests.crashes`.

Photos of 64 x 48 px, 200 Gaussians, a dozen steps: a whole reconstruction takes less than a second in a process that
was forked from one that has everything loaded. Files that hold times or memory are compared without those.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import dgs
import numpy as np
import torch
from dgs.command_line import run
from dgs.core import compiled
from dgs.core.cloud import GaussianCloud
from dgs.core.errors import DgsError
from dgs.core.formats.colmap import write_model
from dgs.core.formats.gaussians import read_gaussians, write_gaussians
from dgs.core.lock import working_on
from dgs.core.pipeline import snapshots
from dgs.core.training import run as training_run
from dgs.core.training import settings as training_settings
from dgs.core.training.trainer import Trainer
from dgs.core.training.warmup import compile_kernels
from dgs.core.views import SparsePoints
from dgs.tests.command_line.scene import scene_cameras, scene_gaussians
from dgs.tests.core.calibration.calibration_photos import photo, point_light
from dgs.tests.core.sfm.test_find_cameras import cameras, photographed, texture
from PIL import Image
from scipy.ndimage import gaussian_filter

WIDTH, HEIGHT, STEPS = 64, 48, 24
#: Photos of a room's corner: as few as structure from motion takes, and one more.
WALLS = 6
#: Fields of JSON that differ from run to run: times, memory, and what a resumed run says of itself.
UNLIKE = {"seconds", "machine", "memory", "peak_memory_mb", "predicted", "notes", "stopped", "time", "resume"}
#: Parts of the page that hold such: numbers, charts over time, notes and settings.
FIGURES = re.compile(
    r"<svg.*?</svg>|[0-9][0-9.,]*|<h3[^>]*>Notes</h3>.*?</ul>|<details><summary>Settings.*?</details>|\s+", re.DOTALL
)
#: Part of a folder that is no state of it: pictures of the training that runs or ran last.
PASSING = ("snapshot",)
#: There when a run was cut off that can be gone on with.
BEGUN = ".run/.begun"
RUN = str(Path(dgs.__path__[0]) / "run_dgs.py")
#: What a scene's file begins and ends with (its content holds addresses of the memory, and is never the same twice).
ZSTANDARD = (b"\x28\xb5\x2f\xfd", b"\xb1\xea\x92\x8f")

State = dict[str, str]


@dataclass(frozen=True)
class Case:
    """One command on one folder.

    Attributes:
        name: of the command and what it finds.
        start: which of the prepared folders it works on.
        words: of the command line; {data} and {folder} are put in.
        work: instead of a command line, what is called with the data's and the folder's path.
        again: words that finish what was cut off, where a run can be gone on with.
        process: whether it runs as a user runs it, in a process of its own that was not prepared for this.
        search: whether a child process looks for cameras meanwhile, by structure from motion.
    """

    name: str
    start: str
    words: tuple[str, ...] = ()
    work: Callable[[Path, Path], None] | None = None
    again: tuple[str, ...] = ()
    process: bool = False
    search: bool = False

    def run(self, data: Path, folder: Path, again: bool = False) -> int:
        """The command in this process; its exit status."""
        if self.work is not None:
            try:
                self.work(data, folder)
            except DgsError:
                return DgsError.exit_code
            return 0
        words = self.command(data, folder, again)
        return subprocess.run([sys.executable, RUN, *words], check=False).returncode if self.process else run(words)

    def command(self, data: Path, folder: Path, again: bool = False) -> list[str]:
        """Words of the command line."""
        words = self.again if again and self.again and (folder / BEGUN).exists() else self.words
        return [word.format(data=data, folder=folder) for word in words]


_DRAFT = (
    *("--preset", "draft", "--max-gaussians", "200", "--holdout-every", "4", "--sh-degree", "0", "--threads", "1"),
    *("--progress", "none"),
)
_MADE = (
    *("reconstruct", "{data}/photos", "--out", "{folder}", "--psf", "gaussian:1", "--cameras", "{data}/model"),
    *_DRAFT,
)
_FOUND = ("reconstruct", "{data}/walls", "--out", "{folder}", "--psf", "gaussian:1", *_DRAFT)
_CAMERAS = ("cameras", "{data}/walls", "--out", "{folder}", "--psf", "gaussian:1", "--threads", "1")
_PLACED = ("update", "{folder}", "{data}/more walls", "--share", "0.5", "--threads", "1")
_OTHER = ("reconstruct", "{data}/others", *_MADE[2:], "--seed", "1")
_UPDATE = ("update", "{folder}", "{data}/new", "--cameras", "{data}/model", "--share", "0.5", "--threads", "1")
_NEXT = ("next-view", "{folder}", "--samples", "2", "--number", "4", "--count", "2", "--threads", "1")
_RENDER = (
    "render",
    "{data}/%s",
    "--cameras",
    "{data}/few",
    "--out",
    "{folder}",
    "--threads",
    "1",
    "--progress",
    "none",
)
_MEASURE = ("measure-psf", "{data}/%s", "--out", "{folder}/kernel.tif", "--kind", "point", "--progress", "none")


def _exported(suffix: str, twin: str) -> Callable[[Path, Path], None]:
    return lambda data, folder: write_gaussians(folder / f"twin{suffix}", read_gaussians(data / twin))


CASES = (
    Case("reconstruct into a new folder", "nothing", _MADE, again=(*_MADE, "--resume")),
    Case(
        "reconstruct over a twin with an update",
        "updated",
        (*_OTHER, "--snapshots"),
        again=(*_OTHER, "--snapshots", "--resume"),
    ),
    Case("resume a stopped run", "stopped", (*_MADE, "--resume")),
    Case("resume a killed run", "killed", (*_MADE, "--resume")),
    Case("resume a killed run over a twin", "killed over", (*_OTHER, "--resume")),
    Case("update", "made", (*_UPDATE, "--progress", "none")),
    Case("rollback", "updated", ("update", "{folder}", "--rollback", "--progress", "none")),
    Case("rollback to another run's twin", "replaced", ("update", "{folder}", "--rollback", "--progress", "none")),
    Case("next-view", "made", (*_NEXT, "--progress", "none")),
    Case("next-view again", "updated", (*_NEXT, "--progress", "none", "--candidates", "dome")),
    Case("render over pictures", "pictures", tuple(word.replace("%s", "b.ply") for word in _RENDER)),
    Case("measure-psf over a kernel", "kernel", tuple(word.replace("%s", "wide.png") for word in _MEASURE)),
    Case("export PLY", "exported", work=_exported(".ply", "b.ply")),
    Case("export glTF", "exported", work=_exported(".glb", "b.ply")),
    Case("export SPZ", "exported", work=_exported(".spz", "b.ply")),
    Case("export splat", "exported", work=_exported(".splat", "b.ply")),
    Case("blend over a scene", "scene", ("blend", "{data}/b.ply", "--out", "{folder}/twin.blend")),
    Case("cameras from photos", "nothing", (*_CAMERAS, "--progress", "none"), search=True),
    Case("cameras from photos over a twin", "made", (*_CAMERAS, "--progress", "none"), search=True),
    Case("reconstruct from photos alone", "nothing", _FOUND, again=(*_FOUND, "--resume"), search=True),
    Case("update by photos alone", "found", (*_PLACED, "--progress", "none"), search=True),
)


class Stage:
    """The sets, and a folder for each state that a command starts from.

    Args:
        work: a folder of its own; what was prepared there before is used again.
    """

    def __init__(self, work: Path) -> None:
        self.data, self.folder, self._kept = work / "data", work / "case", work / "kept"
        if not (work / "prepared").is_file():
            shutil.rmtree(work, ignore_errors=True)
            _write_sets(self.data)
        self._work = work

    def prepare(self, names: set[str]) -> None:
        """Makes the folders of these names, in children, with the commands themselves."""
        makers = {
            "nothing": self._nothing,
            "made": lambda: self._run(_MADE),
            "found": lambda: self._run(_FOUND),
            "updated": self._updated,
            "replaced": lambda: (self._run(_MADE), self._run(_OTHER)),
            "stopped": lambda: self._cut_off(_MADE, signal.SIGINT, 130),
            "killed": lambda: self._cut_off(_MADE, signal.SIGKILL, -9),
            "killed over": lambda: (self.put("updated"), self._cut_off(_OTHER, signal.SIGKILL, -9)),
            "pictures": lambda: self._run([word.replace("%s", "a.ply") for word in _RENDER]),
            "kernel": lambda: self._run([word.replace("%s", "narrow.png") for word in _MEASURE]),
            "exported": self._exported,
            "scene": lambda: self._run(("blend", "{data}/a.ply", "--out", "{folder}/twin.blend")),
        }
        for name, make in makers.items():
            if name not in names or (self._kept / name).is_dir():
                continue
            if name == "killed over":
                self.prepare({"updated"})
            self._nothing()
            make()
            shutil.copytree(self.folder, self._kept / name) if self.folder.is_dir() else None
        (self._work / "prepared").touch()

    def put(self, name: str) -> None:
        """The case's folder is as it was prepared."""
        self._nothing()
        if (self._kept / name).is_dir():
            shutil.copytree(self._kept / name, self.folder)

    def put_into(self, name: str) -> None:
        """The same, where the folder is there and empty, and may not be removed: a disk is mounted there."""
        if (self._kept / name).is_dir():
            shutil.copytree(self._kept / name, self.folder, dirs_exist_ok=True)

    def state(self, name: str) -> State:
        """Of a prepared folder."""
        return state(self._kept / name)

    def _nothing(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self, words: Any) -> None:
        case = Case("", "", tuple(words))
        status, said = child(lambda: case.run(self.data, self.folder))
        assert status == 0, f"{words}: {status} {said}"

    def _updated(self) -> None:
        self._run(_MADE)
        self._run((*_UPDATE, "--progress", "none"))
        self._run((*_NEXT, "--progress", "none"))

    def _cut_off(self, words: tuple[str, ...], number: int, expected: int) -> None:
        """Stopped or killed in the middle of its training."""

        def interrupted() -> int:
            usual = Trainer.advance

            def advance(trainer: Trainer, *given: Any) -> float:
                if trainer.step == 2 * STEPS // 3:
                    os.kill(os.getpid(), number)
                return usual(trainer, *given)

            Trainer.advance = advance  # type: ignore[method-assign]
            return Case("", "", words).run(self.data, self.folder)

        status, said = child(interrupted)
        assert status == expected, f"{words}: {status} {said}"

    def _exported(self) -> None:
        self.folder.mkdir()
        for suffix in (".ply", ".glb", ".spz", ".splat"):
            write_gaussians(self.folder / f"twin{suffix}", read_gaussians(self.data / "a.ply"))


def child(work: Callable[[], int]) -> tuple[int, str]:
    """Runs `work` in a forked child; its exit status (negative: the signal) and what it said on stderr."""
    reads, writes = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(reads)
        run_and_exit(work, writes)
    os.close(writes)
    with os.fdopen(reads, "r", errors="replace") as pipe:
        said = pipe.read()
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), said


def run_and_exit(work: Callable[[], int], said: int) -> NoReturn:
    """Ends this forked process with the status of `work`; 99: a traceback. `said`: where its stderr goes."""
    status = 99
    try:
        os.dup2(said, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        status = work()
    except BaseException:  # noqa: BLE001  (the process must end here, whatever happened)
        traceback.print_exc()
    finally:
        os._exit(status)


def warm_up() -> None:
    """Loads what a command needs, so that forked children begin at once; starts no thread that lives on.

    A training has a dozen steps here, and keeps a checkpoint, the twin so far and a snapshot every few. Whoever tests
    other things in the same process puts that right again: `as_usual`.
    """
    torch.set_num_threads(1)
    compiled.set_threads(1)
    _hasten(STEPS, 0.03, (0.05, 0.05))
    compile_kernels(0)
    for name in ("calibration.measure", "calibration.pictures", "pipeline.reconstruct", "pipeline.update"):
        importlib.import_module(f"dgs.core.{name}")
    for name in ("dgs.core.uncertainty.next_view", "matplotlib.figure", "matplotlib.font_manager", "pycolmap"):
        importlib.import_module(name)


@contextlib.contextmanager
def as_usual() -> Iterator[None]:
    """Puts right at the end what `warm_up` changed in this process."""
    before = (
        training_settings.PRESETS.draft_steps,
        training_run.RUN.checkpoint_seconds,
        (snapshots.INTERVAL, snapshots.TWIN_INTERVAL),
    )
    threads = torch.get_num_threads(), compiled.threads()
    try:
        yield
    finally:
        _hasten(*before)
        torch.set_num_threads(threads[0])
        compiled.set_threads(threads[1])


def _hasten(steps: int, checkpoints: float, snapshot: tuple[float, float]) -> None:
    """Steps of a draft; seconds between checkpoints, and between snapshots and twins so far."""
    object.__setattr__(training_settings.PRESETS, "draft_steps", steps)
    object.__setattr__(training_run.RUN, "checkpoint_seconds", checkpoints)
    snapshots.INTERVAL, snapshots.TWIN_INTERVAL = snapshot  # type: ignore[misc]


def opened(folder: Path) -> tuple[State, list[str]]:
    """The folder's state when a command has opened it, and what was said about it."""
    said: list[str] = []
    if folder.is_dir():
        with working_on(folder, "look", said.append):
            pass
    return state(folder), said


def state(folder: Path) -> State:
    """A digest of every file that is not hidden, by name."""
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in _files(folder)}


def alike(folder: Path) -> State:
    """The same without times and memory: two runs with one seed give the same."""
    return {name: _digest(path) for name, path in _files(folder)}


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in name.parts) or name.parts[0] in PASSING
        if path.is_file() and not hidden:
            yield name.as_posix(), path


def _digest(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix == ".json":
        data = json.dumps(_plain(json.loads(data)), sort_keys=True).encode()
    elif path.suffix == ".html":
        data = FIGURES.sub("", data.decode("utf-8")).encode()
    elif path.suffix == ".npz":
        arrays = dict(np.load(io.BytesIO(data)))
        facts = json.loads(arrays.pop("__facts__", np.frombuffer(b"{}", np.uint8)).tobytes())
        data = json.dumps(_plain(facts), sort_keys=True).encode() + b"".join(
            name.encode() + arrays[name].tobytes() for name in sorted(arrays)
        )
    elif path.suffix == ".blend":
        data = b"whole" if data[:4] == ZSTANDARD[0] and data[-4:] == ZSTANDARD[1] else data
    return hashlib.sha256(data).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items() if name not in UNLIKE}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _write_sets(data: Path) -> None:
    """photos, new, others (a part of photos, brighter), walls, cameras, two twins, two points of light."""
    from dgs.core.rasterizer import render

    around = [
        replace(c, name=f"{i:02d}.png", width=WIDTH, height=HEIGHT, fx=72.0, fy=72.0, cx=32.0, cy=24.0)
        for i, c in enumerate(scene_cameras())
    ]
    gaussians = scene_gaussians(500)
    for index, camera in enumerate(around):
        image = render(gaussians, camera).image.detach().clamp(0, 1)
        pixels = (image * 255).round().byte().permute(1, 2, 0).numpy()
        save(data / ("new" if index in (3, 5) else "photos") / camera.name, pixels)
        if index < 6:
            save(data / "others" / camera.name, np.minimum(pixels, 225) + 30)
    points = SparsePoints(gaussians.means.double().numpy()[:100], np.full((100, 3), 128, np.uint8))
    write_model(data / "model", {camera.name: camera for camera in around}, points)
    write_model(data / "few", {camera.name: camera for camera in around[:3]}, points)
    _write_walls(data)
    for seed, name in enumerate(("a.ply", "b.ply")):
        random = np.random.default_rng(seed)
        values = [random.normal(size=(80, *sides)).astype(np.float32) for sides in ((3,), (3,), (4,), (), (1, 3))]
        write_gaussians(data / name, GaussianCloud(values[0], values[1] / 3 - 2, *values[2:]))
    for name, sigma in (("narrow.png", 1.5), ("wide.png", 2.0)):
        photo(data / name, point_light(41, (20.3, 19.8), sigma), bits=8)


def _write_walls(data: Path) -> None:
    """Photos that show enough for structure from motion, in 'walls'; one beside them in 'more walls'."""
    textures = [texture(1), texture(2)]
    for index, camera in enumerate(cameras(WALLS).values()):
        grey = gaussian_filter(photographed(camera, textures), 1.0)
        pixels = np.repeat(np.clip(grey * 255 + 0.5, 0, 255)[:, :, None], 3, 2)
        save(data / ("more walls" if index == 2 else "walls") / f"{index:02d}.png", pixels)


def save(path: Path, pixels: np.ndarray) -> None:
    """Writes a picture, and its folder where that is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels.astype(np.uint8)).save(path)
