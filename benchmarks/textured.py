"""Meshes with colours at their corners and with textures, seen from held-out cameras, against the sharp truth.

    python -m benchmarks.textured TWIN SET                        # SET: a set of the laboratory's, with sharp/
    python -m benchmarks.textured TWIN SET --mesh 500000:0 50000:1024 50000:2048 --picture FILE.png

A mesh is FACES:TEXTURE, texels each way, and 0 for none; each is seen in its corners' colours, too.
Each mesh is drawn by 4 x 4 rays a px, unlit, and compared where the truth is opaque and every mesh covers the whole px:
there the difference is that of the colours, and of nothing else.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.compiled import kernel, run
from dgs.core.formats.cameras import read_cameras
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.progress import Silent
from dgs.core.triangles import Mesh
from dgs.core.twin.seen_by import splats_and_cameras
from PIL import Image

#: Rays along each side of a px, and views of the picture.
RAYS, SHOWN = 4, 1


@kernel
def draw_in_depth(begin, end, corners, depth, owner, weights):  # type: ignore[no-untyped-def]
    """Nearest face of each ray; corners: [M, 3, 3] x, y in rays and depth; weights: [H, W, 3] perspectively right."""
    height, width = depth.shape
    for m in range(begin, end):
        c = corners[m]
        if min(c[0, 2], c[1, 2], c[2, 2]) <= 1e-6:
            continue
        area = (c[1, 0] - c[0, 0]) * (c[2, 1] - c[0, 1]) - (c[1, 1] - c[0, 1]) * (c[2, 0] - c[0, 0])
        if abs(area) < 1e-12:
            continue
        left, right = max(0, int(min(c[:, 0]) - 0.5)), min(width - 1, int(max(c[:, 0])))
        for row in range(max(0, int(min(c[:, 1]) - 0.5)), min(height - 1, int(max(c[:, 1]))) + 1):
            for column in range(left, right + 1):
                x, y = column + 0.5, row + 0.5
                b = ((x - c[0, 0]) * (c[2, 1] - c[0, 1]) - (y - c[0, 1]) * (c[2, 0] - c[0, 0])) / area
                d = ((c[1, 0] - c[0, 0]) * (y - c[0, 1]) - (c[1, 1] - c[0, 1]) * (x - c[0, 0])) / area
                a = 1.0 - b - d
                if a < 0.0 or b < 0.0 or d < 0.0:
                    continue
                z = 1.0 / (a / c[0, 2] + b / c[1, 2] + d / c[2, 2])
                if z < depth[row, column]:
                    depth[row, column], owner[row, column] = z, m
                    weights[row, column, 0] = a * z / c[0, 2]
                    weights[row, column, 1] = b * z / c[1, 2]
                    weights[row, column, 2] = d * z / c[2, 2]


def drawn(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """[H, W] face of each ray, -1 where none is, and its weights [H, W, 3]."""
    local = mesh.vertices @ camera.rotation.T + camera.translation
    x = (camera.fx * local[:, 0] / local[:, 2] + camera.cx) * RAYS
    y = (camera.fy * local[:, 1] / local[:, 2] + camera.cy) * RAYS
    corners = np.ascontiguousarray(np.stack([x, y, local[:, 2]], axis=1)[mesh.faces])
    shape = (camera.height * RAYS, camera.width * RAYS)
    owner, weights = np.full(shape, -1, np.int64), np.zeros((*shape, 3))
    run(draw_in_depth, len(corners), corners, np.full(shape, np.inf), owner, weights, grain=len(corners))
    return owner, weights


def mixed(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The four texels around, as viewers mix them; u, v: from the lower left corner, 0 to 1."""
    height, width = image.shape[:2]
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    found = 0.0
    for tap in range(4):
        i, j = row + (tap >> 1), column + (tap & 1)
        share = (1 - np.abs(y - i)) * (1 - np.abs(x - j))
        found = found + share[..., None] * image[i.clip(0, height - 1), j.clip(0, width - 1)]
    return np.asarray(found)


def seen(mesh: Mesh, camera: Camera, textured: bool) -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] sRGB of 1, and [H, W] where it covers the whole px."""
    owner, weights = drawn(mesh, camera)
    at = np.maximum(owner, 0)
    if textured and mesh.texture is not None:
        places = (mesh.texture.places[mesh.texture.faces[at]] * weights[..., None]).sum(axis=2)
        colour = mixed(mesh.texture.image, places[..., 0], places[..., 1])
    else:
        assert mesh.colours is not None
        colour = (mesh.colours[mesh.faces[at]] * weights[..., None]).sum(axis=2)
    blocks = (camera.height, RAYS, camera.width, RAYS)
    return colour.reshape(*blocks, 3).mean(axis=(1, 3)) / 255.0, (owner >= 0).reshape(blocks).all(axis=(1, 3))


def truth(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] sRGB of 1, and [H, W] where it is opaque."""
    whole = np.asarray(Image.open(file).convert("RGBA"), np.float64) / 255.0
    return whole[..., :3], whole[..., 3] > 0.999


def main() -> None:
    """Makes the meshes, compares them, prints a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("twin", type=Path)
    parser.add_argument("set", type=Path)
    parser.add_argument("--mesh", nargs="+", default=["500000:0", "50000:1024", "50000:2048"])
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    gaussians, cameras = splats_and_cameras(options.twin)
    trained = {camera.name for camera in cameras}
    pinholes = read_cameras(options.set / "transforms.json").pinholes()
    held_out = [camera for name, camera in sorted(pinholes.items()) if name not in trained]
    ways: dict[str, tuple[Mesh, bool]] = {}
    for asked in options.mesh:
        faces, size = map(int, asked.split(":"))
        before, spent = time.monotonic(), time.process_time()
        made = build_mesh(gaussians, cameras, MeshSettings(faces=faces, texture=size), Silent())
        took = f"{time.process_time() - spent:.0f} s of a core, {time.monotonic() - before:.0f} s"
        print(f"{len(made.mesh.faces)} faces, {size}: texel {made.texel / made.pixel:.2f} px, {took}", flush=True)
        ways[f"{faces} corners"] = made.mesh, False
        if size:
            ways[f"{faces} texture {size}"] = made.mesh, True
    rows = compared(ways, held_out, options.set / "sharp", options.picture)
    for name, values in rows.items():
        print(f"{name:24} {np.mean(values):.2f} dB")


def compared(
    ways: dict[str, tuple[Mesh, bool]], held_out: list[Camera], sharp: Path, picture: Path | None
) -> dict[str, list[float]]:
    """PSNR of each way in each view, where all of them and the truth are whole; the picture shows the first view."""
    rows: dict[str, list[float]] = {name: [] for name in ways}
    for index, camera in enumerate(held_out):
        true, inside = truth(sharp / camera.name)
        views = {name: seen(mesh, camera, textured) for name, (mesh, textured) in ways.items()}
        inside = np.logical_and.reduce([inside, *(whole for _, whole in views.values())])
        for name, (image, _) in views.items():
            rows[name].append(float(-10 * np.log10(((image - true)[inside] ** 2).mean())))
        if picture is not None and index < SHOWN:
            shown = [image * whole[..., None] for image, whole in views.values()]
            strip = np.concatenate([*shown, true], axis=1).clip(0.0, 1.0)
            Image.fromarray(np.round(strip * 255).astype(np.uint8)).save(picture, quality=85)
    return rows


if __name__ == "__main__":
    main()
