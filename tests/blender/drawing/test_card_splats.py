"""What the shader for graphics cards is given: the engine's own splats, places and order; and when it is chosen."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

pytest.importorskip("bpy")

from dgs.core.camera import Camera
from dgs.core.cloud import GaussianCloud
from dgs.core.serving.messages import PlacedTwin, SharedTwin
from dgs.core.serving.stage import Stage, carried, shown
from dgs.dgs_addon.drawing import sorting
from dgs.dgs_addon.drawing.drawer import AUTOMATIC, CARD, ENGINE, choice
from dgs.dgs_addon.drawing.held_twins import HeldTwins
from dgs.dgs_addon.drawing.splats import Order, Splats, far_to_near, kept_rows, splats_of, standing
from dgs.tests.core.serving.test_pictures import crowd

TURN = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
CAMERA = Camera("", 60, 40, 50.0, 50.0, 30.0, 20.0, TURN, np.array([0.3, -0.2, 1.5]))
EVEN = np.block([[1.5 * TURN.T, np.array([[0.2], [0.1], [-0.4]])], [np.zeros((1, 3)), np.ones((1, 1))]])
STRETCHED = EVEN @ np.diag([1.3, 0.6, 1.0, 1.0])


def content(cloud: GaussianCloud, key: str = "a") -> tuple[SharedTwin, bytes]:
    twin = SharedTwin(key, len(cloud), cloud.sh.shape[1])
    values = bytearray(twin.bytes)
    planes = twin.planes(memoryview(values))
    planes[0][:], planes[1][:], planes[2][:] = cloud.means, np.exp(cloud.log_scales), cloud.quaternions
    planes[3][:, :3], planes[3][:, 3] = cloud.sh[:, 0], 1.0 / (1.0 + np.exp(-cloud.opacity_logits))
    for k, plane in enumerate(planes[4:], start=1):
        plane[:] = cloud.sh[:, k]
    return twin, bytes(values)


def placed(matrix: np.ndarray, **more: object) -> PlacedTwin:
    return PlacedTwin("a", tuple(matrix.reshape(16)), **more)  # type: ignore[arg-type]


def test_texels_hold_the_twins_one_after_the_other() -> None:
    first, second = crowd(50), crowd(20)
    splats = splats_of([content(first), content(second, "b")])
    assert splats.starts == (0, 50, 70) and splats.coefficients == first.sh.shape[1]
    own = splats.texels[50:, 0, :3] + splats.origins[1]
    assert np.allclose(own, second.means, atol=1e-6) and (splats.texels[50:, 0, 3] == 1).all()
    assert np.array_equal(splats.texels[:50, 1], first.quaternions)
    flat = splats.harmonics.reshape(70, -1)
    for k in range(1, splats.coefficients):
        assert np.array_equal(flat[:50, 3 * k - 3 : 3 * k], first.sh[:, k])


@pytest.mark.parametrize("matrix", [np.eye(4), EVEN, STRETCHED])
def test_splats_stand_where_the_engine_has_them(matrix: np.ndarray) -> None:
    cloud = crowd(80)
    splats, twin = splats_of([content(cloud)]), placed(matrix)
    stands = standing(splats, (twin,), CAMERA)
    rows = stands.rows[0]
    there = splats.texels[:, 0, :3].astype(np.float64) @ rows[:, :3].T + rows[:, 3]
    moved = carried(cloud, matrix)
    wanted = moved.means.astype(np.float64) @ CAMERA.rotation.T + CAMERA.translation
    assert np.allclose(there, wanted, atol=1e-5)
    assert np.allclose(stands.turns[0] @ stands.turns[0].T, np.eye(3), atol=1e-9)
    order = far_to_near(splats, kept_rows(splats, (twin,)), stands.rows)
    depths = wanted[order.index, 2]
    assert len(depths) > 20 and (np.diff(depths) <= 1e-5).all() and depths.min() > 0


def test_what_is_shown_is_what_the_engine_shows() -> None:
    cloud = crowd(200)
    box = np.linalg.inv(
        np.diag([1.0, 1.0, 0.8, 1.0]) + np.array([[0.0] * 4, [0.0] * 4, [0.0, 0.0, 0.0, 5.0], [0.0] * 4])
    )
    for more in ({}, {"faintest": 0.4}, {"most": 30}, {"box": tuple(box.reshape(16))}, {"size": 0.0}):
        twin = placed(np.eye(4), **more)
        kept = kept_rows(splats_of([content(cloud)]), (twin,))
        assert np.allclose(cloud.means[kept], shown(cloud, twin).means), more
    broken = cloud.sh.copy()
    broken[3] = np.nan
    broken[4] = 1e7
    splats = splats_of([content(GaussianCloud(*list(vars(cloud).values())[:4], broken))])
    assert {3, 4}.isdisjoint(kept_rows(splats, (placed(np.eye(4)),)))


def test_the_nearest_depth_is_the_engines() -> None:
    cloud = crowd(5000)
    twin, stage = content(cloud), Stage()
    stage.put(twin[0], twin[0].planes(memoryview(twin[1])))
    staged = stage.staged((placed(EVEN),))
    assert staged is not None
    near = staged.near(staged.camera(CAMERA))
    assert near is not None
    splats = splats_of([twin])
    stands = standing(splats, (placed(EVEN),), CAMERA)
    order = far_to_near(splats, kept_rows(splats, (placed(EVEN),)), stands.rows)
    depths = splats.texels[:, 0, :3] @ stands.rows[0, 2, :3] + stands.rows[0, 2, 3]
    assert set(order.index) == set(np.flatnonzero(depths > near * staged.unit))


def test_many_splats_are_sorted_beside_the_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last order is drawn until the thread is done, and the newest one comes in the end."""
    monkeypatch.setattr(sorting, "AT_ONCE", 10)
    sorter, gate = sorting.Sorter(), threading.Event()

    def sort(key: tuple[object, object], wait: bool = True) -> Order:
        if wait:
            gate.wait(10)
        return Order(np.arange(3), key)

    assert sorter.order((1, "a"), 20, lambda: sort((1, "a"), False)).key == (1, "a"), "the first one is waited for"
    for name in "bcd":
        assert sorter.order((1, name), 20, lambda name=name: sort((1, name))).key == (1, "a")
    assert sorter.busy
    gate.set()
    until = time.monotonic() + 10
    while sorter.busy and time.monotonic() < until:
        time.sleep(0.01)
    assert sorter.order((1, "d"), 20, lambda: sort((1, "d"))).key == (1, "d")
    assert sorter.order((2, "d"), 20, lambda: sort((2, "d"))).key == (2, "d"), "other splats have another order"


