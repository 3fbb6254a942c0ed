"""A twin as a Blender object: one mesh vertex per Gaussian, attributes named as native splats'.

The attributes keep the file's own axes (COLMAP: y down, z away) and the object's matrix turns them
into Blender's. So spherical harmonics need no rotation of their own: their directions are turned with
the object (see `nodes`), and what leaves Blender again is bit for bit what came in.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud, cloud_part, finite_rows
from ...core.errors import FormatError
from ..axes import matrix_to_blender
from .live import drawn_live
from .nodes import LIVE_INPUT, VIEWPORT_INPUT, set_splat_input, splat_input, splat_nodes
from .reading import read_values, readable
from .software import SOFTWARE_SPLATS, drawn_by_software

#: Object property that marks a twin; its value is the number of harmonics.
TWIN = "dgs_harmonics"
SCALE, ROTATION, BASE = "scale", "rotation", "radiance:base"
#: The twin's own colours while others are shown (see `known`).
OWN_BASE = "dgs_own_base"
#: Point attribute: which splat of its files a point is (see `sources`).
ROW = "dgs_row"


def fields_of(harmonics: int, base: str = BASE) -> list[tuple[str, str, int]]:
    """Attributes that hold a Gaussian, where their kind keeps the numbers, and how many these are."""
    fields = [("position", "vector", 3), (SCALE, "vector", 3), (ROTATION, "value", 4), (base, "color", 4)]
    return [*fields, *((harmonic(index), "vector", 3) for index in range(harmonics - 1))]


def harmonic(index: int) -> str:
    """Attribute of the harmonic behind the zeroth, as Blender's native splats name it."""
    return f"radiance:sh_{index}"


def add_twin(cloud: GaussianCloud, name: str, collection: Any) -> Any:
    """Adds the Gaussians as an object that renders as splats.

    Args:
        cloud: raw Gaussians; those with a value that is not finite are left out.
        name: name of the object and its mesh.
        collection: `bpy` collection to link it to.

    Returns:
        The new `bpy` object, turned from the engine's axes into Blender's.

    Raises:
        FormatError: no Gaussian can be shown.
    """
    mesh = splat_mesh(cloud, name)
    twin = bpy.data.objects.new(name, mesh)
    twin[TWIN] = int(cloud.sh.shape[1])
    # Blender's matrices are assigned row by row from columns.
    twin.matrix_world = matrix_to_blender(np.eye(4)).T.tolist()
    collection.objects.link(twin)
    modifier = twin.modifiers.new("Splats", "NODES")
    modifier.node_group = splat_nodes(view_dependent=glossy(cloud))
    if drawn_live() and splat_input(modifier, LIVE_INPUT) is not None:  # (a file of an older version has no such nodes)
        set_splat_input(modifier, LIVE_INPUT, True)
    if drawn_by_software():
        set_splat_input(modifier, VIEWPORT_INPUT, SOFTWARE_SPLATS)
    return twin


def glossy(cloud: GaussianCloud) -> bool:
    """Whether colours change with the direction of view, as far as Blender shows it."""
    return cloud.sh.shape[1] >= 4


def splat_mesh(cloud: GaussianCloud, name: str) -> Any:
    """A `bpy` mesh of loose vertices: position, scale (standard deviations), rotation (unit w x y z),
    radiance:base (raw zeroth harmonic R G B, opacity 0..1), radiance:sh_0.. (raw), and the row in the cloud.

    Raises:
        FormatError: no Gaussian has finite values only.
    """
    rows = np.flatnonzero(finite_rows(cloud))
    if len(rows) < len(cloud):
        cloud = cloud_part(cloud, rows)
    if not len(cloud):
        raise FormatError(f"'{name}' holds no Gaussian that can be shown", "Choose another PLY")
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(cloud))
    mesh.attributes["position"].data.foreach_set("vector", _flat(cloud.means))
    with np.errstate(over="ignore"):  # an opacity logit of -100 is an opacity of 0
        opacity = 1.0 / (1.0 + np.exp(-cloud.opacity_logits))
    _add(mesh, SCALE, "FLOAT_VECTOR", "vector", np.exp(np.clip(cloud.log_scales, -40.0, 40.0)))
    _add(mesh, ROTATION, "QUATERNION", "value", _unit(cloud.quaternions))
    _add(mesh, BASE, "FLOAT_COLOR", "color", np.concatenate([cloud.sh[:, 0], opacity[:, None]], axis=1))
    for index in range(cloud.sh.shape[1] - 1):
        _add(mesh, harmonic(index), "FLOAT_VECTOR", "vector", cloud.sh[:, index + 1])
    mesh.attributes.new(ROW, "INT", "POINT").data.foreach_set("value", rows.astype(np.int32))
    mesh.update()
    return mesh


def read_twin(twin: Any) -> GaussianCloud:
    """The Gaussians of an object that `add_twin` made, in the engine's axes as they were read."""
    with readable(twin) as mesh:
        base = read_values(mesh, OWN_BASE if OWN_BASE in mesh.attributes else BASE, "color", 4)
        rest = [read_values(mesh, harmonic(index), "vector", 3) for index in range(int(twin[TWIN]) - 1)]
        opacity = np.clip(base[:, 3], 1e-7, 1.0 - 1e-7)
        return GaussianCloud(
            means=read_values(mesh, "position", "vector", 3),
            log_scales=np.log(read_values(mesh, SCALE, "vector", 3)),
            quaternions=read_values(mesh, ROTATION, "value", 4),
            opacity_logits=np.log(opacity / (1.0 - opacity)),
            sh=np.stack([base[:, :3], *rest], axis=1),
        )


def read_means(twin: Any) -> NDArray[np.float64]:
    """[N, 3] centres of a twin's Gaussians, in its own axes."""
    with readable(twin) as mesh:
        return read_values(mesh, "position", "vector", 3).astype(np.float64)


def is_twin(thing: Any) -> bool:
    """Whether a `bpy` object (or None) is a twin."""
    return thing is not None and thing.type == "MESH" and TWIN in thing


def why_no_picture(scene: Any) -> str:
    """What a `bpy` scene lacks for pictures of a twin; '' for nothing."""
    if not any(is_twin(thing) for thing in scene.objects):
        return "There is no twin in this scene yet (step 5)"
    return "" if scene.camera is not None else "The scene has no camera: import or add one"


def scene_twin(scene: Any, active: Any) -> Any:
    """The active twin, else any of the scene's; None if it has none."""
    if is_twin(active):
        return active
    return next((thing for thing in scene.objects if is_twin(thing)), None)


def _unit(quaternions: NDArray[np.float32]) -> NDArray[np.float32]:
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    identity = np.array([1.0, 0.0, 0.0, 0.0], np.float32)
    return np.where(length > 1e-12, quaternions / np.maximum(length, 1e-12), identity)


def _flat(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32).reshape(-1)


def _add(mesh: Any, name: str, kind: str, field: str, values: NDArray[np.float32]) -> None:
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, _flat(values))
