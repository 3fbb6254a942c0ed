"""What no old photo saw is no change of the object."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings
from dgs.core.twin.changes import _unseen, shows_changed

SIDE, FOCAL, DEPTH = 64, 64.0, 2.0


def wall() -> Gaussians:
    """A closed wall at z = 2, from x, y = -2 to 2."""
    at = np.arange(-2.0, 2.01, 0.06)
    x, y = (plane.ravel() for plane in np.meshgrid(at, at))
    n = len(x)
    means = torch.tensor(np.stack([x, y, np.full(n, DEPTH)], axis=1), dtype=torch.float32)
    turn = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n, 1)
    return Gaussians(means, torch.full((n, 3), np.log(0.05)), turn, torch.full((n,), 4.0), torch.zeros(n, 1, 3))


def at(x: float) -> SimpleNamespace:
    """A camera that looks along z, moved to the right by x."""
    camera = Camera(f"{x}", SIDE, SIDE, FOCAL, FOCAL, SIDE / 2, SIDE / 2, np.eye(3), np.array([-x, 0.0, 0.0]))
    return SimpleNamespace(name=camera.name, camera=camera)


def test_what_lies_outside_of_all_old_photos_is_unseen() -> None:
    new, old = at(1.0), at(0.0)  # half a frame apart: its right half was not in the old photo
    everything = np.ones((SIDE, SIDE), bool)
    unseen = _unseen(wall(), [new], {new.name: everything}, [old], RasterSettings())[new.name]
    assert unseen[:, 36:].all() and not unseen[6:-6, 4:28].any()
    both = _unseen(wall(), [new], {new.name: everything}, [old, at(1.5)], RasterSettings())[new.name]
    assert not both[6:-6, 6:-6].any()


def test_what_stood_behind_something_is_unseen() -> None:
    hidden = wall()
    front = hidden.means.abs()[:, :2].max(dim=1).values < 0.3
    means = hidden.means.clone()
    means[front, 2] = 1.0  # a board before the wall's middle; from aside the new photo looks behind it
    twin = Gaussians(
        torch.cat([hidden.means, means[front]]), *(torch.cat([t, t[front]]) for _, t in list(hidden.named())[1:])
    )
    new, old = at(0.9), at(0.0)
    unseen = _unseen(twin, [new], {new.name: np.ones((SIDE, SIDE), bool)}, [old], RasterSettings())[new.name]
    # Behind the board the old photo saw x from -0.6 to 0.6; in the new one that is where x - 0.9 = (u - 32) / 32.
    middle = unseen[28:36]
    assert middle[:, 14:20].all() and not unseen[2:7, 14:20].any()


def test_what_is_unseen_is_decided_for_two_px_at_a_time() -> None:
    """Every old photo's depth has to be rendered: half as many px each way; and no coarser, or thin things are lost."""
    sizes = set()
    for x in (0.9, 1.0, 1.1, 1.2):
        new, old = at(x), at(0.0)
        everything = np.ones((SIDE, SIDE), bool)
        unseen = _unseen(wall(), [new], {new.name: everything}, [old], RasterSettings())[new.name]
        assert unseen.any() and not unseen.all()
        blocks = unseen.reshape(SIDE // 2, 2, SIDE // 2, 2)
        assert (blocks == blocks[:, :1, :, :1]).all()
        sizes.add(int(np.argmax(unseen[SIDE // 2])))
    assert len(sizes) > 1 and np.gcd.reduce(list(sizes)) == 2


def test_what_changed_reaches_two_thirds_of_the_blur_into_old_photos() -> None:
    twin_wall = wall()
    splats = twin_wall.means[:, :2].abs().max(dim=1).values < 0.2
    shown = {}
    for margin in (0.0, 3.0, 9.0):
        twin = SimpleNamespace(
            scale=SimpleNamespace(to_unit=lambda gaussians: gaussians),
            gaussians=twin_wall,
            raster_settings=RasterSettings,
            margin=lambda step, px=margin: px * step,
            step=1,
        )
        found = shows_changed(twin, splats, [at(0.0)])["0.0"]  # type: ignore[arg-type,list-item]
        shown[margin] = np.flatnonzero(found[SIDE // 2])
        assert shows_changed(twin, splats & False, [at(0.0)]) == {}  # type: ignore[arg-type,list-item]
    assert shown[0.0].min() > 20 and shown[0.0].max() < 43  # 0.2 of 2 before 64 px is 6.4 px to each side
    for margin, more in ((3.0, 1), (9.0, 5)):  # one px is the least; two, and six
        assert shown[margin].min() == shown[0.0].min() - more and shown[margin].max() == shown[0.0].max() + more
