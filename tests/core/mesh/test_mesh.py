"""Depths of flat splats, distances fused from them, and meshes: against closed forms and plain numpy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.errors import DgsError, FormatError
from dgs.core.formats.gltf_file import open_gltf
from dgs.core.formats.meshes import write_mesh
from dgs.core.gaussians import Gaussians
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.mesh.cleaning import CleaningSettings, decimated, face_areas, without_crumbs
from dgs.core.mesh.fusion_kernels import mark_blocks
from dgs.core.mesh.marching import zero_surface
from dgs.core.mesh.surfaces import SeenSurface, weights
from dgs.core.mesh.volume import Volume, VolumeSettings, fused, points_of, usual_voxel
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings, blended_depths, render, surface_of_centres
from dgs.core.triangles import Mesh
from dgs.studies.stability.fuzzed_state import write_twin
from plyfile import PlyData
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

RADIUS = 0.5


def looking_at_the_middle(angle: float, tilt: float = 0.3, width: int = 96, height: int = 80) -> Camera:
    """A camera 2 units from the origin."""
    centre = 2.0 * np.array([np.sin(angle) * np.cos(tilt), -np.sin(tilt), -np.cos(angle) * np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(f"{angle:.2f}", width, height, 110.0, 110.0, width / 2, height / 2, rotation, -rotation @ centre)


def ball_depth(camera: Camera) -> np.ndarray:
    """[H, W] depth of a ball round the origin in closed form; NaN beside it."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    middle = camera.translation
    a, b, c = (rays**2).sum(-1), rays @ middle, middle @ middle - RADIUS**2
    with np.errstate(invalid="ignore"):
        return ((b - np.sqrt(b * b - a * c)) / a).astype(np.float32)


def flat_ball(count: int = 6000) -> Gaussians:
    """Opaque flat splats on a ball round the origin."""
    golden = np.arange(count) * np.pi * (3 - np.sqrt(5))
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    normals = np.stack([np.sqrt(1 - z * z) * np.cos(golden), np.sqrt(1 - z * z) * np.sin(golden), z], axis=1)
    quaternions = np.concatenate([1 + normals[:, 2:], -normals[:, 1:2], normals[:, :1], np.zeros((count, 1))], axis=1)
    size = 1.2 * RADIUS * np.sqrt(4 * np.pi / count) / 2
    scales = np.tile([size, size, 0.02 * size], (count, 1))
    colours = (normals[:, None] * 0.4) / 0.28209479
    arrays = (RADIUS * normals, np.log(scales), quaternions, np.full(count, 6.0), colours)
    return Gaussians(*(torch.tensor(array, dtype=torch.float32) for array in arrays))


def seen_balls() -> list[SeenSurface]:
    found = []
    for angle in np.arange(8) * np.pi / 4:
        camera = looking_at_the_middle(angle)
        depth = ball_depth(camera)
        image = np.full((3, *depth.shape), 0.5, np.float32)
        found.append(SeenSurface(camera, depth, weights(depth, camera), image))
    return found


def test_depths_of_centres_are_those_of_the_rasterizer() -> None:
    twin, camera = flat_ball(800), looking_at_the_middle(0.4)
    with torch.no_grad():
        drawn = render(twin, camera, settings=RasterSettings(depth=True))
    depths = blended_depths(twin, camera, centres=True)
    assert drawn.depth is not None
    solid = drawn.alpha.numpy() > 0.5
    assert solid.sum() > 500
    assert np.allclose(depths.alpha, drawn.alpha.numpy(), atol=1e-4)
    assert np.allclose(depths.expected[solid], (drawn.depth / drawn.alpha).numpy()[solid], rtol=1e-4)


