"""What new photos say has changed: the medium (everywhere alike) or the object (somewhere).

The medium is asked first: the width of a Gaussian blur, shared by the new photos, that explains them best
with the twin as it is. A median over px asks most of the frame, so that a part that moved has no say. What then
remains, averaged over what the blur ties together and measured in its own spread, is a change of the object where
it is far beyond chance, and where old photos have seen the object: elsewhere the twin only guessed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import binary_dilation, binary_opening, gaussian_filter
from torch import Tensor

from ..constants import SH_C0
from ..forward import sharp_view
from ..gaussians import Gaussians
from ..imaging.medium import Medium
from ..imaging.psf import PointSpread
from ..rasterizer import RasterSettings, with_gradient
from ..training.grid import GridView, coarse_camera
from .opened import OpenedTwin
from .surface import surface_depth

#: Widths of the blur that are tried, relative to the twin's.
WIDTHS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.75)
#: Another width is believed if it lowers the residual by this share.
LEAST_GAIN = 0.1
#: A px has changed where the smoothed residual is so many times its robust spread, and at least so large (sRGB).
MINIMUM_RATIO, MINIMUM_CHANGE = 6.0, 0.03
#: An old photo saw a place if its own view of the twin lies as deep there within this share, and not in the outermost
#: share of its frame.
SAME_DEPTH, BORDER = 0.1, 0.02
#: What was seen is decided on a grid coarser by this factor: every old photo's depth has to be rendered.
COARSE = 2
#: Old photos that are asked, the nearest first.
NEAREST = 16
#: A splat has changed if so much of what the new photos see of it lies in changed px.
SHARE = 0.5


@dataclass(frozen=True)
class Changes:
    """What has changed.

    Attributes:
        width: of the new photos' blur over the twin's; 1 where nothing speaks against it.
        gain: share by which that width lowers the median squared residual.
        changed: [H, W] bool on the grid by new photo's name: the object looks different there.
        residuals: [H, W] float32 by name: photo less twin through the blur, mean over channels, sRGB.
        unseen: [H, W] bool by name: it looks changed, but no old photo saw that part of the object.
        splats: [N] bool, Gaussians that show what has changed.
    """

    width: float
    gain: float
    changed: dict[str, np.ndarray]
    residuals: dict[str, np.ndarray]
    unseen: dict[str, np.ndarray]
    splats: Tensor

    @property
    def share(self) -> float:
        """Share of the new photos' px that changed."""
        return float(np.mean([c.mean() for c in self.changed.values()])) if self.changed else 0.0

    @property
    def unseen_share(self) -> float:
        """Share of the new photos' px that show what the twin only guessed, and guessed wrong."""
        return float(np.mean([u.mean() for u in self.unseen.values()])) if self.unseen else 0.0


def wider(psf: PointSpread, factor: float) -> PointSpread:
    """The Gaussian point spread with its width times `factor`."""
    x, y = psf.sigma_x * factor, psf.sigma_y * factor
    return replace(psf, sigma_x=x, sigma_y=y, source=f"gaussian:{x:.6g},{y:.6g},{psf.angle:.6g}")


def find_changes(twin: OpenedTwin, views: Sequence[GridView], medium: Medium) -> Changes:
    """Compares new photos on the twin's grid with what the twin shows through the blur."""
    step, model = twin.step, replace(twin, medium=medium).model(max(1, math.ceil(WIDTHS[-1] * twin.margin(twin.step))))
    gaussians, settings = twin.scale.to_unit(twin.gaussians), twin.raster_settings()
    with torch.no_grad():
        exposed = {view.name: model.expose(gaussians, view, twin.background) for view in views}

    def residual(view: GridView, factor: float) -> Tensor:
        seen = exposed[view.name]
        if view.psf is not None and factor != 1.0:
            spread = medium.psf_for(view.name)
            assert spread is not None
            seen = replace(seen, medium=model.medium(view.blurred_by(wider(spread, factor).on_grid(step))))
        out = seen.residual(torch.from_numpy(view.planes()))
        return out if view.valid is None else torch.where(torch.from_numpy(view.valid), out, 0.0)

    width, gain = _width(views, residual)
    changed, residuals = {}, {}
    ties = max(1.0, twin.margin(step) / 3.0)
    for view in views:
        rest = residual(view, width)
        residuals[view.name] = rest.mean(dim=0).numpy()
        smooth = np.stack([gaussian_filter(plane.numpy(), ties) for plane in rest])
        size = np.sqrt((smooth**2).mean(axis=0))
        spread = float(np.median(size)) + 1e-6
        found = (size > MINIMUM_RATIO * spread) & (size > MINIMUM_CHANGE)
        changed[view.name] = binary_dilation(binary_opening(found, iterations=1), iterations=round(2 * ties))
    unseen = {view.name: np.zeros_like(changed[view.name]) for view in views}
    if any(found.any() for found in changed.values()):
        unseen = _unseen(gaussians, views, changed, twin.on_grid(twin.kept or twin.views, step), settings)
        # Slivers along the border of what was seen are no changes.
        slim = max(1, round(ties))
        changed = {name: binary_opening(found & ~unseen[name], iterations=slim) for name, found in changed.items()}
    return Changes(width, gain, changed, residuals, unseen, _splats(gaussians, views, changed, settings))


