"""The render engine "Descatter": final pictures, animations, Rendered mode."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.colour import srgb_to_linear
from ...core.errors import CameraError, DgsError
from ...core.serving.messages import View
from ..engine_sentences import in_users_language
from ..scene.material import OWN_ENGINE
from .holdouts import held_out, holdout_corners
from .meshes import draw_meshes, forget_meshes, visible_meshes
from .picture_server import Picture, PictureServer
from .process import picture_server
from .quad import fill
from .through import THROUGH, blur_before
from .twins import changed_twins, guessed_twins, placed_twins
from .view_camera import Frame, final_camera
from .viewport import Look, draw_twins

#: Seconds between two looks whether the user has stopped the rendering.
_LOOK = 0.1
#: Where nothing is seen: as Cycles writes it.
_NOWHERE = 1e10
_CHANNEL = "final"
ENGINE = OWN_ENGINE
#: Scene property: sRGB colour behind the twins where the film is not transparent.
BACKGROUND = "dgs_background"
#: View layer property: whether there is a pass of the expected error, and the pass.
EXPECTED_ERROR, ERROR_PASS = "dgs_expected_error", "Expected Error"
#: Less alpha than a step of 8 bits says nothing of what is seen.
_FAINTEST = np.float32(1 / 255)


class DescatterRenderEngine(bpy.types.RenderEngine):
    """The engine's own sorted blending, as twins were trained with it."""

    bl_idname = ENGINE
    bl_label = "Descatter"
    bl_use_preview = False
    bl_use_eevee_viewport = True

    def update(self, data: Any, depsgraph: Any) -> None:
        """Reads the scene, while nobody else can change it."""
        self._view, self._guessed, self._failure, self._back = None, None, "", 0.0
        self._holdouts, self._near, self._solid = np.zeros((0, 3, 3)), 0.0, 0.0
        try:
            self._server = picture_server()
            self._view = self._asked(depsgraph)
            if getattr(depsgraph.view_layer_eval, EXPECTED_ERROR, False):
                self._guessed = View(guessed_twins(depsgraph, self._server), self._view.camera)
        except DgsError as error:
            self._failure = str(error)

    def render(self, depsgraph: Any) -> None:
        """One view layer's picture."""
        picture = None if self._view is None else self._drawn(self._view)
        guessed = None if self._guessed is None or picture is None else self._drawn(self._guessed)
        if self._failure:
            self.report({"ERROR"}, in_users_language(self._failure))
        if picture is None:
            return
        height, width = picture.pixels.shape[:2]
        if len(self._holdouts):
            self._hold_out(picture, guessed)
        layer = depsgraph.view_layer_eval
        result = self.begin_result(0, 0, width, height, layer=layer.name, view=self.active_view_get())
        passes = result.layers[0].passes
        _fill(passes.get("Combined"), picture.pixels)
        if picture.depth is not None and layer.use_pass_z:
            _fill(passes.get("Depth"), _depths(picture, self._back))
        if guessed is not None:
            _fill(passes.get(ERROR_PASS), _shares(guessed))
        self.end_result(result)

    def update_render_passes(self, scene: Any, renderlayer: Any) -> None:
        """What the compositor may ask for."""
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        if renderlayer.use_pass_z:
            self.register_pass(scene, renderlayer, "Depth", 1, "Z", "VALUE")
        if getattr(renderlayer, EXPECTED_ERROR, False):
            self.register_pass(scene, renderlayer, ERROR_PASS, 1, "X", "VALUE")

    def view_update(self, _context: Any, depsgraph: Any) -> None:
        """Rendered mode: something has changed."""
        changed_twins(depsgraph)
        if any(update.is_updated_geometry for update in depsgraph.updates):
            forget_meshes()

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        """Rendered mode: draws the last picture, in linear light, which Blender shows by its view transform.

        Where there are meshes, too, they are drawn first, and the picture has alpha and depth.
        """
        meshes = visible_meshes(depsgraph, context.space_data)
        background = background_of(context.scene)
        if meshes:
            eye = context.region_data
            if background is not None:
                fill(tuple(srgb_to_linear(np.array(background))))
            draw_meshes(meshes, eye.view_matrix, eye.window_matrix)
            background = None
        look = Look(depth=bool(meshes), light=True, background=background, through=is_through(context.scene))
        failure = draw_twins(context, depsgraph, look)
        self.update_stats("", in_users_language(failure))

    def _asked(self, depsgraph: Any) -> View:
        scene = depsgraph.scene_eval
        if scene.camera is None:
            raise CameraError("The scene has no camera", "Import or add one")
        frame = Frame.of(scene.render, self.resolution_x, self.resolution_y)
        camera, self._back = final_camera(scene.camera.evaluated_get(depsgraph), scene.render, frame)
        twins = placed_twins(depsgraph, self._server, fresh=True)
        layer = depsgraph.view_layer_eval
        blur = blur_before(scene, camera, self._back) if is_through(scene) else None
        self._holdouts = holdout_corners(depsgraph)
        self._near = scene.camera.data.clip_start + self._back
        self._solid = layer.pass_alpha_threshold
        deep = layer.use_pass_z or len(self._holdouts) > 0
        # Soft edges of twins, too, lie before a holdout or behind it.
        solid = 0.0 if len(self._holdouts) else self._solid
        return View(twins, camera, deep, True, background_of(scene), solid, blur=blur)

    def _hold_out(self, picture: Picture, guessed: Picture | None) -> None:
        """Nothing is seen where a holdout is nearer than the twins, as in Cycles and EEVEE."""
        assert picture.depth is not None
        hidden = held_out(self._holdouts, picture.view.camera, self._near) < picture.depth
        faint = hidden | (picture.pixels[..., 3] <= self._solid)
        for drawn in (picture, guessed):
            if drawn is not None:
                drawn.pixels[hidden] = 0.0
        picture.depth[faint] = _NOWHERE

    def _drawn(self, view: View) -> Picture | None:
        server: PictureServer = self._server
        self.update_stats("", "The engine draws" if server.pid is not None else "The engine starts")
        server.ask(_CHANNEL, view)
        while (picture := server.wait(_CHANNEL, _LOOK)) is None:
            if self.test_break():
                return None
            if not server.waiting(_CHANNEL):
                self._failure = server.error or "The engine made no picture"
                return None
        return picture


def background_of(scene: Any) -> tuple[float, float, float] | None:
    """sRGB colour behind the twins; None where the film is transparent."""
    if scene.render.film_transparent:
        return None
    red, green, blue = getattr(scene, BACKGROUND, (0.0, 0.0, 0.0))
    return red, green, blue


def is_through(scene: Any) -> bool:
    """Whether a scene's pictures are seen through the medium."""
    return bool(getattr(scene, THROUGH, False))


def _shares(picture: Picture) -> NDArray[np.float32]:
    """[H, W, 1] mean over what is seen in a px; 0 where nothing is."""
    alpha = picture.pixels[..., 3:]
    return np.where(alpha > _FAINTEST, picture.pixels[..., :1] / np.maximum(alpha, _FAINTEST), np.float32(0.0))


def _depths(picture: Picture, back: float) -> NDArray[np.float32]:
    """[H, W, 1] depths from the camera as Blender has it."""
    assert picture.depth is not None
    nowhere = np.float32(_NOWHERE)
    return np.where(picture.depth < nowhere, picture.depth - np.float32(back), nowhere)[..., None]


def _fill(target: Any, values: NDArray[np.float32]) -> None:
    """Writes a pass of a render result, rows upwards."""
    if target is not None:
        target.rect.foreach_set(np.ascontiguousarray(values).reshape(-1))
