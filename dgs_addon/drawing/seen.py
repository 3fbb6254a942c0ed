"""What photos see of a twin's splats: the engine weighs them in each photo, with all that hides them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.errors import DgsError
from ...core.serving.messages import PlacedTwin, View
from ..axes import matrix_to_engine, read_camera
from ..scene.reading import read_flags, readable
from ..scene.scene_cameras import PHOTO
from ..scene.twin import TWIN
from .contents import content_of
from .process import picture_server

#: A splat that is less than so many px of a photo, all its px added up by how much they show of it, is not seen there;
#: or less than such a share of what a splat has there on average, where most are smaller than a px. (It is the share of
#: `core.training.density.contribution`, below which the training itself does without a splat.)
_LEAST_PX, _LEAST_SHARE = 1.0, 0.15
#: Px that count as none at all.
_NOTHING = 1e-6
#: Longer side in px that photos are weighed at: contributions are areas, which need no detail.
_SIDE = 480
#: Seconds that the engine may take for one photo; the first waits for its start.
_PATIENCE = 120.0

_last: tuple[object, NDArray[np.intp]] | None = None


def photos_that_see(twin: Any, scene: Any, progress: Callable[[float], None]) -> NDArray[np.intp]:
    """[N] in how many photos whose cameras came with a twin each splat is seen; hidden ones hide none, and are in none.

    Args:
        twin: `bpy` object; scene: `bpy` scene, whose frame the cameras have.
        progress: is called with the share that is done.

    Raises:
        DgsError: there are no cameras, or no engine, or it cannot do it.
    """
    global _last
    cameras = [
        _small(read_camera(thing, scene.render, thing.name))
        for thing in twin.children
        if thing.type == "CAMERA" and PHOTO in thing
    ]
    if not cameras:
        raise DgsError(f"'{twin.name}' has no cameras in the scene", "Add them, or select by islands only")
    with readable(twin) as mesh:
        content = content_of(mesh, twin.data.session_uid, int(twin[TWIN]))
        shown = ~read_flags(mesh, "hide")
    counts = np.zeros(len(shown), np.intp)
    if content is None:
        return counts
    matrix = tuple(float(x) for x in matrix_to_engine(np.array(twin.matrix_world, np.float64)).reshape(16))
    placed = PlacedTwin(content[0].key, matrix)
    key = placed, tuple((c.rotation.tobytes(), c.translation.tobytes(), c.fx, scale) for c, scale in cameras)
    if _last is None or _last[0] != key:
        server = picture_server()
        server.put(*content)
        seen = np.zeros(content[0].count, np.intp)
        for number, (camera, scale) in enumerate(cameras):
            weights = server.weights(View((placed,), camera), _PATIENCE)
            if weights is None or len(weights) != len(seen):
                raise DgsError(server.error or "The engine could not weigh the splats", "Select by islands only")
            seen += weights >= max(min(_LEAST_PX / scale, _LEAST_SHARE * float(weights.mean())), _NOTHING)
            progress((number + 1) / len(cameras))
        _last = key, seen
    counts[shown] = _last[1]
    return counts


def _small(camera: Camera) -> tuple[Camera, float]:
    """The camera with fewer px, and how many of its own px one of these is."""
    share = min(1.0, _SIDE / max(camera.width, camera.height))
    small = camera.resized(max(1, round(share * camera.width)), max(1, round(share * camera.height)))
    return small, camera.width * camera.height / (small.width * small.height)
