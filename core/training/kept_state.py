"""What is kept of a run, so that another can go on with it, and what is said of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from ..gaussians import Gaussians
from .checkpoint import Checkpoint
from .density.control import DensityControl
from .optimizer import Adam
from .origin import origin
from .scene import TrainedScene

#: What the projection culls because it has to; what is merely not seen (outside, transparent) is no repair.
_CULLED = {
    "non_finite": "non-finite parameters (Gaussian-views)",
    "degenerate": "without a shape, too bright or too far (Gaussian-views)",
    "behind": "behind the camera (Gaussian-views)",
}


def counts_of(scene: TrainedScene) -> dict[str, int]:
    """What was added, removed, refused and repaired so far."""
    names = {f"refused, non-finite gradient of {n}": c for n, c in scene.optimizer.refused.items()}
    refused = {"refused, non-finite gradients": sum(names.values()), **names}
    adjusted = {"cameras adjusted": scene.asked["adjusted"]} if scene.cameras_moved else {}
    culled = {f"culled, {_CULLED[reason]}": scene.culled.get(reason, 0) for reason in _CULLED}
    always = {"dropped, non-finite Gaussians": 0, "clamped scales, most at once": 0, **scene.repairs}
    return {**scene.density.counts, "unneeded": scene.asked["unneeded"], **adjusted, **refused, **always, **culled}


def fingerprint_of(scene: TrainedScene) -> dict[str, Any]:
    """What a checkpoint must share with this run to be continued by it."""
    settings = asdict(scene.settings)
    for free in ("threads", "time_limit", "device", "steps", "until", "min_steps"):
        settings.pop(free)
    psf, plain = scene.medium.psf, scene.known_background
    if scene.origin is None:
        scene.origin = origin(scene.views, scene.heldout, scene.points)
    return {
        "settings": settings,
        "photos": [v.name for v in scene.views],
        **scene.origin,
        "point spread": None if psf is None else np.round(psf.kernel(), 9).sum(axis=0).tolist(),
        "blur space": scene.medium.blur_space,
        **({"own point spreads": _own_spreads(scene)} if scene.medium.per_view else {}),
        **({} if plain is None else {"background": [*plain.colour, plain.space]}),
        **({"effects": {e.name: e.described() for e in scene.begun.effects}} if scene.begun else {}),
    }


def _own_spreads(scene: TrainedScene) -> dict[str, str]:
    """A digest of each kernel that a photo has of its own."""
    return {
        name: "none" if psf is None else hashlib.sha256(np.round(psf.kernel(), 9).tobytes()).hexdigest()[:16]
        for name, psf in sorted(scene.medium.per_view.items())
    }


def checkpoint_of(scene: TrainedScene, seconds: float, history: list[dict[str, float]]) -> Checkpoint:
    """Everything that is needed to go on."""
    o, d = scene.optimizer, scene.density
    arrays = {**_arrays(scene), **scene.learned.state()}
    counters = {
        "steps": o.steps,
        **{f"density.{k}": v for k, v in d.counts.items()},
        **{f"refused.{k}": v for k, v in o.refused.items()},
        **{f"asked.{k}": v for k, v in scene.asked.items()},
        **{f"culled.{k}": v for k, v in scene.culled.items()},
        **{f"repair.{k}": v for k, v in scene.repairs.items()},
    }
    return Checkpoint(arrays, fingerprint_of(scene), scene.step, seconds, history, counters)


def _arrays(scene: TrainedScene) -> dict[str, np.ndarray]:
    """Parameters, their moments and the density statistics, by name."""
    o, d = scene.optimizer, scene.density
    arrays = {"pull": d.gradients.cpu().numpy(), "views": d.views.cpu().numpy()}
    for name, tensor in () if scene.restored_around is None else scene.restored_around.named():
        arrays[f"around.{name}"] = tensor.cpu().numpy()
    for name, tensor in o.gaussians.named():
        arrays[f"value.{name}"] = tensor.detach().cpu().numpy()
        arrays[f"first.{name}"] = o.first[name].cpu().numpy()
        arrays[f"second.{name}"] = o.second[name].cpu().numpy()
    return arrays


def _take(scene: TrainedScene, arrays: Mapping[str, np.ndarray]) -> None:
    """Goes on with what `_arrays` gave; counts stay."""
    take = lambda name: torch.from_numpy(arrays[name].copy()).to(scene.device)  # noqa: E731
    before, names = scene.optimizer, [name for name, _ in scene.optimizer.gaussians.named()]
    scene.optimizer = Adam(Gaussians(**{name: take(f"value.{name}") for name in names}))
    for name in names:
        scene.optimizer.first[name], scene.optimizer.second[name] = take(f"first.{name}"), take(f"second.{name}")
    scene.optimizer.steps, scene.optimizer.refused = before.steps, before.refused
    if f"around.{names[0]}" in arrays:
        scene.restored_around = Gaussians(**{name: take(f"around.{name}") for name in names})
    counts = scene.density.counts
    scene.density = DensityControl(len(scene.optimizer.gaussians), scene.device)
    scene.density.gradients, scene.density.views, scene.density.counts = take("pull"), take("views"), counts


def restore(scene: TrainedScene, checkpoint: Checkpoint) -> None:
    """Goes on from `checkpoint`, exactly."""
    _take(scene, checkpoint.arrays)
    group = lambda p: {k[len(p) :]: v for k, v in checkpoint.counters.items() if k.startswith(p)}  # noqa: E731
    scene.optimizer.steps = checkpoint.counters["steps"]
    scene.optimizer.refused, scene.repairs, scene.culled = group("refused."), group("repair."), group("culled.")
    scene.asked = {**scene.asked, **group("asked.")}
    scene.density.counts = group("density.")
    scene.step = checkpoint.step
    scene.learned.restore(checkpoint.arrays)


def follow_first(scene: TrainedScene) -> None:
    """Goes on with rank 0's Gaussians: where processors differ, so do last digits, and they add up."""
    if scene.ranks.alone:
        return
    arrays = {name: array for name, array in _arrays(scene).items() if array.dtype == np.float32}
    _take(scene, scene.ranks.arrays_of_first(arrays))
