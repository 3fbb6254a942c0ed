"""The picture server as a process: lines in, lines out, pictures in shared memory; it ends with its master."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import dgs
import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.serving.messages import Drawn, PlacedTwin, SharedTwin, View
from dgs.core.serving.server import PictureServer
from dgs.core.serving.shared_area import SharedArea

ROOT = Path(dgs.__path__[0])
CAMERA = Camera("", 40, 30, 40.0, 40.0, 20.0, 15.0, np.eye(3), np.zeros(3))
PLACED = PlacedTwin("red", tuple(np.eye(4).reshape(16)))


def red_splat(area: SharedArea) -> dict[str, object]:
    twin = SharedTwin("red", 1, 1)
    planes = twin.planes(area.view(twin.bytes))
    planes[0][:], planes[1][:], planes[2][:], planes[3][:] = (0, 0, 3), 0.5, (1, 0, 0, 0), (1.7, -1.7, -1.7, 0.9)
    return {"twin": {"key": "red", "count": 1, "harmonics": 1}}


def test_a_process_answers_and_ends_with_its_standard_input() -> None:
    areas = [SharedArea.create(), SharedArea.create()]
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "run_dgs.py"), "serve", "--threads", "1"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        pass_fds=[area.descriptor for area in areas if area.descriptor is not None],
    )
    assert process.stdin is not None and process.stdout is not None

    def ask(message: object) -> dict[str, object]:
        process.stdin.write(f"{json.dumps(message)}\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline())

    assert ask({"areas": [area.address for area in areas]}) == {"event": "ready"}
    assert ask({"view": View((PLACED,), CAMERA).message()})["missing"] == ["red"]
    assert ask(red_splat(areas[0])) == {"event": "twin", "key": "red"}
    for camera in (CAMERA, CAMERA.resized(1280, 960)):  # the area grows
        drawn = Drawn.parse(ask({"view": View((PLACED,), camera, True).message()}))
        pixels, depth = drawn.planes(areas[1].view(drawn.bytes))
        assert pixels.shape[:2] == (camera.height, camera.width) and not drawn.missing
        middle = camera.height // 2, camera.width // 2
        assert pixels[middle][3] == pytest.approx(0.9, abs=0.01) and pixels[middle][0] > 0.85 > pixels[middle][1]
        assert depth is not None and depth[middle] == pytest.approx(3.0, rel=1e-4)
    alpha = pixels[..., 3].sum()
    assert ask({"seen": View((PLACED,), CAMERA.resized(1280, 960)).message()}) == {"event": "seen", "count": 1}
    assert np.frombuffer(areas[1].view(4), np.float32)[0] == pytest.approx(alpha, rel=1e-3)
    away = View((PLACED,), CAMERA.moved(CAMERA.rotation, np.array([0.0, 0.0, -9.0]))).message()
    assert ask({"seen": away})["count"] == 1 and np.frombuffer(areas[1].view(4), np.float32)[0] == 0.0
    assert ask({"seen": View((), CAMERA).message()})["count"] == 0
    assert ask({"view": 3})["event"] == "error" and ask({"forget": "red"})["event"] == "forgotten"
    assert ask({"view": View((PLACED,), CAMERA).message()})["missing"] == ["red"]
    process.stdin.close()
    assert process.wait(10) == 0


@pytest.mark.parametrize(
    "message",
    [
        None,
        [],
        {},
        {"view": {}},
        {"areas": 3},
        {"twin": {"key": "a", "count": 2**40, "harmonics": 1}},
        {"twin": {"key": "a", "count": 3, "harmonics": 2}},
        {"view": {**View((PLACED,), CAMERA).message(), "background": [1.0]}},
        {"view": {**View((PLACED,), CAMERA).message(), "twins": [{**vars(PLACED), "matrix": [1.0]}]}},
        {"view": View((), CAMERA.resized(10**6, 10**6)).message()},
        {"a": 1, "b": 2},
    ],
)
def test_what_is_not_understood_is_refused(message: object) -> None:
    server = PictureServer()
    server.answer({"areas": [SharedArea.create().address, SharedArea.create().address]})
    with pytest.raises(ValueError):
        server.answer(json.loads(json.dumps(message)))


def test_odd_numbers_of_a_view_make_no_crash() -> None:
    server, areas = PictureServer(), [SharedArea.create(), SharedArea.create()]
    server.answer({"areas": [area.address for area in areas]})
    server.answer(red_splat(areas[0]))
    for matrix in (np.zeros((4, 4)), 1e30 * np.eye(4), np.ones((4, 4))):
        placed = PlacedTwin("red", tuple(matrix.reshape(16)))
        message = json.loads(json.dumps({"view": View((placed,), CAMERA).message()}))
        assert server.answer(message)["event"] == "picture"