@pytest.mark.parametrize("held", [0.3, 0.5, 0.9])
def test_the_surface_alone_is_that_of_all_depths(held: float) -> None:
    """Also where the last tiles are cut, and where a tile ends before its Gaussians do."""
    random = torch.Generator().manual_seed(3)
    twin, camera = flat_ball(800), looking_at_the_middle(0.4)
    twin = replace(twin, opacity_logits=torch.randn(len(twin), generator=random) * 2)
    camera = replace(camera, width=camera.width - 5, height=camera.height - 7)
    settings = RasterSettings(low_pass=0.5)
    there = blended_depths(twin, camera, settings, held=held, centres=True).surface
    found = surface_of_centres(twin, camera, settings, held=held)
    assert np.isfinite(there).mean() > 0.1
    assert (np.isfinite(there) != np.isfinite(found)).mean() < 1e-3, "but where the level is just met"
    both = np.isfinite(there) & np.isfinite(found)
    assert np.isclose(found[both], there[both], rtol=1e-6).mean() > 0.999


def test_one_flat_splat_lies_in_its_plane() -> None:
    """Seen from aside, its depth changes over the frame as the plane's does; its centre's does not."""
    turn = 0.5
    quaternion = [np.cos(turn / 2), np.sin(turn / 2), 0.0, 0.0]
    arrays = ([[0.0, 0.0, 2.0]], [np.log([0.3, 0.3, 0.001])], [quaternion], [5.0], [[[1.0, 1.0, 1.0]]])
    splat = Gaussians(*(torch.tensor(np.array(a), dtype=torch.float32) for a in arrays))
    camera = Camera("one", 40, 40, 60.0, 60.0, 20.0, 20.0, np.eye(3), np.zeros(3))
    depths = blended_depths(splat, camera)
    y = (np.arange(40) + 0.5 - 20.0) / 60.0
    normal = np.array([0.0, -np.sin(turn), np.cos(turn)])
    plane = 2.0 * normal[2] / (normal[1] * y + normal[2])
    seen = depths.alpha[:, 20] > 0.6
    assert seen.sum() > 8
    assert np.allclose(depths.surface[seen, 20], plane[seen], atol=2e-4)
    assert np.allclose(depths.spread[seen, 20], 0.0, atol=2e-3)
    assert np.allclose(blended_depths(splat, camera, centres=True).surface[seen, 20], 2.0)


def scattered(count: int) -> Gaussians:
    """Long and flat Gaussians of every direction, faint and opaque; the last one's turn is no number."""
    random = np.random.default_rng(6)
    means = random.uniform([-0.6, -0.9, 1.0], [0.6, 0.9, 3.0], (count, 3))
    turns = random.standard_normal((count, 4))
    turns[-1] = 0.0
    arrays = (means, np.log(random.uniform(0.02, 0.3, (count, 3))), turns, random.uniform(-2, 3, count))
    colours = np.zeros((count, 1, 3))
    return Gaussians(*(torch.tensor(array, dtype=torch.float32) for array in (*arrays, colours)))


def densest_plainly(twin: Gaussians, camera: Camera) -> np.ndarray:
    """[N, H, W] depth at which each Gaussian is densest along the ray of each px, in plain numpy."""
    w, x, y, z = (twin.quaternions / twin.quaternions.norm(dim=1, keepdim=True)).double().numpy().T
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z)]
    rows += [1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x)]
    turns = camera.rotation @ np.stack([*rows, 1 - 2 * (x * x + y * y)], axis=1).reshape(-1, 3, 3)
    scales = twin.log_scales.double().exp().numpy()
    metric = np.einsum("nik,nk,njk->nij", turns, scales**-2, turns)
    middle = twin.means.double().numpy() @ camera.rotation.T + camera.translation
    across, down = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(across - camera.cx) / camera.fx, (down - camera.cy) / camera.fy, np.ones_like(across)], axis=-1)
    along = np.einsum("yxi,nij,nj->nyx", rays, metric, middle) / np.einsum("yxi,nij,yxj->nyx", rays, metric, rays)
    reach = 3.0 * np.sqrt((turns[:, 2] ** 2 * scales**2).sum(axis=1))
    least, most = ((middle[:, 2] + side * reach)[:, None, None] for side in (-1, 1))
    return np.clip(along, np.maximum(least, 0.0), most)


