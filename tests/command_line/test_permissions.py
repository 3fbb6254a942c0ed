"""What a user may not read or write ends with one line before any work, and nothing is left behind; as a real user."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import dgs
import pytest
from dgs.command_line import run
from dgs.core.formats.transforms import write_transforms
from dgs.studies.stability.fuzzed_samples import cameras
from dgs.studies.stability.fuzzed_state import write_twin

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="permissions and users of POSIX")

#: Root may read and write everything, so that tests of root become this user.
NOBODY = 65534
#: What commands load, on Blender's side too.
_LOADED = ("co*/**/*.py", "studies/**/*.py", "dgs_addon/scene/*.py", "dgs_addon/laboratory/**/*.py")


@pytest.fixture(scope="module", autouse=True)
def loaded() -> None:
    """What commands load is loaded once, as the tests' own user: nobody may not read every user's Python."""
    package = Path(dgs.__file__).parent
    with contextlib.suppress(ImportError):
        importlib.import_module("bpy")
    for file in sorted(file for pattern in _LOADED for file in package.glob(pattern)):
        name = ".".join(file.relative_to(package).with_suffix("").parts)
        if name.endswith(("worker", "__init__", "__main__")):
            continue
        with contextlib.suppress(ImportError):
            importlib.import_module(f"dgs.{name}")
    b"x".decode("utf-8-sig")
    subprocess.run([sys.executable, "-c", "0"], check=True)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A set and a twin that belong to the user who asks (pytest's own folders are for nobody else)."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        write_twin(place)
        write_transforms(place / "transforms.json", cameras())
        (place / "psf.json").write_text(json.dumps({"*": "gaussian:2"}))
        places = {name: {"photo": "a.png", "at": at} for name, at in (("a", [8, 9]), ("b", [20, 12]))}
        measures = [{"name": "edge", "kind": "length", "of": ["a", "b"]}]
        (place / "points.json").write_text(json.dumps({"places": places, "measures": measures}))
        (place / "list.txt").write_text("photos/a.png\nphotos/b.png\n")
        shutil.copytree(place / "photos", place / "masks")
        (place / "closed").mkdir()
        if os.getuid() == 0:
            for path in [place, *place.rglob("*")]:
                os.chown(path, NOBODY, NOBODY)
        yield place
        for path in [place, *place.rglob("*")]:
            if path.is_dir():
                path.chmod(0o755)


def said_as_a_user(folder: Path, *words: object) -> tuple[int, str]:
    """Status and words of a command that a user without rights runs, in a process of its own."""
    said = folder / "said.txt"
    said.touch()
    process = os.fork()
    if process == 0:
        status = 99
        try:
            output = os.open(said, os.O_WRONLY | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            sys.stdout, sys.stderr = (os.fdopen(n, "w", encoding="utf-8", closefd=False) for n in (1, 2))
            if os.getuid() == 0:
                os.setgroups([])
                os.setgid(NOBODY)
                os.setuid(NOBODY)
            status = run([*map(str, words)])
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    _, ended = os.waitpid(process, 0)
    return os.waitstatus_to_exitcode(ended), said.read_text("utf-8")


def ends_with_a_line(status: int, said: str) -> str:
    """The last line, behind lines of progress."""
    assert status == 2 and "Traceback" not in said and "A bug" not in said, said
    return said.strip().splitlines()[-1]


def commands(folder: Path) -> dict[str, list[object]]:
    """A request of each kind that would run."""
    photos, twin, out = folder / "photos", folder / "twin", folder / "out"
    ply, model = twin / "twin.ply", twin / "cameras"
    made = ["reconstruct", photos, "--out", out, "--preset", "draft"]
    return {
        "reconstruct": [*made, "--cameras", model],
        "transforms": [*made, "--cameras", folder / "transforms.json"],
        "masks": [*made, "--cameras", model, "--masks", folder / "masks"],
        "psf": [*made, "--cameras", model, "--psf", f"per-photo:{folder / 'psf.json'}"],
        "list": ["reconstruct", folder / "list.txt", *made[2:], "--cameras", model],
        "batch": ["batch", photos, "--out", out, "--preset", "draft", "--cameras", model],
        "cameras": ["cameras", photos, "--out", out],
        "render": ["render", ply, "--cameras", model, "--out", out],
        "inspect": ["inspect", photos, "--out", out],
        "measure-psf": ["measure-psf", photos / "a.png", "--out", out / "k.tif"],
        "estimate": ["estimate", photos, "--cameras", model],
        "synthesize": ["synthesize", "--views", "2", "--out", out],
        "compare": ["compare", photos, "--out", out],
        "tradeoff": ["tradeoff", photos, "--out", out],
        "blend": ["blend", ply, "--out", out / "a.blend"],
        "next-view": ["next-view", twin],
        "measure": ["measure", twin, folder / "points.json", "--out", out / "m.csv"],
        "mesh": ["mesh", twin, "--out", out / "a.ply"],
        "change": ["change", twin, twin, "--out", out],
        "update": ["update", twin, photos],
        "rollback": ["update", twin, "--rollback"],
        "stress": ["stress", "--fuzz-files", "1", "--only", "plan.json", "--record", out / "r.json"],
    }


CLOSED = [
    ("reconstruct", "photos"),
    ("reconstruct", "twin/cameras"),
    ("reconstruct", "twin/cameras/images.bin"),
    ("transforms", "transforms.json"),
    ("masks", "masks"),
    ("psf", "psf.json"),
    ("list", "list.txt"),
    ("batch", "photos"),
    ("cameras", "photos"),
    ("render", "twin/twin.ply"),
    ("render", "twin/cameras/cameras.bin"),
    ("inspect", "photos"),
    ("measure-psf", "photos/a.png"),
    ("estimate", "photos"),
    ("compare", "photos"),
    ("tradeoff", "photos"),
    ("blend", "twin/twin.ply"),
    *((name, "twin") for name in ("next-view", "mesh", "measure", "change", "update", "rollback")),
    ("measure", "points.json"),
    *(("mesh", f"twin/{file}") for file in ("report.json", "twin.ply", "cameras")),
    *((name, f"twin/{file}") for name in ("next-view", "update") for file in ("report.json", "twin.ply", "photos.txt")),
    *(("change", f"twin/{file}") for file in ("report.json", "twin.ply", "photos.txt")),
]


def test_kernels_are_compiled_where_nothing_can_be_kept(tmp_path):
    """A home that takes no files, as of a system's own users, was a traceback before any work."""
    code = (
        "import sys; sys.path.insert(0, '.'); import run_dgs; run_dgs.mount_package()\n"
        "import numpy as np; from dgs.core.photos.png16_kernels import unfilter\n"
        "rows = np.array([[1, 5, 0, 2, 0]], np.uint8); unfilter(rows, 2); print(rows.tolist())\n"
    )
    env = {**os.environ, "XDG_CACHE_HOME": "/proc/nowhere"}
    env.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(dgs.__file__).parent,
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == "[[1, 5, 0, 7, 0]]".split()


