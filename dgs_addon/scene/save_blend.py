"""A .blend with a twin and its cameras, written without a window."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from ...core.camera import Camera
from ...core.errors import DeviceError, OutputError
from ...core.files import make_folder
from ...core.formats.gaussians import read_gaussians
from ...core.outputs import placing_output
from ..axes import place_camera

#: How a compressed .blend ends: number of frames, flags, mark; and the bytes before the table of frames.
SEEK_END, SEEK_MARK, SEEK_HEAD = struct.Struct("<IB4s"), b"\xb1\xea\x92\x8f", 8


def save_blend(twin_file: Path, cameras: Path | None, out: Path, photos: Path | None = None) -> None:
    """Writes a scene that renders the twin in Cycles, with the engine's own colours, as it is opened.

    The process's own Blender scene is replaced. Lit objects added to the scene later need the panel's
    'Blend as Light'.

    Args:
        twin_file: file of Gaussians, of any format of `core.formats.gaussians`.
        cameras: file of cameras or a folder with one; None places one camera before the twin.
        out: the .blend, overwritten.
        photos: folder of photos to show behind the cameras; they are linked, not packed.

    Raises:
        FormatError: the twin or the cameras cannot be used.
        OutputError: the .blend cannot be written.
        DeviceError: this Python has no bpy.
    """
    try:
        import bpy  # late: an import of this file must not need Blender, the command line does it
    except ImportError as error:
        raise DeviceError("This Python has no Blender (bpy)", "Install bpy, or run it as 'blender -b -P'") from error

    from .cameras import add_cameras  # late: needs bpy
    from .material import prepare_scene  # late: needs bpy
    from .twin import add_twin  # late: needs bpy

    cloud = read_gaussians(twin_file)
    make_folder(out.parent)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    twin = add_twin(cloud, twin_file.stem, scene.collection)
    if cameras is not None:
        add_cameras(cameras, photos, scene)
    else:
        _camera_before(twin, scene)
    prepare_scene(scene, as_trained=True)
    scene.cycles.samples = 32
    scene.cycles.use_denoising = False  # splats have no noise to remove, and not every build has a denoiser
    bpy.context.view_layer.objects.active = twin
    with placing_output(out) as whole:
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(whole.resolve()), compress=True)
        except RuntimeError as error:
            raise OutputError(f"'{out}' cannot be written ({error})", "Free space or choose another folder") from error
        if not _is_whole(whole):
            raise OutputError(f"'{out}' could not be written whole", "Free space or choose another folder")


def _is_whole(scene: Path) -> bool:
    """Whether a compressed .blend has all that its last lines say; Blender does not notice that a disk is full.

    Format: zstd's "seekable format": a table of the sizes of all frames, their number, a byte, and a mark.
    """
    data = scene.read_bytes()
    if len(data) < SEEK_END.size or not data.endswith(SEEK_MARK):
        return False
    count, flags, _ = SEEK_END.unpack(data[-SEEK_END.size :])
    entry = 12 if flags & 0x80 else 8
    table = count * entry + SEEK_END.size
    sizes = data[len(data) - table : len(data) - SEEK_END.size]
    frames = sum(int.from_bytes(sizes[at : at + 4], "little") for at in range(0, len(sizes), entry))
    return len(data) == frames + SEEK_HEAD + table


def _camera_before(twin: Any, scene: Any) -> None:
    """A camera where the engine's world has its front (along +z, y down), far enough to see nearly all."""
    from .cameras import new_camera  # late: needs bpy
    from .twin import read_twin  # late: needs bpy

    means = read_twin(twin).means.astype(np.float64)
    centre = np.median(means, axis=0)
    radius = max(float(np.quantile(np.linalg.norm(means - centre, axis=1), 0.95)), 1e-3)
    translation = -centre + [0.0, 0.0, 3.0 * radius]
    place_camera(
        new_camera("Camera", scene),
        Camera("Camera", 1280, 720, 1280, 1280, 640, 360, np.eye(3), translation),
        scene.render,
    )
