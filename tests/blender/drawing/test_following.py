"""A view's picture is coarse while the view moves and full when it rests; questions and answers of the real server."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from dgs.core.camera import Camera
from dgs.core.serving.messages import PlacedTwin, SharedTwin, View
from dgs.dgs_addon.axes import CAMERA_FLIP, ENGINE_FROM_BLENDER
from dgs.dgs_addon.drawing.follower import Follower
from dgs.dgs_addon.drawing.pace import PACE, Pace
from dgs.dgs_addon.drawing.picture_server import PictureServer, serve_command
from dgs.dgs_addon.drawing.view_camera import window_camera

PLACED = PlacedTwin("a", tuple(np.eye(4).reshape(16)))
CAMERA = Camera("", 320, 200, 300.0, 300.0, 160.0, 100.0, np.eye(3), np.zeros(3))


@pytest.fixture(scope="module")
def server() -> Iterator[PictureServer]:
    server = PictureServer(serve_command(Path(sys.executable)))
    twin = SharedTwin("a", 1, 1)
    content = bytearray(twin.bytes)
    planes = twin.planes(memoryview(content))
    planes[0][:], planes[1][:], planes[2][:], planes[3][:] = (0, 0, 3), 0.5, (1, 0, 0, 0), (1.7, -1.7, -1.7, 0.9)
    server.put(twin, bytes(content))
    yield server
    server.close()
    assert server.pid is None


def view(shift: float = 0.0) -> View:
    return View((PLACED,), CAMERA.moved(CAMERA.rotation, np.array([shift, 0.0, 0.0])))


def answered(server: PictureServer, follower: Follower, channel: str, now: float) -> None:
    end = time.monotonic() + 60
    while server.waiting(channel) and time.monotonic() < end:
        time.sleep(0.01)
    assert follower.step(server, now)


def test_coarse_while_it_moves_full_when_it_rests(server: PictureServer) -> None:
    follower = Follower("view")
    for index in range(4):  # a view of its own every 0.05 s
        now = 10 + 0.05 * index
        follower.show(index, view(0.1 * index), now)
        follower.step(server, now)
        answered(server, follower, "view", now)
        assert not follower.done or follower.picture.pixels.shape == (200, 320, 4)
        follower._pace.share = 0.4  # as if each took long
    width = follower.picture.pixels.shape[1]
    assert width == round(0.4 * 320)
    assert not follower.step(server, now + 0.5 * PACE.rest) and not server.waiting("view"), "it may move on"
    follower.step(server, now + 2 * PACE.rest)
    answered(server, follower, "view", now + 3 * PACE.rest)
    assert follower.done and follower.picture.pixels.shape == (200, 320, 4)
    assert not follower.step(server, now + 9) and not server.waiting("view"), "nothing is asked twice"
    middle = follower.picture.pixels[100]
    assert abs(int(middle[:, 3].argmax()) - (160 + 100 * 0.3)) <= 1, "it is the last view's"


def test_a_window_that_is_drawn_seldom_does_not_take_each_drawing_for_a_rest(server: PictureServer) -> None:
    follower = Follower("slow")
    for index in range(3):
        follower.show(index, view(0.1 * index), 10 + 0.3 * index)
    follower._pace.share = 0.4
    follower.step(server, 10.6 + 0.25)
    answered(server, follower, "slow", 10.6 + 0.3)
    assert follower.picture.pixels.shape[1] == 128


def test_the_pace_comes_to_what_the_machine_can_do() -> None:
    for full, wanted in ((0.01, 1.0), (4 * PACE.frame, 0.5), (1000.0, PACE.coarsest)):
        pace = Pace()
        for _ in range(30):
            pace.took(pace.share, full * pace.share**2)
        assert pace.share == pytest.approx(wanted, rel=0.02)


def test_only_the_newest_question_of_a_channel_is_answered(server: PictureServer) -> None:
    for index in range(50):
        server.ask("fast", view(0.01 * index))
    picture = server.wait("fast", 60)
    while server.waiting("fast"):
        picture = server.wait("fast", 60) or picture
    assert picture is not None and picture.view.camera.translation[0] == pytest.approx(0.49)


def test_a_killed_process_is_replaced_and_gets_the_twins_anew(server: PictureServer) -> None:
    server.ask("view", view())
    before = server.wait("view", 60)
    os.kill(server.pid, signal.SIGKILL)
    server.ask("view", view())
    after = server.wait("view", 60)
    assert before is not None and after is not None and (before.pixels == after.pixels).all() and after.pixels.any()


def test_one_that_never_starts_is_given_up_and_says_why(tmp_path: Path) -> None:
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho 'no such library' >&2\nexit 3\n")
    broken.chmod(0o755)
    server = PictureServer(serve_command(broken))
    server.ask("view", view())
    assert server.wait("view", 30) is None
    assert server.starts == 3 and server.error.endswith("status 3: no such library")
    server.close()


@pytest.mark.parametrize("flat", [False, True])
def test_the_camera_of_a_3d_view_sees_points_where_opengl_does(flat: bool) -> None:
    random = np.random.default_rng(0)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    look = np.eye(4)
    look[:3, :3], look[:3, 3] = turn, (0.3, -0.2, -6.0)
    window = np.array([[2.1, 0, 0.12, 0], [0, 3.3, -0.07, 0], [0, 0, -1.0, -0.2], [0, 0, -1, 0]])
    if flat:
        window = np.array([[0.3, 0, 0, 0.1], [0, 0.5, 0, -0.2], [0, 0, -0.01, -1], [0, 0, 0, 1.0]])
    points = random.uniform(-1, 1, (20, 3))
    clip = np.concatenate([points, np.ones((20, 1))], axis=1) @ (window @ look).T
    wanted = (clip[:, :2] / clip[:, 3:] + 1) / 2 * [640, 400]
    camera, back = window_camera(look, window, 640, 400)
    seen = points @ ENGINE_FROM_BLENDER.T @ camera.rotation.T + camera.translation
    x, y = camera.fx * seen[:, 0] / seen[:, 2] + camera.cx, camera.fy * seen[:, 1] / seen[:, 2] + camera.cy
    assert np.abs(np.stack([x, 400 - y], axis=1) - wanted).max() < (1.0 if flat else 1e-6)
    depth = -(points @ look[2, :3] + look[2, 3])
    assert np.allclose(seen[:, 2] - back, depth, atol=1e-6) and (back > 0) is flat
    assert np.allclose(CAMERA_FLIP @ camera.rotation @ ENGINE_FROM_BLENDER, turn)
