"""Photos that a camera took while it moved, drawn by the forward model along known paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import align_similarity
from dgs.core.forward import ForwardModel, medium_of
from dgs.core.frames import Frame
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import CameraMotion
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.paths.coordinates import px_units
from scipy.spatial.transform import Rotation

SETTINGS = RasterSettings(low_pass=0.5)


class Photo:
    """What the forward model asks of one."""

    def __init__(self, camera: Camera) -> None:
        self.name, self.camera, self.psf = camera.name, camera, None


def turned_upright(camera: Camera) -> Camera:
    """One whose photo is higher than it is wide."""
    return replace(camera, width=camera.height, height=camera.width, cx=camera.cy, cy=camera.cx)


def exposed_by(scene, camera, *effects):
    frame, formation = Frame(camera.height, camera.width, 0), Formation(effects)
    settings = replace(SETTINGS, depth=formation.by_depth)
    model = ForwardModel(settings, lambda _: medium_of(None, frame), 0, formation)
    with torch.no_grad():
        return model.expose(scene.truth, Photo(camera))


def truly_moved(scene, seed=0, px=5.0, readout=0.0):
    """A path of about `px` px in an exposure for every photo but each fourth, and the photos that it leaves."""
    random = np.random.default_rng(seed)
    names = [view.name for view in scene.views]
    twists = torch.zeros(len(names), 3, 6)
    for i, view in enumerate(scene.views):
        if i % 4 == 3:
            continue
        angle, units = random.uniform(0, 2 * np.pi), px_units(view.camera)
        part = np.zeros((3, 6))
        part[1, 3:5] = px / 2 * np.array([np.sin(angle), np.cos(angle)])
        part[2] = 0.2 * px * random.standard_normal(6)
        twists[i] = torch.from_numpy(part * units).float()
    motion = CameraMotion(names, twists).rolling(readout)
    views = []
    for view in scene.views:
        photo = exposed_by(scene, view.camera, motion).degraded.numpy()
        pixels = np.round(photo.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)
        views.append(replace(view, photo=np.ascontiguousarray(pixels)))
    return motion, views


def shaken(camera: Camera, random: np.random.Generator, size: float = 0.02) -> Camera:
    """Turned by about `size` radians about each axis, and shifted by as many units."""
    turn = Rotation.from_rotvec(size * random.standard_normal(3)).as_matrix()
    return camera.moved(turn @ camera.rotation, turn @ camera.translation + size * random.standard_normal(3))


def off(found: list[Camera], true: list[Camera]) -> float:
    """Largest distance of a centre from the true one, after a similarity."""
    still = align_similarity({c.name: c for c in found}, {c.name: c for c in true})
    return max(float(np.linalg.norm(still.camera(a).centre - b.centre)) for a, b in zip(found, true, strict=True))