@pytest.mark.parametrize("held", [0.3, 0.6])
def test_depths_along_rays_are_those_of_gaussians_blended_one_by_one(held: float) -> None:
    """Each Gaussian rendered alone says how opaque it is; also where tiles are cut, and beside what is no Gaussian."""
    twin, camera = scattered(60), Camera("one", 37, 70, 60.0, 64.0, 18.0, 36.0, np.eye(3), np.zeros(3))
    camera = replace(camera, rotation=looking_at_the_middle(0.05).rotation, translation=np.array([0.1, 0.0, 0.2]))
    found = blended_depths(twin, camera, held=held)
    sound = Gaussians(*(tensor[:-1] for _, tensor in twin.named()))
    where, middle = densest_plainly(sound, camera), sound.means.double().numpy() @ camera.rotation[2]
    clear, mean, square, level = np.ones((70, 37)), *np.zeros((3, 70, 37))
    for index in np.argsort(middle):
        alone = Gaussians(*(tensor[index : index + 1] for _, tensor in sound.named()))
        with torch.no_grad():
            weight = render(alone, camera, settings=RasterSettings()).alpha.numpy() * np.where(clear < 1e-4, 0.0, clear)
        falls = (clear > 1 - held) & (clear - weight <= 1 - held)
        level = np.where(falls, where[index], level)
        mean, square, clear = mean + weight * where[index], square + weight * where[index] ** 2, clear - weight
    alpha = 1 - clear
    assert alpha.mean() > 0.2 and (level > 0).mean() > 0.2 and (clear < 1e-3).any()
    assert np.allclose(found.alpha, alpha, atol=2e-4)
    solid = alpha > 0.05
    assert np.allclose(found.expected[solid], (mean / alpha)[solid], rtol=1e-3)
    spread = np.sqrt(np.maximum(square / np.maximum(alpha, 1e-9) - (mean / np.maximum(alpha, 1e-9)) ** 2, 0.0))
    assert np.allclose(found.spread[solid], spread[solid], atol=5e-3)
    both = np.isfinite(found.surface) & (level > 0)
    assert (np.isfinite(found.surface) == (level > 0)).mean() > 0.995
    assert np.isclose(found.surface[both], level[both], rtol=1e-4).mean() > 0.99


def test_surface_is_where_the_asked_share_of_light_is_held_back() -> None:
    """Three sheets that each hold back 40 %: 0.4, 0.64 and 0.784 of the light."""
    logit = float(np.log(0.4 / 0.6))
    arrays = ([[0.0, 0.0, z] for z in (1.0, 2.0, 3.0)], np.log(np.full((3, 3), [1.0, 1.0, 1e-3])))
    rest = ([[1.0, 0, 0, 0]] * 3, [logit] * 3, [[[1.0, 1.0, 1.0]]] * 3)
    sheets = Gaussians(*(torch.tensor(np.array(a), dtype=torch.float32) for a in (*arrays, *rest)))
    camera = Camera("one", 32, 32, 200.0, 200.0, 16.0, 16.0, np.eye(3), np.zeros(3))
    at = {held: blended_depths(sheets, camera, held=held).surface[16, 16] for held in (0.3, 0.5, 0.7, 0.9)}
    assert np.allclose([at[0.3], at[0.5], at[0.7]], [1.0, 2.0, 3.0], atol=1e-3) and np.isnan(at[0.9])


