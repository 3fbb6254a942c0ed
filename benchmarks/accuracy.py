#!/usr/bin/env python3
"""How sharp the twin becomes, against what else could be done with the same blurred photos.

    python benchmarks/accuracy.py --data FOLDER [--data FOLDER ...] [--seeds 3] [--steps 1000]

FOLDER holds `blur5/` (or `photos/`) and `sharp/`; cameras come from the blurred photos (found once,
kept in benchmarks/runs/) or from `--cameras`. Every method runs the same optimizer on the same grid
with the same budget, seeds and held-out views (0, 8, 16, ...):

    plain         Gaussian splatting of the blurred photos
    wiener n vW   each photo deconvolved with noise-to-signal ratio n, then Gaussian splatting with
                  total variation W. n 'measured' is what the photos' own spectra tell: the choice
                  that needs no truth, with the W of our own method.
    paper         the loss of the paper: MAE + SSIM on the degraded render
    dgs           ours
    oracle        Gaussian splatting of the sharp photos

Scores: the sharp render, through the photo's own lens and at its size, against the sharp photo.
Rows that are there already are not run again. Writes benchmarks/accuracy_<set>.json and .md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin: minutes on a busy machine

import run_dgs  # noqa: E402

run_dgs.mount_package()

import accuracy_table  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from dgs.core import compiled  # noqa: E402
from dgs.core.errors import DgsError  # noqa: E402
from dgs.core.evaluation.metrics import low_passed_truth_psnr  # noqa: E402
from dgs.core.files import write_json  # noqa: E402
from dgs.core.formats.colmap import write_lenses  # noqa: E402
from dgs.core.imaging.fourier import wiener_photo  # noqa: E402
from dgs.core.imaging.medium import Medium  # noqa: E402
from dgs.core.imaging.psf import parse_psf  # noqa: E402
from dgs.core.imaging.spectrum import OPPONENT, noise_to_signal  # noqa: E402
from dgs.core.photos.load import Photo, load_photos  # noqa: E402
from dgs.core.photos.undistort import undistorted_views  # noqa: E402
from dgs.core.pipeline.heldout import TruthFolder, ViewScorer, heldout_names  # noqa: E402
from dgs.core.pipeline.views import Viewer  # noqa: E402
from dgs.core.progress import Silent  # noqa: E402
from dgs.core.sfm.find import find_cameras  # noqa: E402
from dgs.core.sfm.known import load_cameras  # noqa: E402
from dgs.core.sfm.reconstruction import Reconstruction  # noqa: E402
from dgs.core.sfm.settings import SfmSettings  # noqa: E402
from dgs.core.training.grid import grid_step  # noqa: E402
from dgs.core.training.run import train  # noqa: E402
from dgs.core.training.scale import scene_scale  # noqa: E402
from dgs.core.training.settings import TrainingSettings  # noqa: E402

RATIOS = ("1e-5", "3e-5", "1e-4", "3e-4", "1e-3", "measured")
VARIATIONS = (0.0, 0.1, 0.3)
#: Cycles/px up to which the low-passed truths know everything.
CUTOFFS = (0.11, 0.125)
EVERY = 8
FITTED = 4


def methods() -> list[str]:
    """All rows, in the order in which they are run."""
    wiener = [f"wiener {ratio} v{variation:g}" for ratio in RATIOS for variation in VARIATIONS]
    return ["plain", "paper", "dgs", "oracle", *wiener]


def deconvolved(photos: list[Photo], medium: Medium, ratio: str) -> list[Photo]:
    """Every photo after Wiener's filter, in 16 bits, masked pixels as they were."""
    assert medium.psf is not None
    rotation = torch.from_numpy(OPPONENT).float()
    table: Any = None
    if ratio == "measured":
        chosen = photos[:: max(1, len(photos) // 12)]
        full = np.iinfo(photos[0].pixels.dtype).max
        measured = noise_to_signal((planes(p).numpy() for p in chosen), medium.psf, 1 / full / 12**0.5)
        table = np.stack([measured.brightness, measured.colour, measured.colour])
    out = []
    for photo in photos:
        if table is None:
            sharp = wiener_photo(planes(photo), medium.psf, float(ratio)).planes
        else:  # brightness and colour apart, as they were measured
            turned = torch.einsum("ij,jhw->ihw", rotation, planes(photo))
            sharp = torch.einsum("ji,jhw->ihw", rotation, wiener_photo(turned, medium.psf, table).planes)
        values = np.round(sharp.clamp(0, 1).numpy().transpose(1, 2, 0) * 65535).astype(np.uint16)
        out.append(replace(photo, pixels=np.ascontiguousarray(values)))
    return out


def planes(photo: Photo) -> torch.Tensor:
    """[3, H, W] float32 sRGB."""
    full = np.float32(np.iinfo(photo.pixels.dtype).max)
    return torch.from_numpy(np.ascontiguousarray(photo.pixels.transpose(2, 0, 1)).astype(np.float32) / full)


def ingredients(
    method: str, photos: list[Photo], truth: TruthFolder, medium: Medium, base: TrainingSettings
) -> tuple[list[Photo], Medium, TrainingSettings]:
    """What a method trains on: photos, the medium it knows of, settings."""
    plain = replace(base, variation_weight=0.0)
    if method == "dgs":
        return photos, medium, base
    if method == "paper":
        return photos, medium, replace(plain, loss="paper")
    if method == "plain":
        return photos, Medium(None), plain
    if method == "oracle":
        return [replace(p, pixels=truth.pixels(p.name)) for p in photos], Medium(None), plain
    _, ratio, variation = method.split()
    return deconvolved(photos, medium, ratio), Medium(None), replace(base, variation_weight=float(variation[1:]))


def one_run(
    method: str, seed: int, photos: list[Photo], truth: TruthFolder, cameras: Reconstruction, medium: Medium,
    settings: TrainingSettings,
) -> dict[str, Any]:  # fmt: skip
    """Trains one twin and scores it; one row."""
    registered = [p for p in photos if p.name in cameras.poses]
    held = [name for name in heldout_names([p.name for p in photos], EVERY) if name in cameras.poses]
    wall, cpu = time.perf_counter(), time.process_time()
    seen, known, chosen = ingredients(method, registered, truth, medium, replace(settings, seed=seed))
    views = [v for v in undistorted_views(seen, cameras) if v.name not in held]
    trained = train(views, [], cameras.points, known, chosen, Silent())
    seconds = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    scale = scene_scale(list(cameras.cameras().values()), cameras.points)
    viewer = Viewer(trained.gaussians, scale, "cpu", trained.low_pass, trained.background)
    scorer = ViewScorer(viewer, cameras, medium, truth, 2.0, Silent())
    by_name = {p.name: p for p in registered}
    fitted = [v.name for v in views][:: max(1, len(views) // FITTED)][:FITTED]
    row: dict[str, Any] = {"method": method, "seed": seed, "seconds": {k: round(v, 1) for k, v in seconds.items()},
                           "gaussians": len(trained.gaussians), "steps": trained.steps}  # fmt: skip
    for kind, names in (("heldout", held), ("fitted", fitted)):
        scores = [scorer.score(by_name[name], kind == "heldout", None)[0] for name in names]
        row[kind] = {name: accuracy_table.mean([(s.sharp or {}).get(name) for s in scores])
                     for name in ("psnr", "ssim", "psnr_inside")}  # fmt: skip
        row[kind]["degraded_psnr"] = accuracy_table.mean([(s.degraded or {}).get("psnr") for s in scores])
    return row


def limits(names: list[str], truth: TruthFolder) -> dict[str, float | None]:
    """PSNR of the truths themselves without what is finer than each cutoff."""
    pictures = [truth.pixels(name) for name in names]
    unit = [p.astype(np.float64) / np.iinfo(p.dtype).max for p in pictures]
    return {f"{c:g}": accuracy_table.mean([low_passed_truth_psnr(u, c) for u in unit]) for c in CUTOFFS}


def found_cameras(folder: Path, photos: list[Photo], medium: Medium, options: argparse.Namespace) -> Reconstruction:
    """Given ones, those found before, or new ones from the blurred photos."""
    if options.cameras is not None:
        return load_cameras(options.cameras, photos)
    kept = HERE / "runs" / f"{folder.name}_cameras"
    if not kept.is_dir():
        assert medium.psf is not None
        work = HERE / "runs" / "work"
        found = find_cameras(photos, medium.psf.kernel(), SfmSettings(threads=options.threads), work, Silent())
        write_lenses(kept, found.lenses, found.poses, found.points)
    return load_cameras(kept, photos)


def run_key(settings: TrainingSettings, options: argparse.Namespace) -> str:
    """Rows of other settings are other rows."""
    facts = [asdict(settings), options.psf, options.photos, str(options.cameras)]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:8]


def run_file(label: str, key: str, method: str, seed: int) -> Path:
    """Where a row is kept."""
    return HERE / "runs" / f"{label}-{key}-{method.replace(' ', '_')}-{seed}.json"


def measure(folder: Path, options: argparse.Namespace) -> None:
    """All rows of one set, and its table."""
    source = next(p for p in (folder / options.photos, folder / "photos", folder / "blur5") if p.is_dir())
    photos = load_photos(source, None, Silent())
    truth, medium = TruthFolder(folder / "sharp"), Medium(parse_psf(options.psf))
    cameras = found_cameras(folder, photos, medium, options)
    step = grid_step(medium, *photos[0].size)
    asked = {"steps": options.steps, "max_gaussians": options.gaussians}
    settings = replace(TrainingSettings(), grid_step=step, **{k: v for k, v in asked.items() if v})
    label = f"{folder.name}_{settings.steps}" if options.steps else folder.name
    key = run_key(settings, options)
    settings = replace(settings, threads=options.threads)
    wanted = [(m, s) for s in range(options.seeds) for m in methods() if not options.only or m in options.only]
    for number, (method, seed) in enumerate(wanted, start=1):
        kept = run_file(label, key, method, seed)
        if kept.is_file():
            continue
        print(f"{folder.name}: run {number} of {len(wanted)}, {method}, seed {seed} ... ", end="", flush=True)
        row = one_run(method, seed, photos, truth, cameras, medium, settings)
        write_json(kept, row)
        print(f"{row['heldout']['psnr']} dB held out, {row['seconds']['wall']} s", flush=True)
    files = [run_file(label, key, method, seed) for method, seed in wanted]
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    held = [n for n in heldout_names([p.name for p in photos], EVERY) if n in cameras.poses]
    facts = {"set": folder.name, "photos": len(photos), "registered": len(cameras.poses), "heldout": held,
             "psf": options.psf, "grid_step": step, "steps": settings.steps, "max_gaussians": settings.max_gaussians,
             "variation_weight": settings.variation_weight,
             "truth_low_passed_psnr": limits(held, truth)}  # fmt: skip
    summary = accuracy_table.summarised(rows, f"wiener measured v{settings.variation_weight:g}")
    write_json(HERE / f"accuracy_{label}.json", {"facts": facts, "methods": summary, "rows": rows})
    text = accuracy_table.markdown(facts, summary)
    (HERE / f"accuracy_{label}.md").write_text(text, encoding="utf-8")
    print(text)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", default=[], metavar="FOLDER")
    parser.add_argument("--photos", default="blur5", help="name of the folder of blurred photos inside FOLDER")
    parser.add_argument("--psf", default="gaussian:5")
    parser.add_argument("--cameras", type=Path, help="known cameras instead of found ones")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, help="instead of the product's own number")
    parser.add_argument("--gaussians", type=int, help="budget instead of the product's own")
    parser.add_argument("--only", action="append", default=[], metavar="METHOD", help="as named in the table")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    compiled.set_threads(options.threads)
    torch.set_num_threads(options.threads)
    (HERE / "runs").mkdir(exist_ok=True)
    try:
        for folder in options.data:
            measure(folder.resolve(), options)
    except DgsError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
