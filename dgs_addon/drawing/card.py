"""Views of twins drawn by the graphics card: splats as textures, a quad each, far to near.

They are blended in single precision into a picture of the view's size, which then goes into the view as one rectangle:
there it is tested against the scene's depth, as the engine's own pictures are (`quad`).
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass, replace
from typing import Any

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.constants import FRUSTUM_MARGIN
from ...core.errors import DeviceError
from ...core.serving.messages import Floats, PlacedTwin, View
from .held_twins import HeldTwins
from .sorting import Sorter
from .splat_shader import screen_shader, splat_shader
from .splats import Splats, far_to_near, kept_rows, splats_of, standing

#: Px that the engine renders a frame larger than asked for (`core.serving.picture`): the projection of what lies
#: beside the frame depends on its size.
_MARGIN = 3
#: Texels in a row of a texture: every card takes that many.
_WIDTH = 4096
#: Sets of twins that are kept on the card: one that is shown, and the one before it.
_SETS = 2

_versions = itertools.count(1)


@dataclass
class _OnCard:
    """A set of twins on the card."""

    splats: Splats
    rows: Any
    harmonics: Any
    shown: tuple[object, NDArray[np.intp]] | None = None
    version: int = 0

    def kept(self, placed: tuple[PlacedTwin, ...]) -> NDArray[np.intp]:
        """Rows that are shown; `version` changes with them."""
        what = tuple(replace(twin, matrix=()) for twin in placed)  # (where they stand changes nothing of it)
        if self.shown is None or self.shown[0] != what:
            self.shown, self.version = (what, kept_rows(self.splats, placed)), next(_versions)
        return self.shown[1]


class Card:
    """The graphics card, and the twins on it.

    Attributes:
        twins: states that were handed over.
        drawn: pictures that it has made.
    """

    def __init__(self) -> None:
        self.twins = HeldTwins()
        self.drawn = 0
        self._sets: dict[tuple[str, ...], _OnCard] = {}

    def loaded(self, placed: tuple[PlacedTwin, ...]) -> _OnCard:
        """The twins of a view as textures.

        Raises:
            DeviceError: they do not fit onto the card.
        """
        keys = tuple(twin.key for twin in placed)
        contents = self.twins.contents(keys)
        if keys not in self._sets:
            while len(self._sets) >= _SETS:
                self._sets.pop(next(iter(self._sets)))
            splats = splats_of(contents)
            harmonics = _texture(splats.harmonics) if splats.coefficients > 1 else None
            rows = _texture(splats.texels)
            # (they lie on the card now, and are most of a twin)
            splats = replace(splats, harmonics=np.zeros((0, *splats.harmonics.shape[1:]), np.float32))
            self._sets[keys] = _OnCard(splats, rows, harmonics)
        return self._sets[keys]


class CardView:
    """One 3D view's picture on the card."""

    def __init__(self) -> None:
        self._sorter = Sorter()
        self._size: tuple[int, int, bool] | None = None
        self._targets: list[Any] = []
        self._frame: Any = None
        self._order: tuple[object, Any, int] | None = None
        self._drawn: object = None
        self._late = False

    @property
    def waiting(self) -> bool:
        """Whether a better order is on its way, or has come after the last drawing."""
        return self._late

    def draw(self, card: Card, key: object, view: View, window: Any = None, back: float = 0.0) -> None:
        """Draws a view into what is bound, all over it.

        Args:
            key: equal for equal views; view: linear light, through no medium.
            window: [4, 4] OpenGL's projection where depths count; None to draw over everything.
            back: how far behind Blender's the view's camera stands.

        Raises:
            DeviceError: the card cannot.
        """
        try:
            self._blend(card, key, view)
            self._show(view, window, back)
        except DeviceError:
            raise
        except Exception as error:  # (drivers fail in their own ways; whoever draws goes on with the engine)
            raise DeviceError(f"The graphics card cannot draw splats ({error})", "The engine draws") from error

    def pixels(self) -> Floats:
        """[H, W, 4] what was blended last, rows upwards: sRGB multiplied by alpha. Waits for the card."""
        assert self._size is not None
        width, height, _ = self._size
        read = self._targets[0].read().to_list()  # (as an array, Blender 4.3 has it in another order)
        return np.array(read, np.float32).reshape(height, width, 4)

    def _blend(self, card: Card, key: object, view: View) -> None:
        deep = view.depth
        frame = self._sized(view.camera.width, view.camera.height, deep)
        if self._drawn is not None and self._drawn == (key, self._size) and not self._late:
            return
        loaded = card.loaded(view.twins) if view.twins else None
        self._late = False
        order, count, twins = self._ordered(loaded, view) if loaded is not None else (None, 0, None)
        with frame.bind():
            frame.clear(color=(0.0, 0.0, 0.0, 0.0))
            if loaded is not None and count:
                self._splats(loaded, view, order, count, twins)
        self._drawn = key, self._size
        card.drawn += 1

    def _ordered(self, loaded: _OnCard, view: View) -> tuple[Any, int, Any]:
        """The order and the twins' places as textures, and how many splats are drawn."""
        splats = loaded.splats
        kept, stands = loaded.kept(view.twins), standing(splats, view.twins, view.camera)
        key = loaded.version, stands.rows[:, 2].tobytes()
        order = self._sorter.order(key, len(kept), lambda: far_to_near(splats, kept, stands.rows, key))
        self._late = order.key != key
        if self._order is None or self._order[0] != order.key:
            index = order.index.astype(np.float32)
            self._order = order.key, _texture(index, "R32F") if len(index) else None, len(index)
        return self._order[1], self._order[2], _texture(stands.texels())

    def _splats(self, loaded: _OnCard, view: View, order: Any, count: int, twins: Any) -> None:
        camera, splats = view.camera, loaded.splats
        shader = splat_shader(splats.coefficients, view.depth)
        gpu.state.blend_set("ALPHA_PREMULT")
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        shader.bind()
        shader.uniform_sampler("splats", loaded.rows)
        shader.uniform_sampler("twins", twins)
        shader.uniform_sampler("order", order)
        if loaded.harmonics is not None:
            shader.uniform_sampler("harmonics", loaded.harmonics)
            shader.uniform_int("texels", splats.harmonics.shape[1])
        shader.uniform_float("lens", (camera.fx, camera.fy, camera.cx, camera.cy))
        shader.uniform_float("frame", (camera.width, camera.height, *_beyond(camera)))
        corners = ((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0))
        batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners})
        batch.draw_instanced(shader, instance_start=0, instance_count=count)
        gpu.state.blend_set("NONE")

    def _show(self, view: View, window: Any, back: float) -> None:
        deep = window is not None and view.depth
        shader = screen_shader(deep)
        gpu.state.blend_set("ALPHA_PREMULT")
        gpu.state.depth_test_set("LESS_EQUAL" if deep else "NONE")
        gpu.state.depth_mask_set(deep)
        shader.bind()
        shader.uniform_sampler("picture", self._targets[0])
        shader.uniform_float("behind", (0.0,) * 4 if view.background is None else (*view.background, 1.0))
        shader.uniform_float("power", view.power)
        if deep:
            shader.uniform_sampler("depths", self._targets[1])
            z, w = window[2], window[3]
            shader.uniform_float("projection", (z[2], z[3], w[2], w[3]))
            shader.uniform_float("back", back)
        corners = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
        batch_for_shader(shader, "TRI_STRIP", {"pos": corners}).draw(shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")

    def _sized(self, width: int, height: int, deep: bool) -> Any:
        if self._size != (width, height, deep):
            self._targets = [gpu.types.GPUTexture((width, height), format="RGBA32F") for _ in range(1 + deep)]
            self._frame = gpu.types.GPUFrameBuffer(color_slots=self._targets)
            self._size, self._drawn = (width, height, deep), None
        return self._frame


def seconds_of(view: CardView, card: Card, picture: View, turns: int = 3) -> float:
    """What drawing one picture takes until it can be read, in a place where the card may be used."""
    times = []
    for turn in range(turns):
        began = time.perf_counter()
        view._blend(card, ("measured", turn), picture)
        view.pixels()
        times.append(time.perf_counter() - began)
    return min(times)


def _beyond(camera: Camera) -> tuple[float, float]:
    """Px beyond the frame up to which the projection is not clamped, besides the share of the frame itself."""
    grown = _MARGIN + FRUSTUM_MARGIN * 2 * _MARGIN
    return grown, grown


def _texture(values: Floats, kind: str = "RGBA32F") -> Any:
    """Numbers as a texture, row after row; the last row is filled up.

    Raises:
        DeviceError: the card takes no texture so high.
    """
    channels = 4 if kind == "RGBA32F" else 1
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    texels = len(flat) // channels
    width = min(_WIDTH, max(1, texels))
    height = max(1, -(-texels // width))
    if height > gpu.capabilities.max_texture_size_get():
        raise DeviceError(f"{texels} texels do not fit onto the graphics card", "The engine draws")
    if texels < width * height:
        flat = np.concatenate([flat, np.zeros(channels * (width * height - texels), np.float32)])
    return gpu.types.GPUTexture((width, height), format=kind, data=gpu.types.Buffer("FLOAT", len(flat), flat))