def test_states_that_nobody_draws_are_dropped() -> None:
    held = HeldTwins()
    for key in "ab":
        held.put(*content(crowd(4), key))
    for _ in range(40):
        held.contents(["b"])
    assert held.has("b") and not held.has("a")
    held.retire("b")
    held.put(*content(crowd(4), "c"))
    held.contents(["c"])
    assert not held.has("b")


@pytest.mark.parametrize(
    ("named", "by_card"),
    [
        (("NVIDIA GeForce RTX 4070/PCIe/SSE2", "NVIDIA Corporation", "NVIDIA"), True),
        (("AMD Radeon RX 7800 XT (radeonsi, navi32)", "AMD", "AMD"), True),
        (("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "Intel", "INTEL"), True),
        (("Apple M2", "Apple", "APPLE"), True),
        (("llvmpipe (LLVM 19.1.7, 256 bits)", "Mesa", "SOFTWARE"), False),
        (("softpipe", "Mesa", "UNKNOWN"), False),
        (("Google SwiftShader", "Google Inc.", "UNKNOWN"), False),
        (("Microsoft Basic Render Driver", "Microsoft", "UNKNOWN"), False),
        ((), False),
    ],
)
def test_real_cards_draw_and_programs_do_not(named: tuple[str, ...], by_card: bool) -> None:
    found = choice(AUTOMATIC, named)
    assert found.card is by_card and (not named or by_card is False or named[0] in found.why)
    assert choice(CARD, named or ("?",)).card and not choice(ENGINE, named).card
    failed = choice(CARD, named, "no memory")
    assert not failed.card and "no memory" in failed.why
    assert isinstance(splats_of([content(crowd(2))]), Splats)