def _unseen(
    gaussians: Gaussians,
    views: Sequence[GridView],
    found: dict[str, np.ndarray],
    old: Sequence[GridView],
    settings: RasterSettings,
) -> dict[str, np.ndarray]:
    """[H, W] bool by name: of what looks changed, where the twin has no surface, or one that was in no old photo."""
    coarse = replace(settings, low_pass=settings.low_pass / COARSE**2)
    others = [coarse_camera(view.camera, COARSE) for view in old]
    depths: dict[int, np.ndarray] = {}
    out = {}
    for view in views:
        camera, whole = coarse_camera(view.camera, COARSE), found[view.name]
        asked = whole[: camera.height * COARSE : COARSE, : camera.width * COARSE : COARSE]
        row, column = np.nonzero(asked)
        z = surface_depth(gaussians, camera, coarse)[row, column] if len(row) else np.zeros(0)
        local = np.stack([(column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy, np.ones_like(z)])
        points = ((local * z).T - camera.translation) @ camera.rotation
        seen = np.zeros(len(row), bool)
        for index in np.argsort([np.linalg.norm(c.centre - camera.centre) for c in others])[:NEAREST]:
            if seen[np.isfinite(points[:, 0])].all():
                break
            c = others[index]
            at, z = c.projected(points)
            x, y = at.T
            edge = BORDER * min(c.width, c.height)
            inside = (x > edge) & (y > edge) & (x < c.width - edge) & (y < c.height - edge)  # (NaN is not)
            if not (inside & ~seen).any():
                continue
            if index not in depths:
                depths[index] = surface_depth(gaussians, c, coarse)
            there = depths[index][np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int)]
            seen |= inside & (np.abs(there / np.where(inside, z, 1.0) - 1.0) < SAME_DEPTH)
        known = np.zeros(asked.shape, bool)
        known[row, column] = seen
        unseen = asked & ~binary_opening(known, iterations=1)
        fine = unseen.repeat(COARSE, axis=0).repeat(COARSE, axis=1)
        rest = [(0, n - m) for n, m in zip(whole.shape, fine.shape, strict=True)]
        out[view.name] = np.pad(fine, rest, mode="edge") & whole
    return out


def _width(views: Sequence[GridView], residual) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    if any(view.psf is None or view.psf.samples is not None for view in views):
        return 1.0, 0.0
    medians = {
        factor: float(np.mean([float(residual(view, factor).square().mean(dim=0).median()) for view in views]))
        for factor in WIDTHS
    }
    best = min(medians, key=lambda factor: medians[factor])
    gain = 1.0 - medians[best] / max(medians[1.0], 1e-12)
    return (best, gain) if gain > LEAST_GAIN else (1.0, 0.0)


def _splats(
    gaussians: Gaussians, views: Sequence[GridView], changed: dict[str, np.ndarray], settings: RasterSettings
) -> Tensor:
    """[N] bool: which splats are seen mostly in changed px (their blending weights, summed)."""
    inside, everywhere = torch.zeros(len(gaussians)), torch.zeros(len(gaussians))
    for view in views:
        mask = torch.from_numpy(changed[view.name])
        if not bool(mask.any()):
            continue
        # (a colour's gradient is its blending weight where harmonics are not cut at black)
        bright = torch.zeros_like(gaussians.sh).requires_grad_()
        image = sharp_view(replace(gaussians, sh=bright), view.camera, settings).image
        seen = mask.expand(3, -1, -1).float().contiguous()
        (inner,) = torch.autograd.grad(with_gradient(image, seen), bright, retain_graph=True)
        (whole,) = torch.autograd.grad(with_gradient(image, torch.ones_like(image)), bright)
        inside += inner[:, 0].mean(dim=1) / SH_C0
        everywhere += whole[:, 0].mean(dim=1) / SH_C0
    return (inside > SHARE * everywhere) & (everywhere > 0.5)


def shows_changed(twin: OpenedTwin, splats: Tensor, views: Sequence[GridView]) -> dict[str, np.ndarray]:
    """[H, W] bool by name: where old photos show what has changed since, as far as the twin can tell."""
    if not bool(splats.any()):
        return {}
    gaussians = twin.scale.to_unit(twin.gaussians)
    settings = twin.raster_settings()
    sh = torch.zeros_like(gaussians.sh)
    sh[:, 0] = torch.where(splats[:, None], 0.5 / SH_C0, -0.5 / SH_C0)
    reach = max(1, round(twin.margin(twin.step) * 2 / 3))
    out = {}
    with torch.no_grad():
        for view in views:
            share = sharp_view(replace(gaussians, sh=sh), view.camera, settings).image[0].numpy()
            out[view.name] = binary_dilation(share > 0.3, iterations=reach)
    return out
