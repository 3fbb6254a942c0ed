"""Structure from motion on photos of textured planes, rendered here: truth is known exactly."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.errors import CameraError, Cancelled, DegenerateMotion, NativeCrash, NoOverlap, TooFewPhotos
from dgs.core.evaluation.poses import pose_errors
from dgs.core.photos.load import Photo
from dgs.core.progress import Silent
from dgs.core.sfm import find
from dgs.core.sfm.settings import SfmSettings
from scipy.ndimage import gaussian_filter, map_coordinates

WIDTH, HEIGHT, FOCAL, SIGMA = 400, 300, 420.0, 3.0


def texture(seed: int) -> np.ndarray:
    """Blobs and edges of many sizes, [900, 900] in [0, 1]."""
    noise = np.random.default_rng(seed)
    total = np.zeros((900, 900))
    for size in (3.0, 6.0, 12.0, 24.0):
        layer = gaussian_filter(noise.standard_normal((900, 900)), size)
        total += np.sign(layer) + layer / layer.std()
    return (total - total.min()) / np.ptp(total)


def photographed(camera: Camera, textures: list[np.ndarray]) -> np.ndarray:
    """Two planes at right angles (a corner of a room): z = 0 for x < 0 and x = 0 behind it."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    rays = rays @ camera.rotation
    origin = camera.centre
    image, nearest = np.zeros((HEIGHT, WIDTH)), np.full((HEIGHT, WIDTH), np.inf)
    for plane, (normal, axes) in enumerate([((1.0, 0.0, 1.0), (0, 1)), ((-1.0, 0.0, 1.0), (0, 1))]):
        n = np.array(normal)
        depth = -(origin @ n) / (rays @ n)
        hit = origin + depth[..., None] * rays
        wanted = (depth > 0) & (depth < nearest) & ((hit[..., 0] < 0) == (plane == 1))
        rows, columns = hit[..., 1] * 150 + 450, hit[..., axes[0]] * 150 + 450
        value = map_coordinates(textures[plane], [rows, columns], order=3, mode="reflect")
        image[wanted], nearest[wanted] = value[wanted], depth[wanted]
    return image


