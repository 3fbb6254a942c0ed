"""Lengths and meshes of twins against rendered truth: how many 95 % intervals hold, how far surfaces are off.

    python -m benchmarks.measured FOLDER                     # what is missing is rendered, trained and measured; hours
    python -m benchmarks.measured FOLDER --only shelf-5      # one set
    python -m benchmarks.measured FOLDER --table             # what is there already
    python -m benchmarks.measured FOLDER --only shelf-5 --marks 4   # each corner on four photos; printed, not kept

FOLDER holds sets NAME-SIGMA (photos of the laboratory's scenes blurred by SIGMA px, with depth maps; NAME-0 is sharp)
and twins/NAME-SIGMA (the draft preset, cameras given). Each figure is kept in benchmarks/measured.json as soon as it is
there; a run that was stopped goes on.

Lengths: corners of the SHARP photos (where their depth is no step) are marked on eight photos with an error of 0.3 px,
and lengths between corners of one photo are measured as `run_dgs.py measure` does, on held-out photos, too.
Mesh: 100,000 points of `run_dgs.py mesh`'s surface, px of the photos weighed alike, against the truth's depth maps (to
the plane of the nearest true px), and 50,000 true px against the mesh; in px-equivalents.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from dgs.core.camera import Camera
from dgs.core.formats.cameras import read_cameras
from dgs.core.measure.measured import measure
from dgs.core.measure.places import PRECISION
from dgs.core.measure.request import AskedMeasure, AskedPlace, MeasureRequest, Point
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.mesh.matching import Matching
from dgs.core.mesh.surfaces import weights
from dgs.core.progress import Silent
from dgs.core.triangles import Mesh
from dgs.core.twin.opened import open_twin
from dgs.core.twin.seen_by import splats_and_cameras
from PIL import Image
from scipy.spatial import cKDTree
from skimage.feature import corner_shi_tomasi, peak_local_max

ROOT = Path(__file__).resolve().parents[1]
ROWS = ROOT / "benchmarks" / "measured.json"
#: How each scene is rendered.
SCENES = {
    "shelf": ("front", 32, 8, []),
    "orrery": ("dome", 48, 16, ["--background", "transparent"]),
    "village": ("drone", 48, 8, []),
    "rugby-ball": ("patch", 40, 16, []),
}
SIGMAS = (0, 1, 2, 3, 5, 8)
#: What the settings of `core.measure.places` were chosen on; all others check them.
CHOSEN_ON = ("shelf-3", "shelf-5", "orrery-2", "orrery-5")
PHOTOS, LENGTHS, STEP = 8, 480, 6.0
#: px from a photo's border within which nothing is marked.
EDGE = 3.0


def run_dgs(*words: object) -> None:
    subprocess.run([sys.executable, str(ROOT / "run_dgs.py"), *map(str, words), "--progress", "none"], check=True)


def prepared(folder: Path, name: str) -> tuple[Path, Path]:
    """The set and its twin, made if they are not there."""
    scene, sigma = name.rsplit("-", 1)
    path, views, samples, more = SCENES[scene]
    photos, twin, psf = folder / name, folder / "twins" / name, "none" if sigma == "0" else f"gaussian:{sigma}"
    if not (photos / "depth").is_dir():
        words = ["--scene", scene, "--path", path, "--views", views, "--size", "400x300", "--samples", samples, *more]
        run_dgs("synthesize", "--out", photos, *words, "--overscan", 20, "--psf", psf, "--depth")
    if not (twin / "report.json").is_file():
        given = ["--cameras", photos / "transforms.json", "--psf", psf, "--preset", "draft", "--effects", "none"]
        run_dgs("reconstruct", photos / "photos", "--out", twin, *given)
    return photos, twin


def true_depth(photos: Path, name: str) -> np.ndarray:
    depth = np.load(photos / "depth" / f"{Path(name).stem}.npy").astype(np.float64)
    return np.where(np.isfinite(depth) & (depth < 1e5), depth, np.nan)


def unprojected(camera: Camera, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    local = np.stack([(x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z], axis=-1)
    return (local - camera.translation) @ camera.rotation


def corners(photos: Path, camera: Camera, count: int) -> tuple[np.ndarray, np.ndarray]:
    """[n, 2] px of corners of the sharp photo whose depth is known and no step, and [n, 3] where they are."""
    depth = true_depth(photos, camera.name)
    picture = Image.open(photos / "sharp" / camera.name).convert("RGBA")
    white = Image.new("RGBA", picture.size, (255, 255, 255, 255))
    grey = np.asarray(Image.alpha_composite(white, picture).convert("L"), np.float64)
    strong = np.where(np.isfinite(depth), corner_shi_tomasi(grey, 2), 0.0)
    found, places = [], []
    for row, column in peak_local_max(strong, min_distance=6, num_peaks=4 * count, exclude_border=12):
        around = depth[row - 1 : row + 2, column - 1 : column + 2]
        if np.isfinite(around).all() and np.ptp(around) < STEP * around.mean() / camera.fx and len(found) < count:
            found.append((column + 0.5, row + 0.5))
            places.append(
                unprojected(camera, np.array(column + 0.5), np.array(row + 0.5), np.array(depth[row, column]))
            )
    return np.array(found).reshape(-1, 2), np.array(places).reshape(-1, 3)


def shown_by(photos: Path, cameras: dict[str, Camera], place: np.ndarray) -> dict[str, np.ndarray]:
    """[2] px of a place in each photo that shows it."""
    found = {}
    for name, camera in cameras.items():
        x, y, z = camera.rotation @ place + camera.translation
        at = np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
        if z > 0 and (at > EDGE).all() and (at < [camera.width - EDGE, camera.height - EDGE]).all():
            depth = true_depth(photos, name)[int(at[1]), int(at[0])]
            if abs(depth - z) < 2 * z / camera.fx:  # (False where it is not known)
                found[name] = at
    return found


def marked(own: str, shown: dict[str, np.ndarray], marks: int, random: np.random.Generator) -> dict[str, Point]:
    """A place's marks on its own photo and some others that show it, evenly chosen, each off by what a click is."""
    others = sorted(set(shown) - {own})
    chosen = np.unique(np.linspace(0, len(others) - 1, min(marks - 1, len(others))).round().astype(int))
    found = dict[str, Point]()
    for name in (own, *(others[index] for index in chosen if marks > 1)):
        x, y = shown[name] + random.normal(0.0, PRECISION.click, 2)
        found[name] = (float(x), float(y))
    return found