def fused_plainly(surfaces: list[SeenSurface], places: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """What `fuse` computes, view by view in plain numpy: mean distance in `reach` and sum of weights, at [N, 3]."""
    total, whole = np.zeros(len(places)), np.zeros(len(places))
    largest = max(float(s.weight.max()) for s in surfaces)
    for s in surfaces:
        local = places @ s.camera.rotation.T + s.camera.translation
        column = np.floor(s.camera.fx * local[:, 0] / local[:, 2] + s.camera.cx).astype(int)
        row = np.floor(s.camera.fy * local[:, 1] / local[:, 2] + s.camera.cy).astype(int)
        inside = (column >= 0) & (row >= 0) & (column < s.camera.width) & (row < s.camera.height)
        at = np.clip(row, 0, s.camera.height - 1), np.clip(column, 0, s.camera.width - 1)
        distance = (s.depth[at] - local[:, 2]) / reach
        weight = np.where(inside & (np.abs(distance) <= 1) & (s.weight[at] > 0), s.weight[at] / largest, 0.0)
        total, whole = total + np.where(weight > 0, weight * distance, 0.0), whole + weight
    return total / np.maximum(whole, 1e-30), whole


def test_fused_distances_are_those_of_plain_numpy() -> None:
    surfaces, voxel = seen_balls(), 0.03
    volume = fused(surfaces, voxel)
    inside = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for block in (0, len(volume.blocks) // 2, len(volume.blocks) - 1):
        places = volume.low + (volume.blocks[block] * 8 + inside + 0.5) * voxel
        value, weight = fused_plainly(surfaces, places, VolumeSettings().reach * voxel)
        assert np.allclose(volume.weights[block].ravel(), weight, atol=1e-5)
        seen = weight > 1e-6
        assert np.allclose(volume.values[block].ravel()[seen] / VolumeSettings().reach, value[seen], atol=1e-4)


def test_a_ball_comes_out_round_closed_and_the_right_way_out() -> None:
    mesh = zero_surface(fused(seen_balls(), 0.018))
    distance = np.linalg.norm(mesh.vertices, axis=1)
    assert len(mesh.faces) > 5000
    assert np.median(np.abs(distance - RADIUS)) < 0.3 * 0.018
    assert np.abs(distance - RADIUS).max() < 4 * 0.018
    outwards = (mesh.normals() * mesh.vertices).sum(axis=1) / distance
    assert np.mean(outwards > 0.5) > 0.98
    # eight cameras a little above its middle see all but its two ends: every border lies there, and no seam is open
    borders = mesh.vertices[np.unique(mesh.open_edges())]
    assert len(borders) and (np.abs(borders[:, 1]) > 0.2).all()


def test_parts_that_meet_are_welded() -> None:
    """The surface crosses parts of 64 voxels: without welding there is a seam at each."""
    mesh = zero_surface(fused(seen_balls(), 0.01))
    extent = np.ptp(mesh.vertices, axis=0) / 0.01
    borders = mesh.vertices[np.unique(mesh.open_edges())]
    assert extent.max() > 90 and (np.abs(borders[:, 1]) > 0.2).all()


def noisy_volume(count: int) -> Volume:
    """Blocks that fill a box with smooth noise; some voxels were not seen, and a block is missing."""
    random = np.random.default_rng(4)
    sizes = np.array([count, 2, 2])
    places = np.argwhere(np.ones(sizes, bool)).astype(np.int32)
    field = gaussian_filter(random.standard_normal(sizes * 8), 1.5).astype(np.float32)
    field[10, 3, 5] = 0.0
    known = random.random(field.shape) > 0.01
    blocks = [tuple(slice(8 * p, 8 * p + 8) for p in place) for place in np.delete(places, 7, axis=0)]
    values, weights = (np.stack([array[block] for block in blocks]) for array in (field, known.astype(np.float32)))
    return Volume(np.zeros(3), 1.0, np.delete(places, 7, axis=0), values, weights, values**2, 0.0)


def test_the_surface_is_that_of_one_dense_field() -> None:
    """Marching cubes of all voxels at once, where a cell's corners were all seen; here they are filled part by part."""
    volume = noisy_volume(10)
    dense, seen = np.ones((80, 16, 16), np.float32), np.zeros((80, 16, 16), bool)
    for place, values, known in zip(volume.blocks, volume.values, volume.weights, strict=True):
        at = tuple(slice(8 * p, 8 * p + 8) for p in place)
        dense[at], seen[at] = np.where(np.abs(values) < 1e-3, 1e-3 * np.where(values < 0, -1, 1), values), known > 0
    cells = np.zeros_like(seen)
    cells[1:, 1:, 1:] = np.lib.stride_tricks.sliding_window_view(seen, (2, 2, 2)).all(axis=(3, 4, 5))
    corners, faces, _, _ = marching_cubes(dense, 0.0, mask=cells, gradient_direction="descent")
    mesh = zero_surface(volume)
    assert len(mesh.faces) > 3000 and (~seen).sum() > 500

    expected, found = (corners + 0.5)[faces].mean(axis=1), mesh.vertices[mesh.faces].mean(axis=1)
    assert len(found) == len(expected)
    for some, others in ((found, expected), (expected, found)):
        assert cKDTree(others).query(some)[0].max() < 1e-4


def test_blocks_are_marked_all_along_each_ray_and_beside_it() -> None:
    """Eight corners of a box of 1.5 voxels about each step, one by one."""
    surface, voxel, reach, shape = seen_balls()[1], 0.03, 0.12, (3, 9, 9)
    camera, low = surface.camera, np.array([-0.1, -1.0, -1.0])
    pose = np.concatenate([camera.rotation.ravel(), camera.translation])
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    marked, expected = np.zeros((2, *shape), np.uint8)
    outside = 0
    mark_blocks(0, 27, surface.depth, pose, lens, 3, reach, voxel, low, 1.8, marked)
    rows, columns = (axis.ravel() for axis in np.mgrid[0:80:3, 0:96:3])
    near = surface.depth[rows, columns] <= 1.8
    on = points_of(surface, rows[near], columns[near]), camera.centre
    depth = surface.depth[rows[near], columns[near]][:, None].astype(float)
    for step in np.linspace(-reach, reach, 9):
        for corner in np.ndindex(2, 2, 2):
            beside = (np.array(corner) - 0.5) * 1.5 * voxel
            place = on[1] + (on[0] - on[1]) * (1 + step / depth) + beside
            block = np.floor((place - low) / (8 * voxel)).astype(int)
            there = ((block >= 0) & (block < shape)).all(axis=1)
            expected[tuple(block[there].T)] = 1
            outside += int((~there).sum())
    assert 20 < expected.sum() < 150 and outside and near.sum() < np.isfinite(surface.depth[rows, columns]).sum()
    assert np.array_equal(marked, expected)


def test_finer_voxels_lose_nothing_and_the_finest_are_made_larger() -> None:
    surfaces = seen_balls()
    fine = fused(surfaces, 0.2 * usual_voxel(surfaces))
    assert fine.far == 0.0 and np.isclose(fine.voxel, 0.2 * usual_voxel(surfaces))
    assert 1e-4 < fused(surfaces, 1e-25).voxel < 0.1 * usual_voxel(surfaces)


def test_a_twins_mesh_has_its_shape_and_colours() -> None:
    cameras = [looking_at_the_middle(angle) for angle in np.arange(8) * np.pi / 4]
    made = build_mesh(flat_ball(), cameras, MeshSettings(faces=4000), Silent())
    mesh = made.mesh
    assert mesh.colours is not None and mesh.deviation is not None
    distance = np.linalg.norm(mesh.vertices, axis=1)
    assert np.median(np.abs(distance - RADIUS)) < 0.5 * made.pixel
    assert made.made > 4000 >= len(mesh.faces) > 2000
    expected = 0.5 + 0.4 * mesh.vertices / distance[:, None]
    assert np.median(np.abs(mesh.colours / 255.0 - expected)) < 0.03
    assert (mesh.deviation >= 0).all() and np.median(mesh.deviation) < 2 * made.pixel


def test_a_twin_of_another_unit_has_the_same_mesh() -> None:
    """A thousand times smaller, the near plane alone would cut everything off."""
    cameras = [looking_at_the_middle(angle) for angle in np.arange(8) * np.pi / 4]
    small = build_mesh(flat_ball(1500), cameras, MeshSettings(), Silent())
    twin, size = flat_ball(1500), 1e-3
    twin.means, twin.log_scales = twin.means * size, twin.log_scales + float(np.log(size))
    moved = [camera.moved(camera.rotation, camera.translation * size) for camera in cameras]
    tiny = build_mesh(twin, moved, MeshSettings(), Silent())
    assert abs(len(tiny.mesh.faces) - len(small.mesh.faces)) < 0.02 * len(small.mesh.faces)
    distance = np.linalg.norm(tiny.mesh.vertices, axis=1)
    assert np.median(np.abs(distance - RADIUS * size)) < 0.5 * tiny.pixel < 0.02 * size


def test_crumbs_are_swept_and_surfaces_stay() -> None:
    ball = without_crumbs(zero_surface(fused(seen_balls(), 0.03)), 0.03)
    crumb = np.array([[2.0, 0, 0], [2.03, 0, 0], [2.0, 0.03, 0]])
    both = Mesh(
        np.concatenate([ball.vertices, crumb]),
        np.concatenate([ball.faces, [[0, 1, 2] + np.full(3, len(ball.vertices))]]),
    )
    assert len(without_crumbs(both, 0.03).faces) == len(ball.faces)
    alone = Mesh(crumb, np.array([[0, 1, 2]]))
    assert len(without_crumbs(alone, 0.03).faces) == 1
    assert len(decimated(ball, 500).faces) <= 520


def test_parts_are_those_of_scipy_and_so_are_their_areas() -> None:
    random = np.random.default_rng(5)
    vertices = random.random((900, 3))
    faces = random.integers(0, 900, (220, 3))
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    mesh = Mesh(vertices, faces)
    pairs = coo_array((np.ones(2 * len(faces)), (faces[:, [0, 1]].T.ravel(), faces[:, [1, 2]].T.ravel())), (900, 900))
    part = connected_components(pairs, directed=False)[1][faces[:, 0]]
    areas = np.bincount(part, face_areas(mesh))
    least = float(np.median(areas[areas > 0]))
    expected = mesh.with_faces(faces[areas[part] >= least])
    found = without_crumbs(mesh, 1.0, CleaningSettings(crumb=least))
    assert 0 < len(found.faces) < len(faces) and len(np.unique(part)) > 20
    assert np.array_equal(found.vertices, expected.vertices) and np.array_equal(found.faces, expected.faces)
    assert np.array_equal(mesh.faces, faces), "the mesh itself stays as it is"


def test_no_surface_says_so() -> None:
    twin = flat_ball(50)
    faint = replace(twin, opacity_logits=torch.full((50,), -5.0))
    with pytest.raises(DgsError, match="No camera sees a surface"):
        build_mesh(faint, [looking_at_the_middle(0.0)], MeshSettings(), Silent())


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply"])
def test_files_hold_the_mesh(tmp_path: Path, suffix: str) -> None:
    vertices = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 2]])
    colours = np.array([[255, 0, 0], [0, 128, 0], [0, 0, 255], [10, 20, 30]], np.uint8)
    mesh = Mesh(vertices, np.array([[0, 2, 1], [1, 2, 3]]), colours, np.arange(4, dtype=np.float32))
    file = tmp_path / f"m{suffix}"
    write_mesh(file, mesh)
    if suffix == ".glb":
        asset = open_gltf(file)
        ((content, _),) = asset.placed_meshes()
        part = content["primitives"][0]
        assert np.allclose(asset.array(part["attributes"]["POSITION"]), vertices * [1, -1, -1])
        assert asset.array(part["indices"]).ravel().tolist() == mesh.faces.ravel().tolist()
        assert np.isclose(asset.array(part["attributes"]["COLOR_0"])[1, 1], 0.2158605, atol=1e-4)
        assert asset.array(part["attributes"]["_DEVIATION"]).ravel().tolist() == [0, 1, 2, 3]
    elif suffix == ".ply":
        read = PlyData.read(str(file))
        assert np.allclose(np.stack([read["vertex"][a] for a in "xyz"], axis=1), vertices)
        assert read["vertex"]["green"].tolist() == colours[:, 1].tolist()
        assert [list(face) for face in read["face"]["vertex_indices"]] == mesh.faces.tolist()
    else:
        lines = file.read_text().splitlines()
        assert sum(line.startswith("v ") for line in lines) == 4 and "f 1//1 3//3 2//2" in lines
        assert "v 1 -1 -2 0.0392 0.0784 0.1176" in lines


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="glb, .obj, .ply"):
        write_mesh(tmp_path / "a.stl", Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)))


def test_command_writes_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_twin(tmp_path)
    out = tmp_path / "out" / "a.glb"
    words = ["mesh", str(tmp_path / "twin"), "--out", str(out), "--progress", "none"]
    assert run([*words[:-4], "--out", str(tmp_path / "a.stl")]) == 2
    assert "is no mesh that can be written" in capsys.readouterr().err
    for detail in ("0", "-1", "nan", "inf", "1e-320", "x"):
        assert run([*words, "--detail", detail]) == 2 and "above zero" in capsys.readouterr().err
    status = run(words)
    said = capsys.readouterr()
    assert status in (0, 2) and (out.is_file() if status == 0 else "surface" in said.err), said
