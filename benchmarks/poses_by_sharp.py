"""How right cameras are that were found from blurred photos: `python -m benchmarks.poses_by_sharp --data FOLDER`.

FOLDER holds `blur5/`, `sharp/` and `reference_cameras/` (structure from motion on the sharp photos). A reference that
was itself found from photos is uncertain: a camera that moves sideways and turns back is hardly seen to move. So each
set of cameras is asked two questions:

- against the reference, after similarity alignment: centres, in px at the scene's distance (medians), and by how
  many px the reference's points are laid wrong in the photos;
- against the sharp photos themselves: features of the SHARP photos, matched pair by pair (the same matches for all
  sets of cameras), and how far from their epipolar lines they lie (Sampson's distance, px). No alignment, no
  reference: a camera that is wrong is wrong here, and the reference must answer as well.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
from dgs.core.evaluation.poses import align_similarity, pose_errors
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.photos.load import Photo, load_photos
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Reconstruction
from dgs.core.sfm.find import find_cameras
from dgs.core.sfm.given import load_cameras
from dgs.core.sfm.keyframes import read_matches
from dgs.core.sfm.settings import SfmSettings
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin.refine_cameras import refine_cameras

#: Matches of a pair that count, and a match that is farther off under every set of cameras is a false one (px).
MINIMUM_MATCHES, FALSE = 30, 4.0

Pairs = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]


def sharp_matches(folder: Path, work: Path) -> Pairs:
    """Verified matches of the sharp photos, by their names without extension."""
    database = work / "sharp.db"
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu, options.num_threads, options.sift.max_num_features = False, 2, 4000
    pycolmap.extract_features(database, folder, extraction_options=options)
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu, matching.num_threads = False, 2
    pycolmap.match_exhaustive(database, matching)
    found = read_matches(database)
    out = {}
    for (a, b), index in found.pairs.items():
        if len(index) >= MINIMUM_MATCHES:
            names = Path(found.names[a]).stem, Path(found.names[b]).stem
            out[names] = (found.keypoints[a][index[:, 0]], found.keypoints[b][index[:, 1]])
    return out


def off_the_lines(cameras: Reconstruction, pairs: Pairs) -> tuple[list[tuple[str, str]], list[np.ndarray]]:
    """Sampson's distance in px of all matches, pair by pair."""
    stems = {Path(name).stem: name for name in cameras.poses}
    keys, found = [], []
    for (a, b), (first, second) in pairs.items():
        if a not in stems or b not in stems:
            continue
        rays = [cameras.lenses[stems[s]].from_pixels(p) for s, p in ((a, first), (b, second))]
        x, y = (np.concatenate([ray, np.ones((len(ray), 1))], axis=1) for ray in rays)
        one, two = cameras.poses[stems[a]], cameras.poses[stems[b]]
        rotation = two.rotation @ one.rotation.T
        shift = two.translation - rotation @ one.translation
        cross = np.array([[0, -shift[2], shift[1]], [shift[2], 0, -shift[0]], [-shift[1], shift[0], 0]])
        essential = cross @ rotation
        there, back = x @ essential.T, y @ essential
        square = (y * there).sum(axis=1) ** 2 / ((there[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1))
        keys.append((a, b))
        found.append(np.sqrt(square) * cameras.lenses[stems[a]].fx)
    return keys, found


def laid_wrong(cameras: Reconstruction, truth: Reconstruction) -> float:
    """Median px by which the truth's points are laid wrong in the photos, after similarity alignment."""
    mine, right = cameras.cameras(), truth.cameras()
    to_truth = align_similarity(mine, right)
    out = []
    points = truth.points.positions
    for name in sorted(set(mine) & set(right)):
        places = []
        for camera in (to_truth.camera(mine[name]), right[name]):
            local = points @ camera.rotation.T + camera.translation
            places.append(local[:, :2] / local[:, 2:] * [camera.fx, camera.fy])
            inside = (local[:, 2] > 0) & (np.abs(places[-1]) < [camera.width / 2, camera.height / 2]).all(axis=1)
        out.append(np.linalg.norm(places[0] - places[1], axis=1)[inside])
    return float(np.median(np.concatenate(out)))


def refined(found: Reconstruction, photos: list[Photo], psf: PointSpread) -> tuple[Reconstruction, str]:
    """The cameras through the loss, whether they are kept or not, and what the product would decide."""
    views = undistorted_views([p for p in photos if p.name in found.poses], found)
    settings = TrainingSettings.preset("balanced")
    out = refine_cameras(views, [], found.points, Medium(psf), settings, Silent())
    poses = {name: Pose(c.rotation, c.translation) for name, c in out.tried.items()}
    given = {view.name: view.camera for view in views}
    lenses = {}
    for name, camera in out.tried.items():
        lens = found.lenses[name]
        lenses[name] = replace(lens, params=(lens.fx * camera.fx / given[name].fx, *lens.params[1:]))
    return Reconstruction(poses, lenses, found.points, found.figures), "kept" if out.kept else "not kept"


def report(folder: Path, psf: PointSpread) -> None:
    """A table's rows for one set."""
    photos, sharp = load_photos(folder / "blur5", None, Silent()), load_photos(folder / "sharp", None, Silent())
    truth = load_cameras(folder / "reference_cameras", photos)
    plain = SfmSettings().unrefined()
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        pairs = sharp_matches(folder / "sharp", work)
        sets = {
            "the reference": truth,
            "found from the sharp photos": find_cameras(sharp, None, SfmSettings(), work, Silent()),
        }
        sets["blurred, features alone"] = find_cameras(photos, psf.kernel(), plain, work, Silent())
        sets["blurred, as found"] = found = find_cameras(photos, psf.kernel(), SfmSettings(), work, Silent())
    moved, decision = refined(found, photos, psf)
    sets[f"blurred, through the loss ({decision})"] = moved
    lines = {label: off_the_lines(cameras, pairs) for label, cameras in sets.items()}
    common = set.intersection(*(set(keys) for keys, _ in lines.values()))
    by_pair = {label: dict(zip(*line, strict=True)) for label, line in lines.items()}
    order = sorted(common)
    least = np.min([np.concatenate([found[k] for k in order]) for found in by_pair.values()], axis=0)
    true = least < FALSE
    for label, cameras in sets.items():
        errors = pose_errors(
            {Path(n).stem: c for n, c in cameras.cameras().items()},
            {Path(n).stem: c for n, c in truth.cameras().items()},
            truth.points.positions,
        )
        off = np.concatenate([by_pair[label][k] for k in order])[true]
        stems = Reconstruction(
            {Path(n).stem: p for n, p in cameras.poses.items()},
            {Path(n).stem: p for n, p in cameras.lenses.items()},
            cameras.points,
            cameras.figures,
        )
        right = Reconstruction(
            {Path(n).stem: p for n, p in truth.poses.items()},
            {Path(n).stem: p for n, p in truth.lenses.items()},
            truth.points,
            truth.figures,
        )
        print(
            f"| {folder.name} | {label} | {len(cameras.poses)} | {100 * np.median(errors.focal):+.2f} % "
            f"| {np.nanmedian(errors.centre_px):.2f} | {laid_wrong(stems, right):.2f} "
            f"| {np.median(off):.2f}, {np.sqrt((np.minimum(off, FALSE) ** 2).mean()):.2f} |",
            flush=True,
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", required=True, metavar="FOLDER")
    parser.add_argument("--psf", default="gaussian:5")
    options = parser.parse_args()
    print("| set | cameras | placed | focal | centre, px | points laid wrong, px | off their lines, px: median, rms |")
    print("|---|---|---|---|---|---|---|")
    for folder in options.data:
        report(folder, parse_psf(options.psf))
    return 0


if __name__ == "__main__":
    sys.exit(main())