def lengths(photos: Path, twin_folder: Path, marks: int = 1) -> dict[str, Any]:
    """Errors and intervals of lengths, px-equivalents, of corners that are marked on so many photos."""
    twin, random = open_twin(twin_folder, Silent()), np.random.default_rng(0)
    cameras = read_cameras(photos / "transforms.json").pinholes()
    names = sorted(view.name for view in twin.views)
    places, measures, truth = dict[str, AskedPlace](), list[AskedMeasure](), dict[str, float]()
    for photo in names[:: len(names) // PHOTOS][:PHOTOS]:
        found, true = corners(photos, cameras[photo], LENGTHS)
        pairs = [random.permutation(len(found))[:2] for _ in range(LENGTHS // PHOTOS)] if len(found) > 1 else []
        for a, b in pairs:
            ends = []
            for index in (a, b):
                ends.append(f"{photo} {index}")
                shown = {photo: found[index]}
                if marks > 1:
                    shown = shown_by(photos, {name: cameras[name] for name in names}, true[index]) | shown
                where = marked(photo, shown, marks, random)
                places.setdefault(ends[-1], AskedPlace(ends[-1], where, None, None))
            name = f"{photo} {len(measures)}"
            measures.append(AskedMeasure(name, "length", (ends[0], ends[1])))
            truth[name] = float(np.linalg.norm(true[a] - true[b]))
    result = measure(twin, MeasureRequest(places, tuple(measures), None), 0.0, Silent())
    rows = []
    for one in result.measures:
        if one.value is not None and one.deviation is not None:
            pixel = np.mean([result.places[name]["pixel"] for name in one.of])  # (a length is given in these px)
            rows.append((one.value - truth[one.name] / pixel, one.deviation))
    error, deviation = np.array(rows).T
    return {
        "lengths": len(rows),
        "not measured": len(measures) - len(rows),
        "held": int((np.abs(error) <= 1.96 * deviation).sum()),
        "median error": round(float(np.median(np.abs(error))), 3),
        "median deviation": round(float(np.median(deviation)), 3),
    }


def truth_cloud(photos: Path, cameras: list[Camera]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True px of all cameras: [n, 3] places, [n, 3] normals (NaN at steps), [n] size of a px."""
    parts = []
    for camera in cameras:
        depth = true_depth(photos, camera.name)
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        world = unprojected(camera, x, y, depth)
        normal = np.cross(np.gradient(world, axis=1), np.gradient(world, axis=0))
        with np.errstate(invalid="ignore", divide="ignore"):
            normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
            pixel = depth / camera.fx
            normal[weights(depth.astype(np.float32), camera) * pixel**2 < 0.05] = np.nan
        known = np.isfinite(depth)
        parts.append((world[known], normal[known], pixel[known]))
    cloud = tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    chosen = np.random.default_rng(1).permutation(len(cloud[0]))[:700_000]
    return cloud[0][chosen], cloud[1][chosen], cloud[2][chosen]


def sampled(mesh: Mesh, cameras: list[Camera], density: float, random: np.random.Generator) -> np.ndarray:
    """Places on a mesh, as many for each px of the nearest camera everywhere."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area, size = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, np.full(len(a), np.inf)
    for camera in cameras:
        z = ((a + b + c) / 3 @ camera.rotation.T + camera.translation)[:, 2]
        size = np.where(z > 0, np.minimum(size, np.abs(z) / camera.fx), size)
    weight = np.nan_to_num(area / size**2)
    count = min(1_000_000, int(density * weight.sum()) + 1)
    face = random.choice(len(weight), count, p=weight / weight.sum())
    share = random.random((count, 2))
    share = np.where((share.sum(1) > 1)[:, None], 1 - share, share)
    return np.asarray(a[face] + share[:, :1] * (b - a)[face] + share[:, 1:] * (c - a)[face])


def mesh_errors(photos: Path, twin_folder: Path, matching: Matching = "filled") -> dict[str, Any]:
    """Distances between the twin's mesh and the truth, px-equivalents; with the mesh's own limit of what is near."""
    gaussians, cameras = splats_and_cameras(twin_folder)
    made = build_mesh(gaussians, cameras, MeshSettings(matching=matching), Silent())
    places, normals, pixels = truth_cloud(photos, cameras)
    near = pixels < 3.0 * made.voxel
    places, normals, pixels = places[near], normals[near], pixels[near]
    random = np.random.default_rng(0)
    on_mesh = sampled(made.mesh, cameras, 4.0, random)[:100_000]
    apart, nearest = cKDTree(places).query(on_mesh, workers=-1)
    off = _distances(on_mesh - places[nearest], apart, normals[nearest], pixels[nearest])
    true = random.permutation(len(places))[:50_000]
    dense = sampled(made.mesh, cameras, 9.0, random)
    apart, nearest = cKDTree(dense).query(places[true], workers=-1)
    missed = _distances(places[true] - dense[nearest], apart, normals[true], pixels[true])
    right, whole = float((off < 1).mean()), float((missed < 1).mean())
    return {
        "mesh median": round(float(np.median(off)), 3),
        "within 1 px": round(right, 3),
        "completeness": round(whole, 3),
        "F": round(2 * right * whole / (right + whole), 3),
        "faces": len(made.mesh.faces),
    }


def _distances(offset: np.ndarray, apart: np.ndarray, normal: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """[n] px: to the plane of what is near, to the place itself of what is not."""
    plane = np.abs((offset * normal).sum(axis=1))
    return np.where(np.isfinite(plane) & (apart < 3 * pixel), plane, apart) / pixel


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Markdown."""
    head = "| set | lengths | held | error, px | deviation, px | mesh, px | within 1 px | completeness | F |"
    out = [head, "|" + "---|" * 9]
    for name, row in sorted(rows.items()):
        share = f"{100 * row['held'] / max(1, row['lengths']):.0f} %"
        star = "" if name in CHOSEN_ON else " *"
        keys = ("median error", "median deviation", "mesh median", "within 1 px", "completeness", "F")
        cells = [name + star, row["lengths"], share, *[row.get(key, "") for key in keys]]
        out.append("| " + " | ".join(map(str, cells)) + " |")
    for words, chosen in (("chosen on", True), ("checked on (*)", False)):
        some = [row for name, row in rows.items() if (name in CHOSEN_ON) == chosen]
        count, held = sum(row["lengths"] for row in some), sum(row["held"] for row in some)
        out.append(f"\n{words}: {held} of {count} lengths held ({100 * held / max(1, count):.1f} %)")
    return "\n".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", metavar="SET")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--marks", type=int, default=1, help="photos that each corner is marked on")
    options = parser.parse_args()
    if options.marks > 1:
        for name in options.only or [f"{scene}-5" for scene in SCENES]:
            print(name, lengths(*prepared(options.folder, name), marks=options.marks), flush=True)
        return
    rows = json.loads(ROWS.read_text()) if ROWS.is_file() else {}
    wanted = options.only or [f"{scene}-{sigma}" for sigma in SIGMAS for scene in SCENES]
    parts = {"held": lengths, "F": mesh_errors}  # what each adds to a row, by a figure that it brings
    for figure, part in parts.items() if not options.table else ():
        for name in wanted:
            if figure not in rows.get(name, {}):
                rows[name] = {**rows.get(name, {}), **part(*prepared(options.folder, name))}
                ROWS.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")
                print(name, rows[name], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