@pytest.mark.parametrize(("name", "closed"), CLOSED)
def test_what_may_not_be_read_is_named(name, closed, folder):
    mode = stat.S_IMODE((folder / closed).stat().st_mode)
    (folder / closed).chmod(0)
    status, said = said_as_a_user(folder, *commands(folder)[name])
    (folder / closed).chmod(mode)
    last = ends_with_a_line(status, said)
    assert Path(closed).name in last and ("permission" in last.lower() or "cannot be read" in last), said
    assert "damaged" not in last and "Export it again" not in last and not (folder / "out" / "twin.ply").exists()


@pytest.mark.parametrize("name", [name for name, words in commands(Path()).items() if Path("out") in words])
def test_an_output_folder_that_may_not_be_written(name, folder):
    (folder / "out").mkdir(mode=0o555)
    status, said = said_as_a_user(folder, *commands(folder)[name])
    last = ends_with_a_line(status, said)
    assert "Cannot write" in last and "out" in last and "permission denied" in last, said
    assert not any((folder / "out").iterdir())


def test_a_disk_that_is_read_only(folder):
    """Removing what could not be written failed, too, and that was said instead."""
    command = 'mount --bind "$1" "$1" && mount -o remount,ro,bind "$1" && exec "$2" -c "$3" "$1"'
    code = (
        "import sys; sys.path.insert(0, '.'); import run_dgs; run_dgs.mount_package()\n"
        "from pathlib import Path; from dgs.core.files import check_writable, write_text; here = Path(sys.argv[1])\n"
        "from dgs.core.errors import OutputError\n"
        "for write in (lambda: check_writable(here), lambda: write_text(here / 'a.txt', 'x')):\n"
        "    try: write()\n"
        "    except OutputError as error: print(error)\n"
    )
    words = ["unshare", "--mount", "sh", "-c", command, "sh", str(folder), sys.executable, code]
    try:
        done = subprocess.run(words, cwd=Path(dgs.__file__).parent, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no unshare")
    if done.returncode and "Traceback" not in done.stderr:
        pytest.skip("this user may not mount")
    said = done.stdout.splitlines()
    assert len(said) == 2 and all("The disk is read-only; choose another folder" in line for line in said), done.stderr
