"""Is the expected error of a twin's sharp views as large as the true one? `python -m benchmarks.reliability`.

Photos of scenes of `view_scenes` are taken from viewpoints drawn at random; a twin is trained on most of them, the rest
is held out and measures the parts of the expected error (`core/uncertainty/expected_error.py`), through the blur. Then
the px of 16 sharp views from elsewhere are sorted by what is expected, and each tenth's expected and true rms error
compared.
Rows go to runs/reliability.jsonl; `--picture FILE` draws the curves.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from dgs.core import compiled
from dgs.core.uncertainty.detail import Detail
from dgs.core.uncertainty.expected_error import PARTS, ExpectedError, ExpectedErrorSettings
from dgs.core.uncertainty.information_gain import opened, spread
from dgs.core.uncertainty.linear_model import Viewpoint
from dgs.core.uncertainty.posterior import sample_posterior

from .next_view import linear_model
from .view_scenes import BOARD, SCENES, Case

ALL = {**SCENES, "board": BOARD}
#: Photos trained on, and held out besides.
PHOTOS = {6: 2, 12: 2, 20: 4}


def tenths(expected: torch.Tensor, true: torch.Tensor) -> list[list[float]]:
    """Expected and true rms (8-bit steps) in tenths of the px by the expected variance."""
    groups = np.array_split(np.argsort(expected.numpy()), 10)
    return [[255 * float(expected[g].mean().sqrt()), 255 * float(true[g].mean().sqrt())] for g in groups]


def measure(case: Case, count: int, keep: dict[str, torch.Tensor] | None = None) -> dict[str, Any]:
    """One training: curves of the whole prediction, of the usual weights alone, and of the colours alone.

    Args:
        keep: takes the parts' variances and the true squared errors, for choosing the usual weights.
    """
    order = [int(i) for i in np.random.default_rng([case.seed, 7]).permutation(len(case.cameras))]
    taken, held = order[:count], order[count : count + PHOTOS[count]]
    trainer = case.train(taken)
    linear, viewpoints, noise = linear_model(trainer, taken, case, True)
    tests = [Viewpoint(trainer.scale.camera_to_unit(c), None) for c in case.tests]
    seen = [viewpoints[i] for i in taken]
    posterior = sample_posterior(linear, seen, noise, 6, 8, case.seed)
    variance = float(torch.stack([case.planes(i).var(dim=(1, 2)).mean() for i in taken]).mean())
    model = ExpectedError(Detail(linear, noise, tests, seen), posterior, seen, variance)
    model.fit([(viewpoints[i], case.planes(i)) for i in held])
    m, parts, true, alone = linear.margin, [], [], []
    for viewpoint, camera, truth in zip(tests, case.tests, case.sharp, strict=True):
        parts.append(model.shapes(viewpoint).sharp.flatten(1))
        true.append((case.view(trainer, camera) - truth).square().mean(dim=0).flatten())
        own = spread(linear, opened(linear, posterior, seen, viewpoint), viewpoint)[1]
        alone.append(own[:, m : own.shape[1] - m, m : own.shape[2] - m].mean(dim=0).flatten())
    shapes, errors = torch.cat(parts, dim=1), torch.cat(true)
    if keep is not None:
        keep.update(shapes=shapes, errors=errors)
    weights = {"expected": model.weights, "usual weights": torch.tensor(ExpectedErrorSettings().usual_weights)}
    curves = {name: tenths((w[:, None] * shapes).sum(dim=0), errors) for name, w in weights.items()}
    curves["colours only"] = tenths(torch.cat(alone), errors)
    return {"psnr": case.accuracy(trainer), "weights": dict(zip(PARTS, model.weights.tolist(), strict=True)), **curves}


def main() -> None:
    """Runs what is missing, prints the table, draws the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=list(ALL), choices=list(ALL))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(5)))
    parser.add_argument("--photos", type=int, nargs="+", default=list(PHOTOS), choices=list(PHOTOS))
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "runs" / "reliability.jsonl")
    options = parser.parse_args()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    for name in options.scenes:
        for seed in options.seeds:
            case = None
            for count in options.photos:
                key = {"scene": name, "seed": seed, "photos": count, "steps": options.steps}
                if any(all(row[k] == v for k, v in key.items()) for row in rows):
                    continue
                case = case or Case(ALL[name], seed, options.steps)
                rows.append({**key, **measure(case, count)})
                with options.out.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
                print(name, seed, count, " ".join(f"{p:.0f}->{t:.0f}" for p, t in rows[-1]["expected"]), flush=True)
    rows = [r for r in rows if r["seed"] in options.seeds and r["scene"] in options.scenes]
    report(rows)
    if options.picture:
        draw(rows, options.picture)