def cameras(count: int) -> dict[str, Camera]:
    """An arc of cameras that look at the origin."""
    result = {}
    for i, angle in enumerate(np.linspace(-0.5, 0.5, count)):
        centre = 4.0 * np.array([np.sin(angle), 0.15 * np.cos(5 * angle), -np.cos(angle)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        name = f"été {i}.png"
        result[name] = Camera(name, WIDTH, HEIGHT, FOCAL, FOCAL, 200, 150, rotation, -rotation @ centre)
    return result


def photo(name: str, grey: np.ndarray) -> Photo:
    eight = np.clip(grey * 255 + 0.5, 0, 255).astype(np.uint8)
    return Photo(name, Path(name), np.repeat(eight[:, :, None], 3, 2))


def kernel(sigma: float) -> np.ndarray:
    x = np.arange(-12, 13)
    line = np.exp(-(x**2) / (2 * sigma**2))
    return np.outer(line, line) / line.sum() ** 2


class Cancelling(Silent):
    def __init__(self) -> None:
        self.asked = 0

    def cancelled(self) -> bool:
        self.asked += 1
        return self.asked > 3


@pytest.fixture(scope="module")
def blurred() -> tuple[dict[str, Camera], list[Photo]]:
    textures = [texture(1), texture(2)]
    truth = cameras(9)
    return truth, [
        photo(name, gaussian_filter(photographed(camera, textures), SIGMA, truncate=5))
        for name, camera in truth.items()
    ]


def test_finds_cameras_of_blurred_photos(blurred: tuple[dict[str, Camera], list[Photo]], tmp_path: Path) -> None:
    truth, photos = blurred
    found = find.find_cameras(photos, kernel(SIGMA), SfmSettings(), tmp_path, Silent())
    assert found.names == tuple(sorted(truth))
    errors = pose_errors(found.cameras(), truth, np.zeros((1, 3)))
    assert abs(np.median(errors.focal)) < 0.005
    assert np.median(errors.centre_px) < 0.12  # by features alone, without aligned patches, it is 0.21
    assert found.figures.attempts[0].verdict == "trusted"
    assert len(found.points.positions) > 700
    assert found.points.colours.std() > 5
    assert list(tmp_path.iterdir()) == []


def test_two_photos_are_too_few(blurred: tuple[dict[str, Camera], list[Photo]], tmp_path: Path) -> None:
    with pytest.raises(TooFewPhotos, match="2 photos"):
        find.find_cameras(blurred[1][:2], None, SfmSettings(), tmp_path, Silent())


def test_photos_of_nothing_are_no_overlap(tmp_path: Path) -> None:
    noise = np.random.default_rng(0)
    photos = [photo(f"{i}.png", 0.5 + 0.01 * noise.standard_normal((60, 80))) for i in range(4)]
    with pytest.raises(NoOverlap, match="Only 0 of 4 photos share enough detail") as error:
        find.find_cameras(photos, None, SfmSettings(), tmp_path, Silent())
    assert error.value.way_out


def test_a_camera_that_only_turns_is_refused_with_this_reason(tmp_path: Path) -> None:
    textures = [texture(3), texture(4)]
    middle = cameras(3)["été 1.png"]
    photos = []
    for i, angle in enumerate(np.linspace(-0.15, 0.15, 5)):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        rotation = turn @ middle.rotation
        turned = middle.moved(rotation, -rotation @ middle.centre)
        photos.append(photo(f"{i}.png", photographed(turned, textures)))
    with pytest.raises(DegenerateMotion, match="only turned"):
        find.find_cameras(photos, None, SfmSettings(), tmp_path, Silent())


def test_cancelling_ends_the_child(blurred: tuple[dict[str, Camera], list[Photo]], tmp_path: Path) -> None:
    started = time.perf_counter()
    with pytest.raises(Cancelled):
        find.find_cameras(blurred[1], kernel(SIGMA), SfmSettings(), tmp_path, Cancelling())
    assert time.perf_counter() - started < 5
    assert list(tmp_path.iterdir()) == []


def test_the_search_ends_at_its_limit(blurred: tuple[dict[str, Camera], list[Photo]], tmp_path: Path) -> None:
    work = tmp_path / "sfm"
    with pytest.raises(CameraError, match="within 0.5 s"):
        find.find_cameras(blurred[1], kernel(SIGMA), SfmSettings(hard_limit=0.5), work, Silent())
    assert not work.exists()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_an_abort_in_native_code_is_an_error(
    blurred: tuple[dict[str, Camera], list[Photo]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    aborting = tmp_path / "worker.py"
    aborting.write_text("import os; os.abort()", encoding="utf-8")
    monkeypatch.setattr(find, "_WORKER", aborting)
    with pytest.raises(NativeCrash, match="SIGABRT"):
        find.find_cameras(blurred[1], None, SfmSettings(), tmp_path / "work", Silent())


@pytest.mark.skipif(os.name != "posix", reason="process groups")
def test_the_child_dies_with_its_parent(tmp_path: Path) -> None:
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import subprocess, sys, time\n"
            "child = subprocess.Popen([sys.executable, '-c', 'import importlib.util, sys, time;"
            'spec = importlib.util.spec_from_file_location("w", sys.argv[1]);'
            "w = importlib.util.module_from_spec(spec); spec.loader.exec_module(w);"
            "w.end_with_parent(); time.sleep(60)', sys.argv[1]], stdin=subprocess.PIPE)\n"
            "print(child.pid, flush=True); time.sleep(60)",
            str(find._WORKER),
        ],
        stdout=subprocess.PIPE,
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    time.sleep(1.0)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for _ in range(50):
        if not running(child):
            return
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the child outlived its parent")


def running(pid: int) -> bool:
    """Whether the process runs (an orphan that ended may stay listed as a zombie)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").split(")")[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