def off(curve: list[list[float]]) -> float:
    """Largest factor between expected and true of any tenth."""
    ratios = np.array([p / t for p, t in curve])
    return float(np.maximum(ratios, 1 / ratios).max())


def report(rows: list[dict[str, Any]]) -> None:
    """Tables of the mean curves."""
    for way in ("expected", "usual weights", "colours only"):
        print(f"\n{way}: expected -> true rms error of sharp px, 8-bit steps, tenths by expected error\n")
        print(
            "| scene | photos | tenths, mean over seeds | most off | calibration error | "
            "single trainings within 1.5 in all tenths | most off of any |"
        )
        print("|---|---|---|---|---|---|---|")
        for name in dict.fromkeys(r["scene"] for r in rows):
            for count in sorted({r["photos"] for r in rows}):
                curves = [r[way] for r in rows if r["scene"] == name and r["photos"] == count]
                if not curves:
                    continue
                mean = [[float(p), float(t)] for p, t in np.mean(curves, axis=0)]
                error = float(np.mean([abs(p - t) for p, t in mean]))
                worst = [off(curve) for curve in curves]
                print(
                    f"| {name} | {count} | {', '.join(f'{p:.0f} → {t:.0f}' for p, t in mean)} | {off(mean):.2f} | "
                    f"{error:.1f} | {sum(w <= 1.5 for w in worst)} of {len(worst)} | {max(worst):.2f} |"
                )


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Reliability curves: one panel per scene, one line per number of photos."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(r["scene"] for r in rows))
    figure, axes = plt.subplots(1, len(names), figsize=(2.5 * len(names), 2.9), sharex=True, sharey=True)
    for axis, name in zip(np.atleast_1d(axes), names, strict=True):
        line = np.array([1.5, 60.0])
        axis.plot(line, line, color="0.4", linewidth=0.8)
        axis.fill_between(line, line / 1.5, line * 1.5, color="0.92")
        for count, colour in zip(sorted({r["photos"] for r in rows}), ("#c0392b", "#2c6fbb", "#2e8b57"), strict=False):
            curves = np.array([r["expected"] for r in rows if r["scene"] == name and r["photos"] == count])
            for curve in curves:
                axis.plot(*curve.T, color=colour, linewidth=0.5, alpha=0.4)
            axis.plot(*curves.mean(axis=0).T, color=colour, marker=".", markersize=4, label=f"{count} photos")
        old = np.mean([r["colours only"] for r in rows if r["scene"] == name], axis=0)
        axis.plot(*old.T, color="0.3", linestyle=":", label="colours only (before)")
        axis.set(xscale="log", yscale="log", title=name, xlabel="expected")
        ticks = [2, 5, 10, 20, 50]
        axis.set_xticks(ticks, [str(t) for t in ticks])
        axis.set_yticks(ticks, [str(t) for t in ticks])
        axis.minorticks_off()
    np.atleast_1d(axes)[0].set_ylabel("true rms error, 8-bit steps")
    np.atleast_1d(axes)[-1].legend(fontsize=6, frameon=False)
    figure.tight_layout()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
